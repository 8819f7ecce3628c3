//! Random edits of scenes that persist, and what a client knows from the answers that it took.

use std::collections::{BTreeMap, BTreeSet};

use pairmask_core::Aabb;
use pairmask_core::scene::{Ended, Indices, Sets, Step};
use pairmaskd::scene::Random;

/// Boxes of a scene, changed at random: they drift, jump, come and go, and their indices are used again.
#[derive(Debug)]
pub struct RandomEdits {
    random: Random,
    boxes: BTreeMap<u32, Aabb>,
    /// Boxes that there are at the most.
    most_boxes: u32,
    /// How many there shall be in a while.
    target: usize,
}

/// An edit that owns its arrays.
#[derive(Clone, Debug, Default)]
pub struct OwnedEdit {
    removed: Vec<u32>,
    indices: Vec<u32>,
    boxes: Vec<Aabb>,
    switched: [Vec<u32>; 2],
    flagged: [Vec<u32>; 2],
}

impl OwnedEdit {
    /// The steps.
    pub fn steps(&self) -> Vec<Step<'_>> {
        let mut steps = vec![
            Step::Set(Sets { indices: Indices::List(&self.indices), boxes: &self.boxes }),
            Step::Remove(Indices::List(&self.removed)),
        ];
        for (on, (switched, flagged)) in self.switched.iter().zip(&self.flagged).enumerate() {
            steps.push(Step::Switch(Indices::List(switched), on == 1));
            steps.push(Step::Static(Indices::List(flagged), on == 1));
        }
        steps
    }
}

/// Edges of the world, for which a scene of a thousand unit boxes has about as many pairs.
const WORLD: f32 = 16.0;

impl RandomEdits {
    /// A scene without boxes.
    pub const fn new(seed: u64, most_boxes: u32) -> Self {
        Self { random: Random::new(seed), boxes: BTreeMap::new(), most_boxes, target: 0 }
    }

    /// Boxes that there are.
    pub fn len(&self) -> usize {
        self.boxes.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.boxes.is_empty()
    }

    fn one_in(&mut self, bound: u64) -> bool {
        self.random.below(bound) == 0
    }

    fn some_box(&mut self) -> Aabb {
        let r = &mut self.random;
        let edge = [1.0, 1.0, 1.0, 1.0, 0.0, 6.0][r.below(6) as usize];
        let center = [(); 3].map(|()| r.range(0.0, WORLD));
        match r.below(200) {
            0 => Aabb::EMPTY,
            1 => Aabb { min: [f32::NAN; 3], max: center },
            2 => Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] },
            _ => Aabb::from_center_half(center, [0.5 * edge; 3]),
        }
    }

    fn moved(&mut self, b: &Aabb) -> Aabb {
        let by = [0.0, 0.05, 0.05, 0.5][self.random.below(4) as usize];
        let by = self.random.direction().map(|x| by * x);
        Aabb {
            min: std::array::from_fn(|axis| b.min[axis] + by[axis]),
            max: std::array::from_fn(|axis| b.max[axis] + by[axis]),
        }
    }

    /// Some indices that have a box, as many as `most`, in no order.
    fn some(&mut self, most: usize) -> Vec<u32> {
        let count = self.random.below(most.min(self.boxes.len()) as u64 + 1) as usize;
        let indices: Vec<u32> = self.boxes.keys().copied().collect();
        let mut chosen = BTreeSet::new();
        let mut some = Vec::new();
        for _ in 0..count {
            let index = indices[self.random.below(indices.len() as u64) as usize];
            if chosen.insert(index) {
                some.push(index);
            }
        }
        some
    }

    /// The next edit, which is right.
    pub fn edit(&mut self) -> OwnedEdit {
        let mut edit = OwnedEdit::default();
        if self.one_in(40) {
            self.target = self.random.below(u64::from(self.most_boxes) + 1) as usize;
        }
        let n = self.boxes.len();
        let some_step = self.random.below(self.target.abs_diff(n) as u64 + 3) as usize;
        let mut set = BTreeMap::new();
        if n > self.target {
            edit.removed = self.some(some_step);
        } else {
            let skip = self.random.below(5) as usize;
            let free = (0..self.most_boxes).filter(|index| !self.boxes.contains_key(index));
            for index in free.skip(skip).take(some_step).collect::<Vec<u32>>() {
                set.insert(index, self.some_box());
            }
        }
        let share = [n, n / 10, 5, 5, 5, 0][self.random.below(6) as usize];
        for index in self.some(share) {
            let b = self.boxes[&index];
            let there = if self.one_in(9) { self.some_box() } else { self.moved(&b) };
            set.insert(index, there);
        }
        if self.one_in(5) {
            // Another box under the same index.
            for index in self.some(3) {
                if !edit.removed.contains(&index) {
                    edit.removed.push(index);
                }
                let b = self.some_box();
                set.insert(index, b);
            }
        }
        for index in &edit.removed {
            self.boxes.remove(index);
        }
        self.boxes.extend(&set);
        (edit.indices, edit.boxes) = set.into_iter().unzip();
        if self.one_in(2) {
            edit.indices.reverse();
            edit.boxes.reverse();
        }
        for on in 0..2 {
            if self.one_in(4) {
                edit.switched[on] = self.some(4);
            }
            if self.one_in(4) {
                let most = if self.one_in(9) { n } else { 4 };
                edit.flagged[on] = self.some(most);
            }
        }
        edit
    }
}

