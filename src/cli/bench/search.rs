//! The tree search on a scene's field.

use std::time::Instant;

use serde_json::json;

use super::{Report, Row, field, given};
use crate::cli::answer::Form;
use crate::cli::arguments::BenchArgs;
use crate::cli::failure::Failure;
use crate::cli::in_process;
use crate::cli::progress::Meter;
use crate::planner::{self, Method, PlanOptions, StopToken};

pub fn run(arguments: &BenchArgs, form: Form) -> Result<Report, Failure> {
    let (rig, settings) = given(arguments)?;
    let stop = StopToken::default();
    let mut meter = Meter::new(form);
    let (scene, _) = in_process::read_scene(&arguments.file, &settings)?;
    let snapshot = in_process::build_field(scene, &settings, &stop, &mut meter)?;
    let options = PlanOptions { iterations: arguments.iterations, ..PlanOptions::new(rig, Method::Paper, 1) };
    let (mut search_ms, mut check_ms, mut facts) = (Vec::new(), Vec::new(), Vec::new());
    for round in 1..=arguments.repeat {
        meter.stage(&format!("round {round} of {}", arguments.repeat));
        let started = Instant::now();
        let mut ended = started;
        let plan = planner::plan(&snapshot, &settings, &options, &stop, &mut |_| ended = Instant::now())?;
        search_ms.push((ended - started).as_secs_f64() * 1e3);
        check_ms.push(ended.elapsed().as_secs_f64() * 1e3);
        facts = vec![
            ("rig", json!(plan.rig)),
            ("iterations", json!(plan.convergence.len())),
            ("coverage percent", json!(plan.metrics.coverage_percent)),
            ("length m", json!(plan.metrics.length_m)),
            ("turning s", json!(plan.metrics.turning_s)),
            ("profile s", json!(plan.metrics.profile_s)),
        ];
    }
    drop(meter);
    let mut all_facts = field::facts(&snapshot.field(), arguments.repeat);
    all_facts.extend(facts);
    Ok(Report {
        figures: Vec::new(),
        facts: all_facts,
        rows: vec![
            Row { step: "tree search", unit: "ms", values: search_ms, limit: "6 to 9 at 400 iterations, 660 at 10000; goal 500" },
            Row { step: "evaluation and safety check", unit: "ms", values: check_ms, limit: "" },
        ],
    })
}
