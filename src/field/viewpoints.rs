//! Viewpoints of the field: a jittered lattice through the offset shell around the proxy.
//!
//! A cell's viewpoint depends on the cell and on the geometry near it alone, so that an edit moves only viewpoints near by. Under roofs
//! it depends on the way out as well.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::outside::outside;
use super::strips::{Strip, Viewpoints};
use super::tiles::TileGrid;
use crate::scene::Bounds;
use crate::scene::differences::Differences;
use crate::scene::free_space::FreeSpace;
use crate::stop::{Part, StopToken};
use crate::surface::unit_hash;

/// The lattice of viewpoints. Pinned when a scene is loaded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// Corner of cell (0, 0, 0), m; cells may have negative indices.
    pub origin: Point3<f64>,
    pub spacing_m: f64,
    /// Outer edge of the shell, m from the nearest surface.
    pub shell_m: f64,
    pub seed: u64,
}

/// A viewpoint with its distance to the nearest surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    pub position: Point3<f64>,
    pub clearance_m: f64,
}

/// The spacing at which about `target` viewpoints fill the shell, at most `coarsest.spacing_m`: farther apart they would miss the
/// shell altogether, so the target is an outcome for large scenes.
/// `None` when stopped.
pub fn choose_spacing_m(free: &FreeSpace, coarsest: &Lattice, target: u32, stop: &StopToken) -> Option<f64> {
    let count = fill(free, coarsest, stop)?.len();
    let share = count as f64 / f64::from(target.max(1));
    Some(coarsest.spacing_m * libm::cbrt(share).min(1.0))
}

/// How many cells of the lattice lie within the flight limits: an upper bound of the viewpoints.
pub fn cells(free: &FreeSpace, lattice: &Lattice) -> f64 {
    (free.limits.max - free.limits.min).iter().map(|extent| (extent / lattice.spacing_m).max(0.0) + 2.0).product()
}

/// All viewpoints of the lattice that can be reached from the open sky, in the order of their cells; `None` when stopped.
pub fn fill(free: &FreeSpace, lattice: &Lattice, stop: &StopToken) -> Option<Viewpoints> {
    Some(outside(free, lattice, &sites(free, lattice, stop)?))
}

/// Indices of a cell of the lattice.
pub type Cell = [i64; 3];

/// A cell with a viewpoint, whether or not that can be reached from the open sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Site {
    pub cell: Cell,
    pub viewpoint: Viewpoint,
    /// Nothing stands above it.
    pub is_open: bool,
}

/// All cells with a viewpoint, in their order; `None` when stopped.
pub fn sites(free: &FreeSpace, lattice: &Lattice, stop: &StopToken) -> Option<Vec<Arc<Strip>>> {
    let (low, high) = lattice.corners(free);
    if (0..3).any(|i| high[i] < low[i]) {
        return Some(Vec::new());
    }
    let columns: Vec<(i64, i64)> = (low[0]..=high[0]).flat_map(|x| (low[1]..=high[1]).map(move |y| (x, y))).collect();
    stop.begin(Part::Survey, columns.len() as u64);
    let column = |&(x, y): &(i64, i64)| -> Option<Vec<Site>> {
        let cells = (low[2]..=high[2]).map(|z| [x, y, z]);
        stop.advance(1);
        (!stop.is_stopped()).then(|| cells.filter_map(|cell| site(free, lattice, cell)).collect())
    };
    let filled: Option<Vec<Vec<Site>>> = columns.par_iter().map(column).collect();
    Some(Strip::all_of(filled?.concat(), lattice.tile_grid()))
}

