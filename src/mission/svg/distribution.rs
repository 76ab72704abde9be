//! A histogram by area: which share of the surface has which value.

use svg::node::element::Group;

use super::colour;
use super::legend::heading;
use super::pen::{self, Anchor, Place};
use super::sheet::{self, LEGEND_WIDTH};

/// Room for the labels of the vertical axis.
const AXIS: f64 = 30.0;
const HEIGHT: f64 = 110.0;
const BARS: usize = 30;

/// The horizontal axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Scale {
    from: f64,
    to: f64,
    is_logarithmic: bool,
    ticks: Vec<f64>,
}

impl Scale {
    /// From zero to a round value that is not below `most`.
    pub fn linear(most: f64) -> Self {
        let step = sheet::round_up(most.max(1e-6) / 6.0);
        let last = (most / step).ceil().max(1.0);
        Self {
            from: 0.0,
            to: last * step,
            is_logarithmic: false,
            ticks: (0..=last as u32).map(|tick| f64::from(tick) * step).collect(),
        }
    }

    /// Angles between two views.
    pub fn degrees() -> Self {
        Self { from: 0.0, to: 180.0, is_logarithmic: false, ticks: (0..=6).map(|tick| f64::from(tick) * 30.0).collect() }
    }

    /// Between two positive values, with a tick at 0.5, 1, 2, 5, 10 and so on.
    pub fn logarithmic([from, to]: [f64; 2]) -> Self {
        let decades = [0.1, 1.0, 10.0, 100.0, 1000.0].into_iter().flat_map(|decade| [decade, 2.0 * decade, 5.0 * decade]);
        Self { from, to, is_logarithmic: true, ticks: decades.filter(|tick| (from..=to).contains(tick)).collect() }
    }

    /// The place of a value, 0 to 1; what lies outside takes the end.
    fn share(&self, value: f64) -> f64 {
        let share = match self.is_logarithmic {
            true => libm::log(value / self.from) / libm::log(self.to / self.from),
            false => (value - self.from) / (self.to - self.from),
        };
        share.clamp(0.0, 1.0)
    }
}

/// Bars of the share of the surface, percent; `weighted` are values with their surface.
pub fn histogram(place: Place, title: &str, scale: &Scale, weighted: &[(f64, u64)]) -> Group {
    let [left, top] = place;
    let shares = shares(scale, weighted);
    let step = sheet::round_up(shares.iter().copied().fold(1.0, f64::max) / 4.0);
    let most = (shares.iter().copied().fold(1.0, f64::max) / step).ceil() * step;
    let base = top + 22.0 + HEIGHT;
    let width = LEGEND_WIDTH - AXIS;
    let mut group = Group::new().set("class", "histogram").add(heading([left, top + 10.0], title));
    for percent in sheet::round_ticks(0.0, most * 1.000_001, step) {
        let y = base - HEIGHT * percent / most;
        group = group.add(pen::line([left + AXIS, y], [left + LEGEND_WIDTH, y], colour::GRID, 1.0)).add(pen::quiet_text(
            [left + AXIS - 8.0, y + 4.0],
            12.0,
            Anchor::End,
            &format!("{percent:.0}"),
        ));
    }
    for (index, percent) in shares.iter().enumerate().filter(|(_, percent)| **percent > 0.0) {
        let from = left + AXIS + width * index as f64 / BARS as f64;
        let height = HEIGHT * percent / most;
        group = group.add(pen::rectangle([from, base - height], [width / BARS as f64 - 1.5, height], &colour::SHARE.at(0.8)));
    }
    for &tick in &scale.ticks {
        let share = scale.share(tick);
        let anchor = if share > 0.97 { Anchor::End } else { Anchor::Middle };
        let x = left + AXIS + width * share;
        group = group.add(pen::line([x, base], [x, base + 4.0], colour::OUTLINE, 0.7)).add(pen::quiet_text(
            [x, base + 18.0],
            12.0,
            anchor,
            &format!("{tick}"),
        ));
    }
    group.add(pen::line([left + AXIS, base], [left + LEGEND_WIDTH, base], colour::OUTLINE, 1.0))
}

/// Percent of the surface in each bar.
fn shares(scale: &Scale, weighted: &[(f64, u64)]) -> [f64; BARS] {
    let mut areas = [0u64; BARS];
    for (value, area) in weighted {
        areas[((scale.share(*value) * BARS as f64) as usize).min(BARS - 1)] += area;
    }
    let all = areas.iter().sum::<u64>().max(1) as f64;
    areas.map(|area| 100.0 * area as f64 / all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_falls_into_one_bar_and_bars_add_up_to_everything() {
        let weighted = [(0.0, 1), (29.0, 1), (300.0, 2), (-5.0, 4)];
        let shares = shares(&Scale::linear(60.0), &weighted);
        assert_eq!((shares[0], shares[14], shares[29]), (62.5, 12.5, 25.0));
        assert_eq!(shares.iter().sum::<f64>(), 100.0);
        assert_eq!(super::shares(&Scale::linear(0.0), &[]), [0.0; BARS]);
    }

    #[test]
    fn ticks_are_round_and_reach_the_largest_value() {
        assert_eq!(Scale::linear(37.0).ticks, [0.0, 10.0, 20.0, 30.0, 40.0]);
        assert_eq!(Scale::logarithmic([1.0, 100.0]).ticks, [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]);
        assert_eq!(Scale::logarithmic([1.0, 100.0]).share(10.0), 0.5);
    }
}
