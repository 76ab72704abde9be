//! Small rasters and clouds made here, whole, wrong and hostile.

use std::io::Cursor;

use ::tiff::encoder::colortype::{ColorType, Gray16, Gray32Float, GrayI16, RGB8};
use ::tiff::encoder::{Compression, DeflateLevel, TiffEncoder, TiffValue};
use ::tiff::tags::Tag;
use proptest::prelude::*;

use self::scene_files::{las, layered, points};
use super::*;
use crate::scene::{Shape, TERRAIN_NAME, Terrain, read, read_anchored, read_over_ground};
use crate::settings::Settings;
use crate::stop::{Counted, Part, StopToken};

#[path = "../../../tests/scene_files/las.rs"]
mod scene_files;

/// What a raster says of itself.
#[derive(Clone)]
struct Made {
    size: [u32; 2],
    cell: f64,
    keys: Vec<u16>,
    is_placed: bool,
}

const UTM: [u16; 16] = [1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 25830];

impl Made {
    fn new(side: u32, cell: f64) -> Self {
        Self { size: [side; 2], cell, keys: UTM.to_vec(), is_placed: true }
    }

    fn tiff<C: ColorType>(&self, compression: Compression, values: &[C::Inner]) -> Vec<u8>
    where
        [C::Inner]: TiffValue,
    {
        let mut bytes = Vec::new();
        let mut encoder = TiffEncoder::new(Cursor::new(&mut bytes)).unwrap().with_compression(compression);
        let mut image = encoder.new_image::<C>(self.size[0], self.size[1]).unwrap();
        let tags = image.encoder();
        if self.is_placed {
            tags.write_tag(Tag::ModelPixelScaleTag, &[self.cell, self.cell, 0.0][..]).unwrap();
            tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, 499_400.0, 4_797_200.0, 0.0][..]).unwrap();
        }
        tags.write_tag(Tag::GeoKeyDirectoryTag, &self.keys[..]).unwrap();
        tags.write_tag(Tag::GdalNodata, "-9999").unwrap();
        image.write_data(values).unwrap();
        bytes
    }

    fn heights(&self, height: impl Fn(u32, u32) -> f32) -> Vec<u8> {
        let values: Vec<f32> = (0..self.size[0] * self.size[1]).map(|k| height(k % self.size[0], k / self.size[0])).collect();
        self.tiff::<Gray32Float>(Compression::Deflate(DeflateLevel::Fast), &values)
    }
}

/// A slope that rises from 10 m in the west by 10 cm a cell.
fn slope(column: u32, _row: u32) -> f32 {
    10.0 + 0.1 * column as f32
}

/// Two houses on it, 30 x 20 and 20 x 20 cells, 9 and 6 m high, wall to wall.
fn houses(column: u32, row: u32) -> f32 {
    let height = match (column, row) {
        (30..60, 40..60) => 9.0,
        (60..80, 40..60) => 6.0,
        _ => 0.0,
    };
    slope(column, row) + height
}

fn ground_file(bytes: &[u8]) -> GroundFile<'_> {
    GroundFile { file_name: "town_dtm.tif", bytes, is_found: false }
}

fn over(surface: &[u8], ground: &[u8]) -> Result<(Scene, ImportReport), ImportError> {
    read_over_ground("town_dsm.tif", surface, &ground_file(ground), &Settings::default().proxy, None)
}

fn alone(bytes: &[u8]) -> Result<(Scene, ImportReport), ImportError> {
    read("town_dsm.tif", bytes, &Settings::default().proxy)
}

fn terrain(scene: &Scene) -> &Terrain {
    scene.structures.iter().find_map(|structure| structure.terrain()).expect("it has a terrain")
}

/// Name, lower and upper end and area of each prism and obstacle.
fn prisms(scene: &Scene) -> Vec<(String, f64, f64, f64)> {
    use geo::Area;
    let mut prisms: Vec<_> = scene
        .structures
        .iter()
        .filter(|structure| structure.name != TERRAIN_NAME)
        .map(|structure| {
            let bounds = structure.bounds();
            (structure.name.clone(), bounds.min.z, bounds.max.z, structure.outlines().unsigned_area())
        })
        .collect();
    prisms.sort_by(|a, b| a.0.cmp(&b.0));
    prisms
}