/// The same of a scene with these differences to an earlier one, whose sites are `before`; `earlier` is the free space there.
pub fn sites_after(
    free: &FreeSpace,
    lattice: &Lattice,
    before: &[Arc<Strip>],
    earlier: &FreeSpace,
    differences: &Differences,
    stop: &StopToken,
) -> Option<Vec<Arc<Strip>>> {
    let (low, high) = lattice.corners(free);
    let limits = &earlier.limits;
    let (newcomers, gone) = (free.only_new(differences), earlier.clearance.only_gone(differences));
    // Clearances are cut off at the outer edge of the shell: what is farther away changes nothing.
    let near: Vec<Bounds> = differences.boxes().map(|bounds| bounds.grown(SLACK_M)).collect();
    let barred: Vec<Bounds> = differences.barred.iter().map(|bounds| bounds.grown(SLACK_M)).collect();
    // The highest or the outermost structure decides on the limits, the ground on altitudes: when they move, cells may come and go far from it too.
    let have_moved = free.limits != *limits && !differ_above_all(free, limits, lattice, differences);
    let is_all_new = have_moved || differences.is_ground_new;
    let shells: Vec<Bounds> = match is_all_new {
        true => vec![free.limits],
        false => near.iter().map(|bounds| bounds.grown(lattice.shell_m)).chain(barred.iter().copied()).collect(),
    };
    let mut columns = Vec::new();
    for shell in &shells {
        let (from, to) = (lattice.cell(&shell.min), lattice.cell(&shell.max));
        for x in from[0].max(low[0])..=to[0].min(high[0]) {
            columns.extend((from[1].max(low[1])..=to[1].min(high[1])).map(|y| [x, y]));
        }
    }
    columns.sort_unstable();
    columns.dedup();
    let of_column =
        |column: &[i64; 2]| strip_at(before, column[0]).map_or(&[][..], |strip| &strip.sites()[strip.column(column[1])]);
    let renewed = |column: &[i64; 2]| -> Option<Vec<Site>> {
        let mut old = of_column(column).iter().peekable();
        let cells = (low[2]..=high[2]).map(|z| [column[0], column[1], z]);
        let renew = |cell: Cell| {
            while old.next_if(|site| site.cell < cell).is_some() {}
            let old = old.next_if(|site| site.cell == cell);
            let position = position(lattice, cell);
            let is_near = |bounds: &Bounds| bounds.distance_squared(&position) <= lattice.shell_m * lattice.shell_m;
            let is_barred = |bounds: &Bounds| bounds.contains(&position);
            let is_under = |bounds: &Bounds| {
                (0..2).all(|axis| (bounds.min[axis]..=bounds.max[axis]).contains(&position[axis])) && bounds.max.z >= position.z
            };
            let is_open = |site: &Site| if near.iter().any(is_under) { free.sees_the_sky(&position) } else { site.is_open };
            if differences.is_ground_new
                || free.limits.contains(&position) != limits.contains(&position)
                || barred.iter().any(is_barred)
            {
                return site(free, lattice, cell);
            }
            if !near.iter().any(is_near) {
                return old.map(|site| Site { is_open: is_open(site), ..*site });
            }
            // What is nearest, if it is still there, is nearer than all else that was: only what is new can be nearer, or in the way.
            let nearest_m = |site: &Site| site.viewpoint.clearance_m;
            match old
                .filter(|site| free.terrain().is_none() && gone.standing_distance_m(&position, lattice.shell_m) > nearest_m(site))
            {
                Some(_) if !newcomers.is_safe(&position) => None,
                Some(site) => {
                    let clearance_m = newcomers.clearance.standing_distance_m(&position, lattice.shell_m).min(nearest_m(site));
                    Some(Site { viewpoint: Viewpoint { position, clearance_m }, is_open: is_open(site), cell })
                }
                None => site(free, lattice, cell),
            }
        };
        (!stop.is_stopped()).then(|| cells.filter_map(renew).collect())
    };
    let fresh: Vec<Vec<Site>> = columns.par_iter().map(renewed).collect::<Option<_>>()?;
    let grid = lattice.tile_grid();
    if is_all_new {
        return Some(Strip::all_of(fresh.concat(), grid));
    }
    let mut fresh = fresh.into_iter();
    let renewals =
        columns.chunk_by(|a, b| a[0] == b[0]).map(|columns| (columns, fresh.by_ref().take(columns.len()).collect::<Vec<_>>()));
    let renewals: Vec<_> = renewals.collect();
    let renewed = renewals.into_par_iter().map(|(columns, fresh)| {
        let x = columns[0][0];
        (x, renewed_strip(strip_at(before, x), columns, fresh, grid))
    });
    let renewed: Vec<(i64, Option<Arc<Strip>>)> = renewed.collect();
    let (mut strips, mut old) = (Vec::with_capacity(before.len() + renewed.len()), before.iter().peekable());
    for (x, strip) in renewed {
        strips.extend(std::iter::from_fn(|| old.next_if(|old| old.x() < x)).cloned());
        old.next_if(|old| old.x() == x);
        strips.extend(strip);
    }
    strips.extend(old.cloned());
    Some(strips)
}

