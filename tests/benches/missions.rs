//! What each writer takes for a plan of a thousand waypoints; every one of them was to take 50 ms at most.
//!
//! Sorties are written one after the other, as `overfly export` does. Coverage models are made of samples and not of waypoints: they are not here.

use std::sync::{Arc, LazyLock};

use divan::{Bencher, black_box};
use overfly::camera::Rig;
use overfly::mission::course::{Altitudes, Course, CourseOptions, Ground, Sortie};
use overfly::mission::mav_items::Autopilot;
use overfly::mission::{colmap, dji, footprints, geojson, kml, litchi, plan_json, qgc, svg, tables, waypoints};
use overfly::planner::{Method, PlanOptions, StopToken, plan};
use overfly::quality::Which;
use overfly::scene::{BlockSettings, generate_block};
use overfly::session::{Session, Snapshot};
use overfly::settings::Settings;
use overfly::trajectory::plan::Plan;

const WAYPOINTS: usize = 1000;

fn main() {
    let (plan, sorties) = (&FLOWN.plan, FLOWN.course.sorties.len());
    println!("{} waypoints, {} images, {sorties} sorties", plan.waypoints.len(), plan.images.len());
    divan::main();
}

struct Flown {
    snapshot: Snapshot,
    plan: Plan,
    course: Course,
}

/// A flight that stops at each of its views has the most waypoints: over the smallest quarter where they are enough.
static FLOWN: LazyLock<Flown> = LazyLock::new(|| {
    let (settings, stop) = (Settings::default(), StopToken::default());
    let options = PlanOptions::new(Rig::preset("phantom4-rtk").expect("a preset"), Method::Zhou, 1);
    let flown = |side: u32| {
        let side_m = 150.0 * f64::from(side);
        let block = BlockSettings { extent_m: [side_m; 2], buildings: 15 * side * side, ..BlockSettings::default() };
        let session = Session::new(generate_block(&block), Arc::new(settings.clone()), &stop).expect("it can be surveyed");
        let snapshot = session.survey(&stop).and_then(|survey| survey.into_snapshot(&stop)).expect("nobody stops it");
        let plan = plan(&snapshot, &settings, &options, &stop, &mut |_| {}).expect("it can be flown");
        (snapshot, plan)
    };
    let is_enough = |(_, plan): &(Snapshot, Plan)| plan.waypoints.len() >= WAYPOINTS;
    let (snapshot, plan) = (2..).map(flown).find(is_enough).expect("every side is tried");
    let course = Course::new(&plan, Some(&snapshot.free), &CourseOptions::default()).expect("there is room for a take-off");
    Flown { snapshot, plan, course }
});

fn sorties(bencher: Bencher, write: impl Fn(&Course, &Sortie) -> Vec<u8>) {
    let course = &FLOWN.course;
    bencher.bench_local(|| course.sorties.iter().map(|sortie| write(black_box(course), sortie).len()).sum::<usize>());
}

#[divan::bench]
fn course() -> usize {
    let course = Course::new(&FLOWN.plan, Some(&FLOWN.snapshot.free), &CourseOptions::default());
    course.expect("there is room for a take-off").sorties.len()
}

#[divan::bench]
fn qgc_plan(bencher: Bencher) {
    sorties(bencher, |course, sortie| qgc::to_bytes(course, sortie, Autopilot::Px4));
}

#[divan::bench]
fn ardupilot_waypoints(bencher: Bencher) {
    sorties(bencher, waypoints::to_bytes);
}

#[divan::bench]
fn dji_kmz(bencher: Bencher) {
    sorties(bencher, |course, sortie| dji::to_bytes(course, sortie, 0));
}

#[divan::bench]
fn litchi_csv(bencher: Bencher) {
    sorties(bencher, litchi::to_bytes);
}

#[divan::bench]
fn kml_map() -> Option<Vec<u8>> {
    kml::to_bytes(&FLOWN.plan, Which::All, Altitudes::Relative, Ground::of(Some(&FLOWN.snapshot.free)))
}

#[divan::bench]
fn geojson_map() -> Option<Vec<u8>> {
    geojson::to_bytes(&FLOWN.plan, Which::All)
}

#[divan::bench]
fn footprints_of_images() -> Option<Vec<u8>> {
    footprints::to_bytes(&FLOWN.plan, Which::All)
}

#[divan::bench]
fn csv_of_images() -> Vec<u8> {
    tables::images(&FLOWN.plan, Which::All)
}

#[divan::bench]
fn csv_of_waypoints() -> Vec<u8> {
    tables::waypoints(&FLOWN.plan)
}

#[divan::bench]
fn reality_capture_csv() -> Vec<u8> {
    tables::reality_capture(&FLOWN.plan, Which::All)
}

#[divan::bench]
fn metashape_csv() -> Vec<u8> {
    tables::metashape(&FLOWN.plan, Which::All)
}

#[divan::bench]
fn colmap_model() -> usize {
    colmap::to_files(&FLOWN.plan, Which::All).map_or(0, |files| files.len())
}

#[divan::bench]
fn plan_as_json() -> Vec<u8> {
    plan_json::to_bytes(&FLOWN.plan)
}

#[divan::bench]
fn plan_as_svg() -> usize {
    svg::to_bytes(&FLOWN.snapshot.field(), None, &FLOWN.plan).expect("they belong together").len()
}
