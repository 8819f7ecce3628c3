//! Scenes against a naive model, edit by edit: what is told, when it is taken, and why a pair ended.
//!
//! A tier of seconds runs with every `cargo test`. A million edits over 20 seeds run, in minutes, by
//!
//! ```text
//! cargo test --workspace --release --test scenes -- --ignored
//! ```
//!
//! One file, because every test drives a scene and the same model side by side.

use std::collections::{BTreeMap, BTreeSet};

use pairmask_core::Aabb;
use pairmask_core::oracle::{self, Corners};
use pairmask_core::scene::{
    Edit, EditError, EndReason, Ended, Indices, Scene, SceneError, SceneOptions, Sets, Step, Told,
    Want,
};
use rayon::ThreadPoolBuilder;

type Pair = [u32; 2];

/// `SplitMix64`.
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn below(&mut self, bound: usize) -> usize {
        ((u128::from(self.bits()) * bound.max(1) as u128) >> 64) as usize
    }

    fn one_in(&mut self, bound: usize) -> bool {
        self.below(bound) == 0
    }

    fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * ((self.bits() >> 40) as f32 / 16_777_216.0)
    }
}

struct ModelBox {
    b: Aabb,
    /// What the oracle makes of it, where it is switched on.
    corners: Corners,
    on: bool,
    is_static: bool,
}

impl ModelBox {
    fn new(b: Aabb, on: bool, is_static: bool) -> Self {
        let corners = Corners::of(if on { &b } else { &Aabb::EMPTY });
        Self { b, corners, on, is_static }
    }

    fn collides(&self) -> Aabb {
        if self.on { self.b } else { Aabb::EMPTY }
    }

    fn is_pair_with(&self, other: &Self) -> bool {
        !(self.is_static && other.is_static) && self.corners.overlap(&other.corners)
    }
}

/// The naive model: every pair in a set, looked for by comparing with every box.
#[derive(Default)]
struct Model {
    boxes: BTreeMap<u32, ModelBox>,
    pairs: BTreeSet<Pair>,
    /// The same, the larger index first.
    reversed: BTreeSet<Pair>,
    /// Pairs that the client knows from what it took.
    told: BTreeSet<Pair>,
    removed: BTreeSet<u32>,
}

impl Model {
    fn renew(&mut self, index: u32) {
        let of = [index, 0]..=[index, u32::MAX];
        for [a, b] in self.pairs.range(of.clone()).copied().collect::<Vec<Pair>>() {
            self.pairs.remove(&[a, b]);
            self.reversed.remove(&[b, a]);
        }
        for [b, a] in self.reversed.range(of).copied().collect::<Vec<Pair>>() {
            self.pairs.remove(&[a, b]);
            self.reversed.remove(&[b, a]);
        }
        let Some(this) = self.boxes.get(&index) else { return };
        for (&other, b) in &self.boxes {
            if other != index && this.is_pair_with(b) {
                let (a, b) = (index.min(other), index.max(other));
                self.pairs.insert([a, b]);
                self.reversed.insert([b, a]);
            }
        }
    }

    fn reason(&self, [a, b]: Pair) -> EndReason {
        if self.removed.contains(&a) || self.removed.contains(&b) {
            return EndReason::Removed;
        }
        let (a, b) = (&self.boxes[&a], &self.boxes[&b]);
        if !a.on || !b.on || (a.is_static && b.is_static) {
            EndReason::Filtered
        } else {
            EndReason::Separated
        }
    }

    /// The changes that a client has to be told.
    fn changes(&self) -> (Vec<Pair>, Vec<Ended>) {
        let is_replaced = |pair: &Pair| pair.iter().any(|index| self.removed.contains(index));
        let begun = self.pairs.iter().filter(|p| !self.told.contains(*p) || is_replaced(p));
        let ended = self.told.iter().filter(|p| !self.pairs.contains(*p) || is_replaced(p));
        let ended = ended.map(|pair| Ended { pair: *pair, reason: self.reason(*pair) });
        (begun.copied().collect(), ended.collect())
    }

