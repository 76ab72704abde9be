//! Every constant of the model, with its unit; `config/default.toml` is the same values with their reasons and is embedded here.

mod parse;

use serde::de::IntoDeserializer;
use serde::{Deserialize, Serialize};

pub use parse::SettingsError;

/// The embedded defaults, as text.
pub const DEFAULT_TOML: &str = include_str!("../config/default.toml");

/// Iterations that a search may be asked for.
pub const MOST_ITERATIONS: u32 = 10_000_000;

/// All settings of a planner or daemon.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    pub proxy: ProxySettings,
    pub surface: SurfaceSettings,
    pub flight: FlightSettings,
    pub dynamics: DynamicsSettings,
    pub field: FieldSettings,
    pub coverage: CoverageSettings,
    pub objective: ObjectiveSettings,
    pub search: SearchSettings,
    pub refine: RefineSettings,
    pub quality: QualitySettings,
    pub baseline: BaselineSettings,
    pub bound: BoundSettings,
    pub daemon: DaemonSettings,
}

/// How a scene file is read and its gaps are filled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProxySettings {
    /// Reference system of the file's coordinates as an EPSG code, whatever the file says; 0 for what it says itself.
    pub epsg: u32,
    /// Which axis of a mesh points up.
    pub up: UpAxis,
    /// Metres in a unit of a mesh.
    pub unit_m: f64,
    /// Added to the coordinates of a mesh after that, m: x, y, z of a file whose origin was shifted.
    pub offset_m: [f64; 3],
    /// The highest level of detail of CityJSON that is read; 0 for the highest that there is.
    pub lod: f64,
    /// What is done about a building of whose height nothing is known.
    pub missing_heights: MissingHeights,
    /// Height of one storey where only `building:levels` is given, m.
    pub storey_height_m: f64,
    /// Height of a building of which nothing is known, m.
    pub default_height_m: f64,
    /// A taller building is a mistake in the file, m.
    pub max_height_m: f64,
    /// A building farther from the middle of the scene is a mistake in the file, m.
    pub max_extent_m: f64,
}

/// Which axis of a mesh points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UpAxis {
    /// What the format prescribes or is usual in it: y in glTF, z in OBJ, PLY and STL.
    File,
    Y,
    Z,
}

impl UpAxis {
    /// By the name that the configuration has for it.
    pub fn parse(name: &str) -> Option<Self> {
        Self::deserialize(name.into_deserializer()).map_err(|_: serde::de::value::Error| ()).ok()
    }
}

impl MissingHeights {
    /// By the name that the configuration has for it.
    pub fn parse(name: &str) -> Option<Self> {
        Self::deserialize(name.into_deserializer()).map_err(|_: serde::de::value::Error| ()).ok()
    }
}

/// What is done about a building of whose height nothing is known, neither metres nor storeys.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MissingHeights {
    /// It gets the median height of the buildings near it whose height is known, or the constant where there are none.
    Neighbours,
    /// It gets `proxy.default_height_m`.
    Constant,
    /// It is left out: nothing is captured of it, and nothing keeps a flight away from it.
    Drop,
}

/// Sampling of the surface (paper, section 4.1).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceSettings {
    /// Target number N of exposed samples.
    pub samples: u32,
    /// No two neighbours are farther apart, m, even if that takes more samples than the target ...
    pub max_spacing_m: f64,
    /// ... as long as it takes no more than this.
    pub max_samples: u32,
    /// Seed of the sampling and of the lattice's jitter.
    pub seed: u64,
    /// How far in front of a sample its exposure is tested, m.
    pub exposure_offset_m: f64,
}

