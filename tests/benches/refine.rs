//! The refinement of a flight on one core: changes that are tried in a second, each looked at only where it changes the flight, and beside them
//! flights that are looked at as a whole.
//!
//! `cargo bench --bench refine` runs all rigs on the town in `$OVERFLY_SCENES/nihonbashi`, on a generated block if it is not there. The ratio of two rows of
//! one rig is what it saves to look at changes alone; compare rows of one run only, the machine may be shared.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, OnceLock};

use divan::Bencher;
use divan::counter::ItemsCount;
use overfly::camera::{Pose, Rig};
use overfly::refine::{Aim, Annealing, Counting, Ground, Worth};
use overfly::scene::{Scene, generate_block, ny1_size, read};
use overfly::search::{Problem, search};
use overfly::session::{Session, Snapshot};
use overfly::settings::Settings;
use overfly::stop::StopToken;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// As the default goal for coverage.
const MATCHED_PERCENT: f64 = 95.0;

const RIGS: [&str; 3] = ["phantom4-rtk", "m300-oblique", "panoramic"];

/// Changes in one round that is measured: enough of all kinds.
const MOVES: u32 = 2000;

/// In the first rounds over the real town only every so many samples count.
const FEWER: usize = 4;

/// Rounds of [`MOVES`] changes, and temperatures that they begin and end with: what is measured after them is the middle of a search.
const WARM_UP: u32 = 15;
const TEMPERATURES_NS: [f64; 2] = [3e9, 0.3e9];

fn main() {
    divan::main();
}

/// A flight in the middle of its refinement, with all that it rests on.
struct Stage {
    settings: Settings,
    snapshot: Snapshot,
    rig: Rig,
    path: Vec<Pose>,
}

static ONE_CORE: LazyLock<ThreadPool> =
    LazyLock::new(|| ThreadPoolBuilder::new().num_threads(1).build().expect("a thread can be started"));

static STAGES: [OnceLock<Stage>; RIGS.len()] = [const { OnceLock::new() }; RIGS.len()];

fn stage(rig: &str) -> &'static Stage {
    let number = RIGS.iter().position(|name| *name == rig).expect("one of the rigs");
    STAGES[number].get_or_init(|| Stage::new(Rig::preset(rig).expect("a preset")))
}

impl Stage {
    fn new(rig: Rig) -> Self {
        let stop = StopToken::default();
        let mut settings = Settings::default().with_sight(rig.sight_scale());
        settings.refine.sectors = 1;
        settings.refine.round_moves = MOVES;
        let session = Session::new(town(&settings), Arc::new(settings.clone()), &stop).expect("a town can be surveyed");
        let snapshot = session.survey(&stop).and_then(|survey| survey.into_snapshot(&stop)).expect("nobody stops it");
        let mut stage = Self { settings, snapshot, rig, path: Vec::new() };
        stage.path = ONE_CORE.install(|| warm_path(&stage));
        stage
    }

    fn problem(&self) -> Problem<'_> {
        Problem::new(&self.snapshot, &self.settings, self.rig.clone())
    }
}

/// The real town, or a block of about its size.
fn town(settings: &Settings) -> Scene {
    let folder = std::env::var_os("OVERFLY_SCENES")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/scenes"), PathBuf::from);
    let file = folder.join("nihonbashi/buildings.geojson");
    match std::fs::read(&file) {
        Ok(bytes) => read(&file.to_string_lossy(), &bytes, &settings.proxy).expect("the town can be imported").0,
        Err(cause) => {
            eprintln!("on a generated block, because there is no {} (set OVERFLY_SCENES): {cause}", file.display());
            generate_block(&ny1_size())
        }
    }
}

/// The flight of a small tree, refined for some rounds.
fn warm_path(stage: &Stage) -> Vec<Pose> {
    let problem = stage.problem();
    let stop = StopToken::default();
    let first = (0..problem.field.viewpoints.len())
        .max_by_key(|&j| problem.seen_from(j).filter(|&i| problem.is_capturable(i)).count())
        .expect("a viewpoint");
    let start = Pose { position: problem.field.viewpoints[first].position_m.into(), direction: problem.rig.pose_directions()[0] };
    let iterations = stage.settings.refine.tree_iterations;
    let tree = search(&problem, start, iterations, 1, &stop, &|_| 0, &mut |_| {}).expect("the town can be flown");
    let ground = Ground::new(&problem, &stage.settings, false, Counting::Matched, &StopToken::default());
    let mut annealing = Annealing::new(&ground, &tree.path, aim(&problem), 1);
    let [first, last] = TEMPERATURES_NS;
    for round in 0..WARM_UP {
        annealing.round(first * (last / first).powf(f64::from(round) / f64::from(WARM_UP - 1)));
    }
    annealing.best().path.clone()
}

fn aim(problem: &Problem) -> Aim {
    Aim::LeastTime { required: Worth { captured: problem.sufficient, matched: problem.enough_matched(MATCHED_PERCENT) } }
}

/// Items are changes as they are drawn; some are given up before anything is looked at, because they are not possible at that waypoint.
#[divan::bench(args = RIGS, sample_count = 20, sample_size = 1)]
fn tried_changes(bencher: Bencher, rig: &str) {
    let stage = stage(rig);
    let problem = stage.problem();
    let ground = Ground::new(&problem, &stage.settings, false, Counting::Matched, &StopToken::default());
    bench_changes(bencher, &ground, stage);
}

/// The same where only every fourth sample counts, as in the first half of the rounds.
#[divan::bench(args = RIGS, sample_count = 20, sample_size = 1)]
fn tried_changes_on_few_samples(bencher: Bencher, rig: &str) {
    let stage = stage(rig);
    let problem = stage.problem();
    let ground = Ground::new(&problem, &stage.settings, false, Counting::Matched, &StopToken::default()).thinned(FEWER);
    bench_changes(bencher, &ground, stage);
}

fn bench_changes(bencher: Bencher, ground: &Ground, stage: &Stage) {
    let seed = AtomicU64::new(1);
    bencher
        .with_inputs(|| Annealing::new(ground, &stage.path, aim(ground.problem), seed.fetch_add(1, Ordering::Relaxed)))
        .counter(ItemsCount::new(MOVES))
        .bench_local_refs(|annealing| ONE_CORE.install(|| annealing.round(TEMPERATURES_NS[1])));
}

/// Items are flights: all images of all waypoints and legs are looked at by rays, counted and timed, as it would be for each change if the
/// flight were not kept up to date.
#[divan::bench(args = RIGS, sample_count = 50, sample_size = 1)]
fn flights_from_nothing(bencher: Bencher, rig: &str) {
    let stage = stage(rig);
    let problem = stage.problem();
    let ground = Ground::new(&problem, &stage.settings, false, Counting::Matched, &StopToken::default());
    bencher
        .counter(ItemsCount::new(1u32))
        .bench_local(|| ONE_CORE.install(|| Annealing::new(&ground, &stage.path, aim(&problem), 1).best().duration_ns));
}
