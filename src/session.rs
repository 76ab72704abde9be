//! All derived state of one scene. The daemon owns a [`Session`] and is the only one that changes it; everybody else works on
//! immutable [`Snapshot`]s.
//!
//! The field settings are pinned when a scene is loaded (origin, lattice, both spacings, reference area, neighbour radius), and
//! everything derived is local, so that the field of an edited scene is the same, bit for bit, however it came about.

use std::sync::Arc;

use nalgebra::Point3;
use overfly_table::field::FieldFacts;

use crate::coverage::{CELLS, DiskModel, threshold_cells};
use crate::field::{self, Lattice, Outlines, Strip, Tile};
use crate::scene::Scene;
use crate::scene::differences::Differences;
use crate::scene::edit::{DirtyRegion, Edit, EditError};
use crate::scene::free_space::FreeSpace;
use crate::scene::terrain::Terrain;
use crate::settings::Settings;
use crate::stop::StopToken;
use crate::surface::{self, Sample, Sampler, Samples, Sampling};

pub use crate::field::{Cleared, FieldError, FieldStorage, Findings, HeapField, Place, Snapshot, Survey};

/// A scene with its revision and the field settings that were pinned when it was loaded.
#[derive(Clone, Debug)]
pub struct Session {
    scene: Arc<Scene>,
    revision: u64,
    settings: Arc<Settings>,
    disks: Arc<DiskModel>,
    pins: Pins,
    sampler: Arc<Sampler>,
}

/// Cells of the lattice for one viewpoint, at least: what lies in structures or above the shell has none.
const CELLS_PER_VIEWPOINT: f64 = 4.0;

/// What an edit must not change, so that samples and viewpoints away from the edit stay where they are.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pins {
    lattice: Lattice,
    reference_area_m2: f64,
    neighbour_radius_m: f64,
}

impl Session {
    /// Pins lattice, spacings and units for `scene`; revision 1. This samples the whole scene (tens of milliseconds).
    pub fn new(scene: Scene, settings: Arc<Settings>, stop: &StopToken) -> Result<Self, FieldError> {
        let (pins, sampler) = Pins::choose(&scene, &settings, stop)?;
        let disks = Arc::new(DiskModel::new(&settings.coverage));
        Ok(Self { scene: Arc::new(scene), revision: 1, settings, disks, pins, sampler: Arc::new(sampler) })
    }

    /// A session of another scene under the same pinned settings: what a rebuild from the edited scene means.
    pub fn with_scene(&self, scene: Scene, revision: u64) -> Self {
        Self { scene: Arc::new(scene), revision, ..self.clone() }
    }

    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    pub fn revision(&self) -> u64 {
        self.revision
    }

    pub fn settings(&self) -> &Arc<Settings> {
        &self.settings
    }

    /// Changes the scene and counts the revision up; a refused edit changes nothing.
    pub fn apply(&mut self, edit: &Edit) -> Result<DirtyRegion, EditError> {
        let (scene, dirty) = self.scene.edited(edit, &self.settings.proxy)?;
        self.scene = Arc::new(scene);
        self.revision += 1;
        Ok(dirty)
    }

    /// Samples, viewpoints and clearance of the current revision: all that is needed to size the field's table.
    pub fn survey(&self, stop: &StopToken) -> Result<Survey, FieldError> {
        let free = FreeSpace::new(&self.scene, &self.settings.flight)?;
        self.check_size(&free, stop)?;
        let samples = self.sampler.sample(&self.scene, stop).ok_or(FieldError::Stopped)?;
        let sites = field::sites(&free, &self.pins.lattice, stop).ok_or(FieldError::Stopped)?;
        let tiles = field::outside(&free, &self.pins.lattice, &sites).tiles();
        let outlines = Outlines::new(&self.scene, free.zones());
        self.surveyed(Arc::new(free), (samples, outlines), (sites, tiles), None, stop)
    }

    /// The same, and a field that is the same bit for bit, from that of an earlier revision of this session: what the edits in between have not touched
    /// is taken over.
    pub fn survey_after(&self, earlier: &Snapshot, stop: &StopToken) -> Result<Survey, FieldError> {
        self.survey_of(self.cleared_after(earlier, stop)?, earlier, stop)
    }