/// Where the drone may fly and how fast.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlightSettings {
    pub cruise_speed_mps: f64,
    /// Least distance of the curve to every structure, m.
    pub safety_distance_m: f64,
    /// Least altitude above the ground below, m.
    pub altitude_min_m: f64,
    /// Headroom above the tallest structure, m.
    pub above_tallest_m: f64,
    /// Legal ceiling above the ground below, m.
    pub legal_ceiling_m: f64,
    /// How far the flight may leave the box around the structures, m.
    pub lateral_margin_m: f64,
    /// Zones beside those that the scene file brings.
    pub no_fly: Vec<NoFlySetting>,
}

/// Limits of the speed profile: the same for every method and rig.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DynamicsSettings {
    /// Along the path, m/s^2.
    pub acceleration_mps2: f64,
    /// Most change of the acceleration along the path, m/s^3.
    pub jerk_mps3: f64,
    /// Across the path in corners, m/s^2.
    pub lateral_mps2: f64,
    /// How far a corner's arc may pass from the corner, m.
    pub corner_deviation_m: f64,
    /// Of the drone about the vertical, degrees a second.
    pub yaw_rate_dps: f64,
    /// Of the gimbal in pitch, degrees a second.
    pub gimbal_rate_dps: f64,
}

/// A no-fly zone of the configuration. It holds for every scene, so it is usually given in degrees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoFlySetting {
    pub name: String,
    /// Corners as longitude and latitude, degrees.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outline_deg: Vec<[f64; 2]>,
    /// Corners in metres east and north of the scene's origin, in place of degrees: for a scene without georeference.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub outline_m: Vec<[f64; 2]>,
    /// Above the ground below, m.
    pub floor_m: f64,
    pub ceiling_m: f64,
}

/// The viewpoints of the view information field (paper, section 4.3).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FieldSettings {
    /// Target number M of viewpoints.
    pub viewpoints: u32,
    /// Most samples and most viewpoints that a field may have: edits may enlarge a scene whose spacings are pinned.
    pub most_samples: u32,
    pub most_viewpoints: u32,
    /// Coarsest lattice, m: beyond it the shell would fall between the cells.
    pub max_spacing_m: f64,
    /// Outer edge of the offset shell, m from the nearest surface.
    pub shell_m: f64,
}

/// Disks and hemispheres (paper, section 4.1).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CoverageSettings {
    /// How many times the sight of the reference camera the distances below are for; see [`Settings::with_sight`].
    pub sight_scale: f64,
    /// Half-angle of the disk of a near frontal view, degrees.
    pub theta0_deg: f64,
    /// Up to this distance the disk does not shrink, m.
    pub full_disk_m: f64,
    /// Distance over which the disk's half-angle falls by a factor e, m.
    pub falloff_m: f64,
    /// Views more oblique than this capture nothing, degrees from the normal.
    pub max_incidence_deg: f64,
    /// Views from farther away capture nothing, m.
    pub range_m: f64,
    /// A sample is captured when r exceeds this, percent (the paper's h).
    pub threshold_percent: f64,
    /// Share of the capturable samples that ends the search, percent (the paper's G).
    pub goal_percent: f64,
}

/// Eq. 4 to 6 in scale-free units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectiveSettings {
    /// Weight of the efficiency term: alpha_e u = eta * L_ref.
    pub eta: f64,
    /// Weight of the turning term, model units per second.
    pub alpha_t: f64,
    /// Information of a scene of the reference area per percent of its mean r.
    pub information_scale: f64,
    /// Exposed area of the reference scene, m^2.
    pub reference_area_m2: f64,
    /// Path length on the reference scene, m.
    pub reference_length_m: f64,
    /// Eq. 5: time of a hairpin, s, and the coefficient of the squared deviation from it, s/rad^2.
    pub turn_hairpin_s: f64,
    pub turn_curvature_s: f64,
}

