//! What the images of a flight see, image by image.

use crate::coverage::{Bearing, Mask};

/// Samples with the cells that images cover of them and where from; a sample may occur once for each image.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sights {
    samples: Vec<u32>,
    masks: Vec<Mask>,
    bearings: Vec<Bearing>,
    images: usize,
}

impl Sights {
    pub fn push(&mut self, sample: u32, mask: Mask, bearing: Bearing) {
        self.samples.push(sample);
        self.masks.push(mask);
        self.bearings.push(bearing);
    }

    /// Says that what follows is seen by one more image.
    pub fn begin_image(&mut self) {
        self.images += 1;
    }

    /// Views of samples, one for each image that sees one.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    pub fn images(&self) -> usize {
        self.images
    }

    /// Samples with what is covered of them.
    pub fn masks(&self) -> impl Iterator<Item = (usize, Mask)> + '_ {
        self.samples.iter().map(|&i| i as usize).zip(self.masks.iter().copied())
    }

    /// Samples with where they are seen from.
    pub fn bearings(&self) -> impl Iterator<Item = (usize, Bearing)> + '_ {
        self.samples.iter().map(|&i| i as usize).zip(self.bearings.iter().copied())
    }
}

impl FromIterator<(u32, Mask, Bearing)> for Sights {
    fn from_iter<T: IntoIterator<Item = (u32, Mask, Bearing)>>(views: T) -> Self {
        let mut sights = Self::default();
        views.into_iter().for_each(|(sample, mask, bearing)| sights.push(sample, mask, bearing));
        sights
    }
}
