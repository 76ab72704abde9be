//! How long planning takes (section 6.1). One flight after the other, so that none waits for another.

use super::ReproductionError;
use super::figures::{self, ONE_CAMERA};
use super::paper;
use super::study::{Study, build_field};
use super::table::{Cell, Table};
use super::table3;
use crate::camera::Rig;
use crate::planner::{self, Method, PlanOptions};

pub fn table(study: &mut Study) -> Result<Table, ReproductionError> {
    let columns = ["Scene", "Planning [s]", "Field [s]", "The paper's planning over ours"];
    let mut table = Table::new("planning-time", "Planning time (one camera)", &columns);
    let settings = figures::benchmark(&study.settings);
    let rig = Rig::preset(ONE_CAMERA)?;
    for ((name, minutes), (_, site)) in paper::PLANNING_MIN.iter().zip(table3::SCENES) {
        let paper_s = minutes * 60.0;
        table.paper(&[name], &[(paper_s, 0)]);
        if !figures::is_there(study, &mut table, site) {
            continue;
        }
        let Some(scene) = study.scene(site) else { continue };
        let (mut plan_s, mut field_s) = (Vec::new(), Vec::new());
        for seed in 1..=u64::from(study.seeds) {
            study.step(&format!("{}: planning alone, flight {seed} of {}", site.name(), study.seeds))?;
            let before_s = study.now_s();
            let snapshot = build_field((*scene).clone(), &settings, study.stop())?;
            let between_s = study.now_s();
            let options = PlanOptions::new(rig.clone(), Method::Paper, seed);
            if let Err(error) = planner::plan(&snapshot, &settings, &options, study.stop(), &mut |_| ()) {
                table.note(format!("No flight over {}: {error}.", site.name()));
                continue;
            }
            field_s.push(between_s - before_s);
            plan_s.push(study.now_s() - between_s);
        }
        let ratios: Vec<f64> = plan_s.iter().map(|seconds| paper_s / seconds).collect();
        table.ours(&[site.name()], vec![Cell::spread(&plan_s, 2), Cell::spread(&field_s, 2), Cell::spread(&ratios, 0)]);
    }
    figures::note_settings(&mut table, &settings, study.seeds);
    table.note("The paper's minutes are those of its search on a 2.4 GHz Xeon E5-2680 with a Quadro M5000; ours are search, post-selection and safety check.");
    table.note("delfshaven and nihonbashi stand in the places of UK-1 and Bridge-1: they are other scenes than the paper's.");
    Ok(table)
}