/// Algorithms 2 to 5.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SearchSettings {
    /// Iterations K of the main loop.
    pub iterations: u32,
    /// Random locations that are looked at for one new node.
    pub candidates: u32,
    /// Reconnections that one call of `Rewire_Tree` may make.
    pub rewirings: u32,
    /// Nodes that one call of `Rewire_Tree` may take from its queue.
    pub rewire_pops: u32,
    /// The root is rewired every so many iterations.
    pub root_rewire_every: u32,
    /// Neighbour radius as a share of the scene's horizontal diagonal, and its limits, m.
    pub neighbour_share: f64,
    pub neighbour_min_m: f64,
    pub neighbour_max_m: f64,
    /// The nearest so many neighbours are looked at.
    pub neighbours_most: u32,
    /// Least distance of two images along an edge, m; the rig's shutter may need more.
    pub image_spacing_m: f64,
    /// One search's tree may take this much, MB.
    pub memory_mb: u32,
    /// Most that the view of a camera on a gimbal turns on one leg, degrees; blur may allow less (section 5.4).
    pub view_turn_deg: f64,
}

/// Local search on the waypoints of a flight, beyond the paper.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RefineSettings {
    /// Iterations of the tree search that gives the flight to begin with.
    pub tree_iterations: u32,
    /// Rounds, where neither rounds nor seconds are asked for.
    pub rounds: u32,
    /// Samples that count in the first rounds, at least.
    pub coarse_samples: u32,
    /// Changes that each worker tries in one round.
    pub round_moves: u32,
    /// Parts of the flight that are changed at the same time.
    pub sectors: u32,
    /// By how much a change may make the flight worse, on average, in the first and in the last round, s.
    pub hottest_s: f64,
    pub coldest_s: f64,
    /// The same in the first round where an earlier flight is gone on with, s.
    pub resumed_s: f64,
    /// Cells by which a sample has to exceed the threshold while the flight is improved.
    pub margin_cells: u32,
    /// By which views have to keep within the parallax that can be matched, degrees.
    pub margin_parallax_deg: f64,
    /// What all cells of a sample, and a sample beyond the goal, are worth, as shares of a sample's price.
    pub parts_share: f64,
    pub surplus_share: f64,
    /// Factors of the price after a round that ends short of the goal, and after one that does not.
    pub price_rise: f64,
    pub price_fall: f64,
}

/// Prediction of the reconstruction's quality: Error and Completeness in the form of the paper's Tables 2 and 3.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct QualitySettings {
    /// Target number of exposed samples of the truth.
    pub samples: u32,
    /// Standard deviation of a matched image point, pixels.
    pub pixel_noise_px: f64,
    /// A view counts as matched when another view of the sample lies within these angles of it, degrees.
    pub min_parallax_deg: f64,
    pub max_parallax_deg: f64,
    /// A sample is reconstructed when this many of its views are matched.
    pub least_views: u32,
    /// Reconstructability after Smith et al. 2018: the distance at which a view is worth nothing, m, and the sum to reach.
    pub smith_range_m: f64,
    pub smith_target: f64,
}

/// The methods that the paper compares with (sections 6.2 and 6.3).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaselineSettings {
    /// Focal length of oblique photography on the rig's own sensors, mm; 0 keeps the rig's.
    pub op_focal_mm: f64,
    /// Share of an image's footprint that the next line, and the next image on the line, cover again.
    pub op_side_overlap: f64,
    pub op_forward_overlap: f64,
    /// Height of the lines above the ground, m; 0 chooses.
    pub op_height_m: f64,
    /// Reconstructability of a sample that more views need not raise (sum of pair qualities).
    pub smith_target: f64,
    /// Views are added until this share of what all candidates together reach is reached, percent.
    pub smith_share_percent: f64,
    /// Rounds of moving views and leaving them out, at most.
    pub smith_rounds: u32,
    /// Reconstructability of a sample that leaving out views must not undercut.
    pub zhou_target: f64,
    /// Rounds of adjusting views and leaving them out, at most.
    pub zhou_rounds: u32,
    /// Kicks of the local search for the tour, for each view.
    pub tour_kicks: u32,
}

