//! What several tests need: generated scenes and their snapshots.
#![allow(dead_code, reason = "each test uses its own part of this module")]

use std::path::PathBuf;
use std::sync::Arc;

use geo::polygon;
use nalgebra::Point3;
use overfly::camera::Rig;
use overfly::planner::{Conduct, Made, Method, PlanOptions, StopToken, replan};
use overfly::scene::edit::Edit;
use overfly::scene::{BlockSettings, NoFlyZone, Scene, Shape, Triangle, ZoneSource, generate_block};
use overfly::session::{Session, Snapshot};
use overfly::settings::Settings;
use overfly::trajectory::plan::Plan;
use overfly::trajectory::record::Record;
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};

/// A block of about nine buildings on 130 m, small enough for brute force.
pub fn small_block(seed: u64) -> Scene {
    generate_block(&BlockSettings { seed, extent_m: [130.0, 130.0], buildings: 9, ..Default::default() })
}

/// Settings with few samples and viewpoints.
pub fn small_settings() -> Settings {
    let mut settings = Settings::default();
    settings.surface.samples = 150;
    settings.field.viewpoints = 200;
    settings
}

pub fn session(scene: Scene, settings: &Settings) -> Session {
    Session::new(scene, Arc::new(settings.clone()), &StopToken::default()).expect("a generated block can be surveyed")
}

pub fn snapshot(session: &Session) -> Snapshot {
    let stop = StopToken::default();
    session.survey(&stop).and_then(|survey| survey.into_snapshot(&stop)).expect("nobody stops the survey")
}

/// The snapshot that follows from that of an earlier revision.
pub fn snapshot_after(session: &Session, earlier: &Snapshot) -> Snapshot {
    let stop = StopToken::default();
    session.survey_after(earlier, &stop).and_then(|survey| survey.into_snapshot(&stop)).expect("nobody stops the survey")
}

/// The same scene with fresh structures, so that nothing remembered of the old ones can be used.
pub fn forgotten(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    scene.structures.iter_mut().for_each(|structure| *structure = Arc::new((**structure).clone()));
    scene
}

/// An edit of a scene by chance: mostly one that can be made.
pub fn random_edit(scene: &Scene, random: &mut ChaCha8Rng) -> Edit {
    let mut below = |count: u64| random.next_u64() % count;
    let structure = &scene.structures[below(scene.structures.len() as u64) as usize];
    let (id, bounds) = (structure.id, structure.bounds());
    let [x, y] = [bounds.max.x + below(20) as f64, bounds.min.y + below(20) as f64];
    let name = format!("new-{}", below(1 << 40));
    match below(12) {
        0 => Edit::Raise { id, by_m: 1.0 + below(12) as f64 },
        1 => Edit::Lower { id, by_m: 1.0 + below(4) as f64 },
        2 => Edit::Move { id, by_m: [below(21) as f64 - 10.0, below(21) as f64 - 10.0] },
        3..=5 => Edit::Add { name, shape: random_shape([x, y], &mut below) },
        6 | 7 => Edit::Replace { id, shape: random_shape([bounds.min.x, bounds.min.y], &mut below) },
        8 | 9 if scene.zones.len() < 4 => Edit::AddZone { zone: random_zone(name, [x, y], &mut below) },
        8..=10 if !scene.zones.is_empty() => {
            Edit::RemoveZone { name: scene.zones[below(scene.zones.len() as u64) as usize].name.clone() }
        }
        _ => Edit::Remove { id },
    }
}

/// A pillar around the middle of the longest leg, as far up as flights go: the flight before is not safe any more.
pub fn pillar_on(plan: &Plan, number: usize) -> Edit {
    let length = |k: &usize| (plan.waypoints[k + 1].position_m - plan.waypoints[*k].position_m).norm();
    let longest = (0..plan.waypoints.len() - 1).max_by(|a, b| length(a).total_cmp(&length(b))).unwrap();
    let middle = nalgebra::center(&plan.waypoints[longest].position_m, &plan.waypoints[longest + 1].position_m);
    let (x, y) = (middle.x, middle.y);
    let footprint =
        polygon![(x: x - 1.0, y: y - 1.0), (x: x + 1.0, y: y - 1.0), (x: x + 1.0, y: y + 1.0), (x: x - 1.0, y: y + 1.0)];
    Edit::add_prism(format!("pillar-{number}"), footprint, 0.0, middle.z + 1.0)
}

/// The repaired flight alone, with what its images see.
pub fn repaired(snapshot: &Snapshot, settings: &Settings, options: &PlanOptions, record: Option<Record>) -> Option<Made> {
    let (mut repaired, stop) = (None, StopToken::default());
    let on_interim = &mut |made: Made| {
        repaired = Some(made);
        // What follows is not looked at.
        stop.abandon();
    };
    let conduct = Conduct { on_interim, ..Conduct::unheard(&stop) };
    let made = replan(snapshot, settings, options, record, conduct);
    assert!(repaired.is_none() || made.is_err());
    repaired
}

