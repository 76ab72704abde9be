//! Cameras and rigs: what an image taken at a pose can see.

use nalgebra::{Point3, Unit, Vector3};

/// Where a rig is and where it looks. `direction` is `None` where the rig sees in all directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    pub position: Point3<f64>,
    pub direction: Option<Unit<Vector3<f64>>>,
}

/// The cameras that a drone carries.
#[derive(Clone, Debug, PartialEq)]
pub enum Rig {
    /// A camera system that sees in all directions, so that a viewpoint is a position (paper, section 3).
    Panoramic,
}

impl Rig {
    /// Names of the presets.
    pub const PRESETS: [&str; 1] = ["panoramic"];

    /// The preset called `name`.
    pub fn preset(name: &str) -> Option<Self> {
        (name == Self::PRESETS[0]).then_some(Self::Panoramic)
    }

    pub fn name(&self) -> &'static str {
        match self {
            Self::Panoramic => Self::PRESETS[0],
        }
    }

    /// Names of the cameras, in the order of the images that one exposure yields.
    pub fn cameras(&self) -> Vec<String> {
        match self {
            Self::Panoramic => vec!["panorama".to_owned()],
        }
    }

    /// Whether `target` lies within the frustum of a camera at `pose`; what stands between them is the field's affair.
    pub fn frames(&self, _pose: &Pose, _target: &Point3<f64>) -> bool {
        match self {
            Self::Panoramic => true,
        }
    }
}
