//! From heights to a scene: where it lies, its ground, and a prism for each roof.

use nalgebra::Point3;

use super::Heights;
use super::grid::{Affine, MOST_FILLED_M2, fill_nearest};
use super::ground;
use super::regions::LEAST_ROOF_M2;
use super::roofs::{self, LEAST_HEIGHT_M, Standing};
use crate::frame::LocalFrame;
use crate::scene::anchor::Anchor;
use crate::scene::crs::{self, Placement, Unplaced};
use crate::scene::proxy::{Scene, Shape, Structure, StructureId};
use crate::scene::read::{ImportError, assemble};
use crate::scene::report::ImportReport;
use crate::scene::terrain::TERRAIN_NAME;
use crate::settings::ProxySettings;

/// Larger cells show no buildings, m.
const COARSEST_CELL_M: f64 = 10.0;

/// This share of the cells has to have a ground, and may lie below it by more than this, m.
const LEAST_COVERED: f64 = 0.5;
const MOST_BELOW_SHARE: f64 = 0.3;
const BELOW_M: f32 = 1.0;

pub(super) fn compose(
    file: &str,
    mut heights: Heights,
    settings: &ProxySettings,
    anchor: Option<&Anchor>,
    mut report: ImportReport,
) -> Result<(Scene, ImportReport), ImportError> {
    let (columns, rows) = (heights.surface.columns, heights.surface.rows);
    let place = heights.surface.place;
    report.epsg = heights.reference.epsg;
    let anchored = anchor.map(|anchor| anchor.heights(file, report.epsg)).transpose()?;
    let middle = place.at(columns as f64 / 2.0, rows as f64 / 2.0);
    let origin = anchored.map_or(middle, |[x, y, _]| [x, y]);
    let placement = placement(file, &heights, origin, &mut report)?;
    let unit_m = placement.map(|placement| placement.unit_m).or(heights.reference.unit_m).unwrap_or(1.0);
    let height_unit_m = height_unit_m(&heights, placement.as_ref(), unit_m, &mut report);
    let cell_m = place.cell() * unit_m;
    check_size(file, &place, [columns, rows], unit_m, settings)?;

    to_metres(&mut heights, height_unit_m, settings.max_height_m, &mut report);
    let most_filled = (MOST_FILLED_M2 / (cell_m * cell_m)).max(4.0) as usize;
    let (filled, left) = heights.surface.fill_small(most_filled);
    if left == heights.surface.heights.len() {
        let what = "not one of its heights is known".into();
        return Err(ImportError::Structure {
            file: file.into(),
            what,
            remedy: "check its mark for unknown heights, and export it again",
        });
    }
    if filled + left > 0 {
        let share = 100.0 * left as f64 / (columns * rows) as f64;
        report.notes.push(format!(
            "unknown heights: {filled} cells in small gaps taken from their neighbours; {left} cells ({share:.1} %) in larger ones, water or outside, taken to be ground"
        ));
    }
    let ground_m = ground_of(file, &mut heights, cell_m, &mut report)?;

    let local = local_place(&place, origin, placement.as_ref(), unit_m);
    let modelled =
        ground::model(&ground_m, columns, rows, &local).ok_or_else(|| absurd(file, "its ground has no finite height"))?;
    let zero_m = anchored.map_or(modelled.terrain.range_m()[0], |[_, _, z]| z * height_unit_m);
    let terrain = modelled.terrain.lowered(zero_m);
    let [low_m, high_m] = terrain.range_m();
    report.notes.push(format!(
        "terrain of {:.1} m cells, {:.1} m of relief; it lies up to {:.1} m above the ground that it is made of and 0.5 m below at most. Heights of the scene \
         count from its lowest place, {zero_m:.2} m in the file, and those of no-fly zones from the ground below",
        terrain.cell_m(),
        high_m - low_m,
        modelled.most_above_m,
    ));

    let standing = Standing { heights: &heights, ground_m: &ground_m, terrain: &terrain, local: &local, cell_m, zero_m };
    let mut structures = roofs::structures(&standing, &mut report);
    if !structures.iter().any(Structure::is_captured) {
        let what = format!("nothing in it stands {LEAST_HEIGHT_M} m above the ground over {LEAST_ROOF_M2} m^2");
        let remedy = "give a surface model (DSM) and not one of the ground, and a model of the ground that fits it";
        return Err(ImportError::Structure { file: file.into(), what, remedy });
    }
    let shape = Shape::Terrain(terrain.into());
    structures.push(Structure { id: StructureId::of_name(TERRAIN_NAME), name: TERRAIN_NAME.into(), shape });
    report.anchor = Some(Anchor::Heights { epsg: report.epsg, origin: [origin[0], origin[1], zero_m / height_unit_m] });
    let frame = LocalFrame { origin: placement.map(|placement| crate::frame::Geodetic { alt_m: zero_m, ..placement.origin }) };
    Ok(assemble(file, frame, structures, Vec::new(), report))
}

