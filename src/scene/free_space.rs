//! Where the drone may be: flight limits, no-fly zones and the safety distance, as hard constraints.

use std::sync::Arc;

use geo::{Area, Validation};
use nalgebra::Point3;
use rayon::prelude::*;

use super::bounds::Bounds;
use super::clearance::Clearance;
use super::differences::Differences;
use super::proxy::{NoFlyZone, Scene, Structure, ZoneSource};
use super::terrain::Terrain;
use crate::frame::{Geodetic, LocalFrame};
use crate::settings::{FlightSettings, NoFlySetting};

/// The safe space of one scene under one set of flight limits.
#[derive(Debug)]
pub struct FreeSpace {
    pub clearance: Clearance,
    solids: Vec<Solid>,
    zones: Vec<NoFlyZone>,
    /// The box of admissible positions, m: lateral limits and altitudes. Over terrain those above z = 0 that any place of it allows; what each place
    /// allows is looked up in the terrain.
    pub limits: Bounds,
    pub safety_distance_m: f64,
    /// The box around all structures on the ground.
    pub bounds: Option<Bounds>,
    terrain: Option<Arc<Terrain>>,
    /// The least altitude and the legal ceiling above the terrain, m.
    altitudes_m: [f64; 2],
}

/// A structure of the scene.
#[derive(Clone, Debug)]
struct Solid {
    structure: Arc<Structure>,
    bounds: Bounds,
    /// Nothing gets inside without passing through the surface.
    is_closed: bool,
    /// What there is to be captured of it, m^2.
    surface_m2: f64,
}

/// Why a position or a leg cannot be flown.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Obstruction {
    #[error("it is not a finite position")]
    NotFinite,
    #[error(
        "it lies outside of the flight limits x {min_x:.0}..{max_x:.0} m, y {min_y:.0}..{max_y:.0} m, z {min_z:.0}..{max_z:.0} m"
    )]
    OutsideLimits { min_x: f64, max_x: f64, min_y: f64, max_y: f64, min_z: f64, max_z: f64 },
    #[error("it lies inside the structure {0:?}")]
    Inside(String),
    #[error("it comes within {distance_m:.2} m of a structure, nearer than the safety distance of {safety_m} m")]
    TooNear { distance_m: f64, safety_m: f64 },
    #[error(
        "it is {low_m:.1} to {high_m:.1} m above the terrain, outside of the altitudes {least_m:.0}..{most_m:.0} m that are allowed"
    )]
    Altitude { low_m: f64, high_m: f64, least_m: f64, most_m: f64 },
    #[error("it enters the no-fly zone {0:?}")]
    Zone(String),
}

/// Why a no-fly zone of the configuration cannot be kept. A zone that cannot be kept is never passed over.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ZoneError {
    #[error("the no-fly zone {name:?} is given in degrees, but the scene has no georeference; give it as `outline_m`")]
    NoOrigin { name: String },
    #[error("the outline of the no-fly zone {name:?} crosses itself or has no area; put its corners in order")]
    Outline { name: String },
}

impl FreeSpace {
    /// `settings` gives the limits, `scene` the obstacles and its own zones.
    pub fn new(scene: &Scene, settings: &FlightSettings) -> Result<Self, ZoneError> {
        let solids = scene.structures.par_iter().map(Solid::new).collect();
        Self::with_clearance(scene, settings, solids, Clearance::new(scene))
    }

    /// The same of a scene that differs from an earlier one: only what is new is made anew.
    pub fn after(before: &Self, scene: &Scene, differences: &Differences, settings: &FlightSettings) -> Result<Self, ZoneError> {
        let solid = |(structure, kept): (&Arc<Structure>, &Option<usize>)| {
            kept.map_or_else(|| Solid::new(structure), |old| before.solids[old].clone())
        };
        let (solids, clearance) = rayon::join(
            || scene.structures.iter().zip(&differences.kept).map(solid).collect(),
            || Clearance::after(&before.clearance, scene, differences),
        );
        Self::with_clearance(scene, settings, solids, clearance)
    }

