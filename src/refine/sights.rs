//! What the images of a flight see, image by image.

use crate::coverage::Mask;

/// Samples with the cells that images cover of them; a sample may occur once for each image.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sights {
    samples: Vec<u32>,
    masks: Vec<Mask>,
    images: usize,
}

impl Sights {
    pub fn push(&mut self, sample: u32, mask: Mask) {
        self.samples.push(sample);
        self.masks.push(mask);
    }

    /// Says that what follows is seen by one more image.
    pub fn begin_image(&mut self) {
        self.images += 1;
    }

    pub fn images(&self) -> usize {
        self.images
    }

    pub fn iter(&self) -> impl Iterator<Item = (usize, Mask)> + '_ {
        self.samples.iter().map(|&i| i as usize).zip(self.masks.iter().copied())
    }
}

impl FromIterator<(u32, Mask)> for Sights {
    fn from_iter<T: IntoIterator<Item = (u32, Mask)>>(pairs: T) -> Self {
        let mut sights = Self::default();
        pairs.into_iter().for_each(|(sample, mask)| sights.push(sample, mask));
        sights
    }
}