fn absurd(file: &str, what: &str) -> ImportError {
    ImportError::Coordinates { file: file.into(), what: what.into() }
}

/// Where the origin lies on Earth; `None` where nothing known says that.
fn placement(
    file: &str,
    heights: &Heights,
    [x, y]: [f64; 2],
    report: &mut ImportReport,
) -> Result<Option<Placement>, ImportError> {
    let Some(epsg) = heights.reference.epsg else {
        report.notes.push("the file names no EPSG code of a grid: the scene has no place on Earth".into());
        return Ok(None);
    };
    match crs::place(epsg, Point3::new(x, y, 0.0)) {
        Ok(placement) => {
            report.notes.push(format!(
                "grid turned by {:.3} degrees to true north and scaled by {:.5}",
                placement.angle_deg, placement.unit_m
            ));
            Ok(Some(placement))
        }
        Err(Unplaced::Geographic) => Err(ImportError::Structure {
            file: file.into(),
            what: format!("its coordinates are degrees (EPSG:{epsg})"),
            remedy: "reproject it to a grid in metres, for example with `gdalwarp -t_srs EPSG:code in.tif out.tif`",
        }),
        Err(Unplaced::Unknown) => {
            report.notes.push(format!(
                "EPSG:{epsg} cannot be projected to WGS84 here: the scene has no place on Earth, lengths are taken as they are"
            ));
            Ok(None)
        }
    }
}

/// Metres in a unit of height: as the file says, else as in the grid.
fn height_unit_m(heights: &Heights, placement: Option<&Placement>, unit_m: f64, report: &mut ImportReport) -> f64 {
    let of_grid_m = placement.map_or(heights.reference.unit_m.unwrap_or(1.0), |placement| placement.height_unit_m);
    let own_m = heights.reference.height_unit_m.unwrap_or(of_grid_m);
    if (own_m - 1.0).abs() > 1e-6 {
        let whence =
            if heights.reference.height_unit_m.is_some() { "as the file says" } else { "like the grid; the file does not say" };
        report.notes.push(format!("heights are in units of {own_m:.7} m, {whence}"));
    } else if (unit_m - 1.0).abs() > 0.01 {
        report.notes.push(format!("heights are in metres, the grid in units of {unit_m:.4} m"));
    }
    own_m
}

fn check_size(
    file: &str,
    place: &Affine,
    [columns, rows]: [usize; 2],
    unit_m: f64,
    settings: &ProxySettings,
) -> Result<(), ImportError> {
    let length_m = |side: [f64; 2], count: usize| libm::hypot(side[0], side[1]) * count as f64 * unit_m;
    let (width_m, depth_m, cell_m) = (length_m(place.column, columns), length_m(place.row, rows), place.cell() * unit_m);
    if cell_m > COARSEST_CELL_M {
        return Err(ImportError::Structure {
            file: file.into(),
            what: format!("its cells of {cell_m:.1} m show no buildings"),
            remedy: "give a model with cells of 5 m at most (1 m and finer are better), or cut out a smaller part of a large one",
        });
    }
    if width_m.max(depth_m) > 2.0 * settings.max_extent_m {
        return Err(ImportError::Structure {
            file: file.into(),
            what: format!("it is {:.1} x {:.1} km large", width_m / 1000.0, depth_m / 1000.0),
            remedy: "cut out the part that is to be flown, for example with `gdal_translate -projwin west north east south in.tif out.tif`",
        });
    }
    Ok(())
}