    /// Whether an answer is what it has to be, but for its skip meter.
    fn check(&self, told: &Told, named: &BTreeSet<u32>, lost: bool) -> Result<(), String> {
        let all: Vec<Pair> = self.pairs.iter().copied().collect();
        let same = |what: &str, got: &[Pair], expected: &[Pair]| {
            let first = got.iter().zip(expected).find(|(a, b)| a != b);
            let (g, e) = (got.len(), expected.len());
            if got == expected { Ok(()) } else { Err(format!("{what}: {g} for {e}, {first:?}")) }
        };
        match told.want() {
            Want::Nothing => same("nothing", told.pairs(), &[]),
            Want::All => same("all", told.pairs(), &all),
            Want::Moved => {
                let is_named = |pair: &&Pair| pair.iter().any(|index| named.contains(index));
                let moved: Vec<Pair> = self.pairs.iter().filter(is_named).copied().collect();
                same("moved", told.pairs(), &moved)
            }
            _ => {
                let (begun, ended) = self.changes();
                let changes = begun.len() + ended.len();
                let resync = lost || changes > all.len().max(4_096);
                if told.is_resync() != resync {
                    return Err(format!("resync {}, {changes} changes", told.is_resync()));
                }
                if told.pair_count() != Some(all.len() as u64) {
                    return Err(format!("{:?} pairs for {}", told.pair_count(), all.len()));
                }
                if resync {
                    return same("resync", told.pairs(), &all);
                }
                same("begun", told.begun(), &begun)?;
                if told.ended() != ended {
                    return Err(format!("ended: {:?} for {ended:?}", told.ended()));
                }
                Ok(())
            }
        }
    }

    /// The client takes the answer.
    fn take(&mut self, told: &Told) {
        match told.want() {
            Want::All => self.told = told.pairs().iter().copied().collect(),
            Want::Changes if told.is_resync() => {
                self.told = told.pairs().iter().copied().collect();
            }
            Want::Changes => {
                for ended in told.ended() {
                    assert!(self.told.remove(&ended.pair), "{ended:?} was told twice");
                }
                for begun in told.begun() {
                    assert!(self.told.insert(*begun), "{begun:?} was told twice");
                }
            }
            _ => return,
        }
        assert_eq!(self.told, self.pairs, "what was told adds up to the pairs of now");
        self.removed.clear();
    }

    /// Whether the model itself is right: by the oracle, over all boxes.
    fn check_itself(&self) {
        let len = self.boxes.keys().last().map_or(0, |last| *last as usize + 1);
        let mut boxes = vec![Aabb::EMPTY; len];
        for (index, b) in &self.boxes {
            boxes[*index as usize] = b.collides();
        }
        let is_static = |index: u32| self.boxes.get(&index).is_some_and(|b| b.is_static);
        let truth = oracle::truth(&boxes).pairs.into_iter();
        let truth: Vec<Pair> =
            truth.filter(|(a, b)| !(is_static(*a) && is_static(*b))).map(|(a, b)| [a, b]).collect();
        assert!(self.pairs.iter().eq(&truth), "the model and the oracle differ");
    }
}

/// An edit that owns its arrays.
#[derive(Default)]
struct OwnedEdit {
    removed: Vec<u32>,
    set: BTreeMap<u32, Aabb>,
    switched: Vec<(u32, bool)>,
    flagged: Vec<(u32, bool)>,
}

/// A box somewhere in a world of a size, seldom an odd one.
fn some_box(random: &mut Random, world: f32) -> Aabb {
    let edge = match random.below(40) {
        0 => 8.0,
        1 => 60.0,
        2 => 0.0,
        _ => 1.0,
    };
    let mut b = Aabb::from_center_half(
        [(); 3].map(|()| random.range(0.0, world)),
        [(); 3].map(|()| 0.5 * edge * random.range(0.5, 1.5)),
    );
    match random.below(160) {
        0 => b = Aabb::EMPTY,
        1 => b.min[random.below(3)] = f32::NAN,
        2 => b.max[random.below(3)] = f32::INFINITY,
        3 => b = Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] },
        4 => b = Aabb { min: [-0.0; 3], max: [0.0; 3] },
        5 => b = Aabb { min: [1e-45; 3], max: [2e-40; 3] },
        6 => {
            let axis = random.below(3);
            (b.min[axis], b.max[axis]) = (f32::MAX, f32::INFINITY);
        }
        7 => b = Aabb { min: b.max, max: b.min },
        _ => {}
    }
    b
}

