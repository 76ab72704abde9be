//! A simulated flight with edits on its way: the aircraft reports what it has captured, the daemon plans what is left, from where it is.

mod served;
mod support;

use std::sync::Arc;

use geo::{LineString, Polygon};
use overfly::mission::plan_table;
use overfly::planner::StopToken;
use overfly::scene::edit::Edit;
use overfly::scene::{self, StructureId};
use overfly::search::Problem;
use overfly::session::{Session, Snapshot};
use overfly::settings::Settings;
use overfly::trajectory::evaluate;
use overfly::trajectory::plan::{Image, Plan};
use overfly_client::{Client, EditOrder, FlightReport, PlanMessage, PlanOrder, RefusalCode, SceneSource};
use served::{PATIENCE, Served, block, refusal};
use support::{snapshot, snapshot_after};

const GOAL_PERCENT: f64 = 85.0;

fn order() -> PlanOrder {
    PlanOrder { iterations: Some(24), goal_percent: Some(GOAL_PERCENT), ..PlanOrder::default() }
}

fn plan_of(message: &PlanMessage) -> Plan {
    plan_table::from_table(&message.table()).unwrap().0
}

/// What an aircraft reports that has taken so many images of a plan and is where the last one of them was taken.
fn report(plan: &Plan, epoch: u64, taken: usize) -> FlightReport {
    let passage = plan.profile().unwrap().at(plan.images[taken - 1].time_s).unwrap();
    FlightReport {
        epoch,
        images_taken: taken as u64,
        position_m: passage.position_m.into(),
        velocity_mps: passage.velocity_mps.into(),
        ..FlightReport::default()
    }
}

/// The session that the daemon has of the block, computed once more.
fn session_of(source: &SceneSource) -> (Session, Settings) {
    let SceneSource::Bytes { file_name, bytes } = source else { panic!("the block is sent") };
    let mut settings = Settings::default();
    (settings.surface.samples, settings.field.viewpoints) = (150, 200);
    let (scene, _) = scene::read(file_name, bytes, &settings.proxy).unwrap();
    (Session::new(scene, Arc::new(settings.clone()), &StopToken::default()).unwrap(), settings)
}

/// Cells of each sample of one state that images cover which were taken in another one, where the structure is the same.
fn cover(cells: &mut [u128], of: &Snapshot, taken_in: &Snapshot, images: &[Image]) {
    let sightings = evaluate::sightings(taken_in, &taken_in.disks, images, &StopToken::default()).unwrap();
    let (old, new) = (taken_in.field(), of.field());
    for (row, structure) in new.structures.iter().zip(&of.scene.structures) {
        let same = taken_in.scene.structures.iter().position(|known| Arc::ptr_eq(known, structure));
        let Some(first) = same.map(|index| old.structures[index].first_sample) else { continue };
        for k in 0..row.samples {
            let union = sightings.0[(first + k) as usize].iter().fold(0, |union, one| union | one.mask);
            let i = (row.first_sample + k) as usize;
            cells[i] |= if new.samples[i].exposed == 1 { union } else { 0 };
        }
    }
}

#[test]
fn a_flight_with_edits_on_its_way_captures_as_much_and_nothing_twice() {
    let served = Served::start();
    let pilot = served.client();
    let source = block(1, 9);
    let (mut session, settings) = session_of(&source);
    pilot.load(source, Some("block"), &mut |_| {}).unwrap();
    let message = pilot.plan("block", &order(), &mut |_| {}).unwrap();
    let whole = plan_of(&message);
    assert!(whole.metrics.coverage_percent >= GOAL_PERCENT, "{:?}", whole.metrics);

    let mut structures = pilot.structures("block").unwrap();
    structures.sort_by(|a, b| b.top_m.total_cmp(&a.top_m));
    let highest: Vec<(String, u64)> = structures.iter().take(2).map(|known| (known.name.clone(), known.id)).collect();
    let changes = [
        (
            EditOrder::Raise { structure: highest[0].0.clone(), by_m: 4.0 },
            Edit::Raise { id: StructureId(highest[0].1), by_m: 4.0 },
        ),
        (
            EditOrder::Lower { structure: highest[1].0.clone(), by_m: 3.0 },
            Edit::Lower { id: StructureId(highest[1].1), by_m: 3.0 },
        ),
        added(&session),
    ];
    let mut states = vec![snapshot(&session)];
    let mut parts: Vec<Vec<Image>> = Vec::new();
    let (mut plan, mut epoch) = (whole.clone(), message.epoch());
    for (change, edit) in changes {
        let taken = plan.images.len() / 3;
        parts.push(plan.images[..taken].to_vec());
        let here = report(&plan, epoch, taken);
        pilot.report("block", &here).unwrap();
        let edited = pilot.edit("block", &change).unwrap();
        session.apply(&edit).unwrap();
        let next = snapshot_after(&session, states.last().unwrap());
        states.push(next);
        let message = pilot.await_replan(&edited, PATIENCE, &mut |_| {}).unwrap();
        (plan, epoch) = (plan_of(&message), message.epoch());
        let start = plan.profile().unwrap().at(0.0).unwrap();
        assert_eq!(<[f64; 3]>::from(start.position_m), here.position_m);
        assert!((start.velocity_mps - nalgebra::Vector3::from(here.velocity_mps)).norm() < 1e-6, "{start:?} after {here:?}");
    }
    parts.push(plan.images.clone());

    // What the daemon says is captured is what these images capture, each in the state of the scene that it was taken in.
    let last = states.last().unwrap();
    let mut cells = vec![0u128; last.field().samples.len()];
    states.iter().zip(&parts).for_each(|(state, images)| cover(&mut cells, last, state, images));
    let counted: Vec<u16> = cells.iter().map(|cells| cells.count_ones() as u16).collect();
    assert_eq!(plan.cells, counted);
    assert!(plan.metrics.coverage_percent >= GOAL_PERCENT, "{:?}", plan.metrics);

    // Of the structures that nobody has edited as large a share is captured as by the flight without edits.
    let share = |state: &Snapshot, cells: &[u16]| {
        let problem = Problem::new(state, &settings, overfly::camera::Rig::preset("panoramic").unwrap());
        let threshold = state.field().facts.threshold_cells;
        let untouched = |i: usize| {
            let structure = &state.scene.structures[state.field().samples[i].structure as usize];
            last.scene.structure(structure.id).is_some_and(|now| Arc::ptr_eq(now, structures_of(&states, structure.id)))
        };
        let counts: Vec<usize> = (0..cells.len()).filter(|&i| problem.is_capturable(i) && untouched(i)).collect();
        100.0 * counts.iter().filter(|&&i| u32::from(cells[i]) > threshold).count() as f64 / counts.len() as f64
    };
    let [before, after] = [share(&states[0], &whole.cells), share(last, &plan.cells)];
    assert!(after >= before.min(GOAL_PERCENT), "{after} % of what nobody edited, {before} % without edits");

    let taken: Vec<&Image> = parts.iter().flatten().collect();
    for (k, image) in taken.iter().enumerate() {
        let nearest_m = taken[..k].iter().map(|old| (old.position_m - image.position_m).norm()).fold(f64::INFINITY, f64::min);
        assert!(nearest_m > 0.5, "image {k} of {} is taken {nearest_m} m from an earlier one", taken.len());
    }
    let whole_s = whole.metrics.profile_s;
    let flown_s: f64 = plan.metrics.profile_s;
    println!(
        "{} images in {} parts, {before:.1} and {after:.1} %; {whole_s:.0} s, the last part {flown_s:.0} s",
        taken.len(),
        parts.len()
    );
}

