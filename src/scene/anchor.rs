//! Where the local frame of a scene lies in the coordinates of its file. A newer version of the file is put into the same frame by it, bit for bit.

use super::read::ImportError;
use crate::frame::Geodetic;

/// What a reader took for the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Anchor {
    /// Of GeoJSON: a place in degrees.
    Degrees(Geodetic),
    /// Of CityJSON: a point of the file's grid, in its units; z is the ground.
    Grid { epsg: Option<u32>, origin: [f64; 3] },
    /// Of a height raster or a point cloud: a point of the file's grid, in its units; z is the lowest place of the terrain.
    Heights { epsg: Option<u32>, origin: [f64; 3] },
    /// Of an OBJ mesh: a point in its coordinates, m; z is the ground.
    Mesh { origin_m: [f64; 3] },
}

impl Anchor {
    /// The anchor of an OBJ file whose coordinates are local ones already.
    pub const LOCAL_MESH: Self = Self::Mesh { origin_m: [0.0; 3] };

    /// The origin in degrees for a GeoJSON file.
    pub(crate) fn degrees(&self, file: &str) -> Result<Geodetic, ImportError> {
        match self {
            Self::Degrees(origin) => Ok(*origin),
            _ => Err(self.mismatch(file, "a GeoJSON file")),
        }
    }

    /// The origin in the grid of a CityJSON file with this reference system.
    pub(crate) fn grid(&self, file: &str, epsg: Option<u32>) -> Result<[f64; 3], ImportError> {
        match self {
            Self::Grid { epsg: own, origin } if *own == epsg => Ok(*origin),
            _ => Err(self.mismatch(file, &format!("a CityJSON file {}", reference(epsg)))),
        }
    }

    /// The origin in the grid of a height raster or a point cloud with this reference system.
    pub(crate) fn heights(&self, file: &str, epsg: Option<u32>) -> Result<[f64; 3], ImportError> {
        match self {
            Self::Heights { epsg: own, origin } if *own == epsg => Ok(*origin),
            _ => Err(self.mismatch(file, &format!("a height model {}", reference(epsg)))),
        }
    }

    /// The origin in the coordinates of an OBJ file.
    pub(crate) fn mesh(&self, file: &str) -> Result<[f64; 3], ImportError> {
        match self {
            Self::Mesh { origin_m } => Ok(*origin_m),
            _ => Err(self.mismatch(file, "an OBJ file")),
        }
    }

    fn mismatch(&self, file: &str, found: &str) -> ImportError {
        let own = match self {
            Self::Degrees(_) => "a GeoJSON file".to_owned(),
            Self::Grid { epsg, .. } => format!("a CityJSON file {}", reference(*epsg)),
            Self::Heights { epsg, .. } => format!("a height model {}", reference(*epsg)),
            Self::Mesh { .. } => "an OBJ file".to_owned(),
        };
        ImportError::Anchor { file: file.into(), what: format!("it is {found}, and the scene was loaded from {own}") }
    }
}

fn reference(epsg: Option<u32>) -> String {
    epsg.map_or("without an EPSG code".into(), |epsg| format!("in EPSG:{epsg}"))
}
