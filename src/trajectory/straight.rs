//! A straight part of the flight: speeding up, cruising and slowing down within the limits of acceleration and jerk.
//!
//! Every change of speed is an S-curve that begins and ends without acceleration: the acceleration rises with the jerk, holds where it
//! reaches its limit and falls with the jerk. It is symmetric, so that its mean speed is the mean of both ends.

/// Limits of a change of speed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ramp {
    pub acceleration_mps2: f64,
    pub jerk_mps3: f64,
}

/// A straight part flown from one speed to another without exceeding a third.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Straight {
    pub length_m: f64,
    from_mps: f64,
    to_mps: f64,
    peak_mps: f64,
    /// Time of speeding up, at the peak and of slowing down.
    parts_s: [f64; 3],
    ramp: Ramp,
}

/// Where a drone is on a straight part, and how fast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    pub flown_m: f64,
    pub speed_mps: f64,
}

/// Newton steps to the peak of a short part, or to the time of a place, at most; it takes four or five.
const MOST_STEPS: u32 = 40;
/// The peak is found when the length comes out this exactly.
const LENGTH_TOLERANCE: f64 = 1e-13;

impl Ramp {
    /// Time of a change of speed, s.
    pub fn duration_s(&self, change_mps: f64) -> f64 {
        if change_mps >= self.full_change_mps() {
            change_mps / self.acceleration_mps2 + self.acceleration_mps2 / self.jerk_mps3
        } else {
            2.0 * (change_mps.max(0.0) / self.jerk_mps3).sqrt()
        }
    }

    /// Length of a change of speed, m; up and down alike.
    pub fn length_m(&self, one_mps: f64, other_mps: f64) -> f64 {
        (one_mps + other_mps) / 2.0 * self.duration_s((other_mps - one_mps).abs())
    }

    /// The highest speed that a change within `length_m` leads to, m/s.
    pub fn reachable_mps(&self, from_mps: f64, length_m: f64) -> f64 {
        let half_mps = self.full_change_mps() / 2.0;
        if length_m >= (from_mps + half_mps) * 4.0 * half_mps / self.acceleration_mps2 {
            // (v + d/2) (d/a + a/j) = L, solved for v + d.
            let lower = from_mps - half_mps;
            return (lower * lower + 2.0 * self.acceleration_mps2 * length_m).sqrt() - half_mps;
        }
        // 2 (v + d/2) sqrt(d/j) = L is s^3 + 2 v s = L sqrt(j) with s = sqrt(d). Its only real root after Cardano, without differences
        // that cancel.
        let right = length_m * self.jerk_mps3.sqrt();
        let third = 2.0 / 3.0 * from_mps;
        let u = libm::cbrt(right / 2.0 + (right * right / 4.0 + third * third * third).sqrt());
        if u <= 0.0 {
            return from_mps;
        }
        let w = third / u;
        let root = right / (u * u + third + w * w);
        from_mps + root * root
    }

    /// The change of speed from which on the acceleration reaches its limit.
    fn full_change_mps(&self) -> f64 {
        self.acceleration_mps2 * self.acceleration_mps2 / self.jerk_mps3
    }

    /// The highest speed between two others on `length_m` if nothing else limits it, m/s; `limit_mps` lies above it.
    fn peak_mps(&self, length_m: f64, low_mps: f64, high_mps: f64, limit_mps: f64) -> f64 {
        let half_mps = self.full_change_mps() / 2.0;
        let (low, high) = (low_mps - half_mps, high_mps - half_mps);
        let peak_mps = (self.acceleration_mps2 * length_m + (low * low + high * high) / 2.0).max(0.0).sqrt() - half_mps;
        if peak_mps - high_mps >= 2.0 * half_mps {
            return peak_mps;
        }
        self.low_peak_mps(length_m, low_mps, high_mps, limit_mps)
    }