/// The certified lower bound and the plan beside it. Whatever stands here, the bound holds; how high it gets and how long it takes depend on it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoundSettings {
    /// Viewpoints of the field that the graph takes, at most.
    pub waypoints: u32,
    /// A graph is refused when its images see samples more often: pairs of a way to take an image, or of a leg, and a sample.
    pub most_sightings: u32,
    /// Rounds of rows on demand, at most.
    pub most_rounds: u32,
    /// Rounds that lift the bound by less than this share end the work when there are so many of them in a row.
    pub still_share: f64,
    pub still_rounds: u32,
    /// Rows that join in one round, at most.
    pub most_new_rows: u32,
    /// Rows with a smaller multiplier, m for the largest coefficient, are left out of the next program.
    pub idle_m: f64,
    /// Rows that are broken by less are left alone, as a share of a whole capture or visit.
    pub least_violation: f64,
    /// Cuts that are sought for one sample and weighting in one round.
    pub nested_cuts: u32,
    /// Waypoints that are visited less get no rows of their own, as a share of a visit.
    pub least_visit: f64,
    /// Edges from each waypoint to the nearest others that the program begins with.
    pub first_neighbours: u32,
    /// Iterations of the interior-point solver, its relative gap, and by how much it may break rows.
    pub solver_iterations: u32,
    pub solver_gap: f64,
    pub solver_feasibility: f64,
    /// The sharpest weighting of a sample's images: images that it looks at together, capturing sets, steps of one search for such a set.
    pub weighed_images: u32,
    pub weighed_sets: u32,
    pub weighing_steps: u32,
    /// Searches for a plan on the graph, and rounds of each.
    pub plan_searches: u32,
    pub plan_rounds: u32,
    /// Share of the length by which a plan may be worse than the one before and still be followed, at first.
    pub plan_tolerance: f64,
    /// Stops that are taken out of a plan at once, at most.
    pub plan_taken: u32,
}

/// The resident daemon.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DaemonSettings {
    /// Name of the iceoryx2 domain: daemons of different domains do not see each other.
    pub domain: String,
    /// Fields of all scenes together may take this much shared memory, MB.
    pub memory_budget_mb: u64,
    /// Largest scene file that a client may send, MB.
    pub max_scene_mb: u64,
    /// Worker threads; 0 takes as many as there are cores.
    pub threads: u32,
    /// Each worker thread stays on a processor of its own, where the daemon may use as many processors as it has threads (Linux).
    pub pin_threads: bool,
    /// Niceness that searches add to that of the process, 0 to 19 (Linux), once the first safe plan after an edit is out.
    pub search_nice: i32,
}

impl Default for Settings {
    fn default() -> Self {
        toml::from_str(DEFAULT_TOML).expect("the embedded configuration is tested")
    }
}

impl Settings {
    /// The settings for cameras that see `scale` times as far as the reference camera: the distances of the coverage model grow from those
    /// for the sight that the settings have now, and with them the shell of viewpoints.
    pub fn with_sight(mut self, scale: f64) -> Self {
        let Self { coverage, field, quality, .. } = &mut self;
        let ratio = scale / coverage.sight_scale;
        // Nearsighted cameras come nearer, but the shell that they do it in still has to be as thick as streets are wide.
        let shell_ratio = scale.max(1.0) / coverage.sight_scale.max(1.0);
        for distance_m in [&mut coverage.range_m, &mut coverage.full_disk_m, &mut coverage.falloff_m, &mut quality.smith_range_m]
        {
            *distance_m *= ratio;
        }
        field.shell_m *= shell_ratio;
        field.max_spacing_m *= shell_ratio;
        coverage.sight_scale = scale;
        self
    }

    /// Fingerprint of everything that a field depends on beside its scene: a cached field of other settings is not used.
    pub fn field_hash(&self) -> u64 {
        let text = format!("{:?} {:?} {:?} {:?}", self.surface, self.flight, self.field, self.coverage);
        crate::fingerprint::fnv1a(text.as_bytes())
    }
}
