//! How far apart images are taken along the legs.

/// How long a leg has to be, and how many images it has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageSpacing {
    /// No leg is shorter, m. Without an overlap images are no nearer to each other either.
    pub least_leg_m: f64,
    /// For an overlap: images are no farther apart, m.
    pub most_m: Option<f64>,
}

/// With an overlap images on a leg are at least this share of the most apart: a leg of twice the most or longer is cut into the fewest
/// parts that are short enough, and the worst case is one just longer than that, with three.
pub const LEAST_SHARE: f64 = 2.0 / 3.0;

impl ImageSpacing {
    /// As few images as their least distance gives.
    pub fn at_least(least_m: f64) -> Self {
        Self { least_leg_m: least_m, most_m: None }
    }

    /// So many images that they are at most `most_m` apart, on legs of at least `least_leg_m` and twice `most_m`.
    pub fn overlapping(least_leg_m: f64, most_m: f64) -> Self {
        Self { least_leg_m: least_leg_m.max(2.0 * most_m), most_m: Some(most_m) }
    }

    /// Number of images of a leg without the one at its start.
    pub fn image_count(&self, length_m: f64) -> usize {
        let parts = match self.most_m {
            None => (length_m / self.least_leg_m).floor(),
            Some(most_m) => (length_m / most_m).ceil(),
        };
        (parts as usize).max(1)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn counts_are_those_worked_out_by_hand() {
        let counts =
            |spacing: ImageSpacing| [8.0, 8.1, 11.9, 12.0, 15.9, 16.0, 40.0].map(|length_m| spacing.image_count(length_m));
        assert_eq!(counts(ImageSpacing::at_least(8.0)), [1, 1, 1, 1, 1, 2, 5]);
        assert_eq!(counts(ImageSpacing::overlapping(8.0, 4.0)), [2, 3, 3, 3, 4, 4, 10]);
        assert_eq!(ImageSpacing::overlapping(8.0, 3.0).least_leg_m, 8.0);
        assert_eq!(ImageSpacing::overlapping(8.0, 6.0).least_leg_m, 12.0);
        assert_eq!(ImageSpacing::at_least(8.0).image_count(3.0), 1, "a leg ends with an image");
    }

    proptest! {
        #[test]
        fn images_of_an_overlap_are_two_thirds_of_the_most_to_the_most_apart(
            least_m in 0.5..20.0f64, most_m in 0.5..20.0f64, longer in 1.0..30.0f64,
        ) {
            let spacing = ImageSpacing::overlapping(least_m, most_m);
            let length_m = spacing.least_leg_m * longer;
            let apart_m = length_m / spacing.image_count(length_m) as f64;
            prop_assert!((LEAST_SHARE * most_m * (1.0 - 1e-12)..=most_m * (1.0 + 1e-12)).contains(&apart_m), "{} m", apart_m);
        }
    }
}