    /// The same where at least one of both changes is too small for the whole acceleration. In s = sqrt(peak - high) the length is convex
    /// and rises, so that Newton's steps from above come down to the root.
    fn low_peak_mps(&self, length_m: f64, low_mps: f64, high_mps: f64, limit_mps: f64) -> f64 {
        // The same with boundless jerk is never lower.
        let boundless = (self.acceleration_mps2 * length_m + (low_mps * low_mps + high_mps * high_mps) / 2.0).sqrt();
        let mut s = (limit_mps.min(boundless) - high_mps).max(0.0).sqrt();
        for _ in 0..MOST_STEPS {
            let peak_mps = high_mps + s * s;
            let (rise_s, rise_slope) = self.duration_and_slope(peak_mps - low_mps, s);
            let (fall_s, fall_slope) = self.duration_and_slope(s * s, s);
            let (rise_mps, fall_mps) = ((low_mps + peak_mps) / 2.0, (high_mps + peak_mps) / 2.0);
            let excess_m = rise_mps * rise_s + fall_mps * fall_s - length_m;
            if excess_m <= LENGTH_TOLERANCE * length_m {
                break;
            }
            let slope = s * (rise_s + fall_s) + rise_mps * rise_slope + fall_mps * fall_slope;
            s = (s - excess_m / slope).max(0.0);
        }
        high_mps + s * s
    }

    /// Time of a change, and how it grows with s where the change grows with s^2.
    fn duration_and_slope(&self, change_mps: f64, s: f64) -> (f64, f64) {
        if change_mps >= self.full_change_mps() {
            return (self.duration_s(change_mps), 2.0 * s / self.acceleration_mps2);
        }
        let root = (change_mps.max(0.0) * self.jerk_mps3).sqrt();
        // With nothing else in the change, the root is s itself times that of the jerk.
        let slope = if root > 0.0 { 2.0 * s / root } else { 2.0 / self.jerk_mps3.sqrt() };
        (2.0 * root / self.jerk_mps3, slope)
    }

    /// Where a drone is `time_s` after it began to speed up.
    fn rising(&self, from_mps: f64, to_mps: f64, time_s: f64) -> Motion {
        let duration_s = self.duration_s(to_mps - from_mps);
        let jerk_s = (self.acceleration_mps2 / self.jerk_mps3).min(duration_s / 2.0);
        let time_s = time_s.clamp(0.0, duration_s);
        let j = self.jerk_mps3;
        if time_s <= jerk_s {
            let flown_m = from_mps * time_s + j * time_s * time_s * time_s / 6.0;
            return Motion { flown_m, speed_mps: from_mps + j * time_s * time_s / 2.0 };
        }
        let left_s = duration_s - time_s;
        if left_s <= jerk_s {
            let left_m = to_mps * left_s - j * left_s * left_s * left_s / 6.0;
            let length_m = (from_mps + to_mps) / 2.0 * duration_s;
            return Motion { flown_m: length_m - left_m, speed_mps: to_mps - j * left_s * left_s / 2.0 };
        }
        let (a, even_s) = (j * jerk_s, time_s - jerk_s);
        let entry_mps = from_mps + a * jerk_s / 2.0;
        let flown_m = from_mps * jerk_s + a * jerk_s * jerk_s / 6.0 + entry_mps * even_s + a * even_s * even_s / 2.0;
        Motion { flown_m, speed_mps: entry_mps + a * even_s }
    }

    /// When a drone that speeds up has flown so far, s after it began.
    fn time_at_s(&self, from_mps: f64, to_mps: f64, flown_m: f64) -> f64 {
        let duration_s = self.duration_s(to_mps - from_mps);
        let jerk_s = (self.acceleration_mps2 / self.jerk_mps3).min(duration_s / 2.0);
        let j = self.jerk_mps3;
        let bent_m = j * jerk_s * jerk_s * jerk_s / 6.0;
        let (first_m, last_m) = (from_mps * jerk_s + bent_m, to_mps * jerk_s - bent_m);
        if flown_m <= first_m {
            return jerking_s(from_mps, j, flown_m).min(jerk_s);
        }
        let left_m = (from_mps + to_mps) / 2.0 * duration_s - flown_m;
        if left_m <= last_m {
            return duration_s - jerking_s(to_mps, -j, left_m).min(jerk_s);
        }
        // v t + a t^2 / 2 = L without a difference that cancels.
        let (a, even_m) = (j * jerk_s, flown_m - first_m);
        let entry_mps = from_mps + a * jerk_s / 2.0;
        jerk_s + 2.0 * even_m / (entry_mps + (entry_mps * entry_mps + 2.0 * a * even_m).sqrt())
    }
}