fn message(read: Result<(Scene, ImportReport), ImportError>) -> String {
    match read {
        Ok((_, report)) => panic!("it was read: {}", report.summary()),
        Err(error) => error.to_string(),
    }
}

#[test]
fn two_houses_on_a_slope_become_two_prisms_on_a_terrain() {
    let made = Made::new(120, 1.0);
    let (scene, report) = over(&made.heights(houses), &made.heights(slope)).unwrap();
    let prisms = prisms(&scene);
    let names: Vec<&str> = prisms.iter().map(|prism| prism.0.as_str()).collect();
    assert_eq!(names, ["roof-001", "roof-002"]);
    for ((_, base_m, top_m, area_m2), (height_m, east, area)) in prisms.iter().zip([(9.0, 60.0, 600.0), (6.0, 80.0, 400.0)]) {
        // The lowest terrain is 10 m up, the highest corner of a roof at its eastern end.
        let highest_m = f64::from(slope(east as u32, 0)) - 10.0 + height_m;
        assert!((top_m - highest_m).abs() < 0.5, "{top_m} against {highest_m}");
        assert!((area_m2 / area - 1.0).abs() < 0.02, "{area_m2} against {area}");
        assert!(*base_m < 6.0, "it stands in the ground: {base_m}");
    }
    let terrain = terrain(&scene);
    for (x, y) in [(-50.0, 10.0), (0.0, 0.0), (40.0, -30.0)] {
        // The grid is turned by less than a degree against north.
        assert!((terrain.height_m(x, y) - (6.0 + 0.1 * x)).abs() < 0.6, "{} at {x}", terrain.height_m(x, y));
    }
    assert_eq!((report.epsg, report.structures, report.overlapping_pairs), (Some(25830), 2, 0));
    let origin = scene.frame.origin.unwrap();
    assert!((origin.lat_deg - 43.326).abs() < 0.01 && (origin.lon_deg + 3.007).abs() < 0.01, "{origin:?}");
    assert!((origin.alt_m - 10.0).abs() < 0.5);
    for word in ["ground from town_dtm.tif", "nothing tells trees from roofs", "terrain of 5.0 m cells"] {
        assert!(report.summary().contains(word), "{word}: {}", report.summary());
    }
}

#[test]
fn a_mast_on_a_roof_becomes_an_obstacle_on_it() {
    let made = Made::new(120, 1.0);
    let with_mast = |column: u32, row: u32| houses(column, row) + if (column, row) == (45, 50) { 7.0 } else { 0.0 };
    let (scene, report) = over(&made.heights(with_mast), &made.heights(slope)).unwrap();
    let prisms = prisms(&scene);
    assert_eq!(prisms.iter().map(|prism| prism.0.as_str()).collect::<Vec<_>>(), ["obstacle-001", "roof-001", "roof-002"]);
    let (_, _, top_m, area_m2) = prisms[0];
    assert!((top_m - (4.5 + 16.0)).abs() < 0.1 && (area_m2 - 1.0).abs() < 0.1, "{prisms:?}");
    assert!(prisms[1].2 < 15.5, "the roof ends below it: {prisms:?}");
    assert!(report.summary().contains("1 places on them that stand 2 m higher"), "{}", report.summary());
}

#[test]
fn without_a_model_the_ground_is_guessed_and_the_guess_is_told() {
    let (scene, report) = alone(&Made::new(160, 1.0).heights(houses)).unwrap();
    assert!(report.summary().contains("it is guessed"), "{}", report.summary());
    let roofs = prisms(&scene);
    assert!(
        roofs
            .iter()
            .any(|(name, _, top_m, area_m2)| name.starts_with("roof") && *area_m2 > 500.0 && (11.0..17.0).contains(top_m))
    );
}

