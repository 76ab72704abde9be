//! A finished plan as a table: what the daemon publishes.

use bytemuck::{Pod, Zeroable};

use crate::layout::{self, Block, LayoutError, Section};

/// "OVFLYPLN" in memory order on a little-endian machine.
pub const MAGIC: u64 = u64::from_le_bytes(*b"OVFLYPLN");
pub const SCHEMA: u32 = 6;
/// The code of [`PlanFacts::stop`] for a scene in which there is no flight.
pub const INFEASIBLE: u64 = 8;
/// The code of [`PlanFacts::stop`] for a flight that is safe and of which nobody has counted yet what it captures: those figures are NaN, and there are no
/// cells. A plan that has them follows.
pub const SAFE: u64 = 9;

/// The figures of a plan, in the order of `metrics` in `plan.json`. Coverage, capturable, matched, information and objective are NaN while they are not
/// counted ([`SAFE`]).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct MetricsRow {
    pub length_m: f64,
    pub waypoints: u64,
    /// Length over cruise speed (paper, Eq. 4).
    pub movement_s: f64,
    /// Sum of Eq. 5 over the inner waypoints.
    pub turning_s: f64,
    pub flight_s: f64,
    /// Time of the speed profile.
    pub profile_s: f64,
    /// What the flight draws from a full battery; negative for a rig without one.
    pub battery_percent: f64,
    /// Share of the capturable samples above the threshold, by exact rays from the images.
    pub coverage_percent: f64,
    /// The same of the exposed samples.
    pub coverage_exposed_percent: f64,
    /// Share of the exposed samples that can be captured at all: the ceiling.
    pub capturable_percent: f64,
    /// Share of the samples with enough matched views among those that can have them.
    pub matched_percent: f64,
    /// Area-weighted information (model units) by exact rays.
    pub information: f64,
    /// Eq. 6 with the exact information.
    pub objective: f64,
    /// Exposures that wait for the shutter near a corner, and those left out because they would have to wait too long.
    pub delayed_exposures: u64,
    pub dropped_exposures: u64,
    /// The most that the flight smears an image at the surface nearest to it, px.
    pub blur_px: f64,
}

/// What the flight was timed with: with it and the waypoints everyone computes the same timed curve.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct LimitsRow {
    /// What turns along the path: 0 the limits are not known, 1 nothing, 2 a camera on a gimbal, 3 the nose with bolted cameras.
    pub turning: u64,
    pub cruise_mps: f64,
    pub acceleration_mps2: f64,
    pub jerk_mps3: f64,
    pub lateral_mps2: f64,
    pub corner_deviation_m: f64,
    pub yaw_rate_dps: f64,
    pub gimbal_rate_dps: f64,
    /// Speed at the start of the flight, m/s; 0 from rest.
    pub entry_mps: f64,
}

/// What the plan was made from and how the search ended.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PlanFacts {
    pub metrics: MetricsRow,
    pub limits: LimitsRow,
    pub revision: u64,
    pub seed: u64,
    pub iterations: u64,
    /// 0 the coverage goal was reached, 1 the iterations were used up, 2 the search was stopped, 3 its memory was
    /// used up, 4 nothing more could be reached, 5 the method has done all that it does, 6 there was no search yet: what could
    /// still be flown of an earlier flight after an edit, 7 the search goes on and has found a better flight than before, 8 there is no
    /// flight: see [`PlanTable::infeasible`], 9 what can be flown at once after an edit: safe, what it captures is not counted yet ([`SAFE`]).
    pub stop: u64,
    pub origin_lat_deg: f64,
    pub origin_lon_deg: f64,
    pub origin_alt_m: f64,
    /// 1 when the origin means something.
    pub georeferenced: u64,
    /// Coverage goal G in percent of the capturable samples.
    pub goal_percent: f64,
    /// The goal for the matched samples, percent; 0 where none was asked for.
    pub matched_goal_percent: f64,
    /// Field and search times, s.
    pub field_s: f64,
    pub search_s: f64,
    /// Exact evaluation and safety check, s.
    pub check_s: f64,
    /// From taking up the request to this message, s.
    pub total_s: f64,
    /// For an aircraft that is where it must not be, the legs that come before all others and are safe by rules of their own: 1 it brakes to rest,
    /// 2 it gets out, 3 both, one after the other; 0 neither.
    pub egress: u64,
    /// Smallest distance of the curve to a structure or the ground, m.
    pub clearance_m: f64,
    pub threads: u64,
}

/// A waypoint with its view direction; `has_direction` is 0 for a panoramic rig.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct WaypointRow {
    pub position_m: [f64; 3],
    pub direction: [f64; 3],
    pub has_direction: u64,
    /// How far the arc that rounds the corner may pass from it, m; at 0 the drone stops there.
    pub deviation_m: f64,
}

/// One image of one camera of the rig.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct ImageRow {
    pub position_m: [f64; 3],
    pub direction: [f64; 3],
    pub up: [f64; 3],
    /// Horizontal and vertical field of view; 0 for a panoramic image.
    pub fov_deg: [f64; 2],
    /// Since the start of the flight.
    pub time_s: f64,
    pub camera: u32,
    pub has_direction: u16,
    pub selected: u16,
}

/// A camera of the rig; its name stands in the text.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct CameraRow {
    /// Angle that one pixel spans, rad.
    pub pixel_rad: f64,
    /// 0 for a panorama, as the sensor and its resolution.
    pub focal_mm: f64,
    pub sensor_mm: [f64; 2],
    pub pixels: [u32; 2],
}

/// Hemisphere cells of one sample of the field that the plan was made on.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct CellsRow {
    /// Covered by the plan's images, by exact rays.
    pub covered: u16,
    /// Covered by the rig's views from all viewpoints together.
    pub ceiling: u16,
}

