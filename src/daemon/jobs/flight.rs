//! Planning flights.

use std::time::{Duration, Instant};

use overfly_wire::{ProgressNote, Stage};

use super::{Assignment, Failure, Flight, MOST_PAUSE, NewsKind, PlannedFlight, Workshop, attend, threads};
use crate::daemon::scenes::Cause;
use crate::planner::{self, Conduct, Made, PlanError, PlanOptions, Progress, en_route};
use crate::trajectory::plan::{RunTimes, StopReason};

/// Shortest time between two progress notes.
const NOTE_GAP: Duration = Duration::from_millis(25);

impl Workshop {
    pub(super) fn plan_flight(&self, assignment: &Assignment, mut flight: Flight) -> Result<PlannedFlight, Failure> {
        let started = Instant::now();
        let mut record = flight.record.take();
        let flight = &flight;
        let (mut noted, mut searched) = (None::<Instant>, started);
        let mut on_progress = |progress: &Progress| {
            searched = Instant::now();
            let last = progress.iteration >= progress.iterations;
            if last || noted.is_none_or(|time| searched - time >= NOTE_GAP) {
                noted = Some(searched);
                self.post(assignment, NewsKind::Progress(note(assignment, progress)));
            }
        };
        let mut on_interim = |Made { plan, record }: Made| {
            let times = times(assignment, flight, started, Instant::now());
            let is_first = plan.stop == StopReason::Repaired;
            let (attended, done) = attend();
            self.post(assignment, NewsKind::Interim(PlannedFlight::of(Made { plan, record }, times, None), attended));
            // The search that follows takes all cores: it waits until the first safe plan is out.
            if is_first {
                let _ = done.recv_timeout(MOST_PAUSE);
            }
        };
        let mut options = flight.options.clone();
        if let Some((under_way, en_route)) = flight.under_way.as_ref().zip(options.en_route.as_mut()) {
            let evaluated = under_way.evaluate(en_route, &assignment.stop).ok_or(Failure::Stopped)?;
            self.post(assignment, NewsKind::Evaluated(Box::new(evaluated)));
        }
        // Nobody stands back before there is a flight.
        let pool = options.earlier.as_ref().and_then(|_| self.search_pools.take());
        let mut search = |options: &PlanOptions| {
            let conduct = Conduct {
                stop: &assignment.stop,
                on_progress: &mut on_progress,
                on_interim: &mut on_interim,
                search_threads: pool.as_deref(),
            };
            planner::replan(&flight.snapshot, &flight.settings, options, record.take(), conduct)
        };
        let (Made { plan, record }, remark) = match (search(&options), flight.cause) {
            // The start is that of an earlier order, and nobody asked for it in the scene as it is now.
            (Err(error @ PlanError::Start { .. }), Cause::Edit) => {
                let remark = format!("since an edit {}; another start was chosen", without_remedy(&error));
                (search(&PlanOptions { start_m: None, ..options.clone() })?, Some(remark))
            }
            (made, _) => (made?, short_sight(flight)),
        };
        let remarks: Vec<String> = en_route::remark(&plan).into_iter().chain(remark).collect();
        let remark = (!remarks.is_empty()).then(|| remarks.join("; "));
        let times = times(assignment, flight, started, searched);
        Ok(PlannedFlight::of(Made { plan, record }, times, remark))
    }
}

/// What a plan took whose search ended at `searched`.
fn times(assignment: &Assignment, flight: &Flight, started: Instant, searched: Instant) -> RunTimes {
    RunTimes {
        field_s: flight.field_s,
        search_s: (searched - started).as_secs_f64(),
        check_s: searched.elapsed().as_secs_f64(),
        total_s: assignment.taken_up.elapsed().as_secs_f64(),
        threads: threads(),
    }
}

fn note(assignment: &Assignment, progress: &Progress) -> ProgressNote {
    ProgressNote {
        stage: Stage::Search,
        done: progress.iteration,
        of: progress.iterations,
        coverage_percent: progress.coverage_percent,
        length_m: progress.length_m,
        objective: progress.objective,
        elapsed_s: assignment.taken_up.elapsed().as_secs_f64(),
    }
}

/// What there is to say when the field was built for cameras of another sight than the rig's.
fn short_sight(flight: &Flight) -> Option<String> {
    let rig = &flight.options.rig;
    let (has, needs) = (flight.settings.coverage.sight_scale, rig.sight_scale());
    (has != needs).then(|| {
        format!(
            "the field was built for cameras that see {has} times as far as the reference, those of {:?} see {needs} times as far; \
             `overfly serve --rig` builds fields for it",
            rig.name
        )
    })
}

/// What an error says, without what to do about it: that is done already.
fn without_remedy(error: &PlanError) -> String {
    let text = error.to_string();
    text.split(';').next().unwrap_or_default().to_owned()
}
