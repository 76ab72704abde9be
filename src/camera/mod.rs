//! Cameras and rigs: what an image taken at a pose frames. What stands between is the affair of the field.

mod intrinsics;
mod rig;
mod rig_file;
mod view;

use nalgebra::{Point3, Unit, Vector3};

pub use intrinsics::Intrinsics;
pub use rig::{Battery, Cameras, Mount, Rig, sight_scale};
pub use rig_file::RigError;
pub use view::{Targets, View, direction_of, pitch_rad};

/// Where a rig is and how it is turned.
///
/// `direction` is the view direction of a camera on a gimbal, the heading of the drone (horizontal) where cameras are bolted to it, and
/// `None` where the rig sees in all directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    pub position: Point3<f64>,
    pub direction: Option<Unit<Vector3<f64>>>,
}
