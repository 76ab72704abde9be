//! Coverage disks D_i^j: what one view contributes to one sample (paper, section 4.1 and Fig. 4).

use multiversion::multiversion;
use nalgebra::{Point3, Vector3};

use super::hemisphere::{CELLS, Mask, cell_direction};
use crate::settings::CoverageSettings;

/// A sample with a tangent frame: the axes of its hemisphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleFrame {
    pub position: Point3<f64>,
    pub normal: Vector3<f64>,
    tangents: [Vector3<f64>; 2],
}

impl SampleFrame {
    /// `normal` has unit length. The tangents depend on the normal alone.
    pub fn new(position: Point3<f64>, normal: Vector3<f64>) -> Self {
        let helper = if normal.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() };
        let first = normal.cross(&helper).normalize();
        Self { position, normal, tangents: [first, normal.cross(&first)] }
    }
}

/// The disk model with its masks precomputed.
///
/// A mask depends only on the local direction of the view and on the disk's half-angle. Directions are binned on the unit disk
/// below the hemisphere (the projection in which all cells weigh the same), half-angles linearly.
#[derive(Debug)]
pub struct DiskModel {
    shape: DiskShape,
    cells: CellDirections,
    masks: Vec<Mask>,
    /// Half-angle of a frontal disk by distance, rad, at equal steps up to the range.
    frontal: Vec<f64>,
    least_half_angle: f64,
    half_angle_step: f64,
}

/// Bins of the lookup table: directions on a square grid over the unit disk, and half-angles.
const GRID: usize = 64;
const HALF_ANGLES: usize = 16;
const DISTANCES: usize = 1024;

/// Where disks lie and how large they are, whatever the cells that they are counted in.
#[derive(Clone, Debug)]
pub(super) struct DiskShape {
    settings: CoverageSettings,
    min_cosine: f64,
}

/// A view on a sample: local direction to the view and half-angle of its disk, rad.
pub(super) struct Disk {
    direction: Vector3<f64>,
    half_angle: f64,
}

impl DiskShape {
    pub fn new(settings: &CoverageSettings) -> Self {
        Self { min_cosine: libm::cos(settings.max_incidence_deg.to_radians()), settings: settings.clone() }
    }

    /// Range and incidence.
    pub fn faces(&self, sample: &SampleFrame, view: &Point3<f64>) -> bool {
        let to_view = view - sample.position;
        let squared = to_view.norm_squared();
        let along = to_view.dot(&sample.normal);
        let range = self.settings.range_m;
        squared <= range * range && along > 0.0 && along * along >= self.min_cosine * self.min_cosine * squared
    }

    /// The disk of a visible view, without a table's rounding; none out of range or too oblique.
    pub fn exact(&self, sample: &SampleFrame, view: &Point3<f64>) -> Option<Disk> {
        self.disk(sample, view, |distance, cosine| half_angle(&self.settings, distance, cosine))
    }

    fn disk(&self, sample: &SampleFrame, view: &Point3<f64>, half_angle: impl Fn(f64, f64) -> f64) -> Option<Disk> {
        if !self.faces(sample, view) {
            return None;
        }
        let to_view = view - sample.position;
        let distance = to_view.norm();
        let cosine = to_view.dot(&sample.normal) / distance;
        let [first, second] = sample.tangents;
        Some(Disk {
            direction: Vector3::new(to_view.dot(&first) / distance, to_view.dot(&second) / distance, cosine),
            half_angle: half_angle(distance, cosine),
        })
    }
}

/// The directions of as many cells as a mask has bits, by coordinate, so that a disk is held against several at once.
#[derive(Clone, Debug)]
pub(super) struct CellDirections {
    x: [f64; CELLS],
    y: [f64; CELLS],
    z: [f64; CELLS],
}

impl CellDirections {
    /// `direction` of each cell, by its bit.
    pub fn new(direction: impl Fn(usize) -> Vector3<f64>) -> Self {
        let coordinate = |axis: usize| std::array::from_fn(|k| direction(k)[axis]);
        Self { x: coordinate(0), y: coordinate(1), z: coordinate(2) }
    }

