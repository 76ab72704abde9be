//! `quality.svg`: the predicted deviation of every sample from above, with the distributions of what it follows from.

use nalgebra::Point3;
use svg::Document;
use svg::node::element::{Definitions, Group, Path};

use super::colour::{self, DEVIATION, HEIGHT};
use super::distribution::{Scale, histogram};
use super::heading::{self, Figure};
use super::legend;
use super::pen::{self, Anchor, Place};
use super::sheet::{DRAWING_TOP, LEGEND_WIDTH, MARGIN, Sheet, WIDTH};
use super::top_view;
use crate::field::Outlines;
use crate::quality::{Flown, Quality, SampleQuality, Summary, Truth, TruthSample};
use crate::trajectory::plan::Plan;

/// The ends of the colour ramp, m; on a logarithmic scale.
const DEVIATIONS_M: [f64; 2] = [0.0005, 0.05];
/// Steps of the ramp: samples of one step are drawn as one path.
const STEPS: usize = 24;

/// What is drawn.
pub struct Drawn<'a> {
    /// In the frame of the truth.
    pub plan: &'a Plan,
    pub truth: &'a Truth,
    pub quality: &'a Quality,
    pub summary: &'a Summary,
    pub flown: &'a Flown,
    /// `all` or `selected`.
    pub images: &'a str,
}

/// The file's content.
pub fn to_bytes(drawn: &Drawn) -> Vec<u8> {
    let sheet = sheet(drawn);
    let document = Document::new()
        .set("viewBox", (0, 0, WIDTH as u32, sheet.height.ceil() as u32))
        .set("width", WIDTH)
        .set("height", sheet.height.ceil())
        .set("font-family", pen::FONT)
        .add(Definitions::new().add(legend::gradient("ramp-deviation", &DEVIATION)).add(legend::gradient("ramp-height", &HEIGHT)))
        .add(pen::rectangle([0.0, 0.0], [WIDTH, sheet.height.ceil()], colour::PAPER))
        .add(banner(drawn))
        .add(
            pen::group("top-view")
                .add(top_view::axes(&sheet))
                .add(buildings(&sheet, drawn))
                .add(samples(&sheet, drawn))
                .add(path(&sheet, drawn)),
        )
        .add(legend::scale_bar(&sheet))
        .add(key(&sheet, drawn))
        .add(footer(&sheet));
    format!("{document}\n").into_bytes()
}

fn sheet(drawn: &Drawn) -> Sheet {
    let bounds = drawn.truth.scene().bounds();
    let [min, max] = bounds.map_or([Point3::origin(); 2], |bounds| [bounds.min, bounds.max]);
    Sheet::from_above(min, max, drawn.plan)
}

fn banner(drawn: &Drawn) -> Group {
    let Drawn { plan, summary, flown, .. } = drawn;
    let subtitle = format!(
        "predicted quality · {} images ({}) · plan of {} · rig {} · method {} · seed {}",
        summary.images, drawn.images, plan.scene.name, plan.rig, plan.method, plan.seed
    );
    let figure = |label, value, remark| Figure { label, value, remark };
    let metres = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.3} m"));
    let [near, middle, far] = summary.completeness_percent.map(|percent| format!("{percent:.1} %"));
    let safety = match (flown.collides, flown.too_near) {
        (true, _) => "the path collides",
        (false, true) => "below the safety distance",
        _ => "over the whole curve",
    };
    let figures = [
        figure("Predicted Error 90 %", metres(summary.error_90_m), "of the reconstructed surface".to_owned()),
        figure("Predicted Error 95 %", metres(summary.error_95_m), String::new()),
        figure("Completeness 0.020 m", near, "of the exposed surface".to_owned()),
        figure("Completeness 0.050 m", middle, String::new()),
        figure("Completeness 0.075 m", far, String::new()),
        figure("Reconstructed", format!("{:.1} %", summary.reconstructed_percent), format!("seen {:.1} %", summary.seen_percent)),
        figure("Least clearance", format!("{:.1} m", flown.clearance_m), safety.to_owned()),
    ];
    heading::banner(&drawn.truth.scene().name, &subtitle, &figures)
}

