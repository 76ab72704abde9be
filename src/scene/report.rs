//! What an import has repaired, guessed and dropped.

use std::collections::BTreeMap;
use std::fmt;

use serde::Serialize;

use super::anchor::Anchor;

/// The format that a scene was read from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    GeoJson,
    CityJson,
    CityJsonSeq,
    Gltf,
    Obj,
    OsmPbf,
    Ply,
    Stl,
    GeoTiff,
    PointCloud,
}

impl Format {
    /// As people call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::GeoJson => "GeoJSON",
            Self::CityJson => "CityJSON",
            Self::CityJsonSeq => "CityJSON sequence",
            Self::Gltf => "glTF",
            Self::Obj => "OBJ",
            Self::OsmPbf => "OpenStreetMap PBF",
            Self::Ply => "PLY",
            Self::Stl => "STL",
            Self::GeoTiff => "GeoTIFF",
            Self::PointCloud => "point cloud",
        }
    }
}

/// Everything that was not taken from the file as it stands.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImportReport {
    pub format: Format,
    /// Structures and no-fly zones of the scene.
    pub structures: usize,
    pub zones: usize,
    /// Size of the box around the structures, east and north, m.
    pub extent_m: [f64; 2],
    pub tallest_m: f64,
    /// EPSG code of the file's coordinates, where it names one.
    pub epsg: Option<u32>,
    /// Where the local origin lies in the file; `None` where nothing is placed.
    #[serde(skip)]
    pub anchor: Option<Anchor>,
    /// Remarks on the file as a whole.
    pub notes: Vec<String>,
    /// Objects that are no structures (roads, water, ...), by type.
    pub ignored: BTreeMap<String, usize>,
    /// Pairs of structures whose solids overlap. Both stay: a point is inside the scene when it is inside any structure, so
    /// the higher one decides.
    pub overlapping_pairs: usize,
    /// The first of these pairs, by name.
    pub first_overlaps: Vec<[String; 2]>,
    /// How many items there are of each kind.
    pub counts: BTreeMap<ItemKind, usize>,
    /// The items, in the order of the file; of a kind with very many only the first 2000.
    pub items: Vec<ReportItem>,
}

/// One repair, guess or omission.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReportItem {
    /// Name of the structure as in the scene, or the name that it would have had.
    pub structure: String,
    pub place: Place,
    pub kind: ItemKind,
    /// What was found and what was done, in words.
    pub done: String,
}

/// Where in the file an item lies.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Place {
    /// Index into the features of a GeoJSON file, from 0.
    Feature(usize),
    /// Key of a CityJSON object, name of a node of glTF, or way and number of OpenStreetMap.
    Object(String),
    /// Line of an OBJ file, from 1.
    Line(usize),
    /// Face of a PLY or STL file, from 0.
    Face(usize),
}

/// The kinds of items.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ItemKind {
    /// Vertices that repeat their predecessor.
    DuplicateVertices,
    /// A ring whose last vertex is not its first.
    OpenRing,
    /// A ring that runs the wrong way round.
    WrongWinding,
    /// A ring that crosses itself or its hole.
    SelfIntersection,
    /// A ring that does not cross itself, but whose corners seem to be in the wrong order.
    SuspectOrder,
    /// Edges that run out and back.
    Spike,
    /// A hole that takes nothing or everything from its polygon.
    HoleDropped,
    /// Parts of a MultiPolygon that overlap or touch.
    PartsUnited,
    /// Heights in the third coordinate of a footprint.
    ElevationIgnored,
    /// Only some parts of a geometry could be used.
    PartsDropped,
    /// A height that had to be read from text with a unit or a decimal comma.
    HeightText,
    /// A height that is not in the file.
    HeightGuessed,
    /// A building without a height that is left out.
    HeightMissing,
    /// An outline around parts of a building.
    OutlineReplaced,
    /// Something so small that it is left out.
    TooSmall,
    /// Height and number of storeys do not fit each other.
    HeightDisagreement,
    /// A lower end above the upper end, or below the ground.
    BaseIgnored,
    /// Latitude and longitude exchanged in one feature.
    SwappedCoordinates,
    /// Too far from everything else.
    Outlier,
    /// The same structure twice.
    DuplicateDropped,
    /// Two structures of one name.
    Renamed,
    /// A feature without usable geometry.
    NoGeometry,
    /// Faces without area, or of fewer than three vertices.
    DegenerateFaces,
    /// Walls that the file leaves out, as between terraced houses.
    WallsClosed,
    /// Faces turned outwards.
    FacesTurned,
}

/// What an item means for a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// The structure is as the file means it.
    Repaired,
    /// The structure may be taller than it is taken to be.
    Guessed,
    /// What stands there is not known of, and no flight avoids it.
    Dropped,
}

impl ItemKind {
    pub fn meaning(self) -> Meaning {
        match self {
            Self::HeightGuessed | Self::HeightDisagreement => Meaning::Guessed,
            Self::NoGeometry | Self::Outlier | Self::PartsDropped | Self::HeightMissing | Self::TooSmall => Meaning::Dropped,
            _ => Meaning::Repaired,
        }
    }
}