fn jittered(b: &Aabb, random: &mut Random, by: f32) -> Aabb {
    let by = [(); 3].map(|()| random.range(-by, by));
    Aabb {
        min: std::array::from_fn(|axis| b.min[axis] + by[axis]),
        max: std::array::from_fn(|axis| b.max[axis] + by[axis]),
    }
}

/// How large the scene shall be in a while, and how large its world is.
struct Plan {
    target: usize,
    world: f32,
}

fn random_edit(model: &Model, plan: &Plan, random: &mut Random) -> OwnedEdit {
    let mut edit = OwnedEdit::default();
    let n = model.boxes.len();
    let indices: Vec<u32> = model.boxes.keys().copied().collect();
    let some_of = |random: &mut Random, most: usize| -> BTreeSet<u32> {
        let count = random.below(most.min(n) + 1);
        (0..count).map(|_| indices[random.below(n)]).collect()
    };
    // Towards the size that is wanted, in steps of all sizes.
    let step = random.below(plan.target.abs_diff(n) + 3);
    if n > plan.target {
        edit.removed.extend(some_of(random, step));
    } else if random.one_in(2) {
        let free = (0u32..).filter(|i| !model.boxes.contains_key(i));
        let skip = random.below(5);
        for index in free.skip(skip).take(step).collect::<Vec<_>>() {
            edit.set.insert(index, some_box(random, plan.world));
        }
    }
    let share = match random.below(12) {
        0 => n,
        1 => n / 5,
        2..4 => 0,
        _ => 4,
    };
    match random.below(4) {
        0 => {
            for index in some_of(random, share) {
                edit.set.insert(index, some_box(random, plan.world));
            }
        }
        1 if random.one_in(4) => {
            // The same boxes again: nothing moves.
            for index in some_of(random, share) {
                edit.set.insert(index, model.boxes[&index].b);
            }
        }
        _ => {
            let by = [0.02, 0.3, 1.5][random.below(3)];
            for index in some_of(random, share) {
                edit.set.insert(index, jittered(&model.boxes[&index].b, random, by));
            }
        }
    }
    if random.one_in(6) {
        // Removed and set anew in one edit; sometimes the very same box.
        for index in some_of(random, 3) {
            if !edit.removed.contains(&index) {
                edit.removed.push(index);
                let b = if random.one_in(2) {
                    model.boxes[&index].b
                } else {
                    some_box(random, plan.world)
                };
                edit.set.insert(index, b);
            }
        }
    }
    let removed: BTreeSet<u32> = edit.removed.iter().copied().collect();
    edit.set.retain(|index, _| !removed.contains(index) || !random.one_in(9));
    let stays = |index: &u32| !removed.contains(index) || edit.set.contains_key(index);
    if random.one_in(5) {
        let some: Vec<u32> = some_of(random, 4).into_iter().filter(stays).collect();
        edit.switched.extend(some.iter().map(|i| (*i, random.one_in(2))));
    }
    if random.one_in(5) {
        let most = if random.one_in(9) { n } else { 4 };
        let some: Vec<u32> = some_of(random, most).into_iter().filter(stays).collect();
        edit.flagged.extend(some.iter().map(|i| (*i, random.one_in(2))));
    }
    edit
}