/// The pairs that a client knows from the answers that it took.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct KnownPairs(BTreeSet<[u32; 2]>);

impl KnownPairs {
    /// Takes changes. A change that is told twice, or of a pair that is not known, is an error.
    ///
    /// # Errors
    /// What is wrong.
    pub fn change(
        &mut self,
        begun: impl IntoIterator<Item = [u32; 2]>,
        ended: impl IntoIterator<Item = Ended>,
    ) -> Result<(), String> {
        for ended in ended {
            if !self.0.remove(&ended.pair) {
                return Err(format!("{ended:?} ended and was not known"));
            }
        }
        for begun in begun {
            if !self.0.insert(begun) {
                return Err(format!("{begun:?} began and was known"));
            }
        }
        Ok(())
    }

    /// Takes all pairs in place of those that were known.
    pub fn resync(&mut self, pairs: impl IntoIterator<Item = [u32; 2]>) {
        self.0 = pairs.into_iter().collect();
    }

    /// The pairs, sorted.
    pub fn iter(&self) -> impl Iterator<Item = [u32; 2]> {
        self.0.iter().copied()
    }

    /// Whether they are these, which are sorted.
    ///
    /// # Errors
    /// The first difference.
    pub fn compare(&self, pairs: &[[u32; 2]]) -> Result<(), String> {
        if self.0.iter().eq(pairs) {
            return Ok(());
        }
        let there: BTreeSet<_> = pairs.iter().copied().collect();
        let (missed, extra) = (there.difference(&self.0).next(), self.0.difference(&there).next());
        Err(format!("missed {missed:?}, extra {extra:?}, {} of {}", self.0.len(), there.len()))
    }
}

#[cfg(test)]
mod tests {
    use pairmask_core::scene::{Edit, EndReason, Scene, SceneOptions, Want};

    use super::*;

    #[test]
    fn edits_are_right_and_scenes_grow_and_shrink() {
        let mut edits = RandomEdits::new(7, 200);
        let mut scene = Scene::new(SceneOptions::default().with_most_boxes(200));
        let (mut least, mut most) = (usize::MAX, 0);
        for _ in 0..2_000 {
            let edit = edits.edit();
            let edited = scene.edit(Edit { steps: &edit.steps() }, Want::Nothing);
            edited.map(drop).expect("a right edit");
            assert_eq!(scene.len(), edits.len());
            (least, most) = (least.min(scene.len()), most.max(scene.len()));
        }
        assert!(least < 10 && most > 150, "{least} to {most}");
    }

    #[test]
    fn what_is_told_twice_or_never_is_noticed() {
        let mut known = KnownPairs::default();
        let ended = |pair| Ended { pair, reason: EndReason::Separated };
        known.change([[1, 2], [1, 3]], []).expect("new pairs");
        assert!(known.clone().change([[1, 2]], []).is_err());
        assert!(known.clone().change([], [ended([2, 3])]).is_err());
        known.change([[1, 2]], [ended([1, 2])]).expect("another box of the same index");
        known.compare(&[[1, 2], [1, 3]]).expect("both");
        assert!(known.compare(&[[1, 2]]).is_err() && known.compare(&[[1, 2], [2, 3]]).is_err());
        known.resync([[4, 5]]);
        known.compare(&[[4, 5]]).expect("what was told last");
    }
}