const FIRST_OVERLAPS: usize = 10;

/// Items that are kept of a kind, so that a file of faults does not fill the memory; enough for real scenes of guessed heights.
const MOST_ITEMS: usize = 2000;

/// Types of ignored objects that are told apart.
const MOST_TYPES: usize = 100;

impl ImportReport {
    pub(crate) fn new(format: Format) -> Self {
        Self {
            format,
            structures: 0,
            zones: 0,
            extent_m: [0.0; 2],
            tallest_m: 0.0,
            epsg: None,
            anchor: None,
            notes: Vec::new(),
            ignored: BTreeMap::new(),
            overlapping_pairs: 0,
            first_overlaps: Vec::new(),
            counts: BTreeMap::new(),
            items: Vec::new(),
        }
    }

    pub(crate) fn add(&mut self, structure: &str, place: Place, kind: ItemKind, done: impl Into<String>) {
        let count = self.counts.entry(kind).or_default();
        *count += 1;
        if *count <= MOST_ITEMS {
            self.items.push(ReportItem { structure: structure.to_owned(), place, kind, done: done.into() });
        }
    }

    /// Counts what is too many and too little to be told one by one.
    pub(crate) fn count_up(&mut self, kind: ItemKind, count: usize) {
        if count > 0 {
            *self.counts.entry(kind).or_default() += count;
        }
    }

    pub(crate) fn ignore(&mut self, kind: String) {
        let told = self.ignored.len() < MOST_TYPES || self.ignored.contains_key(&kind);
        *self.ignored.entry(if told { kind } else { "of further types".into() }).or_default() += 1;
    }

    pub(crate) fn add_overlap(&mut self, first: &str, second: &str) {
        self.overlapping_pairs += 1;
        if self.first_overlaps.len() < FIRST_OVERLAPS {
            self.first_overlaps.push([first.to_owned(), second.to_owned()]);
        }
    }

    /// The first item, for the message when nothing is left.
    pub(crate) fn first_item(&self) -> String {
        self.items.first().map_or(String::new(), |item| format!(" (the first, {item})"))
    }

    /// How many items there are of one kind.
    pub fn count(&self, kind: ItemKind) -> usize {
        self.counts.get(&kind).copied().unwrap_or(0)
    }

    /// A few lines for a person.
    pub fn summary(&self) -> String {
        let mut lines = vec![format!(
            "{} structures, {} no-fly zones, {:.0} x {:.0} m, tallest {:.1} m",
            self.structures, self.zones, self.extent_m[0], self.extent_m[1], self.tallest_m
        )];
        if !self.counts.is_empty() {
            let counts: Vec<_> = self.counts.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
            lines.push(format!("repaired, guessed or dropped: {}", counts.join(", ")));
        }
        if self.overlapping_pairs > 0 {
            lines.push(format!("{} pairs of structures overlap; the higher one counts", self.overlapping_pairs));
        }
        if !self.ignored.is_empty() {
            let ignored: Vec<_> = self.ignored.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
            lines.push(format!("no structures, left out: {}", ignored.join(", ")));
        }
        lines.extend(self.notes.iter().cloned());
        lines.join("\n")
    }
}

impl fmt::Display for ItemKind {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::DuplicateVertices => "with duplicate vertices",
            Self::OpenRing => "with an open ring",
            Self::WrongWinding => "wound the wrong way",
            Self::SelfIntersection => "with crossing rings",
            Self::SuspectOrder => "with corners in a suspect order",
            Self::Spike => "with a spike",
            Self::HoleDropped => "with a wrong hole",
            Self::PartsUnited => "with overlapping parts",
            Self::ElevationIgnored => "with elevations in the footprint",
            Self::PartsDropped => "with unusable parts",
            Self::HeightText => "with a height in words",
            Self::HeightGuessed => "with a guessed height",
            Self::HeightMissing => "without a height",
            Self::TooSmall => "too small",
            Self::OutlineReplaced => "with parts in place of their outline",
            Self::HeightDisagreement => "whose height and storeys disagree",
            Self::BaseIgnored => "with a wrong lower end",
            Self::SwappedCoordinates => "with latitude and longitude exchanged",
            Self::Outlier => "far outside",
            Self::DuplicateDropped => "given twice",
            Self::Renamed => "renamed",
            Self::NoGeometry => "without usable geometry",
            Self::DegenerateFaces => "with degenerate faces",
            Self::WallsClosed => "with missing walls filled in",
            Self::FacesTurned => "with faces turned outwards",
        })
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Feature(index) => write!(f, "feature {index}"),
            Self::Object(key) => write!(f, "object {key:?}"),
            Self::Line(line) => write!(f, "line {line}"),
            Self::Face(face) => write!(f, "face {face}"),
        }
    }
}

impl fmt::Display for ReportItem {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{} ({}): {}", self.structure, self.place, self.done)
    }
}
