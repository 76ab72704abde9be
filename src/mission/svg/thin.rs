//! Marks that would merge: keeps those that stand apart from all that are kept before them.

use std::collections::HashMap;

use super::pen::Place;

/// The places, in their order, that are at least `gap` pixels from every place of `taken` and from every one kept before.
pub fn apart(places: impl IntoIterator<Item = Place>, taken: impl IntoIterator<Item = Place>, gap: f64) -> Vec<Place> {
    let mut cells: HashMap<(i64, i64), Vec<Place>> = HashMap::new();
    for place in taken {
        cells.entry(cell(place, gap)).or_default().push(place);
    }
    let mut kept = Vec::new();
    for place in places {
        if is_free(&cells, place, gap) {
            cells.entry(cell(place, gap)).or_default().push(place);
            kept.push(place);
        }
    }
    kept
}

fn is_free(cells: &HashMap<(i64, i64), Vec<Place>>, place: Place, gap: f64) -> bool {
    let (column, row) = cell(place, gap);
    let around = (-1..=1).flat_map(|right| (-1..=1).map(move |down| (column + right, row + down)));
    around.filter_map(|cell| cells.get(&cell)).flatten().all(|other| distance(place, *other) >= gap)
}

fn cell(place: Place, gap: f64) -> (i64, i64) {
    ((place[0] / gap).floor() as i64, (place[1] / gap).floor() as i64)
}

fn distance(a: Place, b: Place) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn kept_places_stand_apart_and_no_room_is_wasted(
            places in prop::collection::vec([0.0..60.0f64, 0.0..60.0f64], 1..80),
            taken in prop::collection::vec([0.0..60.0f64, 0.0..60.0f64], 0..5),
        ) {
            let kept = apart(places.clone(), taken.clone(), 6.0);
            for (index, place) in kept.iter().enumerate() {
                prop_assert!(kept[..index].iter().chain(&taken).all(|other| distance(*place, *other) >= 6.0));
            }
            for place in &places {
                let nearest = kept.iter().chain(&taken).map(|other| distance(*place, *other)).fold(f64::MAX, f64::min);
                prop_assert!(nearest < 6.0, "{place:?} has room and is not kept");
            }
        }
    }
}