impl Straight {
    pub fn new(length_m: f64, [from_mps, to_mps]: [f64; 2], limit_mps: f64, ramp: Ramp) -> Self {
        let (low_mps, high_mps) = (from_mps.min(to_mps), from_mps.max(to_mps));
        let top_mps = limit_mps.max(high_mps);
        let changes_m = |peak_mps: f64| ramp.length_m(from_mps, peak_mps) + ramp.length_m(to_mps, peak_mps);
        let level_m = length_m - changes_m(top_mps);
        let (peak_mps, level_m) = if level_m >= 0.0 {
            (top_mps, level_m)
        } else if changes_m(high_mps) >= length_m {
            (high_mps, 0.0)
        } else {
            (ramp.peak_mps(length_m, low_mps, high_mps, top_mps), 0.0)
        };
        let level_s = if peak_mps > 0.0 { level_m / peak_mps } else { 0.0 };
        let parts_s = [ramp.duration_s(peak_mps - from_mps), level_s, ramp.duration_s(peak_mps - to_mps)];
        Self { length_m, from_mps, to_mps, peak_mps, parts_s, ramp }
    }

    pub fn duration_s(&self) -> f64 {
        self.parts_s[0] + self.parts_s[1] + self.parts_s[2]
    }

    /// Time of speeding up, at the highest speed and of slowing down, s.
    pub fn parts_s(&self) -> [f64; 3] {
        self.parts_s
    }

    /// The most acceleration in speeding up and in slowing down, m/s^2.
    pub fn most_mps2(&self) -> [f64; 2] {
        let Ramp { acceleration_mps2, jerk_mps3 } = self.ramp;
        [self.from_mps, self.to_mps].map(|end_mps| acceleration_mps2.min((jerk_mps3 * (self.peak_mps - end_mps).max(0.0)).sqrt()))
    }

    /// Where the drone is `time_s` after it entered the part.
    pub fn motion_at(&self, time_s: f64) -> Motion {
        let [rise_s, level_s, fall_s] = self.parts_s;
        let motion = if time_s <= rise_s {
            self.ramp.rising(self.from_mps, self.peak_mps, time_s)
        } else if time_s <= rise_s + level_s {
            let rise_m = self.ramp.length_m(self.from_mps, self.peak_mps);
            Motion { flown_m: rise_m + self.peak_mps * (time_s - rise_s), speed_mps: self.peak_mps }
        } else {
            // Slowing down is speeding up in reverse.
            let back = self.ramp.rising(self.to_mps, self.peak_mps, rise_s + level_s + fall_s - time_s);
            Motion { flown_m: self.length_m - back.flown_m, ..back }
        };
        Motion { flown_m: motion.flown_m.clamp(0.0, self.length_m), ..motion }
    }

    /// Time after `flown_m` of the part, s, to its last digits.
    pub fn time_at_s(&self, flown_m: f64) -> f64 {
        if flown_m >= self.length_m {
            return self.duration_s();
        }
        let [rise_s, level_s, _] = self.parts_s;
        let rise_m = self.ramp.length_m(self.from_mps, self.peak_mps);
        if flown_m <= rise_m {
            return self.ramp.time_at_s(self.from_mps, self.peak_mps, flown_m);
        }
        let left_m = self.length_m - flown_m;
        if left_m <= self.ramp.length_m(self.to_mps, self.peak_mps) {
            return self.duration_s() - self.ramp.time_at_s(self.to_mps, self.peak_mps, left_m);
        }
        rise_s + ((flown_m - rise_m) / self.peak_mps).min(level_s)
    }
}