/// Whether other limits differ from those of a scene only where no structure that stands in both can have viewpoints: higher above it than its shell.
fn differ_above_all(free: &FreeSpace, limits: &Bounds, lattice: &Lattice, differences: &Differences) -> bool {
    let top_m = free.limits.max.z.min(limits.max.z);
    let is_ceiling_alone = free.limits.min == limits.min && free.limits.max.xy() == limits.max.xy();
    let bounds = free.structure_bounds();
    let mut kept = bounds.iter().zip(&differences.kept).filter(|(_, kept)| kept.is_some());
    is_ceiling_alone && free.terrain().is_none() && kept.all(|(bounds, _)| bounds.max.z + lattice.shell_m + SLACK_M <= top_m)
}

/// The strip of cells with a first index.
fn strip_at(strips: &[Arc<Strip>], x: i64) -> Option<&Arc<Strip>> {
    Strip::find(strips, x).map(|index| &strips[index])
}

/// A strip some of whose columns are made anew; the same as before where nothing is otherwise.
fn renewed_strip(before: Option<&Arc<Strip>>, columns: &[[i64; 2]], fresh: Vec<Vec<Site>>, grid: TileGrid) -> Option<Arc<Strip>> {
    let old = before.map_or(&[][..], |strip| strip.sites());
    let (mut sites, mut kept) = (Vec::with_capacity(old.len()), 0);
    for (column, fresh) in columns.iter().zip(fresh) {
        let range = before.map_or(0..0, |strip| strip.column(column[1]));
        sites.extend_from_slice(&old[kept..range.start]);
        sites.extend(fresh);
        kept = range.end;
    }
    sites.extend_from_slice(&old[kept..]);
    match before {
        Some(before) if sites == old => Some(Arc::clone(before)),
        _ => Strip::new(sites, grid),
    }
}

/// Changed boxes are taken for so much larger, m, that rounding decides nothing.
const SLACK_M: f64 = 1e-3;

impl Lattice {
    fn cell(&self, p: &Point3<f64>) -> Cell {
        ((p - self.origin) / self.spacing_m).map(|v| v.floor() as i64).into()
    }

    pub fn tile_grid(&self) -> TileGrid {
        TileGrid::new(self.spacing_m)
    }

    /// The first and the last cell within the limits.
    fn corners(&self, free: &FreeSpace) -> (Cell, Cell) {
        (self.cell(&free.limits.min), self.cell(&free.limits.max))
    }
}

fn site(free: &FreeSpace, lattice: &Lattice, cell: Cell) -> Option<Site> {
    let viewpoint = viewpoint(free, lattice, cell)?;
    Some(Site { cell, viewpoint, is_open: free.sees_the_sky(&viewpoint.position) })
}

fn viewpoint(free: &FreeSpace, lattice: &Lattice, cell: Cell) -> Option<Viewpoint> {
    let position = position(lattice, cell);
    if !free.limits.contains(&position) {
        return None;
    }
    // The shell lies around what is to be seen, not over all of the ground.
    let standing_m = free.clearance.standing_distance_m(&position, lattice.shell_m);
    if standing_m >= lattice.shell_m || !free.is_safe(&position) {
        return None;
    }
    let clearance_m = match free.terrain() {
        Some(_) => free.clearance.point_distance_m(&position, standing_m),
        None => standing_m,
    };
    Some(Viewpoint { position, clearance_m })
}

