//! Scenes that grow to many boxes and shrink, edits that are refused, and what an answer leaves out.
//!
//! Random edits are held to a model by the tests of the workspace. A hundred thousand boxes, in minutes, by
//!
//! ```text
//! cargo test --release -p pairmask-core --test core -- --ignored
//! ```

use std::collections::BTreeSet;

use pairmask_core::Aabb;
use pairmask_core::oracle;
use pairmask_core::scene::{
    Edit, EditError, EndReason, Ended, Indices, Report, Scene, SceneError, SceneOptions, Sets, Step,
};
use rayon::ThreadPoolBuilder;

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

fn in_pool(work: impl FnOnce() + Send) {
    ThreadPoolBuilder::new().num_threads(3).build().expect("a pool").install(work);
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

/// What is reported adds up to the pairs of a fresh scene, and of the oracle where that is not too slow.
fn grow_and_shrink(seeds: u64, sizes: &[usize]) {
    in_pool(|| {
        for seed in 0..seeds {
            let random = &mut Random(seed);
            let (mut scene, mut reported) = (Scene::new(SceneOptions::default()), BTreeSet::new());
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
                    scene.edit(Edit { steps: &steps }, Report::Changes).expect("an answer");
                    let answer = scene.reported();
                    if answer.is_resync() {
                        reported = answer.pairs().iter().copied().collect();
                    }
                    answer.ended().iter().for_each(|ended| assert!(reported.remove(&ended.pair)));
                    answer.begun().iter().for_each(|begun| assert!(reported.insert(*begun)));
                    scene.acknowledge();
                }
                for (index, b) in (0..).zip(&boxes) {
                    let kept = scene.get(index).expect("it has a box");
                    assert_eq!(bytemuck::bytes_of(&kept), bytemuck::bytes_of(b), "box {index}");
                }
                let mut fresh = Scene::new(SceneOptions::default());
                let steps = [Step::Set(Sets { indices: (0..target as u32).into(), boxes: &boxes })];
                let all = fresh.edit(Edit { steps: &steps }, Report::All).expect("an answer");
                assert!(reported.iter().eq(all.pairs()), "seed {seed}, {target} boxes");
                if target <= 20_000 {
                    let truth = oracle::truth(&boxes).pairs;
                    assert!(truth.iter().map(|[a, b]| [*a, *b]).eq(reported.iter().copied()));
                }
            }
        }
    });
}

/// A scene of three boxes in a row, each touching the next.
fn row() -> Scene {
    let boxes = [0.0, 0.8, 1.6].map(|x| Aabb::from([x, 0.0, 0.0, x + 1.0, 1.0, 1.0]));
    let mut scene = Scene::new(SceneOptions::default().with_most_boxes(100));
    let steps = [Step::Set(Sets { indices: (0..3).into(), boxes: &boxes })];
    scene.edit(Edit { steps: &steps }, Report::Changes).expect("an answer");
    scene
}

#[test]
fn a_wrong_edit_is_refused_and_changes_nothing() {
    let mut scene = row();
    let before = scene.reported().begun().to_vec();
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
            &[Step::Remove((&[1]).into()), Step::Enable((&[1]).into(), false)],
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
        let refused = scene.edit(Edit { steps }, Report::Changes).map(|_| ());
        assert_eq!(refused, Err(SceneError::Edit(expected)));
        assert_eq!((scene.len(), scene.get(9)), (3, None));
        assert_eq!(scene.reported().begun(), before, "the last answer stays");
    }
    let reported = scene.edit(Edit::NONE, Report::Changes).expect("an answer");
    assert_eq!(reported.begun(), before, "it was not taken");
    scene.acknowledge();
    assert_eq!(scene.edit(Edit::NONE, Report::Changes).expect("an answer").begun(), [[0u32; 2]; 0]);
}

#[test]
fn static_pairs_are_not_looked_for_and_the_meter_says_so() {
    let mut scene = row();
    scene.acknowledge();
    let steps = [Step::Static((0..2).into(), true)];
    let reported = scene.edit(Edit { steps: &steps }, Report::Changes).expect("an answer");
    let ended = Ended { pair: [0, 1], reason: EndReason::Filtered };
    assert_eq!((reported.ended(), reported.pair_count()), (&[ended][..], Some(1)));
    assert_eq!((reported.skipped().static_pairs, reported.skipped().boxes), (1, 1));
    scene.acknowledge();
    let reported = scene.edit(Edit::NONE, Report::Changes).expect("an answer");
    assert_eq!((reported.skipped().static_pairs, reported.skipped().unmoved_pairs), (1, 2));
    assert_eq!((reported.skipped().boxes, reported.skipped().tested), (3, 0));
}
