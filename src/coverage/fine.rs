//! The hemisphere in twice as many cells, for reported figures: r with an error of 0.6 points in place of one.

use nalgebra::Point3;

use super::disk::{CellDirections, DiskShape, SampleFrame};
use super::hemisphere::{CELLS, direction_among};
use crate::settings::CoverageSettings;

/// Cells K of a hemisphere in reports.
pub const FINE_CELLS: usize = 256;

/// The covered cells of one hemisphere, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FineMask([u128; 2]);

/// The disks of the model counted in fine cells, exactly.
#[derive(Debug)]
pub struct FineDisks {
    shape: DiskShape,
    cells: [CellDirections; 2],
}

impl FineMask {
    /// The cells that either covers.
    pub fn union(self, other: Self) -> Self {
        Self([self.0[0] | other.0[0], self.0[1] | other.0[1]])
    }

    pub fn count(self) -> u32 {
        self.0[0].count_ones() + self.0[1].count_ones()
    }

    /// Eq. 1: r in percent of the weighted hemisphere.
    pub fn reconstructability_percent(self) -> f64 {
        100.0 * f64::from(self.count()) / FINE_CELLS as f64
    }
}

impl FineDisks {
    pub fn new(settings: &CoverageSettings) -> Self {
        Self {
            shape: DiskShape::new(settings),
            cells: [0, CELLS].map(|first| CellDirections::new(|k| direction_among(first + k, FINE_CELLS))),
        }
    }

    /// Whether a view from `view` could capture the sample if nothing stood between them: range and incidence.
    pub fn faces(&self, sample: &SampleFrame, view: &Point3<f64>) -> bool {
        self.shape.faces(sample, view)
    }

    /// Cells that a visible view from `view` covers; empty out of range or too oblique.
    pub fn mask(&self, sample: &SampleFrame, view: &Point3<f64>) -> FineMask {
        let Some(disk) = self.shape.exact(sample, view) else { return FineMask::default() };
        FineMask([self.cells[0].within(&disk), self.cells[1].within(&disk)])
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;
    use crate::coverage::{DiskModel, reconstructability_percent};
    use crate::settings::Settings;

    #[test]
    fn a_frontal_disk_covers_the_square_of_its_sine() {
        let sample = SampleFrame::new(Point3::new(1.0, 2.0, 3.0), Vector3::new(0.6, 0.0, 0.8));
        for theta0_deg in [15.0f64, 25.0, 40.0, 60.0] {
            let disks = FineDisks::new(&CoverageSettings { theta0_deg, ..Settings::default().coverage });
            let covered = disks.mask(&sample, &(sample.position + sample.normal * 30.0)).reconstructability_percent();
            let expected = 100.0 * theta0_deg.to_radians().sin().powi(2);
            assert!((covered - expected).abs() < 0.5, "{theta0_deg} deg: {covered} against {expected}");
        }
    }

    proptest! {
        #[test]
        fn fine_and_coarse_cells_give_the_same_r_within_their_error(
            views in prop::collection::vec(([-1.0..1.0f64, -1.0..1.0, 0.1..1.0], 5.0..90.0f64), 1..12),
        ) {
            let settings = Settings::default().coverage;
            let (fine, coarse) = (FineDisks::new(&settings), DiskModel::new(&settings));
            let sample = SampleFrame::new(Point3::origin(), Vector3::z());
            let (mut by_fine, mut by_coarse) = (FineMask::default(), 0);
            for ([x, y, z], distance) in views {
                let view = Point3::from(Vector3::new(x, y, z).normalize() * distance);
                by_fine = by_fine.union(fine.mask(&sample, &view));
                by_coarse |= coarse.exact_mask(&sample, &view);
            }
            let apart = by_fine.reconstructability_percent() - reconstructability_percent(by_coarse);
            // The error of 128 cells is one point (RMSE); its tail reaches five.
            prop_assert!(apart.abs() < 7.5, "{} points apart", apart);
        }
    }
}