    fn with_clearance(
        scene: &Scene,
        settings: &FlightSettings,
        solids: Vec<Solid>,
        clearance: Clearance,
    ) -> Result<Self, ZoneError> {
        let mut zones = scene.zones.clone();
        for setting in &settings.no_fly {
            zones.push(zone(setting, &scene.frame)?);
        }
        let bounds_of =
            |is_in: &dyn Fn(&&Solid) -> bool| solids.iter().filter(is_in).map(|solid| solid.bounds).reduce(|a, b| a.union(&b));
        let is_standing = |solid: &&Solid| solid.structure.terrain().is_none();
        let (all, captured) = (bounds_of(&is_standing), bounds_of(&|solid| solid.structure.is_captured()));
        let terrain = scene.structures.iter().find_map(|structure| structure.terrain()).map(Arc::clone);
        Ok(Self {
            clearance,
            limits: limits(captured, terrain.as_deref(), settings),
            bounds: all,
            solids,
            zones,
            safety_distance_m: settings.safety_distance_m,
            terrain,
            altitudes_m: [settings.altitude_min_m, settings.legal_ceiling_m],
        })
    }

    /// The same limits and zones around those structures alone that an earlier scene did not have.
    pub fn only_new(&self, differences: &Differences) -> Self {
        self.only(|index| differences.kept[index].is_none())
    }

    /// The same limits and zones without any structures.
    pub fn without_structures(&self) -> Self {
        self.only(|_| false)
    }

    fn only(&self, is_in: impl Fn(usize) -> bool) -> Self {
        let solids = self.solids.iter().enumerate().filter(|(index, _)| is_in(*index));
        Self {
            clearance: self.clearance.only(&is_in),
            solids: solids.map(|(_, solid)| solid.clone()).collect(),
            zones: self.zones.clone(),
            terrain: self.terrain.clone(),
            ..*self
        }
    }

    /// The no-fly zones of the scene and of the settings.
    pub fn zones(&self) -> &[NoFlyZone] {
        &self.zones
    }

    /// The boxes of the scene's structures, in their order, m.
    pub fn structure_bounds(&self) -> Vec<Bounds> {
        self.solids.iter().map(|solid| solid.bounds).collect()
    }

    /// The surface of all structures that are to be captured, m^2.
    pub fn surface_m2(&self) -> f64 {
        self.solids.iter().map(|solid| solid.surface_m2).sum()
    }

    /// Why `p` is not a safe position; `None` when it is one.
    pub fn obstruction_at(&self, p: &Point3<f64>) -> Option<Obstruction> {
        if !p.coords.iter().all(|v| v.is_finite()) {
            return Some(Obstruction::NotFinite);
        }
        if !self.limits.contains(p) {
            return Some(self.outside());
        }
        if let Some(structure) = self.structure_around(p) {
            return Some(Obstruction::Inside(structure.name.clone()));
        }
        self.obstruction_between(p, p)
    }

    /// Why the straight leg from `a` to `b` is not safe over its whole length, given that both ends are safe positions.
    pub fn obstruction_between(&self, a: &Point3<f64>, b: &Point3<f64>) -> Option<Obstruction> {
        // The limits are a box, and so convex: two ends inside keep the leg inside.
        self.altitude_between(a, b).or_else(|| self.obstruction_at_any_altitude(a, b))
    }

    /// The same, however high above the terrain the leg is.
    pub fn obstruction_at_any_altitude(&self, a: &Point3<f64>, b: &Point3<f64>) -> Option<Obstruction> {
        if !self.clearance.keeps_distance(a, b, self.safety_distance_m) {
            let distance_m = self.clearance.segment_distance_m(a, b, self.safety_distance_m);
            return Some(Obstruction::TooNear { distance_m, safety_m: self.safety_distance_m });
        }
        if let Some(structure) = self.structure_along(a, b) {
            return Some(Obstruction::Inside(structure.name.clone()));
        }
        self.zone_between(a, b)
    }