impl OwnedEdit {
    fn apply_to(&self, model: &mut Model) -> BTreeSet<u32> {
        let mut changed = BTreeSet::new();
        let mut named = BTreeSet::new();
        for index in &self.removed {
            model.boxes.remove(index).expect("the edit removes boxes that there are");
            model.removed.insert(*index);
            changed.insert(*index);
        }
        for (index, b) in &self.set {
            let (on, is_static) =
                model.boxes.get(index).map_or((true, false), |old| (old.on, old.is_static));
            model.boxes.insert(*index, ModelBox::new(*b, on, is_static));
            named.insert(*index);
        }
        for (index, on) in &self.switched {
            let b = model.boxes.get_mut(index).expect("it has a box");
            *b = ModelBox::new(b.b, *on, b.is_static);
            named.insert(*index);
        }
        for (index, on) in &self.flagged {
            model.boxes.get_mut(index).expect("it has a box").is_static = *on;
            named.insert(*index);
        }
        changed.extend(&named);
        for index in &changed {
            model.renew(*index);
        }
        named
    }

    /// Calls `f` with the edit, its sets in one of the ways to name them.
    fn with<R>(&self, way: usize, f: impl FnOnce(Edit<'_>) -> R) -> R {
        let indices: Vec<u32> = self.set.keys().copied().collect();
        let boxes: Vec<Aabb> = self.set.values().copied().collect();
        let mut steps = Vec::new();
        let mut words = vec![0u32; indices.last().map_or(0, |last| *last as usize / 32 + 1)];
        for index in &indices {
            words[*index as usize / 32] |= 1 << (index % 32);
        }
        match way {
            0 => {
                let sets = Sets { indices: (&indices).into(), boxes: &boxes };
                steps.push(Step::Set(sets));
            }
            1 => {
                let indices = Indices::Mask { first: 0, words: &words };
                steps.push(Step::Set(Sets { indices, boxes: &boxes }));
            }
            _ => {
                for (index, b) in indices.iter().zip(&boxes) {
                    let indices = Indices::Range { first: *index, count: 1 };
                    steps.push(Step::Set(Sets { indices, boxes: std::slice::from_ref(b) }));
                }
            }
        }
        for (index, on) in &self.switched {
            let indices = Indices::List(std::slice::from_ref(index));
            steps.push(Step::Switch(indices, *on));
        }
        for (index, on) in &self.flagged {
            let indices = Indices::List(std::slice::from_ref(index));
            steps.push(Step::Static(indices, *on));
        }
        // Removals come first whatever their place.
        steps.push(Step::Remove((&self.removed).into()));
        f(Edit { steps: &steps })
    }
}

/// A fingerprint of all that an answer tells.
fn bytes_of(told: &Told) -> Vec<u8> {
    let pairs = told.begun().iter().chain(told.pairs()).flatten().flat_map(|i| i.to_le_bytes());
    let ended = told.ended().iter().flat_map(|ended| {
        let [a, b] = ended.pair.map(u32::to_le_bytes);
        a.into_iter().chain(b).chain([ended.reason as u8])
    });
    pairs.chain(ended).chain([u8::from(told.is_resync())]).collect()
}

/// Runs `edits` random edits of a seed. Answers are compared with the model's, and the scenes'
/// with each other byte by byte.
fn run(seed: u64, edits: usize, largest: usize, threads: &[usize]) {
    let random = &mut Random(seed);
    let mut model = Model::default();
    let options = |threads| {
        let mut options = SceneOptions::default();
        options.threads = Some(threads);
        options
    };
    let mut scenes: Vec<Scene> = threads.iter().map(|t| Scene::new(options(*t))).collect();
    let mut plan = Plan { target: 1, world: 4.0 };
    let mut lost = false;
    let mut seen = [0usize; 4];
    for edit_number in 0..edits {
        if random.one_in(60) {
            let target = match random.below(10) {
                0 => largest,
                1 => random.below(largest + 1),
                2 => 0,
                _ => random.below(71),
            };
            let density = [0.5f32, 2.0, 6.0, 40.0][random.below(4)];
            plan = Plan { target, world: (target as f32 * density).cbrt() + 0.5 };
        }
        let edit = random_edit(&model, &plan, random);
        let want =
            [Want::Changes, Want::Changes, Want::Changes, Want::Moved, Want::All, Want::Nothing]
                [random.below(6)];
        let is_taken = !random.one_in(4);
        let is_lost = random.one_in(200);
        let named = edit.apply_to(&mut model);
        let way = random.below(3);
        let mut first: Option<Vec<u8>> = None;
        lost |= is_lost;
        for (scene, threads) in scenes.iter_mut().zip(threads) {
            if is_lost {
                scene.lose();
            }
            let told = edit.with(way, |edit| {
                // The edit borrows its arrays for the call alone.
                scene.edit(edit, want).map(|_| ())
            });
            told.unwrap_or_else(|e| panic!("seed {seed}, edit {edit_number}: {e}"));
            let told = scene.told();
            model.check(told, &named, lost).unwrap_or_else(|e| {
                panic!("seed {seed}, edit {edit_number}, {threads} threads: {e}")
            });
            let bytes = bytes_of(told);
            assert_eq!(first.get_or_insert_with(|| bytes.clone()), &bytes, "bytes differ");
            assert_eq!(scene.len(), model.boxes.len());
        }
        seen[want as usize] += 1;
        if is_taken {
            if matches!(want, Want::Changes | Want::All) {
                lost = false;
            }
            model.take(scenes[0].told());
            scenes.iter_mut().for_each(Scene::take);
        }
        if edit_number % 97 == 0 {
            model.check_itself();
            for (index, b) in &model.boxes {
                let got = scenes[0].get(*index).expect("it has a box");
                assert_eq!(bytemuck::bytes_of(&got), bytemuck::bytes_of(&b.b), "box {index}");
            }
        }
    }
    assert!(edits < 100 || seen.iter().all(|count| *count > 0), "{seen:?}");
}

fn in_pool(work: impl FnOnce() + Send) {
    ThreadPoolBuilder::new().num_threads(3).build().expect("a pool").install(work);
}

#[test]
fn answers_are_those_of_the_model_on_every_number_of_threads() {
    in_pool(|| {
        for seed in 0..12 {
            run(seed, 400, 300, &[1, 2, 3]);
        }
        run(100, 150, 3_000, &[1, 3]);
    });
}

#[test]
#[ignore = "minutes: run in release, see the head of this file"]
fn a_million_edits_over_twenty_seeds() {
    in_pool(|| {
        for seed in 1_000..1_020 {
            run(seed, 50_000, 250, &[1, 3]);
        }
        for seed in 2_000..2_003 {
            run(seed, 1_500, 2_000, &[1, 2, 3]);
        }
    });
}

#[test]
fn a_scene_grows_and_shrinks() {
    grow_and_shrink(1, &[1, 10, 700, 7_000, 6_500, 64, 1]);
}

#[test]
#[ignore = "minutes: run in release, see the head of this file"]
fn a_scene_grows_to_a_hundred_thousand_boxes_and_back() {
    grow_and_shrink(3, &[1, 10, 700, 20_000, 100_000, 99_000, 3_000, 64, 1]);
}

/// What is told adds up to the pairs of a fresh scene, and of the oracle where that is not too slow.
fn grow_and_shrink(seeds: u64, sizes: &[usize]) {
    in_pool(|| {
        for seed in 0..seeds {
            let random = &mut Random(seed);
            let (mut scene, mut told) = (Scene::new(SceneOptions::default()), BTreeSet::new());
            let mut boxes: Vec<Aabb> = Vec::new();
            for &target in sizes {
                for round in 0..6 {
                    let removed: Vec<u32> =
                        (target.min(boxes.len()) as u32..boxes.len() as u32).collect();
                    boxes.truncate(target);
                    let mut indices = Vec::new();
                    let mut set = Vec::new();
                    for index in 0..target {
                        let moves = random.one_in([3, 50, 1_000][round % 3]);
                        if index >= boxes.len() {
                            // Few odd ones: each plane without end is a pair with all others.
                            let world = (4.0 * target as f32).cbrt();
                            let plain = [(); 3].map(|()| random.range(0.0, world));
                            boxes.push(if random.one_in(1_000) {
                                some_box(random, world)
                            } else {
                                Aabb::from_center_half(plain, [0.5; 3])
                            });
                        } else if moves {
                            boxes[index] = jittered(&boxes[index], random, 0.4);
                        } else {
                            continue;
                        }
                        indices.push(index as u32);
                        set.push(boxes[index]);
                    }
                    let steps = [
                        Step::Remove((&removed).into()),
                        Step::Set(Sets { indices: (&indices).into(), boxes: &set }),
                    ];
                    scene.edit(Edit { steps: &steps }, Want::Changes).expect("an answer");
                    let answer = scene.told();
                    if answer.is_resync() {
                        told = answer.pairs().iter().copied().collect();
                    }
                    answer.ended().iter().for_each(|ended| assert!(told.remove(&ended.pair)));
                    answer.begun().iter().for_each(|begun| assert!(told.insert(*begun)));
                    scene.take();
                }
                let mut fresh = Scene::new(SceneOptions::default());
                let steps = [Step::Set(Sets { indices: (0..target as u32).into(), boxes: &boxes })];
                let all = fresh.edit(Edit { steps: &steps }, Want::All).expect("an answer");
                assert!(told.iter().eq(all.pairs()), "seed {seed}, {target} boxes");
                if target <= 20_000 {
                    let truth = oracle::truth(&boxes).pairs;
                    assert!(truth.iter().map(|(a, b)| [*a, *b]).eq(told.iter().copied()));
                }
            }
        }
    });
}

/// A scene of three boxes in a row, each touching the next.
fn row() -> (Scene, Model) {
    let mut edit = OwnedEdit::default();
    for i in 0..3u32 {
        let x = 0.8 * i as f32;
        edit.set.insert(i, Aabb::from([x, 0.0, 0.0, x + 1.0, 1.0, 1.0]));
    }
    let mut options = SceneOptions::default();
    options.most_boxes = 100;
    let (mut scene, mut model) = (Scene::new(options), Model::default());
    edit.apply_to(&mut model);
    edit.with(0, |edit| scene.edit(edit, Want::Changes).map(|_| ())).expect("an answer");
    (scene, model)
}

#[test]
fn the_model_notices_a_broken_answer() {
    let (scene, mut model) = row();
    let none = BTreeSet::new();
    assert_eq!(model.check(scene.told(), &none, false), Ok(()));
    assert!(model.check(scene.told(), &none, true).is_err(), "a resync was due");
    model.pairs.insert([0, 2]);
    assert!(model.check(scene.told(), &none, false).is_err(), "a pair was missed");
    model.pairs.remove(&[0, 2]);
    model.pairs.remove(&[0, 1]);
    assert!(model.check(scene.told(), &none, false).is_err(), "a pair was added");
    model.pairs.insert([0, 1]);
    model.told.insert([0, 1]);
    assert!(model.check(scene.told(), &none, false).is_err(), "a pair was told twice");
    model.told.clear();
    model.told.insert([1, 7]);
    model.removed.insert(7);
    assert!(model.check(scene.told(), &none, false).is_err(), "an end was not told");
}

#[test]
#[should_panic(expected = "told twice")]
fn the_client_notices_what_is_told_twice() {
    let (scene, mut model) = row();
    model.take(scene.told());
    model.take(scene.told());
}

#[test]
fn a_wrong_edit_is_refused_and_changes_nothing() {
    let (mut scene, model) = row();
    let before = scene.told().begun().to_vec();
    let b = Aabb::EMPTY;
    let set = |indices, boxes| Step::Set(Sets { indices, boxes });
    let (one, two) = ([b], [b, b]);
    let beyond = |index| EditError::BeyondLimit { index, limit: 100 };
    let cases: [(&[Step<'_>], EditError); 12] = [
        (&[set((&[100]).into(), &one)], beyond(100)),
        (&[Step::Remove((&[u32::MAX]).into())], beyond(u64::from(u32::MAX))),
        (&[set(Indices::Range { first: u32::MAX, count: 2 }, &two)], beyond(1 << 32)),
        (&[set((&[0, 1]).into(), &one)], EditError::Lengths { indices: 2, boxes: 1 }),
        (&[set((0..1).into(), &two)], EditError::Lengths { indices: 1, boxes: 2 }),
        (&[set((&[1, 1]).into(), &two)], EditError::SetTwice { index: 1 }),
        (&[set((&[1]).into(), &one), set((1..2).into(), &one)], EditError::SetTwice { index: 1 }),
        (&[Step::Remove((&[3]).into())], EditError::Absent { index: 3 }),
        (&[Step::Remove((&[1, 1]).into())], EditError::Absent { index: 1 }),
        (
            &[Step::Remove((&[1]).into()), Step::Switch((&[1]).into(), false)],
            EditError::Absent { index: 1 },
        ),
        (
            &[set((&[0]).into(), &one), Step::Static((&[50]).into(), true)],
            EditError::Absent { index: 50 },
        ),
        (
            &[set((&[9]).into(), &one), Step::Static((&[8]).into(), true)],
            EditError::Absent { index: 8 },
        ),
    ];
    for (steps, expected) in cases {
        let refused = scene.edit(Edit { steps }, Want::Changes).map(|_| ());
        assert_eq!(refused, Err(SceneError::Edit(expected)));
        assert_eq!((scene.len(), scene.get(9)), (3, None));
        assert_eq!(scene.told().begun(), before, "the last answer stays");
    }
    let told = scene.edit(Edit::NONE, Want::Changes).expect("an answer");
    assert_eq!(told.begun(), before, "it was not taken");
    assert_eq!(model.check(told, &BTreeSet::new(), false), Ok(()));
    scene.take();
    assert_eq!(scene.edit(Edit::NONE, Want::Changes).expect("an answer").begun(), [[0u32; 2]; 0]);
}

#[test]
fn scenes_of_every_small_size_are_told_and_ended() {
    for n in 0..=70u32 {
        let boxes: Vec<Aabb> = (0..n)
            .map(|i| {
                let [x, y] = [i % 7, i / 7].map(|x| 0.9 * x as f32);
                Aabb::from([x, y, 0.0, x + 1.0, y + 1.0, 1.0])
            })
            .collect();
        let mut scene = Scene::new(SceneOptions::default());
        let steps = [Step::Set(Sets { indices: (0..n).into(), boxes: &boxes })];
        let told = scene.edit(Edit { steps: &steps }, Want::Changes).expect("an answer");
        let truth: Vec<Pair> =
            oracle::truth(&boxes).pairs.into_iter().map(|(a, b)| [a, b]).collect();
        assert_eq!(told.begun(), truth, "{n} boxes");
        scene.take();
        let steps = [Step::Remove((0..n).into())];
        let told = scene.edit(Edit { steps: &steps }, Want::Changes).expect("an answer");
        let ended: Vec<Pair> = told.ended().iter().map(|ended| ended.pair).collect();
        assert_eq!(ended, truth, "{n} boxes");
        assert!(told.ended().iter().all(|ended| ended.reason == EndReason::Removed));
    }
}

#[test]
fn static_pairs_are_not_looked_for_and_the_meter_says_so() {
    let (mut scene, _) = row();
    scene.take();
    let steps = [Step::Static((0..2).into(), true)];
    let told = scene.edit(Edit { steps: &steps }, Want::Changes).expect("an answer");
    let ended = Ended { pair: [0, 1], reason: EndReason::Filtered };
    assert_eq!((told.ended(), told.pair_count()), (&[ended][..], Some(1)));
    assert_eq!((told.skipped().static_pairs, told.skipped().boxes), (1, 1));
    scene.take();
    let told = scene.edit(Edit::NONE, Want::Changes).expect("an answer");
    assert_eq!((told.skipped().static_pairs, told.skipped().unmoved_pairs), (1, 2));
    assert_eq!((told.skipped().boxes, told.skipped().tested), (3, 0));
}
