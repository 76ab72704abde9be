//! How one scene differs from another, structure by structure and zone by zone: what an edit, a batch of edits or a new version of a file has
//! changed.

use std::sync::Arc;

use super::bounds::Bounds;
use super::proxy::{Scene, Structure};

/// What two scenes do not have in common.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Differences {
    /// For each structure of the later scene the index that the very same structure has in the earlier one.
    pub kept: Vec<Option<usize>>,
    /// Boxes of what stood there before and does not any more, m.
    pub gone: Vec<Bounds>,
    /// Boxes of what stands there now and did not before, m.
    pub come: Vec<Bounds>,
    /// Boxes of the no-fly zones that only one of the scenes has, m.
    pub barred: Vec<Bounds>,
    /// The ground is another one: altitudes and zones that count from it are elsewhere.
    pub is_ground_new: bool,
}

impl Differences {
    /// Both scenes have their structures in the order of their ids.
    pub fn between(before: &Scene, after: &Scene) -> Self {
        let mut differences = Self { kept: Vec::with_capacity(after.structures.len()), ..Self::default() };
        let mut old = before.structures.iter().enumerate().peekable();
        for structure in &after.structures {
            while let Some((_, gone)) = old.next_if(|(_, old)| old.id < structure.id) {
                differences.lose(gone);
            }
            let same_id = old.next_if(|(_, old)| old.id == structure.id);
            let kept = same_id.filter(|(_, old)| is_same(old, structure)).map(|(index, _)| index);
            if kept.is_none() {
                same_id.iter().for_each(|(_, old)| differences.lose(old));
                differences.come.push(structure.bounds());
                differences.is_ground_new |= structure.terrain().is_some();
            }
            differences.kept.push(kept);
        }
        old.for_each(|(_, gone)| differences.lose(gone));
        let only = |these: &Scene, others: &Scene| {
            let gone = these.zones.iter().filter(|zone| !others.zones.contains(zone));
            gone.filter_map(|zone| zone.bounds(these.terrain())).collect::<Vec<_>>()
        };
        differences.barred = only(before, after);
        differences.barred.extend(only(after, before));
        differences
    }

    fn lose(&mut self, gone: &Structure) {
        self.gone.push(gone.bounds());
        self.is_ground_new |= gone.terrain().is_some();
    }

    /// All boxes in which structures came or went.
    pub fn boxes(&self) -> impl Iterator<Item = &Bounds> {
        self.gone.iter().chain(&self.come)
    }
}

fn is_same(a: &Arc<Structure>, b: &Arc<Structure>) -> bool {
    Arc::ptr_eq(a, b) || a == b
}