/// A prism, a mesh or an obstacle by chance, its south-west corner about here.
fn random_shape([x, y]: [f64; 2], below: &mut impl FnMut(u64) -> u64) -> Shape {
    let (width, depth) = (3.0 + below(12) as f64, 3.0 + below(12) as f64);
    let (base_m, height_m) = (below(3) as f64 * 4.0, 3.0 + below(25) as f64);
    let footprint = polygon![(x: x, y: y), (x: x + width, y: y), (x: x + width, y: y + depth), (x: x, y: y + depth)].into();
    match below(3) {
        0 => Shape::Prism { footprint, base_m, top_m: base_m + height_m },
        1 => {
            // A roof with a ridge over open walls, or a sheet where the ridge is all there is.
            let [a, b, c, d] =
                [[x, y], [x + width, y], [x + width, y + depth], [x, y + depth]].map(|[x, y]| Point3::new(x, y, base_m));
            let ridge = Point3::new(x + width / 2.0, y + depth / 2.0, base_m + height_m);
            let faces = [[a, b, ridge], [b, c, ridge], [c, d, ridge], [d, a, ridge]];
            Shape::Mesh { triangles: faces[..1 + below(4) as usize].to_vec() }
        }
        _ => {
            let centre = Point3::new(x, y, base_m + height_m / 2.0);
            Shape::obstacle_box(centre, [width, depth, height_m], below(100) as f64 / 16.0)
        }
    }
}

/// A zone by chance, with or without a ceiling, some of them over half the block.
fn random_zone(name: String, [x, y]: [f64; 2], below: &mut impl FnMut(u64) -> u64) -> NoFlyZone {
    let side = if below(4) == 0 { 80.0 } else { 6.0 + below(20) as f64 };
    let outline = polygon![(x: x, y: y), (x: x + side, y: y - 3.0), (x: x + side / 2.0, y: y + side)].into();
    let floor_m = below(40) as f64;
    let ceiling_m = if below(2) == 0 { f64::MAX } else { floor_m + 5.0 + below(30) as f64 };
    NoFlyZone { name, outline, floor_m, ceiling_m, source: ZoneSource::Edit }
}

/// Makes edits by chance, alone and several at a time, and holds the field that follows from the one before against one that is built anew, bit for
/// bit. Returns how many could be made.
pub fn check_updates(scene: Scene, settings: &Settings, edits: usize, seed: u64) -> usize {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut edited = session(scene, settings);
    let mut latest = snapshot(&edited);
    let (mut tried, mut made) = (0, 0);
    while tried < edits {
        let together = if random.next_u64() % 4 == 0 { 2 + random.next_u64() % 4 } else { 1 };
        let mut scene = Scene::clone(edited.scene());
        let mut batch = Vec::new();
        for _ in 0..together {
            tried += 1;
            let edit = random_edit(&scene, &mut random);
            if let Ok((next, _)) = scene.edited(&edit, &settings.proxy) {
                scene = next;
                batch.push(edit);
            }
        }
        made += batch.len();
        edited = edited.with_scene(scene, edited.revision() + 1);
        latest = snapshot_after(&edited, &latest);
        let rebuilt = snapshot(&edited.with_scene(forgotten(edited.scene()), edited.revision()));
        assert!(latest.storage().is_same(&**rebuilt.storage()), "after {tried} edits: {batch:?}");
    }
    made
}

pub fn options(seed: u64, iterations: u32) -> PlanOptions {
    rig_options("panoramic", seed, iterations)
}

pub fn rig_options(rig: &str, seed: u64, iterations: u32) -> PlanOptions {
    PlanOptions { iterations: Some(iterations), ..PlanOptions::new(Rig::preset(rig).expect("a preset"), Method::Paper, seed) }
}

/// The presets, and a camera whose gimbal turns neither to the horizon nor straight down.
pub fn rigs() -> Vec<Rig> {
    let phantom = include_str!("../../config/rigs/phantom4-rtk.toml");
    let narrow = phantom.replace("[-90.0, 30.0]", "[-52.0, -12.0]").replace("\"phantom4-rtk\"", "\"narrow\"");
    let presets = Rig::PRESETS.into_iter().map(|name| Rig::preset(name).expect("a preset"));
    presets.chain([Rig::parse(&narrow).expect("a rig")]).collect()
}

/// A real scene's file, or `None` with a line that says that the test was skipped.
pub fn real_scene(path: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("OVERFLY_SCENES")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/scenes"), PathBuf::from);
    let file = folder.join(path);
    if file.exists() {
        return Some(file);
    }
    println!("skipped: no real scene at {} (set OVERFLY_SCENES)", file.display());
    None
}

/// Whether the open segment meets a triangle: plane first, then the corner's areas. Written differently from the planner's own
/// test on purpose.
pub fn crosses(a: &Point3<f64>, b: &Point3<f64>, triangle: &Triangle) -> bool {
    let normal = (triangle[1] - triangle[0]).cross(&(triangle[2] - triangle[0]));
    let (side_a, side_b) = (normal.dot(&(a - triangle[0])), normal.dot(&(b - triangle[0])));
    if side_a * side_b >= 0.0 {
        return false;
    }
    let hit = a + (b - a) * (side_a / (side_a - side_b));
    let inside = |p: usize, q: usize| (triangle[q] - triangle[p]).cross(&(hit - triangle[p])).dot(&normal) >= 0.0;
    inside(0, 1) && inside(1, 2) && inside(2, 0)
}
