//! Scenes from heights: surface models (GeoTIFF) with or without a model of the ground, and point clouds (LAS, LAZ), which become heights on a grid.
//!
//! What stands 2.5 m and more above the ground is cut into roofs whose heights belong together; each becomes a prism over its simplified outline. The
//! ground becomes the terrain of the scene, whose lowest place is z = 0.

mod cloud;
mod compose;
mod geo_keys;
mod grid;
mod ground;
mod outline;
mod regions;
mod roofs;
mod tiff;

#[cfg(test)]
mod tests;

pub use self::cloud::{Source, Watched};
use self::geo_keys::Reference;
use self::grid::Grid;
use self::tiff::Fold;
use super::anchor::Anchor;
use super::proxy::Scene;
use super::read::{GroundFile, ImportError};
use super::report::{Format, ImportReport};
use crate::settings::ProxySettings;

/// Heights of a place, whatever they were read from.
struct Heights {
    surface: Grid,
    /// Heights of the ground in the cells of the surface, where known.
    ground: Option<Vec<f32>>,
    /// Whether a cell is one of a building, where points are marked.
    is_building: Option<Vec<bool>>,
    reference: Reference,
}

/// Reads a surface model, over the model of the ground where one is given.
pub(super) fn read_tiff(
    file: &str,
    bytes: &[u8],
    ground: Option<&GroundFile>,
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let mut report = ImportReport::new(Format::GeoTiff);
    let surface = tiff::read(file, bytes, Fold::Highest)?;
    refuse_degrees(file, &surface.reference)?;
    note_reading(&surface, "surface model", &mut report);
    let below = ground.map(|ground| read_ground(file, &surface.reference, ground, &mut report)).transpose()?;
    let cell = |index: usize| {
        let (column, row) = (index % surface.grid.columns, index / surface.grid.columns);
        surface.grid.place.at(column as f64 + 0.5, row as f64 + 0.5)
    };
    let ground = below.map(|below| (0..surface.grid.heights.len()).map(|index| below.height_at(cell(index))).collect());
    let heights = Heights { ground, is_building: None, reference: surface.reference, surface: surface.grid };
    compose::compose(file, heights, settings, anchor, report)
}

/// Reads a point cloud.
pub(super) fn read_cloud(
    file: &str,
    source: &mut dyn Source,
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
) -> Result<(Scene, ImportReport), ImportError> {
    let mut report = ImportReport::new(Format::PointCloud);
    let cloud = cloud::read(file, source)?;
    refuse_degrees(file, &cloud.reference)?;
    let side = cloud.surface.place.cell();
    report.notes.push(format!("{} points, the highest in each cell of {side:.1} x {side:.1} units of the file", cloud.points));
    if cloud.noise > 0 {
        report.notes.push(format!("{} points are marked as noise or withheld: left out", cloud.noise));
    }
    if cloud.outside > 0 {
        report.notes.push(format!("{} points lie outside of the box that the file states: left out", cloud.outside));
    }
    if cloud.alone > 0 {
        report.notes.push(format!("{} points stand alone far above all others of their cell: left out", cloud.alone));
    }
    if 2 * cloud.outside > cloud.points {
        let what = "most of its points lie outside of the box that its header states".into();
        return Err(ImportError::Structure { file: file.into(), what, remedy: "export it with a correct header" });
    }
    let heights =
        Heights { surface: cloud.surface, ground: cloud.ground, is_building: cloud.is_building, reference: cloud.reference };
    compose::compose(file, heights, settings, anchor, report)
}

/// The model of the ground, in the units of the surface model.
fn read_ground(file: &str, surface: &Reference, ground: &GroundFile, report: &mut ImportReport) -> Result<Grid, ImportError> {
    let name = ground.file_name;
    let raster = tiff::read(name, ground.bytes, Fold::Mean)?;
    refuse_degrees(name, &raster.reference)?;
    let (own, other) = (raster.reference, surface);
    if own.epsg.zip(other.epsg).is_some_and(|(own, other)| own != other) {
        let what =
            format!("it is in EPSG:{}, and the surface model {file} in EPSG:{}", own.epsg.unwrap_or(0), other.epsg.unwrap_or(0));
        let remedy = "reproject one of them, for example with `gdalwarp -t_srs EPSG:code in.tif out.tif`";
        return Err(ImportError::Structure { file: name.into(), what, remedy });
    }
    if own.height_unit_m.zip(other.height_unit_m).is_some_and(|(own, other)| own != other) {
        let what = format!("its heights have another unit than those of the surface model {file}");
        let remedy = "bring both to metres, for example with `gdal_calc.py --calc=\"A*0.3048\"`";
        return Err(ImportError::Structure { file: name.into(), what, remedy });
    }
    let how = if ground.is_found { ", which stands beside the surface model" } else { "" };
    report.notes.push(format!("ground from {name}{how}"));
    note_reading(&raster, "model of the ground", report);
    Ok(raster.grid)
}

fn note_reading(raster: &tiff::Raster, what: &str, report: &mut ImportReport) {
    if raster.factor > 1 {
        let [columns, rows, factor] = [raster.grid.columns, raster.grid.rows, raster.factor];
        report.notes.push(format!("{what} gridded down by {factor} to {columns} x {rows} cells while it was read"));
    }
    if raster.absurd > 0 {
        report.notes.push(format!("{what}: {} pixels have no possible height and count as unknown", raster.absurd));
    }
}

fn refuse_degrees(file: &str, reference: &Reference) -> Result<(), ImportError> {
    let Some(epsg) = reference.geographic else { return Ok(()) };
    let named = epsg.map_or(String::new(), |epsg| format!(" (EPSG:{epsg})"));
    Err(ImportError::Structure {
        file: file.into(),
        what: format!("its coordinates are degrees{named}"),
        remedy: "reproject it to a grid in metres, for example with `gdalwarp -t_srs EPSG:code in.tif out.tif` or `pdal` for a cloud",
    })
}
