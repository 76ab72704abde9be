//! The figures of a finished plan, by exact rays from the images' true poses (never from rows of the field).

use nalgebra::Point3;
use overfly_table::field::SampleRow;
use rayon::prelude::*;

use super::plan::Image;
use crate::camera::{Pose, Rig};
use crate::coverage::{Information, Mask, SampleFrame};
use crate::field::Snapshot;
use crate::stop::StopToken;

/// What the images capture.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// Covered cells of each sample.
    pub cells: Vec<u16>,
    pub information: Information,
    /// Capturable samples with r > h.
    pub captured: u32,
    /// Shares of samples with r > h, percent.
    pub coverage_percent: f64,
    pub coverage_exposed_percent: f64,
    /// Share of the exposed samples that can be captured at all, percent.
    pub capturable_percent: f64,
}

/// Casts every line of sight between the images and the exposed samples, in parallel over samples. `None` when abandoned.
pub fn capture(snapshot: &Snapshot, rig: &Rig, images: &[Image], stop: &StopToken) -> Option<Capture> {
    let field = snapshot.field();
    let cells_of = |row: &SampleRow| {
        if row.exposed == 0 {
            return Some(0);
        }
        let sample = SampleFrame::new(row.position_m.into(), row.normal.into());
        (!stop.is_abandoned()).then(|| covered(snapshot, rig, images, &sample).count_ones() as u16)
    };
    let cells: Vec<u16> = field.samples.par_iter().map(cells_of).collect::<Option<_>>()?;
    let threshold = field.facts.threshold_cells;
    let count = |counts: &dyn Fn(usize) -> bool| (0..cells.len()).filter(|&i| counts(i)).count() as f64;
    let above = |cells: u16| u32::from(cells) > threshold;
    let exposed = count(&|i| field.samples[i].exposed == 1);
    let capturable = count(&|i| field.is_capturable(i));
    let captured = count(&|i| field.is_capturable(i) && above(cells[i]));
    Some(Capture {
        captured: captured as u32,
        information: cells.iter().zip(field.samples).map(|(&cells, row)| u64::from(cells) * row.area_mm2).sum(),
        coverage_percent: percent(captured, capturable),
        coverage_exposed_percent: percent(count(&|i| above(cells[i])), exposed),
        capturable_percent: percent(capturable, exposed),
        cells,
    })
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