/// The time that `flown_m` take at a speed that changes with a jerk from an acceleration of 0 on, s: the root of v t + j t^3 / 6 = L. With a rising speed
/// the left side is convex and Newton's steps come down to the root; with a falling one it is concave and they come up.
fn jerking_s(speed_mps: f64, jerk_mps3: f64, flown_m: f64) -> f64 {
    if flown_m <= 0.0 {
        return 0.0;
    }
    let even_s = flown_m / speed_mps;
    let mut time_s = if jerk_mps3 > 0.0 { even_s.min(libm::cbrt(6.0 * flown_m / jerk_mps3)) } else { even_s };
    for _ in 0..MOST_STEPS {
        let bent_mps = jerk_mps3 * time_s * time_s / 2.0;
        let step_s = (speed_mps * time_s + bent_mps * time_s / 3.0 - flown_m) / (speed_mps + bent_mps);
        time_s -= step_s;
        if step_s.abs() <= f64::EPSILON * time_s {
            break;
        }
    }
    time_s
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const GENTLE: Ramp = Ramp { acceleration_mps2: 2.0, jerk_mps3: 4.0 };

    #[test]
    fn a_change_of_speed_takes_the_time_that_is_worked_out_by_hand() {
        // 0 to 8 m/s at 2 m/s^2 and 4 m/s^3: half a second of jerk, 3.5 s at the limit, half a second; 4 m/s on the mean.
        assert!((GENTLE.duration_s(8.0) - 4.5).abs() < 1e-12 && (GENTLE.length_m(0.0, 8.0) - 18.0).abs() < 1e-12);
        // 0.25 m/s: the acceleration rises for 0.25 s to 1 m/s^2 and falls again.
        assert!((GENTLE.duration_s(0.25) - 0.5).abs() < 1e-12 && (GENTLE.length_m(3.0, 3.25) - 1.5625).abs() < 1e-12);
        assert!((GENTLE.reachable_mps(0.0, 18.0) - 8.0).abs() < 1e-12);
        assert!((GENTLE.reachable_mps(3.0, 1.5625) - 3.25).abs() < 1e-12);
        assert_eq!((GENTLE.reachable_mps(0.0, 0.0), GENTLE.reachable_mps(5.0, 0.0)), (0.0, 5.0));
    }

    #[test]
    fn a_part_from_rest_to_rest_cruises_when_it_is_long_enough() {
        let long = Straight::new(100.0, [0.0, 0.0], 8.0, GENTLE);
        assert!((long.duration_s() - (4.5 + 64.0 / 8.0 + 4.5)).abs() < 1e-12);
        // After half a second of jerk 1/12 m, after 2.25 s half of the speed and 18/2 - ... by symmetry about the middle.
        assert!((long.motion_at(0.5).flown_m - 4.0 * 0.125 / 6.0).abs() < 1e-12);
        assert!((long.motion_at(2.25).speed_mps - 4.0).abs() < 1e-12);
        // 9 m: both changes of 9/2 m. dv^2/4 + dv/4 = 4.5 gives dv = (-1 + sqrt(73)) / 2.
        let short = Straight::new(9.0, [0.0, 0.0], 8.0, GENTLE);
        let peak_mps = (73f64.sqrt() - 1.0) / 2.0;
        assert!((short.duration_s() - 2.0 * (peak_mps / 2.0 + 0.5)).abs() < 1e-12, "{short:?}");
        // 0.25 m: dv sqrt(dv/4) = 0.125 gives dv = 0.25^(2/3).
        let tiny = Straight::new(0.25, [0.0, 0.0], 8.0, GENTLE);
        assert!((tiny.duration_s() - 4.0 * (0.25f64.powf(2.0 / 3.0) / 4.0).sqrt()).abs() < 1e-9, "{tiny:?}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        #[test]
        fn what_is_reachable_is_reached_within_the_length_and_no_more(
            from_mps in 0.0..12.0f64, length_m in 0.0..200.0f64, acceleration_mps2 in 0.5..6.0f64, jerk_mps3 in 0.5..30.0f64,
        ) {
            let ramp = Ramp { acceleration_mps2, jerk_mps3 };
            let reached_mps = ramp.reachable_mps(from_mps, length_m);
            prop_assert!(reached_mps >= from_mps);
            prop_assert!((ramp.length_m(from_mps, reached_mps) - length_m).abs() < 1e-7 * (1.0 + length_m), "{} m", ramp.length_m(from_mps, reached_mps));
        }

        #[test]
        fn a_straight_part_keeps_its_limits_and_its_length(
            length_m in 0.01..150.0f64, one in 0.0..1.0f64, other in 0.0..1.0f64, limit_mps in 0.5..12.0f64,
            acceleration_mps2 in 0.5..6.0f64, jerk_mps3 in 0.5..30.0f64,
        ) {
            let ramp = Ramp { acceleration_mps2, jerk_mps3 };
            let from_mps = one * limit_mps;
            let to_mps = (other * limit_mps).min(ramp.reachable_mps(from_mps, length_m));
            let from_mps = from_mps.min(ramp.reachable_mps(to_mps, length_m));
            let straight = Straight::new(length_m, [from_mps, to_mps], limit_mps, ramp);
            let steps = 20_000;
            let step_s = straight.duration_s() / f64::from(steps);
            let at = |k: u32| straight.motion_at(step_s * f64::from(k));
            let (mut integral_m, mut before_mps2) = (0.0, 0.0);
            for k in 0..steps {
                let (now, next) = (at(k), at(k + 1));
                prop_assert!(next.flown_m >= now.flown_m - 1e-9 && next.speed_mps <= limit_mps + 1e-9);
                integral_m += (now.speed_mps + next.speed_mps) / 2.0 * step_s;
                prop_assert!((integral_m - next.flown_m).abs() < 1e-5 * (1.0 + length_m), "{integral_m} m against {} m", next.flown_m);
                let mps2 = (next.speed_mps - now.speed_mps) / step_s;
                prop_assert!(mps2.abs() <= acceleration_mps2 * (1.0 + 1e-6) + 1e-9 / step_s, "{mps2} m/s^2");
                // The quotient of differences takes a step to follow.
                let jerk = if k == 0 { mps2 / step_s } else { (mps2 - before_mps2) / step_s };
                prop_assert!(jerk.abs() <= jerk_mps3 * (1.0 + 1e-6) + 1e-9 / step_s / step_s, "{jerk} m/s^3 at step {k}");
                before_mps2 = mps2;
            }
            prop_assert!(before_mps2.abs() <= jerk_mps3 * step_s + 1e-6, "{before_mps2} m/s^2 at the end");
            prop_assert!((at(steps).speed_mps - to_mps).abs() < 1e-6 && (at(0).speed_mps - from_mps).abs() < 1e-12);
            prop_assert!((integral_m - length_m).abs() < 1e-5 * (1.0 + length_m));
            for k in 0..=20 {
                let flown_m = length_m * f64::from(k) / 20.0;
                let time_s = straight.time_at_s(flown_m);
                prop_assert!((straight.motion_at(time_s).flown_m - flown_m).abs() < 1e-7 * (1.0 + length_m));
                let (mut early_s, mut late_s) = (0.0, straight.duration_s());
                for _ in 0..80 {
                    let middle_s = (early_s + late_s) / 2.0;
                    let is_early = straight.motion_at(middle_s).flown_m < flown_m;
                    *(if is_early { &mut early_s } else { &mut late_s }) = middle_s;
                }
                // Where the drone hardly moves, many times are as good.
                let [found_m, halved_m] = [time_s, late_s].map(|time_s| straight.motion_at(time_s).flown_m);
                prop_assert!((found_m - halved_m).abs() <= 1e-13 * length_m.max(1.0), "{found_m} m against {halved_m} m");
            }
        }

        #[test]
        fn no_higher_peak_would_fit(
            length_m in 0.01..60.0f64, one in 0.0..1.0f64, other in 0.0..1.0f64, acceleration_mps2 in 0.5..6.0f64, jerk_mps3 in 0.5..30.0f64,
        ) {
            // A bisection over the peak as an oracle.
            let ramp = Ramp { acceleration_mps2, jerk_mps3 };
            let (from_mps, limit_mps) = (one * 8.0, 12.0);
            let to_mps = (other * 8.0).min(ramp.reachable_mps(from_mps, length_m));
            let from_mps = from_mps.min(ramp.reachable_mps(to_mps, length_m));
            let needed_m = |peak_mps: f64| ramp.length_m(from_mps, peak_mps) + ramp.length_m(to_mps, peak_mps);
            let (mut fits_mps, mut high_mps) = (from_mps.max(to_mps), limit_mps);
            for _ in 0..100 {
                let middle_mps = (fits_mps + high_mps) / 2.0;
                if needed_m(middle_mps) <= length_m { fits_mps = middle_mps } else { high_mps = middle_mps }
            }
            let straight = Straight::new(length_m, [from_mps, to_mps], limit_mps, ramp);
            prop_assert!((straight.peak_mps - fits_mps).abs() < 1e-6, "{} m/s, but {fits_mps} m/s fit", straight.peak_mps);
        }
    }
}
