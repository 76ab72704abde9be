//! Viewpoints of the field: a jittered lattice through the offset shell around the proxy.
//!
//! A cell's viewpoint depends on the cell and on the geometry near it alone, so that an edit moves only viewpoints near by.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::scene::free_space::FreeSpace;
use crate::stop::StopToken;
use crate::surface::unit_hash;

/// The lattice of viewpoints. Pinned when a scene is loaded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// Corner of cell (0, 0, 0), m; cells may have negative indices.
    pub origin: Point3<f64>,
    pub spacing_m: f64,
    /// Outer edge of the shell, m from the nearest surface.
    pub shell_m: f64,
    pub seed: u64,
}

/// A viewpoint with its distance to the nearest surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    pub position: Point3<f64>,
    pub clearance_m: f64,
}

/// The spacing at which about `target` viewpoints fill the shell, at most `coarsest.spacing_m`: farther apart they would miss the
/// shell altogether, so the target is an outcome for large scenes.
/// `None` when stopped.
pub fn choose_spacing_m(free: &FreeSpace, coarsest: &Lattice, target: u32, stop: &StopToken) -> Option<f64> {
    let count = fill(free, coarsest, stop)?.len();
    let share = count as f64 / f64::from(target.max(1));
    Some(coarsest.spacing_m * libm::cbrt(share).min(1.0))
}

/// How many cells of the lattice lie within the flight limits: an upper bound of the viewpoints.
pub fn cells(free: &FreeSpace, lattice: &Lattice) -> f64 {
    (free.limits.max - free.limits.min).iter().map(|extent| (extent / lattice.spacing_m).max(0.0) + 2.0).product()
}

/// All viewpoints of the lattice, in the order of their cells; `None` when stopped.
pub fn fill(free: &FreeSpace, lattice: &Lattice, stop: &StopToken) -> Option<Vec<Viewpoint>> {
    let cell = |p: &Point3<f64>| ((p - lattice.origin) / lattice.spacing_m).map(|v| v.floor() as i64);
    let (low, high) = (cell(&free.limits.min), cell(&free.limits.max));
    if (0..3).any(|i| high[i] < low[i]) {
        return Some(Vec::new());
    }
    let columns: Vec<(i64, i64)> = (low.x..=high.x).flat_map(|x| (low.y..=high.y).map(move |y| (x, y))).collect();
    let column = |&(x, y): &(i64, i64)| -> Option<Vec<Viewpoint>> {
        (!stop.is_stopped()).then(|| (low.z..=high.z).filter_map(|z| viewpoint(free, lattice, [x, y, z])).collect())
    };
    let filled: Option<Vec<Vec<Viewpoint>>> = columns.par_iter().map(column).collect();
    filled.map(|columns| columns.concat())
}

fn viewpoint(free: &FreeSpace, lattice: &Lattice, cell: [i64; 3]) -> Option<Viewpoint> {
    let position = position(lattice, cell);
    if !free.limits.contains(&position) {
        return None;
    }
    let clearance_m = free.clearance.point_distance_m(&position, lattice.shell_m);
    if clearance_m >= lattice.shell_m || !free.is_safe(&position) {
        return None;
    }
    Some(Viewpoint { position, clearance_m })
}

/// The jittered middle of a cell. Without the jitter, streets along the lattice would be seen from exactly aligned rows.
fn position(lattice: &Lattice, cell: [i64; 3]) -> Point3<f64> {
    /// Share of the cell over which a viewpoint is spread.
    const JITTER: f64 = 0.7;
    let key = |axis: u64| {
        let [x, y, z] = cell.map(|v| v as u64 & 0xf_ffff);
        lattice.seed.wrapping_mul(0x2545_f491_4f6c_dd1d) ^ (x | y << 20 | z << 40) ^ axis << 61
    };
    let offset = |axis: u64| 0.5 + JITTER * (unit_hash(key(axis)) - 0.5);
    let [x, y, z] = cell.map(|v| v as f64);
    lattice.origin + Vector3::new(x + offset(0), y + offset(1), z + offset(2)) * lattice.spacing_m
}
