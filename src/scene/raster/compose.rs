//! From heights to a scene: where it lies, its ground, and a prism for each roof.

use geo::{Area, Coord, LineString, MultiPolygon, Orient, Polygon};
use geo::orient::Direction;
use nalgebra::Point3;

use super::Heights;
use super::grid::{Affine, MOST_FILLED_M2, fill_nearest};
use super::outline::{self, Labels, Outline};
use super::regions::{self, LEAST_ROOF_M2, Regions, Surface};
use super::ground;
use crate::frame::LocalFrame;
use crate::scene::anchor::Anchor;
use crate::scene::bounds::Bounds;
use crate::scene::crs::{self, Placement, Unplaced};
use crate::scene::footprint;
use crate::scene::proxy::{Scene, Shape, Structure, StructureId};
use crate::scene::read::{ImportError, assemble};
use crate::scene::report::ImportReport;
use crate::scene::terrain::{TERRAIN_NAME, Terrain};
use crate::settings::ProxySettings;

/// What stands less than this above the ground is no roof, m: cars, hedges, garden walls.
const LEAST_HEIGHT_M: f64 = 2.5;

/// Larger cells show no buildings, m.
const COARSEST_CELL_M: f64 = 10.0;

/// Corners of outlines are moved by up to so many cells, and by this at least, m.
const TOLERANCE_CELLS: f64 = 0.9;
const LEAST_TOLERANCE_M: f64 = 0.8;

/// A prism ends at the height that this share of its cells does not exceed: single echoes of antennas and birds do not count.
const TOP_SHARE: f64 = 0.95;

/// Prisms and obstacles at most; of more the largest.
const MOST_STRUCTURES: usize = 4000;

/// What is smaller is noise of the survey, m^2.
const LEAST_OBSTACLE_M2: f64 = 2.0;

/// Prisms reach so deep into the terrain, m.
const FOOTING_M: f64 = 0.5;

/// This share of the cells has to have a ground, and may lie below it by more than this, m.
const LEAST_COVERED: f64 = 0.5;
const MOST_BELOW_SHARE: f64 = 0.3;
const BELOW_M: f32 = 1.0;

/// Holes of an outline below this are filled, m^2.
const LEAST_COURT_M2: f64 = 10.0;

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
        return Err(ImportError::Structure { file: file.into(), what, remedy: "check its mark for unknown heights, and export it again" });
    }
    if filled + left > 0 {
        let share = 100.0 * left as f64 / (columns * rows) as f64;
        report.notes.push(format!(
            "unknown heights: {filled} cells in small gaps taken from their neighbours; {left} cells ({share:.1} %) in larger ones, water or outside, taken to be ground"
        ));
    }
    let ground_m = ground_of(file, &mut heights, cell_m, &mut report)?;

    let local = local_place(&place, origin, placement.as_ref(), unit_m);
    let modelled = ground::model(&ground_m, columns, rows, &local).ok_or_else(|| absurd(file, "its ground has no finite height"))?;
    let zero_m = anchored.map_or(modelled.terrain.range_m()[0], |[_, _, z]| z * height_unit_m);
    let terrain = modelled.terrain.lowered(zero_m);
    let [low_m, high_m] = terrain.range_m();
    report.notes.push(format!(
        "terrain of {:.1} m cells, {:.1} m of relief; it lies up to {:.1} m above the ground that it is made of and 0.5 m below at most. Heights of the scene, \
         of no-fly zones too, count from its lowest place, {zero_m:.2} m in the file",
        terrain.cell_m(),
        high_m - low_m,
        modelled.most_above_m,
    ));

    let structures = structures(&heights, &ground_m, &terrain, &local, cell_m, zero_m, &mut report);
    if !structures.iter().any(Structure::is_captured) {
        let what = format!("nothing in it stands {LEAST_HEIGHT_M} m above the ground over {LEAST_ROOF_M2} m^2");
        let remedy = "give a surface model (DSM) and not one of the ground, and a model of the ground that fits it";
        return Err(ImportError::Structure { file: file.into(), what, remedy });
    }
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
            report.notes.push(format!("EPSG:{epsg} cannot be projected to WGS84 here: the scene has no place on Earth, lengths are taken as they are"));
            Ok(None)
        }
    }
}

