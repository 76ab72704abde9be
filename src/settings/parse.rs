//! Settings from the text of a configuration file, over the embedded defaults.

use toml::{Table, Value};

use super::{DEFAULT_TOML, MOST_ITERATIONS, Settings};

/// What is wrong with a configuration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SettingsError {
    #[error("{0}")]
    Syntax(#[from] toml::de::Error),
    #[error("`{key}` is {value}, but must lie between {least} and {most}")]
    Range { key: &'static str, value: f64, least: f64, most: f64 },
    #[error("`{lower}` must not exceed `{upper}`")]
    Order { lower: &'static str, upper: &'static str },
    #[error("`flight.no_fly` {name:?}: {reason}")]
    Zone { name: String, reason: &'static str },
}

impl Settings {
    /// Settings of a file that gives only the keys that it changes. Unknown keys and values out of range are errors.
    pub fn parse(text: &str) -> Result<Self, SettingsError> {
        let mut all: Table = toml::from_str(DEFAULT_TOML)?;
        overlay(&mut all, toml::from_str(text)?);
        let settings: Self = Value::Table(all).try_into()?;
        settings.check()?;
        Ok(settings)
    }

    /// Whether every value lies in a range in which the planner works.
    pub fn check(&self) -> Result<(), SettingsError> {
        for (key, value, least, most) in self.ranges() {
            if !(least..=most).contains(&value) {
                return Err(SettingsError::Range { key, value, least, most });
            }
        }
        self.check_orders()?;
        self.flight.no_fly.iter().try_for_each(|zone| {
            let fault = |reason| Err(SettingsError::Zone { name: zone.name.clone(), reason });
            if zone.outline_m.is_empty() == zone.outline_deg.is_empty() {
                return fault("it needs an outline, either in degrees (`outline_deg`) or in metres (`outline_m`)");
            }
            if zone.outline_m.len() + zone.outline_deg.len() < 3 {
                return fault("its outline needs at least three corners");
            }
            if zone.outline_deg.iter().any(|&[lon, lat]| lon.abs() > 180.0 || lat.abs() > 90.0) {
                return fault("its corners must be longitude and latitude in degrees, in this order");
            }
            if !zone
                .outline_m
                .iter()
                .chain(&zone.outline_deg)
                .flatten()
                .chain([&zone.floor_m, &zone.ceiling_m])
                .all(|v| v.is_finite())
            {
                return fault("its numbers must be finite");
            }
            if zone.floor_m >= zone.ceiling_m {
                return fault("its floor must lie below its ceiling");
            }
            Ok(())
        })
    }

    fn check_orders(&self) -> Result<(), SettingsError> {
        let orders = [
            (self.flight.altitude_min_m, "flight.altitude_min_m", self.flight.legal_ceiling_m, "flight.legal_ceiling_m"),
            (self.flight.safety_distance_m, "flight.safety_distance_m", self.field.shell_m, "field.shell_m"),
            (self.coverage.full_disk_m, "coverage.full_disk_m", self.coverage.range_m, "coverage.range_m"),
            (self.search.neighbour_min_m, "search.neighbour_min_m", self.search.neighbour_max_m, "search.neighbour_max_m"),
            (
                self.quality.min_parallax_deg,
                "quality.min_parallax_deg",
                self.quality.max_parallax_deg,
                "quality.max_parallax_deg",
            ),
        ];
        let wrong = orders.into_iter().find(|(low, _, high, _)| low > high);
        wrong.map_or(Ok(()), |(_, lower, _, upper)| Err(SettingsError::Order { lower, upper }))
    }

    fn ranges(&self) -> Vec<(&'static str, f64, f64, f64)> {
        let Self { proxy, surface, flight, dynamics, field, coverage, objective, search, refine, .. } = self;
        let Self { quality, baseline, bound, daemon, .. } = self;
        vec![
            ("proxy.epsg", f64::from(proxy.epsg), 0.0, 10_000_000.0),
            ("proxy.unit_m", proxy.unit_m, 1e-6, 1e6),
            ("proxy.offset_m[0]", proxy.offset_m[0], -1e8, 1e8),
            ("proxy.offset_m[1]", proxy.offset_m[1], -1e8, 1e8),
            ("proxy.offset_m[2]", proxy.offset_m[2], -1e5, 1e5),
            ("proxy.lod", proxy.lod, 0.0, 4.0),
            ("proxy.storey_height_m", proxy.storey_height_m, 1.0, 20.0),
            ("proxy.default_height_m", proxy.default_height_m, 1.0, 1000.0),
            ("proxy.max_height_m", proxy.max_height_m, 1.0, 10_000.0),
            ("proxy.max_extent_m", proxy.max_extent_m, 10.0, 100_000.0),
            ("surface.samples", f64::from(surface.samples), 1.0, 1_000_000.0),
            ("surface.max_spacing_m", surface.max_spacing_m, 0.1, 100_000.0),
            ("surface.max_samples", f64::from(surface.max_samples), 1.0, 1_000_000.0),
            ("surface.exposure_offset_m", surface.exposure_offset_m, 0.001, 2.0),
            ("flight.cruise_speed_mps", flight.cruise_speed_mps, 0.1, 100.0),
            ("flight.safety_distance_m", flight.safety_distance_m, 0.5, 1000.0),
            ("flight.altitude_min_m", flight.altitude_min_m, 0.5, 10_000.0),
            ("flight.above_tallest_m", flight.above_tallest_m, 0.0, 10_000.0),
            ("flight.legal_ceiling_m", flight.legal_ceiling_m, 1.0, 10_000.0),
            ("flight.lateral_margin_m", flight.lateral_margin_m, 0.0, 10_000.0),
            ("dynamics.acceleration_mps2", dynamics.acceleration_mps2, 0.01, 100.0),
            ("dynamics.jerk_mps3", dynamics.jerk_mps3, 0.01, 10_000.0),
            ("dynamics.lateral_mps2", dynamics.lateral_mps2, 0.01, 100.0),
            ("dynamics.corner_deviation_m", dynamics.corner_deviation_m, 0.0, 100.0),
            ("dynamics.yaw_rate_dps", dynamics.yaw_rate_dps, 0.1, 3600.0),
            ("dynamics.gimbal_rate_dps", dynamics.gimbal_rate_dps, 0.1, 3600.0),
            ("field.viewpoints", f64::from(field.viewpoints), 1.0, 1_000_000.0),
            ("field.most_samples", f64::from(field.most_samples), 1.0, 10_000_000.0),
            ("field.most_viewpoints", f64::from(field.most_viewpoints), 1.0, 10_000_000.0),
            ("field.max_spacing_m", field.max_spacing_m, 1.0, 1000.0),
            ("field.shell_m", field.shell_m, 1.0, 1000.0),
            ("coverage.sight_scale", coverage.sight_scale, 0.25, 4.0),
            ("coverage.theta0_deg", coverage.theta0_deg, 1.0, 89.0),
            ("coverage.full_disk_m", coverage.full_disk_m, 0.0, 10_000.0),
            ("coverage.falloff_m", coverage.falloff_m, 1.0, 100_000.0),
            ("coverage.max_incidence_deg", coverage.max_incidence_deg, 1.0, 89.9),
            ("coverage.range_m", coverage.range_m, 1.0, 10_000.0),
            ("coverage.threshold_percent", coverage.threshold_percent, 0.0, 99.0),
            ("coverage.goal_percent", coverage.goal_percent, 0.0, 100.0),
            ("objective.eta", objective.eta, 0.0, 100.0),
            ("objective.alpha_t", objective.alpha_t, 0.0, 10_000.0),
            ("objective.information_scale", objective.information_scale, 1e-6, 1e6),
            ("objective.reference_area_m2", objective.reference_area_m2, 1.0, 1e12),
            ("objective.reference_length_m", objective.reference_length_m, 1.0, 1e9),
            ("objective.turn_hairpin_s", objective.turn_hairpin_s, 0.0, 1000.0),
            ("objective.turn_curvature_s", objective.turn_curvature_s, 0.0, 1000.0),
            ("search.iterations", f64::from(search.iterations), 0.0, f64::from(MOST_ITERATIONS)),
            ("search.candidates", f64::from(search.candidates), 1.0, 1000.0),
            ("search.neighbour_share", search.neighbour_share, 0.0, 1.0),
            ("search.neighbour_min_m", search.neighbour_min_m, 1.0, 10_000.0),
            ("search.neighbour_max_m", search.neighbour_max_m, 1.0, 10_000.0),
            ("search.neighbours_most", f64::from(search.neighbours_most), 1.0, 1_000_000.0),
            ("search.memory_mb", f64::from(search.memory_mb), 1.0, 1_000_000.0),
            ("search.image_spacing_m", search.image_spacing_m, 0.5, 1000.0),
            ("search.view_turn_deg", search.view_turn_deg, 0.0, 180.0),
            ("refine.tree_iterations", f64::from(refine.tree_iterations), 0.0, f64::from(MOST_ITERATIONS)),
            ("refine.rounds", f64::from(refine.rounds), 0.0, f64::from(MOST_ITERATIONS)),
            ("refine.coarse_samples", f64::from(refine.coarse_samples), 1.0, 1e6),
            ("refine.round_moves", f64::from(refine.round_moves), 1.0, 1e6),
            ("refine.sectors", f64::from(refine.sectors), 1.0, 64.0),
            ("refine.hottest_s", refine.hottest_s, 0.0, 1000.0),
            ("refine.coldest_s", refine.coldest_s, 0.0, 1000.0),
            ("refine.resumed_s", refine.resumed_s, 0.0, 1000.0),
            ("refine.margin_cells", f64::from(refine.margin_cells), 0.0, 128.0),
            ("refine.margin_parallax_deg", refine.margin_parallax_deg, 0.0, 10.0),
            ("refine.parts_share", refine.parts_share, 0.0, 100.0),
            ("refine.surplus_share", refine.surplus_share, 0.0, 1.0),
            ("refine.price_rise", refine.price_rise, 1.0, 10.0),
            ("refine.price_fall", refine.price_fall, 0.1, 1.0),
            ("quality.samples", f64::from(quality.samples), 1.0, 1_000_000.0),
            ("quality.pixel_noise_px", quality.pixel_noise_px, 1e-3, 100.0),
            ("quality.min_parallax_deg", quality.min_parallax_deg, 0.1, 170.0),
            ("quality.max_parallax_deg", quality.max_parallax_deg, 0.1, 180.0),
            ("quality.least_views", f64::from(quality.least_views), 2.0, 1000.0),
            ("quality.smith_range_m", quality.smith_range_m, 1.0, 10_000.0),
            ("quality.smith_target", quality.smith_target, 0.0, 1e6),
            ("baseline.op_focal_mm", baseline.op_focal_mm, 0.0, 2000.0),
            ("baseline.op_side_overlap", baseline.op_side_overlap, 0.0, 0.95),
            ("baseline.op_forward_overlap", baseline.op_forward_overlap, 0.0, 0.95),
            ("baseline.op_height_m", baseline.op_height_m, 0.0, 10_000.0),
            ("baseline.smith_target", baseline.smith_target, 0.01, 1000.0),
            ("baseline.smith_share_percent", baseline.smith_share_percent, 1.0, 100.0),
            ("baseline.smith_rounds", f64::from(baseline.smith_rounds), 0.0, 1000.0),
            ("baseline.zhou_target", baseline.zhou_target, 0.01, 1000.0),
            ("baseline.zhou_rounds", f64::from(baseline.zhou_rounds), 0.0, 1000.0),
            ("baseline.tour_kicks", f64::from(baseline.tour_kicks), 0.0, 100_000.0),
            ("bound.waypoints", f64::from(bound.waypoints), 2.0, 1000.0),
            ("bound.most_sightings", f64::from(bound.most_sightings), 1.0, 1e9),
            ("bound.most_rounds", f64::from(bound.most_rounds), 1.0, 1e6),
            ("bound.still_share", bound.still_share, 0.0, 1.0),
            ("bound.still_rounds", f64::from(bound.still_rounds), 1.0, 1e6),
            ("bound.most_new_rows", f64::from(bound.most_new_rows), 1.0, 1e6),
            ("bound.idle_m", bound.idle_m, 0.0, 1000.0),
            ("bound.least_violation", bound.least_violation, 1e-6, 1.0),
            ("bound.nested_cuts", f64::from(bound.nested_cuts), 1.0, 1000.0),
            ("bound.least_visit", bound.least_visit, 1e-6, 1.0),
            ("bound.first_neighbours", f64::from(bound.first_neighbours), 1.0, 1000.0),
            ("bound.solver_iterations", f64::from(bound.solver_iterations), 1.0, 10_000.0),
            ("bound.solver_gap", bound.solver_gap, 1e-12, 0.1),
            ("bound.solver_feasibility", bound.solver_feasibility, 1e-12, 0.1),
            ("bound.weighed_images", f64::from(bound.weighed_images), 1.0, 128.0),
            ("bound.weighed_sets", f64::from(bound.weighed_sets), 1.0, 100_000.0),
            ("bound.weighing_steps", f64::from(bound.weighing_steps), 1.0, 1e8),
            ("bound.plan_searches", f64::from(bound.plan_searches), 1.0, 1000.0),
            ("bound.plan_rounds", f64::from(bound.plan_rounds), 0.0, f64::from(MOST_ITERATIONS)),
            ("bound.plan_tolerance", bound.plan_tolerance, 0.0, 1.0),
            ("bound.plan_taken", f64::from(bound.plan_taken), 1.0, 1000.0),
            ("daemon.memory_budget_mb", daemon.memory_budget_mb as f64, 1.0, 1e9),
            ("daemon.max_scene_mb", daemon.max_scene_mb as f64, 1.0, 4096.0),
            ("daemon.threads", f64::from(daemon.threads), 0.0, 1024.0),
            ("daemon.search_nice", f64::from(daemon.search_nice), 0.0, 19.0),
        ]
    }
}

fn overlay(below: &mut Table, above: Table) {
    for (key, value) in above {
        match (below.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => overlay(below, above),
            (_, value) => {
                below.insert(key, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_embedded_defaults_are_in_range() {
        assert_eq!(Settings::default().check(), Ok(()));
        assert_eq!(Settings::parse("").as_ref(), Ok(&Settings::default()));
    }

    #[test]
    fn a_file_changes_only_the_keys_that_it_gives() {
        let mut expected = Settings::default();
        expected.surface.samples = 77;
        assert_eq!(Settings::parse("[surface]\nsamples = 77\n"), Ok(expected));
    }

    #[test]
    fn every_mistake_is_named() {
        for (text, named) in [
            ("[surface]\nsample = 77\n", "sample"),
            ("[surface]\nsamples = -1\n", "samples"),
            ("[bound]\nleast_violation = 0.0\n", "bound.least_violation"),
            ("[flight\n", "line 1"),
            ("[flight]\nsafety_distance_m = nan\n", "flight.safety_distance_m"),
            ("[flight]\nsafety_distance_m = 40.0\n", "field.shell_m"),
            ("[[flight.no_fly]]\nname = 'pad'\noutline_m = [[0.0, 0.0]]\nfloor_m = 0.0\nceiling_m = 9.0\n", "pad"),
        ] {
            let error = Settings::parse(text).expect_err("the text is wrong").to_string();
            assert!(error.contains(named), "{text:?} gave {error}");
        }
    }
}
