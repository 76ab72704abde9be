//! What makes a path good: Eq. 4 to 6 in scale-free units.

use nalgebra::Vector3;

use super::leg::angle_rad;
use crate::camera::Pose;
use crate::coverage::{CELLS, Information};
use crate::settings::{ObjectiveSettings, Settings};

/// Sums along a path from the root.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PathSums {
    /// What the legs add to the view at the root, area-weighted: the sum of g* over the path from k = 2 on (Eq. 2 and 3).
    pub information: Information,
    /// Sum of c_m (Eq. 4), m.
    pub length_m: f64,
    /// Sum of c_t (Eq. 5) over the inner waypoints, s.
    pub turning_s: f64,
}

/// Eq. 6 with its weights resolved for one scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Objective {
    settings: ObjectiveSettings,
    /// Model units per unit of [`Information`].
    scale: f64,
    /// alpha_e times the length unit, m.
    efficiency_m: f64,
    /// E_e counts shorter paths as this long, m. G/L has no bound as L goes to 0, and the best path would have no length. At least
    /// `efficiency_m`: with c = `efficiency_m` a longer path raises G (1 + c/L) when its new legs gain more than c / (L + c) of what
    /// the others gained on average, so that below c trees stay with their first lucky legs and never grow.
    shortest_m: f64,
}

impl Objective {
    /// `reference_area_m2` is the scene's exposed surface when it was loaded.
    pub fn new(settings: &Settings, reference_area_m2: f64, neighbour_radius_m: f64) -> Self {
        let settings = settings.objective.clone();
        let reference_length_m = settings.reference_length_m * reference_area_m2 / settings.reference_area_m2;
        // Information counts cells times mm^2. A sample of area a with all K cells covered has r = 100 %, and a scene of the
        // reference area with a mean r of 1 % is worth `information_scale`.
        let percent_per_square_metre = settings.information_scale / settings.reference_area_m2;
        let efficiency_m = settings.eta * reference_length_m;
        Self {
            scale: percent_per_square_metre * 100.0 / (CELLS as f64 * 1e6),
            efficiency_m,
            shortest_m: neighbour_radius_m.max(efficiency_m),
            settings,
        }
    }

    /// E_g: information in model units.
    pub fn gain(&self, information: Information) -> f64 {
        information as f64 * self.scale
    }

    /// E of a path (Eq. 6).
    pub fn value(&self, sums: &PathSums) -> f64 {
        let gain = self.gain(sums.information);
        let efficiency = gain / sums.length_m.max(self.shortest_m);
        gain + self.efficiency_m * efficiency - self.settings.alpha_t * sums.turning_s
    }

    /// The gain E_g that a path of this length and turning needs for a value E: Eq. 6 the other way round.
    pub fn gain_for(&self, value: f64, travel: &PathSums) -> f64 {
        let efficient = 1.0 + self.efficiency_m / travel.length_m.max(self.shortest_m);
        (value + self.settings.alpha_t * travel.turning_s) / efficient
    }

    /// What seconds are worth in units of E: as much as if they were spent on turning.
    pub fn worth_of_s(&self, seconds: f64) -> f64 {
        self.settings.alpha_t.max(1.0) * seconds
    }

    /// Length and turning of a path, without information.
    pub fn travel(&self, path: &[Pose]) -> PathSums {
        let legs: Vec<Vector3<f64>> = path.windows(2).map(|ends| ends[1].position - ends[0].position).collect();
        PathSums {
            information: 0,
            length_m: legs.iter().map(|leg| leg.norm()).sum(),
            turning_s: legs.windows(2).map(|pair| self.turn_s(&pair[0], &pair[1])).sum(),
        }
    }

    /// c_t of the turn from leg `before` to leg `after` (Eq. 5), s. A collinear waypoint is not free: 0.67 s.
    pub fn turn_s(&self, before: &Vector3<f64>, after: &Vector3<f64>) -> f64 {
        let from_hairpin = angle_rad(before, after) - std::f64::consts::PI;
        self.settings.turn_hairpin_s - self.settings.turn_curvature_s * from_hairpin * from_hairpin
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn objective() -> Objective {
        let settings = Settings::default();
        Objective::new(&settings, settings.objective.reference_area_m2, 30.0)
    }

    #[test]
    fn turning_times_are_those_of_the_field_experiment() {
        let east = Vector3::x();
        for (after, expected_s) in [(Vector3::x(), 0.67), (Vector3::y(), 1.855), (-Vector3::x(), 2.25)] {
            assert!((objective().turn_s(&east, &after) - expected_s).abs() < 0.005, "{after:?}");
        }
    }

    #[test]
    fn the_reference_scene_wholly_covered_is_worth_eighty_a_percent() {
        let settings = Settings::default();
        let information = (settings.objective.reference_area_m2 * 1e6) as u64 * CELLS as u64;
        assert!((objective().gain(information) - 80.0 * 100.0).abs() < 1e-6);
    }

    #[test]
    fn a_path_is_worth_its_information_its_efficiency_and_less_its_turns() {
        // On the reference scene c = 2151 m; a tenth of all cells is G = 800.
        let settings = Settings::default();
        let information = (settings.objective.reference_area_m2 * 1e5) as u64 * CELLS as u64;
        let sums = PathSums { information, length_m: 4000.0, turning_s: 20.0 };
        assert!((objective().value(&sums) - (800.0 * (1.0 + 2151.0 / 4000.0) - 10.0 * 20.0)).abs() < 1e-6);
        // Below c the length does not matter.
        let shorter = PathSums { length_m: 500.0, ..sums };
        assert!((objective().value(&shorter) - (800.0 * 2.0 - 200.0)).abs() < 1e-6);
    }

    #[test]
    fn a_path_of_no_length_is_not_infinitely_efficient() {
        let tiny = PathSums { information: 1_000_000_000, length_m: 1e-9, turning_s: 0.0 };
        let short = PathSums { length_m: 30.0, ..tiny };
        assert_eq!(objective().value(&tiny), objective().value(&short));
    }
}