    /// The cells that lie within a disk.
    pub fn within(&self, disk: &Disk) -> Mask {
        let mut flags = [0u8; CELLS];
        flag_kernel(self, disk.direction.into(), libm::cos(disk.half_angle), &mut flags);
        // Eight flags of one byte become eight bits: the product brings each to its place in the top byte.
        let packed = |bytes: &[u8]| {
            let bytes = u64::from_le_bytes(bytes.try_into().expect("eight of them"));
            bytes.wrapping_mul(0x0102_0408_1020_4080) >> 56
        };
        flags.chunks_exact(8).enumerate().fold(0, |mask, (k, bytes)| mask | Mask::from(packed(bytes)) << (8 * k))
    }
}

#[multiversion(targets("x86_64+avx2", "aarch64+neon"))]
fn flag_kernel(cells: &CellDirections, [x, y, z]: [f64; 3], least: f64, flags: &mut [u8; CELLS]) {
    for (((flag, cell_x), cell_y), cell_z) in flags.iter_mut().zip(&cells.x).zip(&cells.y).zip(&cells.z) {
        // In the order of a dot product.
        *flag = u8::from(cell_x * x + cell_y * y + cell_z * z >= least);
    }
}

impl DiskModel {
    pub fn new(settings: &CoverageSettings) -> Self {
        let shape = DiskShape::new(settings);
        let largest = settings.theta0_deg.to_radians();
        let least_half_angle = half_angle(settings, settings.range_m, shape.min_cosine);
        let mut model = Self {
            shape,
            cells: CellDirections::new(cell_direction),
            masks: Vec::new(),
            frontal: (0..=DISTANCES).map(|k| half_angle(settings, settings.range_m * k as f64 / DISTANCES as f64, 1.0)).collect(),
            least_half_angle,
            half_angle_step: (largest - least_half_angle) / HALF_ANGLES as f64,
        };
        model.masks = model.tabulate();
        model
    }

    /// Range beyond which nothing is captured, m.
    pub fn range_m(&self) -> f64 {
        self.shape.settings.range_m
    }

    /// Cells of the largest disk in the lookup table.
    pub fn most_cells(&self) -> u32 {
        self.masks.iter().map(|mask| mask.count_ones()).max().unwrap_or(0)
    }

    /// Whether a view from `view` could capture the sample if nothing stood between them: range and incidence.
    pub fn faces(&self, sample: &SampleFrame, view: &Point3<f64>) -> bool {
        self.shape.faces(sample, view)
    }

    /// Cells that a visible view from `view` covers, by the lookup table; empty out of range or too oblique.
    pub fn mask(&self, sample: &SampleFrame, view: &Point3<f64>) -> Mask {
        let by_table = |distance: f64, cosine: f64| {
            let step = (distance * (DISTANCES as f64 / self.range_m())) as usize;
            self.frontal[step.min(DISTANCES)] * cosine.sqrt().sqrt()
        };
        let Some(disk) = self.shape.disk(sample, view, by_table) else { return 0 };
        let bin = |v: f64| (((v + 1.0) * (GRID as f64 / 2.0)) as usize).min(GRID - 1);
        let radius = (((disk.half_angle - self.least_half_angle) / self.half_angle_step).max(0.0) as usize).min(HALF_ANGLES - 1);
        self.masks[(radius * GRID + bin(disk.direction.y)) * GRID + bin(disk.direction.x)]
    }

    /// The same without the table's rounding, cell by cell: for reported figures and as the table's oracle.
    pub fn exact_mask(&self, sample: &SampleFrame, view: &Point3<f64>) -> Mask {
        self.shape.exact(sample, view).map_or(0, |disk| self.cells.within(&disk))
    }

