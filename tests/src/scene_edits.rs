//! Random edits of scenes, for engines that keep scenes side by side.

use std::collections::{BTreeMap, BTreeSet};

use pairmask_core::Aabb;
use pairmask_core::scene::{Edit, Indices, Sets, Step, Told};

use crate::stress_scenes::Rng;

/// Indices beyond the number of boxes that an [`EditMaker`] may use: it leaves some free.
pub const SKIPPED: u32 = 8;

/// Edits of a seed of [`a_seed_of_edits`], those of [`EditedScenes::grow_and_shrink`] not counted.
pub const EDITS_OF_A_SEED: usize = 50_000;

/// The edits of one seed in twenty, for a million in all: batches, each of a scene of its own, as seed, number
/// of edits and most boxes.
pub fn a_seed_of_edits(seed: u64) -> impl Iterator<Item = (u64, usize, usize)> {
    const BATCH: usize = 2_500;
    let batches = (EDITS_OF_A_SEED / BATCH) as u64;
    // Small scenes, some of some hundred boxes, and one of thousands.
    let largest = |batch| match batch {
        0 => 3_000,
        batch if batch % 4 == 0 => 500,
        _ => 70,
    };
    (0..batches).map(move |batch| (1_000 * seed + batch, BATCH, largest(batch)))
}

/// Scenes that get the same random edits.
pub trait EditedScenes {
    /// What makes the edits.
    fn maker(&mut self) -> &mut EditMaker;

    /// Makes the next edit and checks the answers.
    fn step(&mut self);

    /// Steps until the scenes have grown to nearly so many boxes and shrunk again. Returns how many.
    fn grow_and_shrink(&mut self, largest: usize) -> usize {
        let mut steps = 0;
        for (target, done) in [(largest, largest - largest / 16..usize::MAX), (1, 0..70)] {
            while steps == 0 || !done.contains(&self.maker().boxes().len()) {
                self.maker().aim(target, largest);
                self.step();
                steps += 1;
            }
        }
        steps
    }
}

/// An edit that owns what it sets.
#[derive(Clone, Debug, Default)]
pub struct OwnedEdit {
    /// Indices that are removed.
    pub removed: Vec<u32>,
    /// Boxes that are set.
    pub set: BTreeMap<u32, Aabb>,
    /// Boxes that are switched on or off, in this order.
    pub switched: Vec<(u32, bool)>,
    /// Boxes that become static or not, in this order.
    pub flagged: Vec<(u32, bool)>,
}

/// Makes edits of one scene, each right after those before it.
pub struct EditMaker {
    rng: Rng,
    /// The boxes of the scene.
    boxes: BTreeMap<u32, Aabb>,
    target: usize,
    /// Whether the target stays.
    is_aimed: bool,
    largest: usize,
    world: f32,
}

impl EditMaker {
    /// Edits of a scene that grows to so many boxes at most, and shrinks again, and again.
    pub fn new(seed: u64, largest: usize) -> Self {
        let (rng, boxes) = (Rng::new(seed), BTreeMap::new());
        Self { rng, boxes, target: 1, is_aimed: false, largest, world: 4.0 }
    }

    /// The boxes after the last edit.
    pub const fn boxes(&self) -> &BTreeMap<u32, Aabb> {
        &self.boxes
    }

    /// A number below `bound`.
    pub fn below(&mut self, bound: usize) -> usize {
        self.rng.below(bound.max(1) as u32) as usize
    }

    /// True once in so many times.
    pub fn one_in(&mut self, bound: usize) -> bool {
        self.below(bound) == 0
    }

    fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.rng.point()[0]
    }

    /// Makes the scene grow or shrink to so many boxes from now on, in room for `room` boxes of about a pair
    /// each: a hundred thousand in less room have pairs by the hundred million.
    pub fn aim(&mut self, target: usize, room: usize) {
        self.is_aimed = true;
        self.move_to(target, room, 6.0);
    }

    fn move_to(&mut self, target: usize, room: usize, density: f32) {
        self.target = target;
        self.world = (room as f32 * density).cbrt() + 0.5;
    }

    /// The next edit, applied to [`Self::boxes`].
    pub fn next_edit(&mut self) -> OwnedEdit {
        if !self.is_aimed && self.one_in(30) {
            let target = match self.below(10) {
                0 | 1 => self.largest,
                2 | 3 => self.below(self.largest + 1),
                4 => 0,
                _ => self.below(71),
            };
            let density = [0.5f32, 2.0, 6.0, 40.0][self.below(4)];
            self.move_to(target, target, density);
        }
        let edit = self.some_edit();
        for index in &edit.removed {
            self.boxes.remove(index);
        }
        self.boxes.extend(edit.set.iter().map(|(index, b)| (*index, *b)));
        edit
    }

    fn some_of(&mut self, most: usize) -> BTreeSet<u32> {
        let n = self.boxes.len();
        let indices: Vec<u32> = self.boxes.keys().copied().collect();
        let count = self.below(most.min(n) + 1);
        (0..count).map(|_| indices[self.below(n)]).collect()
    }

    fn some_edit(&mut self) -> OwnedEdit {
        let mut edit = OwnedEdit::default();
        let n = self.boxes.len();
        // Towards the size that is wanted, in steps of all sizes.
        let step = self.below(self.target.abs_diff(n) + 3);
        if n > self.target {
            edit.removed.extend(self.some_of(step));
        } else if self.one_in(2) {
            let skip = self.below(5);
            let is_free = |index: &u32| !self.boxes.contains_key(index);
            for index in (0u32..).filter(is_free).skip(skip).take(step).collect::<Vec<_>>() {
                edit.set.insert(index, self.some_box());
            }
        }
        let share = match self.below(12) {
            0 => n,
            1 => n / 5,
            2..4 => 0,
            _ => 4,
        };
        match self.below(4) {
            0 => {
                for index in self.some_of(share) {
                    edit.set.insert(index, self.some_box());
                }
            }
            1 if self.one_in(4) => {
                // The same boxes again: nothing moves.
                for index in self.some_of(share) {
                    edit.set.insert(index, self.boxes[&index]);
                }
            }
            _ => {
                let by = [0.02, 0.3, 1.5][self.below(3)];
                for index in self.some_of(share) {
                    edit.set.insert(index, self.jittered(index, by));
                }
            }
        }
        if self.one_in(6) {
            // Removed and set anew in one edit; sometimes the very same box.
            for index in self.some_of(3) {
                if !edit.removed.contains(&index) {
                    edit.removed.push(index);
                    let is_same = self.one_in(2);
                    let b = if is_same { self.boxes[&index] } else { self.some_box() };
                    edit.set.insert(index, b);
                }
            }
        }
        let removed: BTreeSet<u32> = edit.removed.iter().copied().collect();
        edit.set.retain(|index, _| !removed.contains(index) || !self.one_in(9));
        let stays = |index: &u32| !removed.contains(index) || edit.set.contains_key(index);
        if self.one_in(5) {
            let some: Vec<u32> = self.some_of(4).into_iter().filter(stays).collect();
            // An index may be named twice.
            let twice = some.iter().chain(some.first());
            edit.switched.extend(twice.map(|index| (*index, self.one_in(2))));
        }
        if self.one_in(5) {
            let most = if self.one_in(9) { n } else { 4 };
            let some: Vec<u32> = self.some_of(most).into_iter().filter(stays).collect();
            edit.flagged.extend(some.iter().map(|index| (*index, self.one_in(2))));
        }
        edit
    }

    /// A box somewhere in the world, seldom an odd one.
    fn some_box(&mut self) -> Aabb {
        // Few large ones in large scenes: each is a pair with many.
        let edge = match self.below(40 + self.boxes.len() / 10) {
            0 => 8.0,
            1 => 60.0,
            2 => 0.0,
            _ => 1.0,
        };
        let center = [(); 3].map(|()| self.range(0.0, self.world));
        let half = [(); 3].map(|()| 0.5 * edge * self.range(0.5, 1.5));
        let mut b = Aabb::from_center_half(center, half);
        // Few odd ones in large scenes: each plane without end is a pair with all others.
        let axis = self.below(3);
        match self.below(160 + self.boxes.len()) {
            0 => b = Aabb::EMPTY,
            1 => b.min[axis] = f32::NAN,
            2 => b.max[axis] = f32::INFINITY,
            3 => b = Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] },
            4 => b = Aabb { min: [-0.0; 3], max: [0.0; 3] },
            5 => b = Aabb { min: [1e-45; 3], max: [2e-40; 3] },
            6 => (b.min[axis], b.max[axis]) = (f32::MAX, f32::INFINITY),
            7 => b = Aabb { min: b.max, max: b.min },
            _ => {}
        }
        b
    }

    fn jittered(&mut self, index: u32, by: f32) -> Aabb {
        let b = self.boxes[&index];
        let by = [(); 3].map(|()| self.range(-by, by));
        Aabb {
            min: std::array::from_fn(|axis| b.min[axis] + by[axis]),
            max: std::array::from_fn(|axis| b.max[axis] + by[axis]),
        }
    }
}