#[test]
fn integers_and_every_packing_are_read() {
    let made = Made::new(100, 1.0);
    let cells = || (0..10_000u32).map(|k| houses(k % 100, k / 100).round());
    let signed: Vec<i16> = cells().map(|z| z as i16).collect();
    let unsigned: Vec<u16> = cells().map(|z| z as u16).collect();
    let count = |bytes: Vec<u8>| prisms(&alone(&bytes).unwrap().0).len();
    let packed = made.tiff::<GrayI16>(Compression::Lzw, &signed);
    assert!(count(packed) >= 2);
    assert_eq!(
        count(made.tiff::<Gray16>(Compression::Uncompressed, &unsigned)),
        count(made.tiff::<GrayI16>(Compression::Packbits, &signed))
    );
}

#[test]
fn fine_rasters_are_gridded_down_while_they_are_read() {
    let made = Made::new(500, 0.1);
    let house = |column: u32, row: u32| if (100..300).contains(&column) && (200..400).contains(&row) { 8.0 } else { 0.0 };
    let (scene, report) = over(&made.heights(house), &made.heights(|_, _| 0.0)).unwrap();
    assert!(report.summary().contains("gridded down by 5 to 100 x 100 cells"), "{}", report.summary());
    let prisms = prisms(&scene);
    assert!(prisms.len() == 1 && (prisms[0].3 - 400.0).abs() < 25.0 && (prisms[0].2 - 8.0).abs() < 0.1, "{prisms:?}");
    assert_eq!((tiff::factor(60_000, 20_000, 0.5), tiff::factor(1000, 1000, 0.25), tiff::factor(1000, 1000, 2.5)), (18, 2, 1));
}

#[test]
fn unknown_heights_are_filled_or_left_out_and_told() {
    let made = Made::new(120, 1.0);
    let surface = |column: u32, row: u32| match (column, row) {
        (40, 50) => f32::NAN,
        (45..47, 50) => -9999.0,
        (50, 50) => f32::INFINITY,
        (0..30, 90..120) => -9999.0,
        _ => houses(column, row),
    };
    let (scene, report) = over(&made.heights(surface), &made.heights(slope)).unwrap();
    let told = report.summary();
    assert!(
        told.contains("4 cells in small gaps")
            && told.contains("900 cells (6.2 %)")
            && told.contains("1 pixels have no possible height"),
        "{told}"
    );
    assert_eq!(prisms(&scene).len(), 2);
    let all = message(alone(&made.heights(|_, _| -9999.0)));
    assert!(all.contains("not one of its heights is known"), "{all}");
    let absurd = message(alone(&made.heights(|_, _| 1e30)));
    assert!(absurd.contains("not one of its heights is known"), "{absurd}");
}

#[test]
fn what_is_no_surface_model_is_refused_with_a_remedy() {
    let made = Made::new(60, 1.0);
    let surface = made.heights(houses);
    let photo = Made::new(8, 1.0).tiff::<RGB8>(Compression::Uncompressed, &[7; 192]);
    let with_keys = |keys: &[u16]| Made { keys: keys.to_vec(), ..made.clone() };
    let cases = [
        (alone(&surface[..surface.len() / 2]), "damaged or cut off"),
        (alone(b"II*\0"), "damaged or cut off"),
        (alone(&photo), "its pixels are RGB"),
        (alone(&Made { is_placed: false, ..made.clone() }.heights(houses)), "does not say where its pixels lie"),
        (
            alone(&with_keys(&[1, 1, 0, 2, 1024, 0, 1, 2, 2048, 0, 1, 4326]).heights(houses)),
            "its coordinates are degrees (EPSG:4326)",
        ),
        (alone(&with_keys(&[1, 1, 0, 1, 3072, 0, 1, 4326]).heights(houses)), "its coordinates are degrees (EPSG:4326)"),
        (alone(&made.heights(slope)), "nothing in it stands"),
        (alone(&Made::new(60, 30.0).heights(houses)), "show no buildings"),
        (over(&made.heights(slope), &made.heights(|c, r| houses(c, r) + 5.0)), "lies below its ground"),
        (over(&surface, &with_keys(&[1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 28992]).heights(slope)), "EPSG:28992"),
        (over(&surface, &surface[..100]), "town_dtm.tif: the TIFF is damaged"),
        (over(b"{\"type\": \"FeatureCollection\", \"features\": []}", &surface), "no surface model"),
        (over(&Made::new(300, 1.0).heights(houses), &made.heights(slope)), "covers only 4 %"),
    ];
    for (read, expected) in cases {
        let told = message(read);
        assert!(told.contains(expected) && told.contains(';'), "{expected}: {told}");
    }
}

