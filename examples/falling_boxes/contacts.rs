//! Contacts: what the physics knows of each overlapping pair, for as long as the pair overlaps.

use std::collections::{BTreeMap, BTreeSet};

use pairmask::SceneAnswer;

/// Two indices of the scene, smaller one first.
pub type Pair = [u32; 2];

/// A `T` for each overlapping pair.
///
/// It is sorted by pairs. Pushes depend on their order, so the world is the same with every backend.
pub struct Contacts<T> {
    kept: BTreeMap<Pair, T>,
}

impl<T> Contacts<T> {
    pub const fn new() -> Self {
        Self { kept: BTreeMap::new() }
    }

    /// Brings the contacts up to date by a taken answer to [`Report::Changes`](pairmask::Report).
    /// `begin` makes the contact of a pair that begins. Returns the pairs that began or ended.
    pub fn update(
        &mut self,
        answer: &SceneAnswer<'_>,
        mut begin: impl FnMut(Pair) -> T,
    ) -> BTreeSet<Pair> {
        let mut changed = BTreeSet::new();
        if answer.is_resync() {
            // All pairs of now replace those that are kept. Contacts of pairs that go on stay.
            let now: BTreeSet<Pair> = answer.pairs().iter().collect();
            self.kept.retain(|pair, _| now.contains(pair) || !changed.insert(*pair));
            for pair in now {
                self.kept.entry(pair).or_insert_with(|| {
                    changed.insert(pair);
                    begin(pair)
                });
            }
        } else {
            // Ended pairs go first: a pair of an index that was removed and given to a new box in one
            // edit may end and begin in one answer.
            for ended in answer.ended() {
                self.kept.remove(&ended.pair);
                changed.insert(ended.pair);
            }
            for pair in answer.begun() {
                self.kept.insert(pair, begin(pair));
                changed.insert(pair);
            }
        }
        changed
    }

    /// The contacts, by pairs.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = (Pair, &T)> {
        self.kept.iter().map(|(pair, contact)| (*pair, contact))
    }
}
