//! What an aircraft has reported of its flight over a scene.
//!
//! An image counts for what it saw in the scene as it was when it was reported. Casting its rays takes longer than the main loop may pause, so images
//! wait, with the snapshot that they were taken in, for the next search, which needs them first and gives back what came of them.

use std::collections::BTreeMap;
use std::sync::Arc;

use overfly_wire::{FlightReport, Refusal, RefusalCode};

use super::convert;
use super::scenes::{LastPlan, Plans};
use crate::planner::en_route::{self, EnRoute};
use crate::planner::{PlanOptions, StopToken};
use crate::search::captured::Captured;
use crate::session::Snapshot;
use crate::trajectory::plan::Image;

/// A flight that is under way.
#[derive(Debug)]
pub struct Flown {
    /// What the images capture that rays were cast for.
    captured: Arc<Captured>,
    /// Images that wait for that, in the order in which they were taken.
    waiting: Vec<Taken>,
    /// How many images of each plan were taken, by its epoch.
    taken: BTreeMap<u64, usize>,
    report: FlightReport,
}

/// Images that were taken in one state of a scene.
#[derive(Clone)]
pub struct Taken {
    snapshot: Snapshot,
    images: Vec<Image>,
}

/// What a search has to know of a flight that is under way.
#[derive(Clone, Debug)]
pub struct UnderWay {
    captured: Arc<Captured>,
    waiting: Vec<Taken>,
}

/// What images capture that rays have been cast for.
#[derive(Debug)]
pub struct Evaluated {
    captured: Captured,
    /// What it was before.
    before: Arc<Captured>,
    /// How many images of each state that waited.
    counts: Vec<usize>,
}

impl Flown {
    /// The flight after a report: the one before, if there is one, with what is new. Nothing changes when it is refused.
    pub fn after(before: Option<&Self>, report: &FlightReport, plans: &Plans, snapshot: &Snapshot) -> Result<Self, Refusal> {
        let mut flown = match before {
            Some(before) => Self {
                captured: Arc::clone(&before.captured),
                waiting: before.waiting.clone(),
                taken: before.taken.clone(),
                report: report.clone(),
            },
            None => Self { captured: Arc::default(), waiting: Vec::new(), taken: BTreeMap::new(), report: report.clone() },
        };
        let last = (report.epoch == 0).then(|| plans.last()).flatten();
        match last.or_else(|| plans.of_epoch(report.epoch)) {
            Some(flown_plan) => flown.take(flown_plan, report, snapshot)?,
            None if report.epoch == 0 && report.images_taken == 0 => {}
            None => return Err(unknown_plan(report, plans)),
        }
        Ok(flown)
    }

    fn take(&mut self, flown_plan: &LastPlan, report: &FlightReport, snapshot: &Snapshot) -> Result<(), Refusal> {
        let plan = &flown_plan.plan;
        let epoch = flown_plan.header.epoch;
        self.report.epoch = epoch;
        let known = self.taken.get(&epoch).copied().unwrap_or(0);
        let now = usize::try_from(report.images_taken).unwrap_or(usize::MAX);
        if !(known..=plan.images.len()).contains(&now) {
            let most = plan.images.len();
            let message =
                format!("{now} images of plan {epoch} are reported as taken; it has {most}, and {known} were taken before");
            return Err(Refusal::new(RefusalCode::Invalid, message));
        }
        self.taken.insert(epoch, now);
        let images = &plan.images[known..now];
        match self.waiting.last_mut().filter(|taken| taken.snapshot.revision == snapshot.revision) {
            _ if images.is_empty() => {}
            Some(taken) => taken.images.extend_from_slice(images),
            None => self.waiting.push(Taken { snapshot: snapshot.clone(), images: images.to_vec() }),
        }
        Ok(())
    }

    /// The epoch of the plan that is flown; 0 for none.
    pub fn epoch(&self) -> u64 {
        self.report.epoch
    }

    pub fn under_way(&self) -> UnderWay {
        UnderWay { captured: Arc::clone(&self.captured), waiting: self.waiting.clone() }
    }

    /// What is planned goes on from where the aircraft is, with what is left of the plan that it flies.
    pub fn go_on(&self, options: &mut PlanOptions, plans: &Plans) {
        let plan = plans.of_epoch(self.report.epoch).map(|flown_plan| &flown_plan.plan);
        let taken = self.taken.get(&self.report.epoch).copied().unwrap_or(0);
        (options.start_m, options.start_view) = (None, None);
        options.earlier = plan.map(|plan| en_route::waypoints_left(plan, taken));
        options.en_route = Some(convert::en_route(&self.report));
    }

    /// Takes over what a search has found out about images; nothing when another one was sooner.
    pub fn note(&mut self, Evaluated { captured, before, counts }: Evaluated) {
        if !Arc::ptr_eq(&self.captured, &before) {
            return;
        }
        self.captured = Arc::new(captured);
        for (taken, count) in self.waiting.iter_mut().zip(counts) {
            taken.images.drain(..count);
        }
        self.waiting.retain(|taken| !taken.images.is_empty());
    }
}

impl UnderWay {
    /// Casts the rays of the images that wait; `None` when abandoned. What a search goes on with is put into `en_route`.
    pub fn evaluate(&self, en_route: &mut EnRoute, stop: &StopToken) -> Option<Evaluated> {
        let mut captured = Captured::clone(&self.captured);
        for Taken { snapshot, images } in &self.waiting {
            en_route::add_images(&mut captured, snapshot, images, stop)?;
        }
        en_route.captured = Arc::new(captured.clone());
        let counts = self.waiting.iter().map(|taken| taken.images.len()).collect();
        Some(Evaluated { captured, before: Arc::clone(&self.captured), counts })
    }
}

impl std::fmt::Debug for Taken {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} images at revision {}", self.images.len(), self.snapshot.revision)
    }
}

fn unknown_plan(report: &FlightReport, plans: &Plans) -> Refusal {
    let epoch = report.epoch;
    let known = match plans.last() {
        Some(last) => format!("the last one is {}", last.header.epoch),
        None => "none has been published".into(),
    };
    let message =
        format!("plan {epoch} of this scene is not known, or not any more; {known}: report the plan that is flown by its epoch");
    Refusal::new(RefusalCode::Invalid, message)
}
