//! The figures of a finished plan, by exact rays from the images' true poses (never from rows of the field).

use nalgebra::Point3;
use rayon::prelude::*;

use super::plan::Image;
use crate::camera::{Pose, Rig};
use crate::coverage::{Information, Mask, SampleFrame};
use crate::search::Problem;
use crate::session::Snapshot;

/// What the images capture.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// Covered cells of each sample.
    pub cells: Vec<u16>,
    pub information: Information,
    /// Shares of samples with r > h, percent.
    pub coverage_percent: f64,
    pub coverage_exposed_percent: f64,
    /// Share of the exposed samples that can be captured at all, percent.
    pub capturable_percent: f64,
}

/// Casts every line of sight between the images and the exposed samples, in parallel over samples.
pub fn capture(snapshot: &Snapshot, rig: &Rig, images: &[Image]) -> Capture {
    let field = snapshot.field();
    let cells: Vec<u16> = field
        .samples
        .par_iter()
        .map(|row| {
            if row.exposed == 0 {
                return 0;
            }
            let sample = SampleFrame::new(row.position_m.into(), row.normal.into());
            covered(snapshot, rig, images, &sample).count_ones() as u16
        })
        .collect();
    let threshold = field.facts.threshold_cells;
    let count = |counts: &dyn Fn(usize) -> bool| (0..cells.len()).filter(|&i| counts(i)).count() as f64;
    let above = |cells: u16| u32::from(cells) > threshold;
    let exposed = count(&|i| field.samples[i].exposed == 1);
    let capturable = count(&|i| above(field.ceilings[i]));
    Capture {
        information: cells.iter().zip(field.samples).map(|(&cells, row)| u64::from(cells) * row.area_mm2).sum(),
        coverage_percent: percent(count(&|i| above(field.ceilings[i]) && above(cells[i])), capturable),
        coverage_exposed_percent: percent(count(&|i| above(cells[i])), exposed),
        capturable_percent: percent(capturable, exposed),
        cells,
    }
}

/// Whether the plan's own count of captured samples reaches the goal, exactly.
pub fn reaches_goal(problem: &Problem, capture: &Capture) -> bool {
    let threshold = problem.field.facts.threshold_cells;
    let captured = capture
        .cells
        .iter()
        .zip(problem.field.ceilings)
        .filter(|&(&cells, &ceiling)| u32::from(cells) > threshold && u32::from(ceiling) > threshold);
    captured.count() as u32 >= problem.sufficient
}

fn covered(snapshot: &Snapshot, rig: &Rig, images: &[Image], sample: &SampleFrame) -> Mask {
    let end: Point3<f64> = sample.position + sample.normal * snapshot.offset_m;
    images.iter().fold(0, |mask, image| {
        let pose = Pose { position: image.position_m, direction: image.direction };
        let sees = snapshot.disks.faces(sample, &pose.position)
            && rig.frames(&pose, &sample.position)
            && !snapshot.free.clearance.occluded(&pose.position, &end);
        if sees { mask | snapshot.disks.exact_mask(sample, &pose.position) } else { mask }
    })
}

fn percent(part: f64, whole: f64) -> f64 {
    if whole == 0.0 { 100.0 } else { 100.0 * part / whole }
}