#[test]
fn absurd_sizes_are_refused_before_memory_is_taken() {
    let mut bytes = Made::new(20, 1.0).heights(houses);
    let entry = |bytes: &[u8], tag: u16| {
        let ifd = u32::from_le_bytes([bytes[4], bytes[5], bytes[6], bytes[7]]) as usize;
        (0..40).map(|k| ifd + 2 + 12 * k).find(|&at| bytes[at..at + 2] == tag.to_le_bytes()).unwrap()
    };
    // Width, height and the rows of a strip, so that the table of strips still fits.
    for tag in [256, 257, 278] {
        let at = entry(&bytes, tag);
        bytes[at + 2..at + 4].copy_from_slice(&4u16.to_le_bytes());
        bytes[at + 8..at + 12].copy_from_slice(&4_000_000_000u32.to_le_bytes());
    }
    let told = message(alone(&bytes));
    assert!(told.contains("4000000000 x 4000000000 pixels"), "{told}");
}

#[test]
fn unknown_systems_and_feet_are_told() {
    let made = Made { keys: vec![1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 20], ..Made::new(120, 1.0) };
    let (scene, report) = over(&made.heights(houses), &made.heights(slope)).unwrap();
    assert!(scene.frame.origin.is_none() && report.summary().contains("EPSG:20 cannot be projected"), "{}", report.summary());
    let feet = Made { keys: [&UTM[..], &[4099, 0, 1, 9002]].concat(), ..Made::new(120, 1.0) };
    let mut keys = feet.keys.clone();
    keys[3] = 4;
    let feet = Made { keys, ..feet };
    let (scene, report) = over(&feet.heights(|c, r| houses(c, r) / 0.3048), &feet.heights(|c, r| slope(c, r) / 0.3048)).unwrap();
    assert!(report.summary().contains("heights are in units of 0.3048000 m, as the file says"), "{}", report.summary());
    assert!((prisms(&scene)[0].2 - 15.0).abs() < 0.6, "{:?}", prisms(&scene));
    assert!(
        message(over(
            &feet.heights(houses),
            &Made { keys: [&UTM[..3], &[4], &UTM[4..], &[4099, 0, 1, 9001]].concat(), ..feet.clone() }.heights(slope)
        ))
        .contains("another unit")
    );
}

#[test]
fn a_newer_survey_is_read_into_the_frame_of_the_older_one() {
    let made = Made::new(120, 1.0);
    let ground = made.heights(slope);
    let (old, report) = over(&made.heights(houses), &ground).unwrap();
    let taller = |column: u32, row: u32| {
        houses(column, row) + if (30..60).contains(&column) && (40..60).contains(&row) { 4.0 } else { 0.0 }
    };
    let anchor = report.anchor.unwrap();
    let surface = made.heights(taller);
    let (new, _) =
        read_over_ground("town_dsm.tif", &surface, &ground_file(&ground), &Settings::default().proxy, Some(&anchor)).unwrap();
    assert_eq!(new.frame, old.frame);
    let (_, changes) = old.updated(&new).unwrap();
    assert_eq!(changes.structures.changed, ["roof-001"]);
    assert!(changes.structures.added.is_empty() && changes.structures.removed.is_empty());
    let refused =
        message(read_anchored("a.obj", b"v 0 0 0\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1 2 4\n", &Settings::default().proxy, &anchor));
    assert!(refused.contains("a height model in EPSG:25830"), "{refused}");
}

fn cloud(bytes: &[u8]) -> Result<(Scene, ImportReport), ImportError> {
    read("town.laz", bytes, &Settings::default().proxy)
}

