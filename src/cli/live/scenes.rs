//! What pages show: a scene with its plan, and the plan before an edit beside it.

use overfly_client::PlanMessage;
use overfly_table::FieldTable;
use serde_json::json;

use crate::mission::page::{self, Flight, Live, Scene3d, Sighted};
use crate::mission::plan_table::{self, PlanTableError};
use crate::trajectory::plan::StopReason;

/// The scene and the plans that are on the stage.
#[derive(Default)]
pub struct Stage {
    set: Option<Set>,
    plan: Option<Act>,
    /// The last plan of the scene before.
    before: Option<Act>,
}

/// What is shown of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    Path,
    /// And what it captures.
    Everything,
}

/// A scene, and the field that it comes from: the daemon and the number of the table.
struct Set {
    field: (u64, u64),
    revision: u64,
    scene: Scene3d,
}

/// A plan with the scene that it was made in.
struct Act {
    epoch: u64,
    revision: u64,
    /// A better one follows.
    is_interim: bool,
    flight: Flight,
    scene: Scene3d,
}

impl Stage {
    /// The field of the scene that is shown: the daemon, and the number of the table.
    pub fn field(&self) -> Option<(u64, u64)> {
        self.set.as_ref().map(|set| set.field)
    }

    /// Puts a plan on the stage, or the word that there is none, with the field that it was made on; gives what pages are to show. What the plan
    /// captures takes longer to find out than the plan has taken.
    pub fn plan(
        &mut self,
        number: (u64, u64),
        field: &FieldTable,
        message: &PlanMessage,
        detail: Detail,
    ) -> Result<Vec<u8>, PlanTableError> {
        let scene = self.set(number, field, message.scene()).scene.clone();
        if message.infeasible().is_none() {
            let (plan, _) = plan_table::from_table(&message.table())?;
            let is_interim = matches!(plan.stop, StopReason::Safe | StopReason::Repaired | StopReason::Improved);
            let sighted = if detail == Detail::Path { None } else { Sighted::by_field(field, &plan, None).ok() };
            let label = format!("plan {} of revision {}", message.epoch(), plan.scene.revision);
            let flight = page::flight(&label, &plan, sighted);
            let act = Act { epoch: message.epoch(), revision: plan.scene.revision, is_interim, flight, scene };
            self.enter(act);
        }
        Ok(self.state(message.infeasible()))
    }

    /// Shows a scene of which there is no plan.
    pub fn scene(&mut self, number: (u64, u64), field: &FieldTable, name: &str) -> Vec<u8> {
        self.set(number, field, name);
        (self.plan, self.before) = (None, None);
        self.state(None)
    }

    fn set(&mut self, number: (u64, u64), field: &FieldTable, name: &str) -> &Set {
        let known = self.set.take().filter(|set| set.field == number);
        self.set.insert(known.unwrap_or_else(|| {
            let revision = field.facts.revision;
            Set { field: number, revision, scene: Scene3d::of_field(field).called(name, revision) }
        }))
    }

    /// The plan before stays beside all that follow from one edit, the interim ones as well; not beside those of another file that was loaded
    /// under the same name.
    fn enter(&mut self, act: Act) {
        for stale in [&mut self.plan, &mut self.before] {
            stale.take_if(|stale| !stale.scene.is_in_frame_of(&act.scene));
        }
        let (epoch, revision) = (act.epoch, act.revision);
        let last = self.plan.replace(act);
        if last.as_ref().is_some_and(|last| last.epoch != epoch && (last.revision != revision || !last.is_interim)) {
            self.before = last;
        }
    }

    fn state(&self, infeasible: Option<&str>) -> Vec<u8> {
        let Some(set) = &self.set else { return Vec::new() };
        // Where nothing can be flown, the plan before shows why not.
        let beside = |act: &Act| act.flight.clone().through(act.scene.clone());
        let flights: Vec<Flight> = self.plan.iter().map(beside).chain(self.before.iter().map(beside)).collect();
        let epoch = self.plan.as_ref().filter(|_| infeasible.is_none()).map(|plan| plan.epoch);
        let is_interim = self.plan.as_ref().is_some_and(|plan| plan.is_interim);
        let head = json!({ "revision": set.revision, "epoch": epoch, "is_interim": is_interim, "infeasible": infeasible });
        let head = head.to_string();
        // The page's data are JSON already.
        [&head.as_bytes()[..head.len() - 1], b",\"page\":", &page::data(&set.scene, &flights), b"}"].concat()
    }
}

