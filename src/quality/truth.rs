//! The scene that a plan is held against: dense samples of its exposed surface, and what stands between.

use crate::coverage::SampleFrame;
use crate::field::FieldError;
use crate::scene::Scene;
use crate::scene::free_space::FreeSpace;
use crate::settings::{FlightSettings, Settings};
use crate::stop::StopToken;
use crate::surface::{Sampler, Sampling, choose_spacing_m};

/// Dense samples and clearance of one scene.
#[derive(Debug)]
pub struct Truth {
    scene: Scene,
    samples: Vec<TruthSample>,
    pub(super) free: FreeSpace,
    /// How far in front of a sample a line of sight ends, m.
    pub(super) offset_m: f64,
}

/// A point on the exposed surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TruthSample {
    pub frame: SampleFrame,
    /// Surface that the sample stands for, mm^2.
    pub area_mm2: u64,
    /// Index of the structure in the scene.
    pub structure: u32,
}

/// Of a scene whose surface is nearly all buried the exposed part alone would take many times the target in all, and as much memory: it
/// is sampled more coarsely.
const MOST_BURIED: f64 = 10.0;

fn bounded(sampling: Sampling, scene: &Scene, target: u32) -> Sampler {
    let sampler = Sampler::new(sampling);
    let excess = sampler.estimate(scene.structures.iter().map(|structure| structure.surface_m2()).sum())
        / (MOST_BURIED * f64::from(target));
    if excess <= 1.0 { sampler } else { Sampler::new(Sampling { spacing_m: sampling.spacing_m * excess.sqrt(), ..sampling }) }
}

impl Truth {
    /// Samples the scene as densely as `quality.samples` asks, in the way in which a field samples its own.
    pub fn new(scene: Scene, settings: &Settings, stop: &StopToken) -> Result<Self, FieldError> {
        let (target, seed) = (settings.quality.samples, settings.surface.seed);
        let offset_m = settings.surface.exposure_offset_m;
        let no_surface = || FieldError::NoSurface { scene: scene.name.clone() };
        let spacing_m = choose_spacing_m(&scene, target, seed, offset_m, stop).ok_or(FieldError::Stopped)?;
        if spacing_m <= 0.0 {
            return Err(no_surface());
        }
        let sampler = bounded(Sampling { spacing_m, seed, offset_m }, &scene, target);
        let all = sampler.sample(&scene, stop).ok_or(FieldError::Stopped)?;
        let exposed = all.iter().filter(|sample| sample.exposed);
        let samples: Vec<_> = exposed
            .map(|sample| TruthSample {
                frame: SampleFrame::new(sample.position, sample.normal),
                area_mm2: sample.area_mm2,
                structure: sample.structure,
            })
            .collect();
        if samples.is_empty() {
            return Err(no_surface());
        }
        // The limits of a flight are the plan's own affair; only what stands in the scene counts here.
        let flight = FlightSettings { no_fly: Vec::new(), ..settings.flight.clone() };
        Ok(Self { free: FreeSpace::new(&scene, &flight)?, scene, samples, offset_m })
    }

    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// All exposed samples, in the order of the scene's structures.
    pub fn samples(&self) -> &[TruthSample] {
        &self.samples
    }
}