/// Metres in a unit of height: as the file says, else as in the grid.
fn height_unit_m(heights: &Heights, placement: Option<&Placement>, unit_m: f64, report: &mut ImportReport) -> f64 {
    let of_grid_m = placement.map_or(heights.reference.unit_m.unwrap_or(1.0), |placement| placement.height_unit_m);
    let own_m = heights.reference.height_unit_m.unwrap_or(of_grid_m);
    if (own_m - 1.0).abs() > 1e-6 {
        let whence = if heights.reference.height_unit_m.is_some() { "as the file says" } else { "like the grid; the file does not say" };
        report.notes.push(format!("heights are in units of {own_m:.7} m, {whence}"));
    } else if (unit_m - 1.0).abs() > 0.01 {
        report.notes.push(format!("heights are in metres, the grid in units of {unit_m:.4} m"));
    }
    own_m
}

fn check_size(file: &str, place: &Affine, [columns, rows]: [usize; 2], unit_m: f64, settings: &ProxySettings) -> Result<(), ImportError> {
    let length_m = |side: [f64; 2], count: usize| libm::hypot(side[0], side[1]) * count as f64 * unit_m;
    let (width_m, depth_m, cell_m) = (length_m(place.column, columns), length_m(place.row, rows), place.cell() * unit_m);
    if cell_m > COARSEST_CELL_M {
        return Err(ImportError::Structure {
            file: file.into(),
            what: format!("its cells of {cell_m:.1} m show no buildings"),
            remedy: "give a model with cells of 5 m at most (1 m and finer are better), or cut out a smaller part of a large one",
        });
    }
    if !(width_m.max(depth_m) <= 2.0 * settings.max_extent_m) {
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
                    what: format!("the model of the ground covers only {:.0} % of it", 100.0 * known as f64 / ground.len() as f64),
                    remedy: "give the DTM of the same place",
                });
            }
            let filled = fill_nearest(&mut ground, columns, rows);
            let below = surface.iter().zip(&ground).filter(|(z, ground)| **z < **ground - BELOW_M).count();
            if below as f64 > MOST_BELOW_SHARE * surface.len() as f64 {
                return Err(ImportError::Structure {
                    file: file.into(),
                    what: format!("it lies below its ground in {:.0} % of the cells", 100.0 * below as f64 / surface.len() as f64),
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

/// What becomes of a region.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Fate {
    Roof,
    Obstacle,
    Dropped,
}

fn structures(
    heights: &Heights,
    ground_m: &[f32],
    terrain: &Terrain,
    local: &Affine,
    cell_m: f64,
    zero_m: f64,
    report: &mut ImportReport,
) -> Vec<Structure> {
    let surface = &heights.surface;
    let is_high: Vec<bool> =
        surface.heights.iter().zip(ground_m).map(|(z, ground)| f64::from(*z - *ground) >= LEAST_HEIGHT_M).collect();
    let found = regions::find(&Surface {
        columns: surface.columns,
        rows: surface.rows,
        cell_m,
        heights_m: &surface.heights,
        is_high: &is_high,
        is_building: heights.is_building.as_deref(),
    });
    let fates = fates(&found, cell_m);
    let tops_m = tops(&found, &surface.heights);
    note_fates(heights, &found, &fates, report);
    let tolerance = TOLERANCE_CELLS.max(LEAST_TOLERANCE_M / cell_m);
    // Only what is kept has an outline, and only that shares walls.
    let kept: Vec<u32> = found
        .labels
        .iter()
        .map(|&label| if label != 0 && fates[label as usize - 1] == Fate::Dropped { 0 } else { label })
        .collect();
    let cells = Labels { labels: &kept, columns: surface.columns, rows: surface.rows };
    let outlines = outline::outlines(&cells, found.regions.len(), tolerance);
    let mut structures = Vec::new();
    let mut numbers = [0; 2];
    for (index, outline) in outlines.iter().enumerate() {
        let area_m2 = found.regions[index].cells as f64 * cell_m * cell_m;
        let Some(footprint) = footprint(outline, local, area_m2).filter(|_| fates[index] != Fate::Dropped) else { continue };
        let top_m = tops_m[index] - zero_m;
        let base_m = Bounds::above(&footprint, 0.0, 0.0).map_or(0.0, |bounds| terrain.range_within_m(&bounds)[0] - FOOTING_M);
        let base_m = ((base_m.max(0.0)) * 100.0).floor() / 100.0;
        let is_roof = fates[index] == Fate::Roof;
        // At the foot of a slope the terrain, which is coarser, may lie above a low roof.
        let top_m = ((top_m.max(base_m + LEAST_HEIGHT_M)) * 100.0).round() / 100.0;
        let (number, kind) = if is_roof { (&mut numbers[0], "roof") } else { (&mut numbers[1], "obstacle") };
        *number += 1;
        let name = format!("{kind}-{number:03}");
        let shape = match is_roof {
            true => Shape::Prism { footprint, base_m, top_m },
            false => Shape::Obstacle { footprint, base_m, top_m },
        };
        structures.push(Structure { id: StructureId::of_name(&name), name, shape });
    }
    let shape = Shape::Terrain(terrain.clone().into());
    structures.push(Structure { id: StructureId::of_name(TERRAIN_NAME), name: TERRAIN_NAME.into(), shape });
    structures
}

/// The largest regions become structures, those that are no buildings or small obstacles.
fn fates(found: &Regions, cell_m: f64) -> Vec<Fate> {
    let cell_m2 = cell_m * cell_m;
    let mut order: Vec<usize> = (0..found.regions.len()).collect();
    order.sort_by_key(|&index| (std::cmp::Reverse(found.regions[index].cells), index));
    let mut fates = vec![Fate::Dropped; found.regions.len()];
    let (mut roofs, mut obstacles) = (0, 0);
    for index in order {
        let region = &found.regions[index];
        let area_m2 = region.cells as f64 * cell_m2;
        let (count, fate) = match region.is_building && area_m2 >= LEAST_ROOF_M2 && roofs < MOST_STRUCTURES {
            true => (&mut roofs, Fate::Roof),
            false => (&mut obstacles, Fate::Obstacle),
        };
        if *count < MOST_STRUCTURES && area_m2 >= LEAST_OBSTACLE_M2 {
            *count += 1;
            fates[index] = fate;
        }
    }
    fates
}

fn note_fates(heights: &Heights, found: &Regions, fates: &[Fate], report: &mut ImportReport) {
    let count = |fate: Fate| fates.iter().filter(|own| **own == fate).count();
    report.notes.push(format!(
        "{} roofs; {} small regions joined to their neighbours; {} regions that are no roofs, most of them smaller than {LEAST_ROOF_M2} m^2, are \
         obstacles: kept clear of, not captured",
        count(Fate::Roof),
        found.joined,
        count(Fate::Obstacle)
    ));
    let dropped = count(Fate::Dropped);
    if dropped > 0 {
        report.notes.push(format!(
            "{dropped} regions are dropped, below {LEAST_OBSTACLE_M2} m^2 or beyond the largest {MOST_STRUCTURES} of their kind: nothing keeps flights clear of them"
        ));
    }
    report.notes.push(match heights.is_building {
        Some(_) => "roofs are where points are marked as buildings; all else that is high is an obstacle".into(),
        None => "nothing tells trees from roofs here: every region that is high and large enough is taken for a roof".into(),
    });
}

/// The height of each region that all but a few of its cells stay below, m in the file.
fn tops(found: &Regions, heights_m: &[f32]) -> Vec<f64> {
    let mut of_regions: Vec<Vec<f32>> = found.regions.iter().map(|region| Vec::with_capacity(region.cells)).collect();
    for (label, z) in found.labels.iter().zip(heights_m).filter(|(label, _)| **label != 0) {
        of_regions[*label as usize - 1].push(*z);
    }
    let top = |mut heights: Vec<f32>| {
        let at = (TOP_SHARE * (heights.len().saturating_sub(1)) as f64).round() as usize;
        if heights.is_empty() { 0.0 } else { f64::from(*heights.select_nth_unstable_by(at, f32::total_cmp).1) }
    };
    of_regions.into_iter().map(top).collect()
}

/// The outline as a footprint in the local frame; `None` where nothing with an area is left of it.
fn footprint(outline: &Outline, local: &Affine, area_m2: f64) -> Option<MultiPolygon<f64>> {
    let moved = |ring: &Vec<Coord<f64>>| {
        let corner = |corner: &Coord<f64>| {
            // Whole centimetres: more than the heights tell.
            let [x, y] = local.at(corner.x, corner.y).map(|length_m| (length_m * 100.0).round() / 100.0);
            Coord { x, y }
        };
        LineString(ring.iter().map(corner).collect())
    };
    let court = |ring: &LineString<f64>| Polygon::new(ring.clone(), Vec::new()).unsigned_area() >= LEAST_COURT_M2;
    let holes: Vec<LineString<f64>> = outline.holes.iter().map(moved).filter(court).collect();
    let mut polygons: Vec<Polygon<f64>> = outline.outer.iter().map(|ring| Polygon::new(moved(ring), Vec::new())).collect();
    polygons.sort_by(|a, b| b.unsigned_area().total_cmp(&a.unsigned_area()));
    if let Some(first) = polygons.first_mut() {
        *first = Polygon::new(first.exterior().clone(), holes);
    }
    let footprint = footprint::repair_closed(&polygons, &mut Vec::new()).ok()?.orient(Direction::Default);
    // A thin region that has lost its shape is not what was seen.
    (footprint.unsigned_area() >= 0.25 * area_m2).then_some(footprint)
}