/// One iteration of the search: the best path so far.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct IterationRow {
    pub objective: f64,
    /// Of the capturable samples, by the field.
    pub coverage_percent: f64,
    pub length_m: f64,
    pub turning_s: f64,
}

/// How many rows each section of a plan holds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlanCounts {
    pub waypoints: usize,
    pub images: usize,
    pub cameras: usize,
    pub samples: usize,
    pub iterations: usize,
    pub text_bytes: usize,
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct PlanHeader {
    magic: u64,
    schema: u32,
    header_bytes: u32,
    total_bytes: u64,
    facts: PlanFacts,
    sections: [Section; SECTIONS],
}

const SECTIONS: usize = 6;
const NAMES: [&str; SECTIONS] = ["waypoints", "images", "cameras", "cells", "iterations", "text"];
const ROW_BYTES: [usize; SECTIONS] = [
    size_of::<WaypointRow>(),
    size_of::<ImageRow>(),
    size_of::<CameraRow>(),
    size_of::<CellsRow>(),
    size_of::<IterationRow>(),
    1,
];

impl PlanCounts {
    /// Size of the whole table in blocks.
    pub fn blocks(&self) -> usize {
        layout::blocks_for(self.sections().1)
    }

    fn sections(&self) -> ([Section; SECTIONS], u64) {
        let counts = [self.waypoints, self.images, self.cameras, self.samples, self.iterations, self.text_bytes];
        let mut rows = [(0, 0); SECTIONS];
        for (row, (count, bytes)) in rows.iter_mut().zip(counts.into_iter().zip(ROW_BYTES)) {
            *row = (count, bytes);
        }
        layout::lay_out(size_of::<PlanHeader>(), rows)
    }
}

/// A plan that is being written where it will be read.
#[derive(Debug)]
pub struct PlanTableMut<'a> {
    pub waypoints: &'a mut [WaypointRow],
    pub images: &'a mut [ImageRow],
    pub cameras: &'a mut [CameraRow],
    pub cells: &'a mut [CellsRow],
    pub iterations: &'a mut [IterationRow],
    pub text: &'a mut [u8],
}

impl<'a> PlanTableMut<'a> {
    /// Writes the header and returns the sections, whose rows hold what `blocks` held: these are exactly as long as [`PlanCounts::blocks`] says, and may
    /// be anything.
    pub fn create(blocks: &'a mut [Block], counts: &PlanCounts, facts: &PlanFacts) -> Self {
        assert_eq!(blocks.len(), counts.blocks(), "the caller sizes the table with PlanCounts::blocks");
        let (sections, total_bytes) = counts.sections();
        let header_bytes = size_of::<PlanHeader>();
        let header =
            PlanHeader { magic: MAGIC, schema: SCHEMA, header_bytes: header_bytes as u32, total_bytes, facts: *facts, sections };
        bytemuck::cast_slice_mut::<Block, u8>(blocks)[..header_bytes].copy_from_slice(bytemuck::bytes_of(&header));
        let [waypoints, images, cameras, cells, iterations, text] = layout::split_mut(blocks, header_bytes, sections, ROW_BYTES);
        Self {
            waypoints: bytemuck::cast_slice_mut(waypoints),
            images: bytemuck::cast_slice_mut(images),
            cameras: bytemuck::cast_slice_mut(cameras),
            cells: bytemuck::cast_slice_mut(cells),
            iterations: bytemuck::cast_slice_mut(iterations),
            text,
        }
    }
}

/// A plan that can be read.
#[derive(Clone, Copy, Debug)]
pub struct PlanTable<'a> {
    pub facts: &'a PlanFacts,
    pub waypoints: &'a [WaypointRow],
    pub images: &'a [ImageRow],
    pub cameras: &'a [CameraRow],
    /// One row for each sample of the field that the plan was made on, in its order.
    pub cells: &'a [CellsRow],
    pub iterations: &'a [IterationRow],
    /// Lines of UTF-8 text: scene, rig, method, then the names of the rig's cameras; scene and reason where there is no flight.
    pub text: &'a [u8],
}

impl<'a> PlanTable<'a> {
    /// Opens a table that somebody else may have written; every bound is checked.
    pub fn open(blocks: &'a [Block]) -> Result<Self, LayoutError> {
        let header: &PlanHeader = layout::header(blocks, "plan", MAGIC, SCHEMA, |header: &PlanHeader| {
            (header.magic, header.schema, header.total_bytes)
        })?;
        let [waypoints, images, cameras, cells, iterations, text] = header.sections;
        Ok(Self {
            facts: &header.facts,
            waypoints: layout::rows(blocks, waypoints, NAMES[0])?,
            images: layout::rows(blocks, images, NAMES[1])?,
            cameras: layout::rows(blocks, cameras, NAMES[2])?,
            cells: layout::rows(blocks, cells, NAMES[3])?,
            iterations: layout::rows(blocks, iterations, NAMES[4])?,
            text: layout::rows(blocks, text, NAMES[5])?,
        })
    }

    /// Why there is no flight in the scene since an edit; `None` where there is one.
    pub fn infeasible(&self) -> Option<&'a str> {
        let text = || std::str::from_utf8(self.text).ok()?.split_terminator('\n').nth(1);
        (self.facts.stop == INFEASIBLE).then(|| text().unwrap_or("the daemon gives no reason"))
    }

    pub fn counts(&self) -> PlanCounts {
        PlanCounts {
            waypoints: self.waypoints.len(),
            images: self.images.len(),
            cameras: self.cameras.len(),
            samples: self.cells.len(),
            iterations: self.iterations.len(),
            text_bytes: self.text.len(),
        }
    }
}