impl OwnedEdit {
    /// Calls `f` with the edit, its sets in one of three ways to name them.
    pub fn with<R>(&self, way: usize, f: impl FnOnce(Edit<'_>) -> R) -> R {
        f(Edit { steps: &self.arrays(way).steps() })
    }

    /// The arrays of the edit, its sets in one of three ways to name them.
    pub fn arrays(&self, way: usize) -> EditArrays<'_> {
        let indices: Vec<u32> = self.set.keys().copied().collect();
        let boxes: Vec<Aabb> = self.set.values().copied().collect();
        let mut words = vec![0u32; indices.last().map_or(0, |last| *last as usize / 32 + 1)];
        for index in &indices {
            words[*index as usize / 32] |= 1 << (index % 32);
        }
        EditArrays { edit: self, indices, boxes, words, way }
    }
}

/// An edit with its sets in one way to name them.
#[derive(Clone, Debug)]
pub struct EditArrays<'e> {
    edit: &'e OwnedEdit,
    indices: Vec<u32>,
    boxes: Vec<Aabb>,
    words: Vec<u32>,
    way: usize,
}

impl EditArrays<'_> {
    /// The steps.
    pub fn steps(&self) -> Vec<Step<'_>> {
        let Self { edit, indices, boxes, words, way } = self;
        let mut steps = Vec::new();
        let all = |indices| Step::Set(Sets { indices, boxes });
        match way {
            0 => steps.push(all(indices.into())),
            1 => steps.push(all(Indices::Mask { first: 0, words })),
            _ => steps.extend(indices.iter().zip(boxes).map(|(index, b)| {
                let indices = Indices::Range { first: *index, count: 1 };
                Step::Set(Sets { indices, boxes: std::slice::from_ref(b) })
            })),
        }
        for (index, on) in &edit.switched {
            steps.push(Step::Switch(Indices::List(std::slice::from_ref(index)), *on));
        }
        for (index, on) in &edit.flagged {
            steps.push(Step::Static(Indices::List(std::slice::from_ref(index)), *on));
        }
        // Removals come first whatever their place.
        steps.push(Step::Remove((&edit.removed).into()));
        steps
    }
}

/// Whether two answers tell the same, but for how they were found.
///
/// # Errors
/// What differs first.
pub fn same_told(got: &Told, expected: &Told) -> Result<(), String> {
    fn same<T: PartialEq + std::fmt::Debug>(
        what: &str,
        got: &[T],
        expected: &[T],
    ) -> Result<(), String> {
        if got == expected {
            return Ok(());
        }
        let first = got.iter().zip(expected).find(|(a, b)| a != b);
        Err(format!("{what}: {} for {}, first {first:?}", got.len(), expected.len()))
    }
    if got.want() != expected.want() || got.is_resync() != expected.is_resync() {
        let [g, e] = [got, expected].map(|told| (told.want(), told.is_resync()));
        return Err(format!("want and resync: {g:?} for {e:?}"));
    }
    same("begun", got.begun(), expected.begun())?;
    same("ended", got.ended(), expected.ended())?;
    same("pairs", got.pairs(), expected.pairs())?;
    if got.pair_count() != expected.pair_count() {
        return Err(format!("pairs: {:?} for {:?}", got.pair_count(), expected.pair_count()));
    }
    Ok(())
}