    /// What of that comes first: the free space, in which a flight can be looked at before there is a field.
    pub fn cleared_after(&self, earlier: &Snapshot, stop: &StopToken) -> Result<Cleared, FieldError> {
        let differences = Differences::between(&earlier.scene, &self.scene);
        let free = FreeSpace::after(&earlier.free, &self.scene, &differences, &self.settings.flight)?;
        self.check_size(&free, stop)?;
        Ok(Cleared { scene: Arc::clone(&self.scene), revision: self.revision, free: Arc::new(free), differences })
    }

    /// The rest of it.
    pub fn survey_of(&self, cleared: Cleared, earlier: &Snapshot, stop: &StopToken) -> Result<Survey, FieldError> {
        let Cleared { free, differences, .. } = cleared;
        let footing = &earlier.footing;
        let bounds = free.structure_bounds();
        let lattice = &self.pins.lattice;
        let surface = || {
            let samples = self.sampler.sample_after(&self.scene, &differences, &footing.samples, &bounds, stop)?;
            Some((samples, Outlines::after(&footing.outlines, &self.scene, free.zones(), &differences)))
        };
        let space = || {
            let sites = field::sites_after(&free, lattice, &footing.sites, &earlier.free, &differences, stop)?;
            let tiles = field::outside(&free, lattice, &sites).tiles();
            Some((sites, tiles))
        };
        let (surface, space) = rayon::join(surface, space);
        let (surface, space) = surface.zip(space).ok_or(FieldError::Stopped)?;
        self.surveyed(free, surface, space, Some((earlier.clone(), differences)), stop)
    }

    /// The spacings are pinned, so an edit that enlarges the scene enlarges its field.
    fn check_size(&self, free: &FreeSpace, stop: &StopToken) -> Result<(), FieldError> {
        check(stop)?;
        check_size(&self.scene, free, &self.settings, &self.pins.lattice, self.sampler.estimate(free.surface_m2()))
    }

    fn surveyed(
        &self,
        free: Arc<FreeSpace>,
        (samples, outlines): (Vec<Sample>, Outlines),
        (sites, tiles): (Vec<Arc<Strip>>, Vec<Tile>),
        earlier: Option<(Snapshot, Differences)>,
        stop: &StopToken,
    ) -> Result<Survey, FieldError> {
        if !samples.iter().any(|sample| sample.exposed) {
            return Err(FieldError::NoSurface { scene: self.scene.name.clone() });
        }
        check(stop)?;
        if tiles.is_empty() {
            return Err(no_free_space(&self.scene, &free, &self.pins.lattice));
        }
        let viewpoints = tiles.iter().map(Tile::viewpoints).sum();
        Ok(Survey {
            scene: Arc::clone(&self.scene),
            revision: self.revision,
            counts: field::counts(&self.scene, &outlines, &free, samples.len(), viewpoints),
            outlines,
            facts: self.facts(&free),
            offset_m: self.sampler.sampling().offset_m,
            disks: Arc::clone(&self.disks),
            free,
            samples: Samples::new(samples, self.scene.structures.len()),
            tiles,
            sites,
            earlier,
        })
    }

    fn facts(&self, free: &FreeSpace) -> FieldFacts {
        let [min, max] = free.bounds.map_or([[0.0; 3]; 2], |b| [b.min.coords.into(), b.max.coords.into()]);
        let origin = self.scene.frame.origin;
        FieldFacts {
            revision: self.revision,
            settings_hash: self.settings.field_hash(),
            lattice_spacing_m: self.pins.lattice.spacing_m,
            sample_spacing_m: self.sampler.sampling().spacing_m,
            reference_area_m2: self.pins.reference_area_m2,
            neighbour_radius_m: self.pins.neighbour_radius_m,
            range_m: self.settings.coverage.range_m,
            hemisphere_cells: CELLS as u32,
            threshold_cells: threshold_cells(self.settings.coverage.threshold_percent),
            min_m: min,
            max_m: max,
            origin_lat_deg: origin.map_or(0.0, |o| o.lat_deg),
            origin_lon_deg: origin.map_or(0.0, |o| o.lon_deg),
            origin_alt_m: origin.map_or(0.0, |o| o.alt_m),
            georeferenced: u64::from(origin.is_some()),
            legal_ceiling_m: self.settings.flight.legal_ceiling_m,
            ground_origin_m: free.terrain().map_or([0.0; 2], Terrain::origin_m),
            ground_cell_m: free.terrain().map_or(0.0, Terrain::cell_m),
            ground_corners: free.terrain().map_or([0; 2], |terrain| terrain.corners().map(|corners| corners as u32)),
        }
    }
}