/// A structure as it was in the first state.
fn structures_of(states: &[Snapshot], id: StructureId) -> &Arc<overfly::scene::Structure> {
    states.iter().find_map(|state| state.scene.structure(id)).expect("it was in one of them")
}

/// A shed at the edge of the block, as an order and as an edit.
fn added(session: &Session) -> (EditOrder, Edit) {
    let bounds = session.scene().bounds().unwrap();
    let [x, y] = [bounds.max.x + 4.0, bounds.min.y];
    let outline_m = vec![[x, y], [x + 9.0, y], [x + 9.0, y + 9.0], [x, y + 9.0]];
    let ring: LineString = outline_m.iter().map(|&[x, y]| (x, y)).collect();
    let footprint = Polygon::new(ring, Vec::new());
    (EditOrder::add_prism("shed", outline_m, 0.0, 6.0), Edit::add_prism("shed", footprint, 0.0, 6.0))
}

#[test]
fn reports_that_cannot_be_true_change_nothing() {
    let served = Served::start();
    let pilot = served.client();
    pilot.load(block(1, 9), Some("block"), &mut |_| {}).unwrap();
    let pose = FlightReport { position_m: [0.0, 0.0, 60.0], ..FlightReport::default() };
    let code = |client: &Client, report: FlightReport| refusal(client.report("block", &report)).0;
    assert_eq!(code(&pilot, FlightReport { images_taken: 1, ..pose.clone() }), RefusalCode::Invalid, "there is no plan yet");
    let message = pilot.plan("block", &PlanOrder { iterations: Some(4), ..order() }, &mut |_| {}).unwrap();
    let plan = plan_of(&message);
    let here = report(&plan, message.epoch(), 4);
    pilot.report("block", &here).unwrap();
    for wrong in [
        FlightReport { images_taken: 3, ..here.clone() },
        FlightReport { images_taken: plan.images.len() as u64 + 1, ..here.clone() },
        FlightReport { images_taken: u64::MAX, ..here.clone() },
        FlightReport { epoch: 1 << 40, ..here.clone() },
        FlightReport { velocity_mps: [f64::NAN; 3], ..here.clone() },
    ] {
        assert_eq!(code(&pilot, wrong.clone()), RefusalCode::Invalid, "{wrong:?}");
    }
    assert_eq!(refusal(pilot.report("nowhere", &here)).0, RefusalCode::UnknownScene);
    // Told once more, it is still the same flight; so it is by the order itself.
    pilot.report("block", &here).unwrap();
    let on = PlanOrder { en_route: Some(here.clone()), iterations: Some(4), ..order() };
    let on = plan_of(&pilot.plan("block", &on, &mut |_| {}).unwrap());
    assert_eq!(<[f64; 3]>::from(on.waypoints[0].position_m), here.position_m);
    let landing_m = Some(plan.waypoints.last().unwrap().position_m.into());
    let late = FlightReport { time_left_s: Some(0.5), landing_m, epoch: 0, images_taken: 0, ..here };
    let late = PlanOrder { en_route: Some(late), iterations: Some(4), ..order() };
    let (code, message) = refusal(pilot.plan("block", &late, &mut |_| {}));
    assert_eq!(code, RefusalCode::Land, "{message}");
    // Without a report another flight begins.
    let again = plan_of(&pilot.plan("block", &PlanOrder { iterations: Some(4), ..order() }, &mut |_| {}).unwrap());
    assert_eq!(again.waypoints, plan.waypoints);
}
