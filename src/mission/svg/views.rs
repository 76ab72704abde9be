//! Where a camera on a gimbal looks, at some of the waypoints.

use nalgebra::Vector3;
use svg::node::element::{Group, Path};

use super::colour;
use super::pen::{self, Place};
use super::sheet::Sheet;
use super::thin;
use crate::trajectory::plan::Plan;

/// Length of the wedge of a level view, pixels; a view that is pitched is shorter, as it is seen from above.
const LENGTH: f64 = 24.0;
/// Waypoints are left out until wedges are this far apart, pixels.
const GAP: f64 = 26.0;
/// A shorter wedge would hide under its waypoint: a view straight down has none.
const LEAST_LENGTH: f64 = 5.0;

/// Whether the waypoints have view directions of their own: one camera, which looks where its waypoint says.
pub fn are_shown(plan: &Plan) -> bool {
    let first = plan.waypoints.first().and_then(|waypoint| waypoint.direction);
    plan.cameras.len() == 1 && first.is_some() && plan.images.first().is_some_and(|image| image.direction == first)
}

/// The wedges of a plan, seen from above; empty for rigs without a gimbal.
pub fn draw(sheet: &Sheet, plan: &Plan) -> Group {
    let group = pen::group("views");
    if !are_shown(plan) {
        return group;
    }
    let half_tangent = plan.cameras[0].intrinsics.map_or(0.5, |intrinsics| intrinsics.half_tangents()[0]);
    let places: Vec<(Place, Vector3<f64>)> = plan
        .waypoints
        .iter()
        .filter_map(|waypoint| {
            let direction = waypoint.direction?.into_inner();
            Some((sheet.seen_from_above(waypoint.position_m.x, waypoint.position_m.y), direction))
        })
        .filter(|(_, direction)| LENGTH * direction.xy().norm() >= LEAST_LENGTH)
        .collect();
    let kept = thin::apart(places.iter().map(|&(place, _)| place), [], GAP);
    let mut kept = kept.iter().peekable();
    let shown = places.iter().filter(|(place, _)| kept.next_if(|next| *next == place).is_some());
    shown.fold(group, |group, (place, direction)| {
        group.add(wedge(*place, [direction.x, -direction.y], half_tangent, sheet.mark_scale()))
    })
}

/// A wedge as it stands on the path and in the legend; `towards` is its axis on the sheet, as long as the cosine of the view's pitch.
pub fn wedge(apex: Place, towards: Place, half_tangent: f64, scale: f64) -> Path {
    let [x, y] = towards.map(|part| part * LENGTH * scale.max(0.6));
    // A wide lens would make wedges that meet their neighbours.
    let half = half_tangent.min(0.6);
    let corner = |side: f64| [apex[0] + x - side * half * y, apex[1] + y + side * half * x];
    Path::new()
        .set("d", pen::ring([apex, corner(-1.0), corner(1.0)]))
        .set("fill", colour::INK)
        .set("fill-opacity", 0.2)
        .set("stroke", colour::INK)
        .set("stroke-width", pen::rounded(0.8 * scale.max(0.6)))
        .set("stroke-opacity", 0.75)
        .set("stroke-linejoin", "round")
}