    /// Why the straight line from `a` to `b` is too low or too high above the terrain, if there is one.
    pub fn altitude_between(&self, a: &Point3<f64>, b: &Point3<f64>) -> Option<Obstruction> {
        let terrain = self.terrain.as_ref().filter(|terrain| !terrain.keeps_altitude(a, b, self.altitudes_m))?;
        let ([low_m, high_m], [least_m, most_m]) = (terrain.altitudes_m(a, b), self.altitudes_m);
        Some(Obstruction::Altitude { low_m, high_m, least_m, most_m })
    }

    /// Whether the straight line from `a` to `b` keeps the altitudes above the terrain, if there is one.
    fn keeps_altitude(&self, a: &Point3<f64>, b: &Point3<f64>) -> bool {
        self.terrain.as_ref().is_none_or(|terrain| terrain.keeps_altitude(a, b, self.altitudes_m))
    }

    /// The ground where it is not flat.
    pub fn terrain(&self) -> Option<&Terrain> {
        self.terrain.as_deref()
    }

    /// The no-fly zone that the straight line from `a` to `b` enters, if any.
    pub fn zone_between(&self, a: &Point3<f64>, b: &Point3<f64>) -> Option<Obstruction> {
        self.zones.iter().find(|zone| zone.meets(a, b, self.terrain())).map(|zone| Obstruction::Zone(zone.name.clone()))
    }

    /// A structure that the leg, which keeps its distance from all surfaces, is inside of: through a large hole of a mesh.
    fn structure_along(&self, a: &Point3<f64>, b: &Point3<f64>) -> Option<&Structure> {
        let leg = b - a;
        // A hole that lets a leg in is wider than twice the safety distance, so what lies behind is not missed in such steps.
        let steps = (leg.norm() / self.safety_distance_m.min(2.0)).ceil() as usize;
        let meets = self.clearance.structures_near(&Bounds { min: a.inf(b), max: a.sup(b) });
        let is_open = |solid: &&Solid| self.is_open(solid);
        let near: Vec<&Solid> = meets.into_iter().map(|index| &self.solids[index]).filter(is_open).collect();
        if near.is_empty() {
            return None;
        }
        (0..=steps)
            .map(|k| a + leg * (k as f64 / steps.max(1) as f64))
            .find_map(|p| near.iter().find(|solid| solid.contains(&p)))
            .map(|solid| solid.structure.as_ref())
    }

    /// Whether `p` is a safe position: [`FreeSpace::obstruction_at`] without a reason, cheapest tests first.
    pub fn is_safe(&self, p: &Point3<f64>) -> bool {
        self.limits.contains(p)
            && self.keeps_altitude(p, p)
            && self.clearance.keeps_distance(p, p, self.safety_distance_m)
            && !self.zones.iter().any(|zone| zone.meets(p, p, self.terrain()))
            && self.structure_around(p).is_none()
    }

    /// Whether the leg between two safe positions is safe. The hot path of the search: no reason is made up.
    pub fn is_leg_safe(&self, a: &Point3<f64>, b: &Point3<f64>) -> bool {
        self.keeps_altitude(a, b)
            && self.clearance.keeps_distance(a, b, self.safety_distance_m)
            && !self.zones.iter().any(|zone| zone.meets(a, b, self.terrain()))
            && self.structure_along(a, b).is_none()
    }

    /// Whether nothing stands above `p`.
    pub fn sees_the_sky(&self, p: &Point3<f64>) -> bool {
        let ground_m = self.terrain.as_ref().map_or(0.0, |terrain| terrain.range_m()[1]);
        let top_m = self.bounds.map_or(0.0, |bounds| bounds.max.z).max(ground_m);
        !self.clearance.occluded(p, &Point3::new(p.x, p.y, top_m + 1.0))
    }

