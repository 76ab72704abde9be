//! The images of a plan, in the frame of the scene that they are held against.

use nalgebra::{Point3, Unit, Vector3};

use crate::frame::LocalFrame;
use crate::scene::{Bounds, Scene};
use crate::trajectory::plan::{Image, Plan};

/// An image in the truth's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    pub image: Image,
    /// Angle that one pixel spans, rad.
    pub pixel_rad: f64,
}

/// Which images of a plan are meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Which {
    All,
    /// Those of the post-selection (section 5.3).
    Selected,
}

/// Why a plan cannot be held against a scene.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Misplaced {
    #[error(
        "the plan has {plan} and the scene {scene:?} has {truth}, so that they have no common frame; give the scene in the plan's frame as `--truth`",
        plan = georeference(*.plan_has), truth = georeference(!*.plan_has)
    )]
    OneFrame { scene: String, plan_has: bool },
    #[error(
        "the plan lies {distance_m:.0} m away from the scene {scene:?}, farther than any image reaches ({range_m} m); give the scene that \
         the plan was made for, or one of the same place and frame, as `--truth`"
    )]
    Apart { scene: String, distance_m: f64, range_m: f64 },
}

fn georeference(has: bool) -> &'static str {
    if has { "a georeference" } else { "none" }
}

/// The images of a plan, in its own frame.
pub fn shots(plan: &Plan, which: Which) -> Vec<Shot> {
    let is_meant = |image: &&Image| which == Which::All || image.selected;
    let shot = |image: &Image| {
        let camera = plan.cameras.get(image.camera as usize)?;
        Some(Shot { image: *image, pixel_rad: camera.pixel_rad })
    };
    plan.images.iter().filter(is_meant).filter_map(shot).collect()
}

/// The plan in the frame of `scene`: positions by way of WGS84, directions turned about the vertical. Two frames without georeference
/// are taken for the same.
pub fn carried(plan: &Plan, scene: &Scene) -> Result<Plan, Misplaced> {
    let from = LocalFrame { origin: plan.scene.origin };
    let (to, mut plan) = (&scene.frame, plan.clone());
    if from.origin.is_some() != to.origin.is_some() {
        return Err(Misplaced::OneFrame { scene: scene.name.clone(), plan_has: from.origin.is_some() });
    }
    if from == *to {
        return Ok(plan);
    }
    for image in &mut plan.images {
        let (position, turn) = carry(&from, to, &image.position_m);
        image.direction = image.direction.map(|direction| turn.apply(&direction));
        image.up = turn.apply(&Unit::new_normalize(image.up)).into_inner();
        image.position_m = position;
    }
    for waypoint in &mut plan.waypoints {
        let (position, turn) = carry(&from, to, &waypoint.position_m);
        waypoint.direction = waypoint.direction.map(|direction| turn.apply(&direction));
        waypoint.position_m = position;
    }
    plan.scene.origin = to.origin;
    Ok(plan)
}

/// A turn about the vertical: up is up in every frame, but north is not the same everywhere.
struct Turn {
    cos: f64,
    sin: f64,
}

impl Turn {
    fn apply(&self, direction: &Unit<Vector3<f64>>) -> Unit<Vector3<f64>> {
        let (x, y) = (direction.x * self.cos - direction.y * self.sin, direction.x * self.sin + direction.y * self.cos);
        Unit::new_normalize(Vector3::new(x, y, direction.z))
    }
}

/// Half the base over which the turn of a frame is measured, m: long against the rounding of positions, short against the Earth.
const BASE_M: f64 = 100.0;

fn carry(from: &LocalFrame, to: &LocalFrame, point: &Point3<f64>) -> (Point3<f64>, Turn) {
    let carried = |point: Point3<f64>| {
        let place = from.geodetic_from_local(&point);
        place.and_then(|place| to.local_from_geodetic(&place)).unwrap_or(point)
    };
    let east = carried(point + Vector3::x() * BASE_M) - carried(point - Vector3::x() * BASE_M);
    let length = libm::hypot(east.x, east.y);
    (carried(*point), Turn { cos: east.x / length, sin: east.y / length })
}

/// Refuses a plan of which no image comes near the scene: it would be "evaluated" to nothing seen at all.
pub fn check_reach(plan: &Plan, scene: &Scene, range_m: f64) -> Result<(), Misplaced> {
    let Some(bounds) = scene.bounds() else { return Ok(()) };
    let nearest_m = plan.images.iter().map(|image| distance_m(&bounds, &image.position_m)).fold(f64::INFINITY, f64::min);
    if nearest_m.is_finite() && nearest_m > range_m {
        return Err(Misplaced::Apart { scene: scene.name.clone(), distance_m: nearest_m, range_m });
    }
    Ok(())
}

fn distance_m(bounds: &Bounds, point: &Point3<f64>) -> f64 {
    (point - point.sup(&bounds.min).inf(&bounds.max)).norm()
}