/// Low structures first, so that a tower stands on its podium; pale, because the samples are what matters.
fn buildings(sheet: &Sheet, drawn: &Drawn) -> Group {
    let scene = drawn.truth.scene();
    let outlines = Outlines::new(scene, &[]);
    let tops: Vec<f64> = scene.structures.iter().map(|structure| structure.bounds().max.z).collect();
    let tallest_m = tops.iter().copied().fold(1.0, f64::max);
    let mut order: Vec<usize> = (0..tops.len()).collect();
    order.sort_by(|a, b| tops[*a].total_cmp(&tops[*b]).then(a.cmp(b)));
    order.into_iter().fold(pen::group("buildings"), |group, index| {
        let rings = outlines.rings(index).iter().map(|ring| pen::ring(ring.iter().map(|c| sheet.seen_from_above(c.x, c.y))));
        let shape = Path::new()
            .set("d", rings.collect::<String>())
            .set("fill", HEIGHT.paler(tops[index] / tallest_m, 0.45))
            .set("fill-rule", "evenodd")
            .set("stroke", colour::OUTLINE)
            .set("stroke-width", pen::rounded(0.6 * sheet.mark_scale()));
        group.add(pen::titled(shape, &scene.structures[index].name))
    })
}

/// Dots by deviation, roofs below walls. Those of a wall stand outside of it, the higher the farther out, so that the whole wall can be
/// seen from above.
fn samples(sheet: &Sheet, drawn: &Drawn) -> Group {
    let is_roof = |sample: &TruthSample| sample.frame.normal.z > 0.5;
    // Samples of roofs nearly touch, so that a roof is a surface; those of walls lie closer, being folded out.
    let spacing = spacing_m(drawn) * sheet.pixels_per_m;
    pen::group("samples")
        .add(dots(sheet, drawn, (0.8 * spacing).clamp(1.3, 9.0), is_roof).set("class", "roofs"))
        .add(dots(sheet, drawn, (0.6 * spacing).clamp(1.3, 4.5), |sample| !is_roof(sample)).set("class", "walls"))
}

fn dots(sheet: &Sheet, drawn: &Drawn, diameter: f64, counts: impl Fn(&TruthSample) -> bool) -> Group {
    let tallest_m = drawn.truth.scene().bounds().map_or(1.0, |bounds| bounds.max.z.max(1.0));
    let mut by_step: Vec<Vec<Place>> = vec![Vec::new(); STEPS];
    let (mut unseen, mut unmatched) = (Vec::new(), Vec::new());
    for (sample, quality) in drawn.truth.samples().iter().zip(&drawn.quality.samples).filter(|(sample, _)| counts(sample)) {
        let place = unfolded(sheet, sample, tallest_m);
        match quality.deviation {
            Some(deviation) => by_step[((share(deviation.normal_m) * STEPS as f64) as usize).min(STEPS - 1)].push(place),
            None if quality.views == 0 => unseen.push(place),
            None => unmatched.push(place),
        }
    }
    let group = Group::new()
        .add(pen::dots(unseen, diameter, colour::NOT_SEEN).set("data-state", "not-seen"))
        .add(pen::dots(unmatched, diameter, colour::NOT_RECONSTRUCTED).set("data-state", "not-reconstructed"));
    let steps = by_step.into_iter().enumerate().filter(|(_, places)| !places.is_empty());
    steps.fold(group, |group, (step, places)| {
        let colour = DEVIATION.at((step as f64 + 0.5) / STEPS as f64);
        group.add(pen::dots(places, diameter, &colour).set("data-state", "reconstructed"))
    })
}

/// Mean distance of neighbouring samples, m.
fn spacing_m(drawn: &Drawn) -> f64 {
    let areas = &drawn.quality.areas_mm2;
    (areas.iter().sum::<u64>() as f64 / 1e6 / areas.len().max(1) as f64).sqrt()
}

fn unfolded(sheet: &Sheet, sample: &TruthSample, tallest_m: f64) -> Place {
    let (position, normal) = (sample.frame.position, sample.frame.normal);
    let widest = (5.0 * sheet.pixels_per_m).min(12.0);
    let offset = 1.5 * sheet.mark_scale() + widest * (position.z / tallest_m).clamp(0.0, 1.0);
    let [x, y] = sheet.seen_from_above(position.x, position.y);
    // A roof's normal has no horizontal part, a wall's nothing else.
    [x + normal.x * offset, y - normal.y * offset]
}

/// The share of the ramp at a deviation.
fn share(deviation_m: f64) -> f64 {
    let [least, most] = DEVIATIONS_M;
    (libm::log(deviation_m / least) / libm::log(most / least)).clamp(0.0, 1.0)
}

