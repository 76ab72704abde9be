//! What the paper reports, figure by figure.

/// Table 1: objective, length m, waypoints, movement s, turning s; NY-1, one camera.
pub const TABLE1: [(&str, [f64; 4]); 4] = [
    ("only E_g", [3274.0, 117.0, 614.0, 215.0]),
    ("only E_g and E_e", [2298.0, 117.0, 455.0, 168.0]),
    ("only E_g and E_t", [2700.0, 89.0, 488.0, 151.0]),
    ("full Eq. (6)", [2151.0, 84.0, 384.0, 115.0]),
];

/// Images, length m, error at 90 and 95 % m, completeness at 0.020, 0.050 and 0.075 m %.
pub type Reconstruction = [f64; 7];

/// Decimals with which the paper prints a [`Reconstruction`].
pub const RECONSTRUCTION_DECIMALS: [usize; 7] = [0, 0, 3, 3, 2, 2, 2];

/// Table 2, top: heights that are off by a share, percent; NY-1, one camera.
pub const TABLE2_HEIGHTS: [(&str, Reconstruction); 3] = [
    ("0%", [252.0, 2151.0, 0.030, 0.261, 43.50, 52.89, 57.42]),
    ("10%", [252.0, 2250.0, 0.037, 0.807, 43.87, 52.43, 57.28]),
    ("20%", [255.0, 2276.0, 0.039, 0.668, 43.43, 51.95, 57.05]),
];

/// Table 2, bottom: dilated boundaries.
pub const TABLE2_BOUNDARIES: [(&str, Reconstruction); 4] = [
    ("original", [252.0, 2151.0, 0.030, 0.261, 43.50, 52.89, 57.42]),
    ("minor", [252.0, 2290.0, 0.038, 0.728, 42.11, 51.48, 55.40]),
    ("medium", [252.0, 2293.0, 0.039, 0.994, 41.71, 51.48, 56.00]),
    ("rough", [254.0, 2283.0, 0.039, 0.792, 42.37, 51.87, 56.36]),
];

/// Table 3: scene, method, figures.
pub const TABLE3: [(&str, &str, Reconstruction); 12] = [
    ("NY-1", "Smith", [433.0, 2808.0, 0.053, 0.792, 36.01, 44.74, 49.47]),
    ("NY-1", "Zhou", [248.0, 1816.0, 0.028, 0.315, 40.24, 47.57, 52.04]),
    ("NY-1", "OP", [1297.0, 3264.0, 0.044, 0.296, 36.58, 44.74, 49.33]),
    ("NY-1", "Ours", [252.0, 2151.0, 0.030, 0.261, 43.50, 52.89, 57.42]),
    ("UK-1", "Smith", [923.0, 7819.0, 0.028, 0.051, 32.04, 37.74, 40.62]),
    ("UK-1", "Zhou", [418.0, 4648.0, 0.028, 0.049, 30.75, 35.96, 40.29]),
    ("UK-1", "OP", [2056.0, 7844.0, 0.057, 0.103, 30.52, 35.11, 38.25]),
    ("UK-1", "Ours", [420.0, 5483.0, 0.034, 0.067, 30.60, 36.08, 53.12]),
    ("Bridge-1", "Smith", [565.0, 4569.0, 0.014, 0.022, 49.47, 55.73, 59.07]),
    ("Bridge-1", "Zhou", [372.0, 4217.0, 0.015, 0.023, 52.78, 59.81, 63.06]),
    ("Bridge-1", "OP", [1232.0, 5565.0, 0.029, 0.043, 50.57, 57.66, 61.36]),
    ("Bridge-1", "Ours", [380.0, 5415.0, 0.018, 0.027, 51.64, 60.48, 70.41]),
];

/// Flights over real scenes: scene, method, length m, flight time min, battery percent.
pub type RealFlight = (&'static str, &'static str, [f64; 3]);

/// Table 4: one camera.
pub const TABLE4: [RealFlight; 4] = [
    ("ArtSci", "Zhou", [7233.0, 41.0, 146.0]),
    ("ArtSci", "Ours", [4137.0, 13.7, 50.0]),
    ("Library", "Zhou", [6531.0, 28.1, 108.0]),
    ("Library", "Ours", [4627.0, 15.5, 50.0]),
];

/// Table 5: five cameras.
pub const TABLE5: [RealFlight; 4] = [
    ("Residency", "OP", [8269.0, 34.0, 486.0]),
    ("Residency", "Ours", [7665.0, 22.0, 304.0]),
    ("High-rise", "OP", [15852.0, 51.0, 1112.0]),
    ("High-rise", "Ours", [13916.0, 42.0, 801.0]),
];

/// Section 6.1: minutes to plan, one camera, on a 2.4 GHz Xeon E5-2680.
pub const PLANNING_MIN: [(&str, f64); 3] = [("NY-1", 5.3), ("UK-1", 10.5), ("Bridge-1", 8.9)];

/// Section 6: thresholds h and goals G, percent, of the benchmarks and of the real scenes.
pub const BENCHMARK_PERCENT: [f64; 2] = [30.0, 95.0];
pub const REAL_PERCENT: [f64; 2] = [15.0, 85.0];

/// Section 6: the most iterations K.
pub const MOST_ITERATIONS: u32 = 400;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_flight_has_the_same_figures_in_every_table() {
        let ours = TABLE3[3].2;
        assert_eq!((TABLE2_HEIGHTS[0].1, TABLE2_BOUNDARIES[0].1), (ours, ours));
        assert_eq!(TABLE1[3].1[0], ours[1]);
    }

    #[test]
    fn movement_is_printed_with_the_turning_in_it() {
        for (objective, [length_m, _, movement_s, turning_s]) in &TABLE1[1..] {
            assert!((length_m / 8.0 + turning_s - movement_s).abs() < 1.5, "{objective}");
        }
    }
}