impl Pins {
    fn choose(scene: &Scene, settings: &Settings, stop: &StopToken) -> Result<(Self, Sampler), FieldError> {
        let free = FreeSpace::new(scene, &settings.flight)?;
        check(stop)?;
        let surface = &settings.surface;
        let spacing_m = surface::choose_spacing_m(scene, surface.samples, surface.seed, surface.exposure_offset_m, stop)
            .ok_or(FieldError::Stopped)?;
        if spacing_m <= 0.0 {
            return Err(FieldError::NoSurface { scene: scene.name.clone() });
        }
        // The number of samples goes with 1 / spacing^2.
        let least_m = spacing_m * (f64::from(surface.samples) / f64::from(surface.max_samples)).sqrt();
        let spacing_m = spacing_m.min(surface.max_spacing_m.max(least_m));
        let sampler = Sampler::new(Sampling { spacing_m, seed: surface.seed, offset_m: surface.exposure_offset_m });
        let coarsest = Lattice {
            origin: Point3::new(free.limits.min.x, free.limits.min.y, 0.0),
            spacing_m: settings.field.max_spacing_m,
            shell_m: settings.field.shell_m,
            seed: surface.seed,
        };
        check_size(scene, &free, settings, &coarsest, sampler.estimate(free.surface_m2()))?;
        let lattice_m = field::choose_spacing_m(&free, &coarsest, settings.field.viewpoints, stop).ok_or(FieldError::Stopped)?;
        if lattice_m <= 0.0 {
            return Err(no_free_space(scene, &free, &coarsest));
        }
        let lattice = Lattice { spacing_m: lattice_m, ..coarsest };
        let exposed = |sample: &Sample| if sample.exposed { sample.area_mm2 } else { 0 };
        let samples = sampler.sample(scene, stop).ok_or(FieldError::Stopped)?;
        let area_mm2: u64 = samples.iter().map(exposed).sum();
        let neighbour_radius_m = neighbour_radius_m(scene, settings);
        Ok((Self { lattice, reference_area_m2: area_mm2 as f64 / 1e6, neighbour_radius_m }, sampler))
    }
}

/// Refuses a field that is too large before memory is taken for it.
fn check_size(scene: &Scene, free: &FreeSpace, settings: &Settings, lattice: &Lattice, samples: f64) -> Result<(), FieldError> {
    for (what, needed, most, key) in [
        ("samples", samples, settings.field.most_samples, "field.most_samples"),
        (
            "viewpoints",
            field::cells(free, lattice) / CELLS_PER_VIEWPOINT,
            settings.field.most_viewpoints,
            "field.most_viewpoints",
        ),
    ] {
        let most = f64::from(most);
        if needed > most {
            return Err(FieldError::TooLarge { scene: scene.name.clone(), what, needed, most, key });
        }
    }
    Ok(())
}

/// "A radius of 10 % scene size" (Algorithm 4), within limits; the scene's size is its horizontal diagonal, m.
fn neighbour_radius_m(scene: &Scene, settings: &Settings) -> f64 {
    let diagonal = scene.bounds().map_or(0.0, |bounds| (bounds.max - bounds.min).xy().norm());
    let search = &settings.search;
    (search.neighbour_share * diagonal).max(search.neighbour_min_m).min(search.neighbour_max_m)
}

fn no_free_space(scene: &Scene, free: &FreeSpace, lattice: &Lattice) -> FieldError {
    FieldError::NoFreeSpace {
        scene: scene.name.clone(),
        safety_m: free.safety_distance_m,
        shell_m: lattice.shell_m,
        low_m: free.limits.min.z,
        high_m: free.limits.max.z,
    }
}

fn check(stop: &StopToken) -> Result<(), FieldError> {
    if stop.is_stopped() { Err(FieldError::Stopped) } else { Ok(()) }
}
