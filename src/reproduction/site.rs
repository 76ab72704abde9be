//! The scenes of the tables.

use crate::scene::BlockSettings;

/// A scene that flights are planned over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Site {
    /// The generated block of the size that the paper gives for NY-1.
    Ny1,
    Delfshaven,
    Nihonbashi,
    Manhattan,
    Marunouchi,
}

impl Site {
    /// Those that come from files.
    pub const REAL: [Self; 4] = [Self::Delfshaven, Self::Nihonbashi, Self::Manhattan, Self::Marunouchi];

    pub fn name(self) -> &'static str {
        match self {
            Self::Ny1 => "block of NY-1's size",
            Self::Delfshaven => "delfshaven",
            Self::Nihonbashi => "nihonbashi",
            Self::Manhattan => "manhattan",
            Self::Marunouchi => "marunouchi",
        }
    }

    /// Where its file stands in the folder of scenes; `None` for one that is generated.
    pub fn file(self) -> Option<&'static str> {
        match self {
            Self::Ny1 => None,
            Self::Delfshaven => Some("delfshaven/delfshaven.city.json"),
            Self::Nihonbashi => Some("nihonbashi/buildings.geojson"),
            Self::Manhattan => Some("manhattan/buildings.geojson"),
            Self::Marunouchi => Some("marunouchi/buildings.geojson"),
        }
    }
}

/// A block for a quick run: large enough for streets, small enough for tests.
pub fn quick_block() -> BlockSettings {
    BlockSettings { seed: 1, extent_m: [120.0, 90.0], buildings: 6, min_height_m: 8.0, max_height_m: 30.0, ..Default::default() }
}
