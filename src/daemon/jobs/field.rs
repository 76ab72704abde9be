//! Building fields; after an edit with the first safe plan before.

use std::time::{Duration, Instant};

use overfly_table::Block;

use super::{
    Assignment, BuiltField, FIELD_NOTE_GAP, Failure, FieldSource, FlightBefore, MOST_PAUSE, NewsKind, PlannedFlight, Workshop,
    attend, threads,
};
use crate::daemon::field_channel::FieldChannel;
use crate::planner::{self, PlanError};
use crate::session::{Cleared, Session, Snapshot};
use crate::stop::Part;
use crate::trajectory::plan::RunTimes;

impl Workshop {
    pub(super) fn build_field(
        &self,
        assignment: &Assignment,
        source: FieldSource,
        channel: &FieldChannel,
    ) -> Result<BuiltField, Failure> {
        let started = Instant::now();
        let mut aside = Duration::ZERO;
        let stop = &assignment.stop;
        // After most edits the field stands before anybody could read how far it has come, and whoever tells of it takes processor from it.
        let is_anew = matches!(source, FieldSource::Scene(..));
        let (session, survey) = match source {
            FieldSource::Scene(scene, settings) => self.tell_while(assignment, Part::Survey, || {
                let session = Session::new(*scene, settings, stop)?;
                let survey = session.survey(stop)?;
                Ok::<_, Failure>((session, survey))
            })?,
            FieldSource::Edited { session, earlier, flight } => {
                let cleared = session.cleared_after(&earlier, stop)?;
                let paused = Instant::now();
                if let Some(flight) = flight {
                    self.fly_on(assignment, &session, &earlier, &cleared, &flight)?;
                }
                aside = paused.elapsed();
                let survey = session.survey_of(cleared, &earlier, stop)?;
                (*session, survey)
            }
        };
        let is_told = is_anew || started.elapsed() >= FIELD_NOTE_GAP;
        let reserve = |count: usize| self.budget.reserve((count * Block::BYTES) as u64);
        let place = |count: usize, write: &dyn Fn(&mut [Block])| Ok(channel.segment(count, reserve(count)?, write)?);
        let build = || survey.build::<Failure>(&place, stop);
        let findings = if is_told { self.tell_while(assignment, Part::Rays, build) } else { build() }?;
        let count = findings.blocks();
        let filled = channel.fill(count, reserve(count)?, |blocks| findings.write(blocks))?;
        if stop.is_stopped() {
            return Err(Failure::Stopped);
        }
        Ok(BuiltField { session, findings, filled, field_s: (started.elapsed() - aside).as_secs_f64() })
    }

    /// Hands out what can be flown of the flight before in a scene without a field. Where that is nothing, whoever plans on the field says why.
    fn fly_on(
        &self,
        assignment: &Assignment,
        session: &Session,
        earlier: &Snapshot,
        cleared: &Cleared,
        FlightBefore { options, safe }: &FlightBefore,
    ) -> Result<(), Failure> {
        let started = Instant::now();
        match planner::safe(earlier, cleared, session.settings(), options, safe.as_ref(), &assignment.stop) {
            Ok(Some((plan, flight))) => {
                let times = RunTimes {
                    check_s: started.elapsed().as_secs_f64(),
                    total_s: assignment.taken_up.elapsed().as_secs_f64(),
                    threads: threads(),
                    ..RunTimes::default()
                };
                let (attended, done) = attend();
                let planned = PlannedFlight { plan, times, record: None, safe: Some(flight), remark: None };
                self.post(assignment, NewsKind::Safe(planned, attended));
                // What follows takes all cores: it waits until the plan is out.
                let _ = done.recv_timeout(MOST_PAUSE);
                Ok(())
            }
            Err(PlanError::Abandoned) => Err(Failure::Stopped),
            Ok(None) | Err(_) => Ok(()),
        }
    }
}