/// The page, and what a browser lets it do. Only scripts that name `nonce` run; all else that it needs comes with it, or from the server that it came
/// from.
pub fn page(scene: &str, token: &str, nonce: &str) -> (Vec<u8>, String) {
    let data = page::data(&Scene3d::empty(scene, None), &[]);
    let html = page::html(&data, Some(&Live { token: token.to_owned() }));
    let html = String::from_utf8_lossy(&html);
    // Lines of their own; within the page's scripts there are none such.
    let named = ["<script>", "<script type=\"module\">"].iter().fold(html.into_owned(), |html, tag| {
        let with_nonce = tag.replacen("<script", &format!("<script nonce=\"{nonce}\""), 1);
        html.replace(&format!("\n{tag}\n"), &format!("\n{with_nonce}\n"))
    });
    let policy = format!(
        "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'unsafe-inline'; img-src data:; connect-src 'self'; base-uri 'none'; \
         form-action 'none'; frame-ancestors 'none'"
    );
    (named.into_bytes(), policy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_script_of_the_page_has_the_nonce_and_the_page_the_token() {
        let (html, policy) = page("a <town>", "7ea5e7", "0ddba11");
        let html = String::from_utf8(html).unwrap();
        let lines: Vec<&str> = html.lines().filter(|line| line.starts_with("<script")).collect();
        let (data, scripts): (Vec<&str>, Vec<&str>) = lines.into_iter().partition(|line| line.contains("application/json"));
        assert!(data.len() == 2 && scripts.len() >= 2, "{data:?} {scripts:?}");
        assert!(scripts.iter().all(|script| script.contains("nonce=\"0ddba11\"")), "{scripts:?}");
        assert!(html.contains("\"token\":\"7ea5e7\"") && !html.contains("<town>"));
        assert!(policy.contains("script-src 'nonce-0ddba11';") && !policy.contains("unsafe-eval"));
    }

    fn act(epoch: u64, revision: u64, is_interim: bool) -> Act {
        let plan = crate::mission::fixture::plan("panoramic", &[[0.0, 0.0, 30.0], [40.0, 0.0, 30.0]]);
        let flight = page::flight(&epoch.to_string(), &plan, None);
        Act { epoch, revision, is_interim, flight, scene: Scene3d::empty("town", None).called("town", revision) }
    }

    #[test]
    fn the_plan_before_an_edit_stays_beside_all_that_follow_from_it() {
        let mut stage = Stage::default();
        let mut beside = |epoch, revision, is_interim| {
            stage.set =
                Some(Set { field: (1, revision), revision, scene: Scene3d::empty("town", None).called("town", revision) });
            stage.enter(act(epoch, revision, is_interim));
            let state: serde_json::Value = serde_json::from_slice(&stage.state(None)).unwrap();
            assert_eq!((state["epoch"].as_u64(), state["revision"].as_u64()), (Some(epoch), Some(revision)));
            let flights = state["page"]["flights"].as_array().unwrap();
            flights.iter().map(|flight| flight["label"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
        };
        assert_eq!(beside(1, 1, false), ["1"]);
        // The path first, then what it captures.
        assert_eq!([beside(2, 2, true), beside(2, 2, true)], [["2", "1"], ["2", "1"]]);
        assert_eq!([beside(3, 2, true), beside(4, 2, false)], [["3", "1"], ["4", "1"]]);
        assert_eq!(beside(5, 3, true), ["5", "4"]);
        assert_eq!(beside(6, 4, true), ["6", "5"], "an edit that came before the search had ended");
        assert_eq!([beside(7, 4, false), beside(8, 4, false)], [["7", "5"], ["8", "7"]], "another order in the same scene");
    }

    #[test]
    fn plans_in_different_frames_do_not_stand_beside_each_other() {
        let at = |lat_deg| Some(crate::frame::Geodetic { lat_deg, lon_deg: 4.0, alt_m: 0.0 });
        let mut stage =
            Stage { set: Some(Set { field: (1, 1), revision: 1, scene: Scene3d::empty("town", None) }), ..Stage::default() };
        for (epoch, lat_deg, beside) in [(1, 51.0, 1), (2, 51.0, 2), (3, 52.0, 1), (4, 52.0, 2)] {
            stage.enter(Act { scene: Scene3d::empty("town", at(lat_deg)), ..act(epoch, 1, false) });
            let state: serde_json::Value = serde_json::from_slice(&stage.state(None)).unwrap();
            assert_eq!(state["page"]["flights"].as_array().map(Vec::len), Some(beside), "{epoch}");
        }
    }

    #[test]
    fn where_nothing_can_be_flown_the_plan_before_shows_why() {
        let mut stage =
            Stage { set: Some(Set { field: (1, 2), revision: 2, scene: Scene3d::empty("town", None) }), ..Stage::default() };
        stage.enter(act(1, 1, false));
        let state: serde_json::Value = serde_json::from_slice(&stage.state(Some("no way \"out\""))).unwrap();
        assert_eq!((&state["infeasible"], &state["epoch"]), (&"no way \"out\"".into(), &serde_json::Value::Null));
        assert_eq!(state["page"]["flights"].as_array().map(Vec::len), Some(1));
    }
}