    fn tabulate(&self) -> Vec<Mask> {
        let centre = |bin: usize| (bin as f64 + 0.5) * (2.0 / GRID as f64) - 1.0;
        let mut masks = Vec::with_capacity(HALF_ANGLES * GRID * GRID);
        for radius in 0..HALF_ANGLES {
            let half_angle = self.least_half_angle + (radius as f64 + 0.5) * self.half_angle_step;
            for y in (0..GRID).map(centre) {
                for x in (0..GRID).map(centre) {
                    // Bins at the rim have centres outside of the disk: they stand for the horizon below them.
                    let direction = Vector3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt()).normalize();
                    masks.push(self.cells.within(&Disk { direction, half_angle }));
                }
            }
        }
        masks
    }
}

/// Half-angle of the disk, rad: theta0 for a near frontal view, less with distance and obliqueness.
fn half_angle(settings: &CoverageSettings, distance_m: f64, cosine: f64) -> f64 {
    let beyond = (distance_m - settings.full_disk_m).max(0.0);
    settings.theta0_deg.to_radians() * libm::exp(-beyond / settings.falloff_m) * cosine.sqrt().sqrt()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::settings::Settings;

    fn unit() -> impl Strategy<Value = Vector3<f64>> {
        [-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64]
            .prop_map(|[x, y, z]| Vector3::new(x, y, z))
            .prop_filter("long enough to have a direction", |v| v.norm() > 0.1)
            .prop_map(|v| v.normalize())
    }

    proptest! {
        #[test]
        fn tangents_and_normal_are_a_right_handed_frame(normal in unit()) {
            let frame = SampleFrame::new(Point3::origin(), normal);
            let [first, second] = frame.tangents;
            prop_assert!((first.cross(&second) - normal).norm() < 1e-12);
        }

        #[test]
        fn only_admissible_views_cover_cells_and_all_but_grazing_ones_do(normal in unit(), direction in unit(), distance in 1.0..120.0f64) {
            let model = DiskModel::new(&Settings::default().coverage);
            let sample = SampleFrame::new(Point3::new(3.0, -2.0, 7.0), normal);
            let view = sample.position + direction * distance;
            let admissible = distance <= 80.0 && direction.dot(&normal) >= 85f64.to_radians().cos();
            prop_assert_eq!(model.faces(&sample, &view), admissible);
            let mask = model.mask(&sample, &view);
            prop_assert!(admissible || mask == 0);
            // A grazing disk may fall between the cells; a steeper one never does.
            prop_assert!(mask != 0 || !admissible || direction.dot(&normal) < 75f64.to_radians().cos());
        }
    }

    proptest! {
        #[test]
        fn a_disk_covers_the_cells_that_lie_within_its_half_angle(direction in unit(), half_angle in 0.0..1.5f64) {
            let mask = CellDirections::new(cell_direction).within(&Disk { direction, half_angle });
            for k in 0..CELLS {
                prop_assert_eq!(mask >> k & 1 == 1, cell_direction(k).dot(&direction) >= libm::cos(half_angle), "cell {}", k);
            }
        }
    }

    #[test]
    fn the_lookup_table_adds_little_error_to_unions() {
        let model = DiskModel::new(&Settings::default().coverage);
        let sample = SampleFrame::new(Point3::origin(), Vector3::new(0.6, 0.0, 0.8));
        let mut squared = 0.0;
        let rounds = 500u32;
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        for _ in 0..rounds {
            let (mut table, mut exact) = (0, 0);
            for _ in 0..4 {
                let direction = Vector3::new(random() - 0.5, random() - 0.5, random()).normalize();
                let view = sample.position + direction * (10.0 + 60.0 * random());
                table |= model.mask(&sample, &view);
                exact |= model.exact_mask(&sample, &view);
            }
            let error = f64::from(table.count_ones()) - f64::from(exact.count_ones());
            squared += error * error;
        }
        let rmse_percent = 100.0 * (squared / f64::from(rounds)).sqrt() / CELLS as f64;
        assert!(rmse_percent < 1.5, "{rmse_percent} points of r");
    }
}