#[test]
fn classified_points_tell_ground_roofs_and_trees_apart() {
    let points = points([2, 6, 5]);
    for bytes in [las(&points, false), las(&points, true), layered(&points, 50_000), layered(&points, 1000), layered(&points, 40)]
    {
        let (scene, report) = cloud(&bytes).unwrap();
        let prisms = prisms(&scene);
        let names: Vec<&str> = prisms.iter().map(|prism| prism.0.as_str()).collect();
        assert_eq!(names, ["obstacle-001", "roof-001"], "{}", report.summary());
        assert!((prisms[1].2 - 8.0).abs() < 0.3 && (prisms[1].3 - 400.0).abs() < 45.0, "{prisms:?}");
        assert!((prisms[0].2 - 7.0).abs() < 0.3, "{prisms:?}");
        let tree = scene.structures.iter().find(|structure| structure.name == "obstacle-001").unwrap();
        assert!(matches!(tree.shape, Shape::Obstacle { .. }));
        let told = report.summary();
        for word in [
            "2 points are marked as noise",
            "1 points stand alone",
            "points that are marked as ground",
            "cell of 0.8 x 0.8 units",
        ] {
            assert!(told.contains(word), "{word}: {told}");
        }
        assert_eq!(report.epsg, Some(25830));
    }
}

#[test]
fn a_cloud_is_counted_while_it_is_read() {
    for bytes in [las(&points([2, 6, 5]), false), layered(&points([2, 6, 5]), 1000)] {
        let (length, stop) = (bytes.len() as u64, StopToken::default());
        let mut source = Watched::new(Cursor::new(&bytes), length, &stop);
        assert_eq!(stop.progress(), Counted { part: Part::Reading, done: 0, of: length });
        let (watched, _) = read_cloud("town.laz", &mut source, &Settings::default().proxy, None).unwrap();
        assert_eq!(watched, cloud(&bytes).unwrap().0);
        assert_eq!(stop.progress(), Counted { part: Part::Reading, done: length, of: length });
        assert_eq!(stop.progress().told(), [length / 1000, length.div_ceil(1000)]);
    }
}

#[test]
fn without_classes_all_that_is_high_is_a_roof_and_that_is_told() {
    let (scene, report) = cloud(&las(&points([1, 1, 1]), true)).unwrap();
    let roofs = prisms(&scene).iter().filter(|prism| prism.0.starts_with("roof")).count();
    assert!(roofs >= 1 && report.summary().contains("nothing tells trees from roofs"), "{}", report.summary());
    assert!(report.summary().contains("it is guessed"));
}

#[test]
fn clouds_that_are_cut_off_or_absurd_are_refused() {
    let (plain, packed) = (las(&points([2, 6, 5]), false), las(&points([2, 6, 5]), true));
    let with = |at: usize, value: &[u8]| {
        let mut bytes = plain.clone();
        bytes[at..at + value.len()].copy_from_slice(value);
        bytes
    };
    let cases = [
        (cloud(&plain[..plain.len() - 28]), "has 14402 of 14403 points"),
        (cloud(&packed[..packed.len() * 2 / 3]), "its points cannot be unpacked"),
        (cloud(&plain[..180]), "its points have no place"),
        (cloud(b"LASF"), "the header is cut off"),
        (cloud(&with(25, &[9])), "LAS 1.0 to 1.4 are read"),
        (cloud(&with(107, &u32::MAX.to_le_bytes())), "it is cut off"),
        (cloud(&with(179, &f64::NAN.to_le_bytes())), "lie in a box of NaN"),
        (cloud(&with(179, &1e300f64.to_le_bytes())), "absurd"),
        (cloud(&with(131, &f64::INFINITY.to_le_bytes())), "its scale or offset"),
        (cloud(&with(155, &7e6f64.to_le_bytes())), "outside of the box"),
    ];
    for (read, expected) in cases {
        let told = message(read);
        assert!(told.contains(expected), "{expected}: {told}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    #[test]
    fn nothing_that_begins_like_a_raster_or_a_cloud_makes_the_reader_panic(
        head in prop::sample::select(vec![&b"II*\0"[..], b"MM\0*", b"II+\0\x08\0\0\0", b"LASF"]),
        rest in proptest::collection::vec(any::<u8>(), 0..400),
    ) {
        let bytes = [head, &rest].concat();
        prop_assert!(alone(&bytes).is_err());
    }
}
