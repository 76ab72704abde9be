//! When which part of the surface is seen and captured.

use nalgebra::Point3;
use overfly_table::FieldTable;
use rayon::prelude::*;
use serde::Serialize;

use super::bytes::Packed;
use crate::coverage::{CELLS, DiskModel, Mask, SampleFrame};
use crate::field::Lookup;
use crate::mission::svg::{self, SvgError};
use crate::settings::{CoverageSettings, Settings};
use crate::trajectory::evaluate::Sightings;
use crate::trajectory::plan::{Plan, sight_scale};

/// Stands for "never".
const NEVER_S: f64 = -1.0;

/// Images that are looked at before what they see is gathered: what all images of a town see at once would take much memory.
const IMAGES_AT_ONCE: usize = 512;

/// The exposed samples of a field as discs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Surface {
    count: usize,
    positions_m: Packed,
    normals: Packed,
    areas_m2: Packed,
    /// Places among the scene's structures.
    structures: Packed,
}

/// What the images of a plan see of the samples of a field, over time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Sighted {
    /// How it is known when a sample is seen.
    by: By,
    /// Whether what images before this flight captured is known, or does not exist.
    knows_before: bool,
    /// A sample is captured when r exceeds this, percent.
    threshold_percent: f64,
    /// Since the start of the flight, s; negative for never.
    seen_s: Packed,
    captured_s: Packed,
    /// r after the whole flight, percent, by exact rays.
    r_percent: Packed,
    /// 1 where the rig can capture the sample at all.
    capturable: Packed,
    #[serde(skip)]
    pub(super) surface: Surface,
}

/// How it is known when a sample is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum By {
    /// By exact rays from each image.
    Rays,
    /// By the field's row of the viewpoint nearest to each image; only r after the whole flight is by rays.
    Field,
    /// The same for a flight before which images were taken.
    #[serde(rename = "field")]
    FieldUnderWay,
}

impl Sighted {
    /// From the exact rays of the plan's images, as they were cast for its figures.
    pub fn by_rays(field: &FieldTable, plan: &Plan, sightings: &Sightings) -> Result<Self, SvgError> {
        svg::check(field, plan)?;
        let of_sample = |i: usize| {
            let seen = sightings.0.get(i).into_iter().flatten();
            let mut seen: Vec<(f64, Mask)> =
                seen.filter_map(|one| Some((plan.images.get(one.image as usize)?.time_s, one.mask))).collect();
            seen.sort_by(|a, b| a.0.total_cmp(&b.0));
            seen
        };
        Ok(Self::new(By::Rays, true, field, plan, of_sample))
    }

    /// From the field alone, for those who have no scene to cast rays in. What rows know nothing of was captured before a flight that is under way,
    /// where it is known whether it is.
    pub fn by_field(field: &FieldTable, plan: &Plan, is_under_way: Option<bool>) -> Result<Self, SvgError> {
        svg::check(field, plan)?;
        let seen = seen_by_field(field, plan);
        let by = if is_under_way == Some(true) { By::FieldUnderWay } else { By::Field };
        Ok(Self::new(by, is_under_way.is_some(), field, plan, |i| seen[i].clone()))
    }

    /// `seen` gives the cells of a sample that are seen, in the order of time.
    fn new(by: By, knows_before: bool, field: &FieldTable, plan: &Plan, seen: impl Fn(usize) -> Vec<(f64, Mask)> + Sync) -> Self {
        let threshold = field.facts.threshold_cells;
        let end_s = plan.images.iter().map(|image| image.time_s).fold(0.0, f64::max);
        let exposed: Vec<usize> = (0..field.samples.len()).filter(|&i| field.samples[i].exposed == 1).collect();
        let times: Vec<[f64; 2]> =
            exposed.par_iter().map(|&i| times_s(by, &seen(i), u32::from(plan.cells[i]), threshold, end_s)).collect();
        let percent = |cells: f64| 100.0 * cells / CELLS as f64;
        let rows = || exposed.iter().map(|&i| &field.samples[i]);
        Self {
            by,
            knows_before,
            threshold_percent: percent(f64::from(threshold)),
            seen_s: Packed::f32(times.iter().map(|times| times[0])),
            captured_s: Packed::f32(times.iter().map(|times| times[1])),
            r_percent: Packed::f32(exposed.iter().map(|&i| percent(f64::from(plan.cells[i])))),
            capturable: Packed::u8(exposed.iter().map(|&i| u8::from(plan.is_capturable(i, threshold)))),
            surface: Surface {
                count: exposed.len(),
                positions_m: Packed::f32(rows().flat_map(|row| row.position_m)),
                normals: Packed::unit_i8(rows().flat_map(|row| row.normal)),
                areas_m2: Packed::f32(rows().map(|row| row.area_mm2 as f64 / 1e6)),
                structures: Packed::u32(rows().map(|row| row.structure)),
            },
        }
    }
}

