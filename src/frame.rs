//! The local frame: x east, y north, z up, metres; z = 0 is the ground plane of the scene.

use serde::{Deserialize, Serialize};

/// A position on the WGS84 ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Geodetic {
    pub lat_deg: f64,
    pub lon_deg: f64,
    pub alt_m: f64,
}

/// The east-north-up frame of a scene. `origin` is `None` for a scene without georeference.
#[derive(Clone, Debug, PartialEq, Default, Serialize, Deserialize)]
pub struct LocalFrame {
    pub origin: Option<Geodetic>,
}
