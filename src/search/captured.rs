//! What was captured before a flight: which images that were taken saw which samples.
//!
//! What an image has seen it has seen, whatever is put up in the way later. So nothing of it is derived from the scene as it is now: lines of sight
//! are those of the scene that the image was taken in, and they are kept by structure and by the number of the sample within it. The samples of a
//! structure depend on that structure alone, so that they stay the same for as long as nobody edits it; with an edit they go, and are to be captured
//! again.

use std::sync::Arc;

use nalgebra::Point3;

use crate::coverage::{Bearing, DiskModel, Mask, SampleFrame};
use crate::field::Snapshot;
use crate::scene::{Scene, Structure};

/// Images that were taken, and what they saw of structures that are as they were.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Captured {
    /// Where the images were taken, m.
    places: Vec<Point3<f64>>,
    /// In the order of the structures' ids.
    surfaces: Vec<Surface>,
}

/// A structure of which something was seen.
#[derive(Clone, Debug, PartialEq)]
struct Surface {
    /// The structure as it was seen. Every edit makes another one, so that the same one means the same surface.
    structure: Arc<Structure>,
    /// The images that saw each of its samples, in their order.
    seen_by: Vec<Vec<u32>>,
}

/// How an image that was taken saw a sample: the cells of its disk, and where from.
pub type View = (Mask, Bearing);

impl Captured {
    /// How many images were taken, also of what has been edited since.
    pub fn images(&self) -> usize {
        self.places.len()
    }

    /// Adds images that were taken in the scene of `snapshot`; `seen` says for each sample of its field which of them saw it, by their numbers in
    /// `places`. What was seen of structures that this scene does not have any more as they were is forgotten.
    pub fn add<'s>(&mut self, snapshot: &Snapshot, places: impl Iterator<Item = Point3<f64>>, seen: impl Fn(usize) -> &'s [u32]) {
        self.forget_edited(&snapshot.scene);
        let first = self.places.len() as u32;
        self.places.extend(places);
        for (row, structure) in snapshot.field().structures.iter().zip(&snapshot.scene.structures) {
            let samples = row.first_sample as usize..(row.first_sample + row.samples) as usize;
            if samples.clone().all(|i| seen(i).is_empty()) {
                continue;
            }
            let surface = self.surface(structure, samples.len());
            for (seen_by, i) in surface.seen_by.iter_mut().zip(samples) {
                seen_by.extend(seen(i).iter().map(|image| first + image));
            }
        }
    }

    /// How the images saw the samples of a field; nothing of those that lie buried now, and of those of structures that have changed. `frames` are the
    /// field's samples. Empty when nothing was captured.
    pub fn views(&self, snapshot: &Snapshot, frames: &[SampleFrame], disks: &DiskModel) -> Vec<Vec<View>> {
        if self.surfaces.is_empty() {
            return Vec::new();
        }
        let field = snapshot.field();
        let mut views = vec![Vec::new(); frames.len()];
        for (row, structure) in field.structures.iter().zip(&snapshot.scene.structures) {
            let Some(surface) = self.find(structure).ok().map(|at| &self.surfaces[at]).filter(|one| one.is_of(structure)) else {
                continue;
            };
            for (k, seen_by) in surface.seen_by.iter().enumerate() {
                let i = row.first_sample as usize + k;
                if field.samples[i].exposed == 1 {
                    views[i] = seen_by.iter().filter_map(|&image| self.view(image, &frames[i], disks)).collect();
                }
            }
        }
        views
    }

    fn view(&self, image: u32, frame: &SampleFrame, disks: &DiskModel) -> Option<View> {
        let place = &self.places[image as usize];
        let mask = if disks.faces(frame, place) { disks.exact_mask(frame, place) } else { 0 };
        (mask != 0).then(|| (mask, Bearing::new(&frame.position, place)))
    }

    fn forget_edited(&mut self, scene: &Scene) {
        self.surfaces.retain(|surface| scene.structure(surface.structure.id).is_some_and(|structure| surface.is_of(structure)));
    }

    fn surface(&mut self, structure: &Arc<Structure>, samples: usize) -> &mut Surface {
        let at = self.find(structure).unwrap_or_else(|at| {
            self.surfaces.insert(at, Surface { structure: Arc::clone(structure), seen_by: vec![Vec::new(); samples] });
            at
        });
        &mut self.surfaces[at]
    }

    fn find(&self, structure: &Structure) -> Result<usize, usize> {
        self.surfaces.binary_search_by_key(&structure.id, |surface| surface.structure.id)
    }
}

impl Surface {
    fn is_of(&self, structure: &Arc<Structure>) -> bool {
        Arc::ptr_eq(&self.structure, structure)
    }
}