/// When a sample is first seen, and when more than `threshold` of its cells are covered, s. `exact` cells are covered in the end; of what rows know nothing, that
/// is when the flight ends, or before it where images were taken then.
fn times_s(by: By, seen: &[(f64, Mask)], exact: u32, threshold: u32, end_s: f64) -> [f64; 2] {
    let last_s = seen.last().map_or(end_s, |one| one.0);
    let all = seen.iter().fold(0, |all, one| all | one.1).count_ones();
    let before = match by {
        By::Rays => exact.saturating_sub(all),
        By::FieldUnderWay if seen.is_empty() => exact,
        By::Field | By::FieldUnderWay => 0,
    };
    let first_s = match seen.first() {
        _ if before > 0 => 0.0,
        Some(first) if exact > 0 => first.0,
        _ if exact > 0 => last_s,
        _ => NEVER_S,
    };
    if exact <= threshold {
        return [first_s, NEVER_S];
    }
    // The cells that only images before the flight can have covered count from its beginning; what rows say is brought to the scale of what rays say.
    let covered = |cells: u32| match by {
        _ if before > 0 => cells + before,
        By::Rays => cells,
        By::Field | By::FieldUnderWay => (cells * exact).checked_div(all).unwrap_or(0),
    };
    if covered(0) > threshold {
        return [first_s, 0.0];
    }
    let mut union: Mask = 0;
    let crossing = seen.iter().find(|one| {
        union |= one.1;
        covered(union.count_ones()) > threshold
    });
    [first_s, crossing.map_or(last_s, |one| one.0)]
}

/// By sample what the rows of the viewpoints nearest to the images say that these see.
fn seen_by_field(field: &FieldTable, plan: &Plan) -> Vec<Vec<(f64, Mask)>> {
    let mut seen = vec![Vec::new(); field.samples.len()];
    let Some(lookup) = Lookup::new(field.viewpoints) else { return seen };
    let disks = DiskModel::new(&coverage_settings(field, plan));
    let frame = |row: &overfly_table::field::SampleRow| SampleFrame::new(row.position_m.into(), row.normal.into());
    let frames: Vec<SampleFrame> = field.samples.iter().map(frame).collect();
    let mut images: Vec<_> = plan.images.iter().collect();
    images.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    for images in images.chunks(IMAGES_AT_ONCE) {
        let sees = images.par_iter().map(|image| {
            let view = image.view();
            let is_framed = |position: &Point3<f64>| view.as_ref().is_none_or(|view| view.frames(position));
            let row = lookup.nearest(&image.position_m).map(|j| field.row(j));
            let samples = row.into_iter().flat_map(|row| row.samples()).filter(|&i| is_framed(&frames[i].position));
            let masks = samples.map(|i| (i, disks.exact_mask(&frames[i], &image.position_m)));
            masks.filter(|(_, mask)| *mask != 0).collect::<Vec<_>>()
        });
        let sees: Vec<Vec<(usize, Mask)>> = sees.collect();
        for (image, sees) in images.iter().zip(sees) {
            sees.into_iter().for_each(|(i, mask)| seen[i].push((image.time_s, mask)));
        }
    }
    seen
}

/// The coverage model of a field: its range stands there, the rest follows from how far the plan's cameras see.
fn coverage_settings(field: &FieldTable, plan: &Plan) -> CoverageSettings {
    let coverage = Settings::default().with_sight(sight_scale(&plan.cameras)).coverage;
    CoverageSettings { range_m: field.facts.range_m, ..coverage }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four images, each of which covers ten cells that the others do not.
    fn seen() -> Vec<(f64, Mask)> {
        (1..=4).map(|k| (f64::from(k), 0x3ff << (10 * k))).collect()
    }

    #[test]
    fn what_rows_cover_is_brought_to_what_rays_say() {
        assert_eq!(times_s(By::Field, &seen(), 80, 39, 9.0), [1.0, 2.0]);
        assert_eq!(times_s(By::Field, &seen(), 40, 39, 9.0), [1.0, 4.0]);
        assert_eq!(times_s(By::Field, &seen(), 20, 39, 9.0), [1.0, NEVER_S]);
        assert_eq!(times_s(By::Field, &[], 40, 39, 9.0), [9.0, 9.0], "rows know nothing of it");
        assert_eq!(times_s(By::Field, &seen(), 0, 39, 9.0), [NEVER_S, NEVER_S]);
        assert_eq!(times_s(By::FieldUnderWay, &seen(), 40, 39, 9.0), [1.0, 4.0]);
        assert_eq!(times_s(By::FieldUnderWay, &[], 40, 39, 9.0), [0.0, 0.0], "seen before");
        assert_eq!(times_s(By::FieldUnderWay, &[], 30, 39, 9.0), [0.0, NEVER_S]);
    }

    #[test]
    fn what_was_covered_before_the_flight_counts_from_its_beginning() {
        assert_eq!(times_s(By::Rays, &seen(), 40, 29, 9.0), [1.0, 3.0]);
        assert_eq!(times_s(By::Rays, &seen(), 50, 29, 9.0), [0.0, 2.0]);
        assert_eq!(times_s(By::Rays, &seen(), 70, 29, 9.0), [0.0, 0.0]);
    }
}