fn to_metres(heights: &mut Heights, height_unit_m: f64, max_height_m: f64, report: &mut ImportReport) {
    let scale = |values: &mut Vec<f32>| values.iter_mut().for_each(|z| *z = (f64::from(*z) * height_unit_m) as f32);
    scale(&mut heights.surface.heights);
    heights.ground.iter_mut().for_each(scale);
    // What stands absurdly high is none of the town.
    let mut known: Vec<f32> = heights.surface.heights.iter().copied().filter(|z| !z.is_nan()).collect();
    if known.is_empty() {
        return;
    }
    let middle = known.len() / 2;
    let most_m = f64::from(*known.select_nth_unstable_by(middle, f32::total_cmp).1) + max_height_m;
    let mut absurd = 0;
    for z in heights.surface.heights.iter_mut().filter(|z| f64::from(**z) > most_m) {
        (*z, absurd) = (f32::NAN, absurd + 1);
    }
    if absurd > 0 {
        report.notes.push(format!("{absurd} cells lie more than {max_height_m} m above the others: taken as unknown"));
    }
}

/// The ground of every cell, m; the surface is known everywhere afterwards.
fn ground_of(file: &str, heights: &mut Heights, cell_m: f64, report: &mut ImportReport) -> Result<Vec<f32>, ImportError> {
    let (columns, rows) = (heights.surface.columns, heights.surface.rows);
    let surface = &mut heights.surface.heights;
    let ground = match heights.ground.take() {
        Some(mut ground) => {
            let is_cloud = report.format == crate::scene::report::Format::PointCloud;
            let known = ground.iter().filter(|z| !z.is_nan()).count();
            // Under the roofs of a cloud there are no points of the ground.
            let least = if is_cloud { 1.0 } else { LEAST_COVERED * ground.len() as f64 };
            if (known as f64) < least {
                return Err(ImportError::Structure {
                    file: file.into(),
                    what: format!(
                        "the model of the ground covers only {:.0} % of it",
                        100.0 * known as f64 / ground.len() as f64
                    ),
                    remedy: "give the DTM of the same place",
                });
            }
            let filled = fill_nearest(&mut ground, columns, rows);
            let below = surface.iter().zip(&ground).filter(|(z, ground)| **z < **ground - BELOW_M).count();
            if below as f64 > MOST_BELOW_SHARE * surface.len() as f64 {
                return Err(ImportError::Structure {
                    file: file.into(),
                    what: format!(
                        "it lies below its ground in {:.0} % of the cells",
                        100.0 * below as f64 / surface.len() as f64
                    ),
                    remedy: "give the surface model (DSM) as the scene and the model of the ground (DTM) with `--dtm`, both of the same place and heights",
                });
            }
            if is_cloud {
                report.notes.push("ground from the points that are marked as ground".into());
            }
            if filled > 0 {
                report.notes.push(format!("{filled} cells without a known ground take that of the nearest one"));
            }
            ground
        }
        None => {
            report.notes.push(
                "no model of the ground is given: it is guessed from the low places of the surface, which takes large roofs and hilltops amiss; give one \
                 with `--dtm FILE`"
                    .into(),
            );
            ground::guess(surface, columns, rows, cell_m)
        }
    };
    surface.iter_mut().zip(&ground).filter(|(z, _)| z.is_nan()).for_each(|(z, ground)| *z = *ground);
    Ok(ground)
}

/// Where a place in cells lies in the local frame, m.
fn local_place(place: &Affine, origin: [f64; 2], placement: Option<&Placement>, unit_m: f64) -> Affine {
    let turned = |offset: [f64; 2]| placement.map_or(offset.map(|length| length * unit_m), |placement| placement.turned(offset));
    let from = [place.origin[0] - origin[0], place.origin[1] - origin[1]];
    Affine { origin: turned(from), column: turned(place.column), row: turned(place.row) }
}