fn path(sheet: &Sheet, drawn: &Drawn) -> Group {
    let project = |point: &Point3<f64>| sheet.seen_from_above(point.x, point.y);
    let corners = || pen::polyline(drawn.plan.waypoints.iter().map(|waypoint| project(&waypoint.position_m)));
    let scale = sheet.mark_scale();
    pen::group("path")
        .add(pen::stroke(corners(), colour::PAPER, 2.0 * scale).set("stroke-opacity", 0.6))
        .add(pen::stroke(corners(), colour::INK, 0.8 * scale).set("stroke-opacity", 0.7))
        .add(top_view::ends(drawn.plan, &project))
}

/// What the colours mean, and how the figures behind them are distributed.
fn key(sheet: &Sheet, drawn: &Drawn) -> Group {
    let left = sheet.legend_left;
    let [least, most] = DEVIATIONS_M;
    let labels = [0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05].map(|deviation_m| {
        let bound = if deviation_m <= least {
            "≤ "
        } else if deviation_m >= most {
            "≥ "
        } else {
            ""
        };
        (share(deviation_m), format!("{bound}{}", deviation_m * 1e3))
    });
    let row = |index: usize| DRAWING_TOP + 88.0 + 26.0 * index as f64;
    let mut group = pen::group("legend")
        .add(legend::ramp([left, DRAWING_TOP], "Deviation along the normal, mm", "ramp-deviation", labels.into_iter()))
        .add(pen::dots([[left + 8.0, row(0)]], 6.0, colour::NOT_RECONSTRUCTED))
        .add(pen::dots([[left + 8.0, row(1)]], 6.0, colour::NOT_SEEN))
        .add(pen::line([left, row(2)], [left + 22.0, row(2)], colour::INK, 1.0))
        .add(legend::north([left + LEGEND_WIDTH - 14.0, row(1)]));
    let labels = [
        "seen, not reconstructed",
        "not seen",
        "path from S to E",
        "walls unfold outwards, their top outermost",
        "Below: shares of the surface, %",
    ];
    for (index, label) in labels.into_iter().enumerate() {
        let from = if index >= 3 { left } else { left + 34.0 };
        group = group.add(pen::text([from, row(index) + 4.5], 13.0, Anchor::Start, label));
    }
    charts(drawn).into_iter().enumerate().fold(group, |group, (index, chart)| {
        let place = [left, DRAWING_TOP + 230.0 + 184.0 * index as f64];
        group.add(histogram(place, chart.title, &chart.scale, &chart.weighted))
    })
}

struct Chart {
    title: &'static str,
    scale: Scale,
    /// Values with their surface, mm^2.
    weighted: Vec<(f64, u64)>,
}

fn charts(drawn: &Drawn) -> [Chart; 4] {
    let weighted = |value: &dyn Fn(&SampleQuality) -> Option<f64>| {
        let samples = drawn.quality.samples.iter().zip(&drawn.quality.areas_mm2);
        samples.filter_map(|(sample, &area)| Some((value(sample)?, area))).collect::<Vec<_>>()
    };
    let most = |values: &[(f64, u64)]| values.iter().map(|(value, _)| *value).fold(0.0, f64::max);
    let views = weighted(&|sample| Some(f64::from(sample.views)));
    let gsd_mm = weighted(&|sample| sample.gsd_m.map(|gsd_m| gsd_m * 1e3));
    let deviation_mm = weighted(&|sample| sample.deviation.map(|deviation| deviation.normal_m * 1e3));
    [
        Chart { title: "Views", scale: Scale::linear(most(&views)), weighted: views },
        Chart {
            title: "Largest parallax, degrees",
            scale: Scale::degrees(),
            weighted: weighted(&|sample| (sample.views > 1).then_some(sample.parallax_rad.to_degrees())),
        },
        Chart { title: "Best ground sampling distance, mm", scale: Scale::linear(most(&gsd_mm)), weighted: gsd_mm },
        Chart {
            title: "Deviation along the normal, mm",
            scale: Scale::logarithmic(DEVIATIONS_M.map(|deviation_m| deviation_m * 1e3)),
            weighted: deviation_mm,
        },
    ]
}

fn footer(sheet: &Sheet) -> svg::node::element::Text {
    let meaning =
        "Pixel noise carried through the geometry of the views that exact rays show; what matching and meshing add is not in it.";
    pen::quiet_text([MARGIN, sheet.height - 28.0], 12.0, Anchor::Start, meaning)
}