/// The jittered middle of a cell. Without the jitter, streets along the lattice would be seen from exactly aligned rows.
fn position(lattice: &Lattice, cell: Cell) -> Point3<f64> {
    /// Share of the cell over which a viewpoint is spread.
    const JITTER: f64 = 0.7;
    let key = |axis: u64| {
        let [x, y, z] = cell.map(|v| v as u64 & 0xf_ffff);
        lattice.seed.wrapping_mul(0x2545_f491_4f6c_dd1d) ^ (x | y << 20 | z << 40) ^ axis << 61
    };
    let offset = |axis: u64| 0.5 + JITTER * (unit_hash(key(axis)) - 0.5);
    let [x, y, z] = cell.map(|v| v as f64);
    lattice.origin + Vector3::new(x + offset(0), y + offset(1), z + offset(2)) * lattice.spacing_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::terrain::tests::hill;
    use crate::scene::{NoFlyZone, Scene, Shape, Structure, StructureId, TERRAIN_NAME, Triangle, ZoneSource};
    use crate::settings::Settings;

    /// A box 40 m wide and 30 m high, without its roof where `open`. All faces look inwards, as in a careless model, so that the
    /// winding number finds no inside.
    fn hall(open: bool) -> Scene {
        let corner = |x: f64, y: f64, z: f64| Point3::new(x * 40.0, y * 40.0, z * 30.0);
        let quad = |[a, b, c, d]: [Point3<f64>; 4]| [[a, c, b], [a, d, c]];
        let mut quads = vec![
            quad([corner(0., 0., 0.), corner(1., 0., 0.), corner(1., 0., 1.), corner(0., 0., 1.)]),
            quad([corner(1., 0., 0.), corner(1., 1., 0.), corner(1., 1., 1.), corner(1., 0., 1.)]),
            quad([corner(1., 1., 0.), corner(0., 1., 0.), corner(0., 1., 1.), corner(1., 1., 1.)]),
            quad([corner(0., 1., 0.), corner(0., 0., 0.), corner(0., 0., 1.), corner(0., 1., 1.)]),
        ];
        if !open {
            quads.push(quad([corner(0., 0., 1.), corner(1., 0., 1.), corner(1., 1., 1.), corner(0., 1., 1.)]));
        }
        let triangles: Vec<Triangle> = quads.concat();
        let structure = Structure { id: StructureId::of_name("hall"), name: "hall".into(), shape: Shape::Mesh { triangles } };
        Scene { name: "hall".into(), frame: Default::default(), structures: vec![structure.into()], zones: vec![] }
    }

    #[test]
    fn a_closed_hall_holds_no_viewpoint_and_an_open_court_does() {
        let settings = Settings::default();
        for (open, expected) in [(false, false), (true, true)] {
            let scene = hall(open);
            let free = FreeSpace::new(&scene, &settings.flight).expect("there are no zones");
            let lattice = Lattice { origin: Point3::new(-60.0, -60.0, 0.0), spacing_m: 6.0, shell_m: 25.0, seed: 1 };
            let viewpoints = fill(&free, &lattice, &StopToken::default()).expect("nobody stops it");
            let within = |v: &Viewpoint| (0.0..40.0).contains(&v.position.x) && (0.0..40.0).contains(&v.position.y);
            let inside = viewpoints.sites().map(|site| site.viewpoint).filter(|v| within(v) && v.position.z < 25.0).count();
            assert_eq!(inside > 0, expected, "open: {open}, {inside} viewpoints inside");
            assert!(viewpoints.len() > 100);
        }
    }

    /// A hall of this height, so far to the east.
    fn hall_at(east_m: f64, height_m: f64) -> Arc<Structure> {
        let mut hall = Structure::clone(&hall(false).structures[0]);
        let Shape::Mesh { triangles } = &mut hall.shape else { panic!("a mesh") };
        triangles.iter_mut().flatten().for_each(|corner| (corner.x, corner.z) = (corner.x + east_m, corner.z * height_m / 30.0));
        hall.name = format!("hall-{east_m}");
        Arc::new(Structure { id: StructureId::of_name(&hall.name), ..hall })
    }

    #[test]
    fn a_taller_tower_lets_flights_rise_elsewhere_as_after_a_rebuild() {
        // Where flights may not rise as far above roofs as viewpoints do, there are more of them then; else there are as many.
        for (above_tallest_m, are_more) in [(5.0, true), (60.0, false)] {
            let mut settings = Settings::default();
            settings.flight.above_tallest_m = above_tallest_m;
            let low = hall_at(200.0, 30.0);
            let with = |tower: Arc<Structure>| {
                let mut scene = Scene { structures: vec![Arc::clone(&low), tower], ..hall(false) };
                scene.structures.sort_by_key(|structure| structure.id);
                scene
            };
            let (before, after) = (with(hall_at(0.0, 40.0)), with(hall_at(0.0, 55.0)));
            let lattice = Lattice { origin: Point3::new(-60.0, -60.0, 0.0), spacing_m: 6.0, shell_m: 25.0, seed: 1 };
            let [old, new] = [&before, &after].map(|scene| FreeSpace::new(scene, &settings.flight).unwrap());
            assert_ne!(old.limits, new.limits);
            let [was, rebuilt] = [&old, &new].map(|free| sites(free, &lattice, &StopToken::default()).unwrap());
            for (from, to, was, rebuilt) in [(&before, &after, &was, &rebuilt), (&after, &before, &rebuilt, &was)] {
                let (earlier, free) = if std::ptr::eq(from, &before) { (&old, &new) } else { (&new, &old) };
                let differences = Differences::between(from, to);
                assert_eq!(
                    sites_after(free, &lattice, was, earlier, &differences, &StopToken::default()).as_ref(),
                    Some(rebuilt)
                );
            }
            let east =
                |strips: &[Arc<Strip>]| strips.iter().flat_map(|strip| strip.sites()).filter(|site| site.cell[0] > 35).count();
            assert_eq!(east(&rebuilt) > east(&was), are_more, "{} and {}", east(&was), east(&rebuilt));
        }
    }

    #[test]
    fn on_another_ground_a_zone_bars_elsewhere_as_after_a_rebuild() {
        let settings = Settings::default();
        let over = |radius_m: f64| {
            let mut scene = hall(false);
            let mut tower = Structure::clone(&scene.structures[0]);
            let Shape::Mesh { triangles } = &mut tower.shape else { panic!("a mesh") };
            triangles.iter_mut().flatten().for_each(|corner| corner.z *= 4.0);
            let name = TERRAIN_NAME.to_owned();
            let shape = Shape::Terrain(hill(40.0, radius_m, 600.0, 10.0).into());
            scene.structures = vec![tower.into(), Structure { id: StructureId::of_name(&name), name, shape }.into()];
            scene.structures.sort_by_key(|structure| structure.id);
            let square = geo::Rect::new((-100.0, -100.0), (100.0, 100.0)).to_polygon().into();
            let name = "sky".to_owned();
            scene.zones =
                vec![NoFlyZone { name, outline: square, floor_m: 60.0, ceiling_m: 80.0, source: ZoneSource::Configuration }];
            scene
        };
        let (before, after) = (over(80.0), over(120.0));
        let free = |scene: &Scene| FreeSpace::new(scene, &settings.flight).unwrap();
        let lattice = Lattice { origin: Point3::new(-60.0, -60.0, 0.0), spacing_m: 6.0, shell_m: 25.0, seed: 1 };
        let sites_of = |free: &FreeSpace| sites(free, &lattice, &StopToken::default()).unwrap();
        let (old, new) = (free(&before), free(&after));
        assert_eq!(old.limits, new.limits, "or all would be renewed for that");
        let (was, rebuilt) = (sites_of(&old), sites_of(&new));
        let differences = Differences::between(&before, &after);
        let updated = sites_after(&new, &lattice, &was, &old, &differences, &StopToken::default()).unwrap();
        assert!(was != rebuilt && updated == rebuilt);
        // Far above the ground as well.
        let far = |strips: &[Arc<Strip>]| {
            let sites = strips.iter().flat_map(|strip| strip.sites());
            sites.filter(|site| site.viewpoint.position.z > 70.0).map(|site| site.cell).collect::<Vec<_>>()
        };
        assert!(far(&was) != far(&rebuilt));
    }
}