    /// The structure that holds `p` inside, if any.
    pub fn structure_around(&self, p: &Point3<f64>) -> Option<&Structure> {
        self.solid_around(p, |_| true)
    }

    /// A structure with holes that holds `p` inside: the only ones to look for where no surface has been passed.
    pub fn open_structure_around(&self, p: &Point3<f64>) -> Option<&Structure> {
        self.solid_around(p, |solid| self.is_open(solid))
    }

    fn solid_around(&self, p: &Point3<f64>, is_asked: impl Fn(&Solid) -> bool) -> Option<&Structure> {
        let near = self.clearance.structures_near(&Bounds { min: *p, max: *p });
        let around = near.into_iter().map(|index| &self.solids[index]).find(|solid| is_asked(solid) && solid.contains(p));
        around.map(|solid| solid.structure.as_ref())
    }

    /// Whether a flight might get inside without passing through a surface. The mirror image of a mesh in the ground counts as well, and has no
    /// surface that could be met.
    fn is_open(&self, solid: &Solid) -> bool {
        !solid.is_closed || -solid.bounds.min.z > self.limits.min.z
    }

    fn outside(&self) -> Obstruction {
        let Bounds { min, max } = self.limits;
        Obstruction::OutsideLimits { min_x: min.x, max_x: max.x, min_y: min.y, max_y: max.y, min_z: min.z, max_z: max.z }
    }
}

impl Solid {
    fn new(structure: &Arc<Structure>) -> Self {
        Self {
            bounds: structure.bounds(),
            is_closed: structure.is_closed(),
            surface_m2: structure.surface_m2(),
            structure: Arc::clone(structure),
        }
    }

    fn contains(&self, p: &Point3<f64>) -> bool {
        self.bounds.contains(p) && self.structure.contains(p)
    }
}

/// The zone of a setting in the frame of the scene.
fn zone(setting: &NoFlySetting, frame: &LocalFrame) -> Result<NoFlyZone, ZoneError> {
    let from_degrees = |&[lon_deg, lat_deg]: &[f64; 2]| {
        let corner = frame.local_from_geodetic(&Geodetic { lat_deg, lon_deg, alt_m: 0.0 });
        corner.map(|p| geo::Coord { x: p.x, y: p.y }).ok_or_else(|| ZoneError::NoOrigin { name: setting.name.clone() })
    };
    let mut ring = setting.outline_deg.iter().map(from_degrees).collect::<Result<Vec<_>, _>>()?;
    ring.extend(setting.outline_m.iter().map(|&[x, y]| geo::Coord { x, y }));
    let outline = geo::MultiPolygon::new(vec![geo::Polygon::new(geo::LineString::new(ring), vec![])]);
    if !outline.is_valid() || outline.unsigned_area() == 0.0 {
        return Err(ZoneError::Outline { name: setting.name.clone() });
    }
    let (floor_m, ceiling_m) = (setting.floor_m, setting.ceiling_m);
    Ok(NoFlyZone { name: setting.name.clone(), outline, floor_m, ceiling_m, source: ZoneSource::Configuration })
}

/// The box of admissible positions above the structures that are to be captured; empty (it contains nothing) without any.
fn limits(captured: Option<Bounds>, terrain: Option<&Terrain>, settings: &FlightSettings) -> Bounds {
    let margin = settings.lateral_margin_m;
    let Some(all) = captured else {
        return Bounds { min: Point3::origin(), max: Point3::new(-1.0, -1.0, -1.0) };
    };
    // The legal ceiling is one above the ground below.
    let [lowest_m, highest_m] = terrain.map_or([0.0; 2], Terrain::range_m);
    let top = (all.max.z + settings.above_tallest_m).min(highest_m + settings.legal_ceiling_m);
    Bounds {
        min: Point3::new(all.min.x - margin, all.min.y - margin, lowest_m + settings.altitude_min_m),
        max: Point3::new(all.max.x + margin, all.max.y + margin, top),
    }
}
