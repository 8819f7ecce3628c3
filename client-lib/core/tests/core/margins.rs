//! Exact pairs from near ones: right regardless of the margins, and sound regardless of what another process says is near.

use std::collections::BTreeSet;

use pairmask_core::aabb::Aabb;
use pairmask_core::oracle;
use pairmask_core::precision::Margin;
use pairmask_core::scene::{
    Edit, ExactPairs, Indices, MarginedSets, Outgoing, Report, Reported, Scene, SceneCopy,
    SceneOptions, Sets, Step,
};
use proptest::prelude::*;

/// A scene of inflated boxes, the boxes of now, and their pairs.
struct Kept {
    scene: Scene,
    now: SceneCopy,
    pairs: ExactPairs,
    outgoing: Outgoing,
}

impl Kept {
    fn new(most_boxes: u32) -> Self {
        Self {
            scene: Scene::new(SceneOptions::default().with_threads(1)),
            now: SceneCopy::new(most_boxes),
            pairs: ExactPairs::default(),
            outgoing: Outgoing::default(),
        }
    }

    /// Sets boxes; what is to be sent of them.
    fn set(&mut self, indices: Indices<'_>, boxes: &[Aabb], margins: &[Margin], report: Report) {
        let sets = MarginedSets { indices, boxes, margins: margins.into() };
        sets.check().expect("a margin each");
        let steps = [sets.step()];
        let edit = Edit { steps: &steps };
        self.now.check(edit).expect("right");
        self.outgoing.clear();
        self.outgoing.choose(&sets, &self.now, (&self.scene).into(), false, Some(1));
        self.pairs.note(edit, &self.now, report);
        self.now.apply(edit);
    }

    /// Sends what is to be sent, and takes what the scene reports.
    fn send(&mut self) {
        let (indices, boxes) = (self.outgoing.indices(), self.outgoing.boxes());
        let steps = [Step::Set(Sets { indices, boxes })];
        let reported = self.scene.edit(Edit { steps: &steps }, Report::Changes).expect("right");
        if reported.is_resync() {
            self.pairs.resync_near(reported.pairs().iter().copied(), &self.now);
        } else {
            let ended = reported.ended().iter().map(|ended| ended.pair);
            self.pairs.change_near(reported.begun().iter().copied(), ended, &self.now);
        }
        self.scene.acknowledge();
    }

    fn all(&mut self) -> Vec<[u32; 2]> {
        self.pairs.note(Edit::NONE, &self.now, Report::All);
        reported_pairs(self.pairs.report(Report::All, &self.now, Some(1)))
    }
}

fn reported_pairs(reported: &Reported) -> Vec<[u32; 2]> {
    reported.pairs().to_vec()
}

fn a_box() -> impl Strategy<Value = Aabb> {
    let odd = prop_oneof![
        Just(Aabb::EMPTY),
        Just(Aabb { min: [f32::NAN; 3], max: [1.0; 3] }),
        Just(Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] }),
    ];
    let plain = (prop::array::uniform3(0.0f32..6.0), prop::array::uniform3(0.0f32..2.0))
        .prop_map(|(min, edges)| Aabb { min, max: std::array::from_fn(|x| min[x] + edges[x]) });
    prop_oneof![12 => plain, 1 => odd]
}

fn a_margin() -> impl Strategy<Value = Margin> {
    prop_oneof![Just(0.0f32), Just(1e-45), 0.0f32..0.5, 0.0f32..9.0, Just(f32::MAX)]
        .prop_map(|units| Margin::new(units).expect("not negative"))
}

/// Frames: a box and a margin for each index.
fn frames() -> impl Strategy<Value = Vec<Vec<(Aabb, Margin)>>> {
    (0usize..40).prop_flat_map(|n| {
        let frame = prop::collection::vec((a_box(), a_margin()), n);
        prop::collection::vec(frame, 1..8)
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn exact_pairs_are_the_oracles_and_near_ones_hold_them(frames in frames(), taken in any::<u8>()) {
        let mut kept = Kept::new(64);
        let mut known = BTreeSet::new();
        for (at, frame) in frames.iter().enumerate() {
            let (boxes, margins): (Vec<Aabb>, Vec<Margin>) = frame.iter().copied().unzip();
            kept.set((0..boxes.len() as u32).into(), &boxes, &margins, Report::Changes);
            kept.send();
            let Kept { pairs, now, .. } = &mut kept;
            let reported = pairs.report(Report::Changes, now, Some(1));
            prop_assert!(!reported.is_resync());
            if taken >> at & 1 == 1 {
                for ended in reported.ended() {
                    prop_assert!(known.remove(&ended.pair));
                }
                for pair in reported.begun() {
                    prop_assert!(known.insert(*pair));
                }
                pairs.acknowledge();
                let truth = oracle::truth(&boxes).pairs;
                prop_assert!(known.iter().copied().eq(truth));
            }
            prop_assert_eq!(kept.all(), oracle::truth(&boxes).pairs);
            let near = kept.scene.edit(Edit::NONE, Report::All).expect("right").pairs().to_vec();
            prop_assert!(kept.all().iter().all(|[a, b]| near.contains(&[*a, *b])));
        }
    }

    #[test]
    fn only_pairs_that_overlap_are_reported_whichever_another_process_lists(
        boxes in prop::collection::vec(a_box(), 0..30),
        lists in prop::collection::vec(
            (prop::collection::vec(prop::array::uniform2(0u32..40), 0..60),
             prop::collection::vec(prop::array::uniform2(any::<u32>()), 0..9),
             any::<bool>(), any::<bool>()),
            0..8,
        ),
    ) {
        let mut kept = Kept::new(64);
        let n = boxes.len() as u32;
        let margins = vec![Margin::new(0.3).expect("not negative"); boxes.len()];
        kept.set((0..n).into(), &boxes, &margins, Report::Changes);
        let truth = oracle::truth(&boxes).pairs;
        let mut known = BTreeSet::new();
        for (some, wild, resync, take) in &lists {
            let begun = some.iter().chain(wild).copied();
            let ended = some.iter().rev().skip(3).chain(wild).copied();
            let Kept { pairs, now, .. } = &mut kept;
            if *resync {
                pairs.resync_near(begun, now);
            } else {
                pairs.change_near(begun, ended, now);
            }
            let reported = pairs.report(Report::Changes, now, Some(1));
            prop_assert!(reported.begun().is_sorted_by(|low, high| low < high));
            let is_true = |pair: &[u32; 2]| truth.binary_search(pair).is_ok();
            prop_assert!(reported.begun().iter().all(is_true));
            if *take {
                for ended in reported.ended() {
                    prop_assert!(known.remove(&ended.pair));
                }
                for pair in reported.begun() {
                    prop_assert!(known.insert(*pair));
                }
                let count = reported.pair_count();
                pairs.acknowledge();
                prop_assert_eq!(count, Some(known.len() as u64));
            }
            let all = kept.all();
            prop_assert!(all.is_sorted_by(|low, high| low < high));
            prop_assert!(all.iter().all(|[a, b]| is_true(&[*a, *b])));
        }
        // An honest answer puts it right.
        kept.send();
        let near = kept.scene.edit(Edit::NONE, Report::All).expect("right").pairs().to_vec();
        let Kept { pairs, now, .. } = &mut kept;
        pairs.resync_near(near.iter().copied(), now);
        prop_assert_eq!(kept.all(), truth);
    }
}

#[test]
fn what_follows_each_other_is_sent_as_a_range_and_threads_choose_the_same() {
    let n = 70_001;
    let at = |i: usize, by: f32| {
        Aabb::new([2.0 * i as f32 + by, 0.0, 0.0], [2.0 * i as f32 + by + 1.0, 1.0, 1.0])
    };
    let margin = Margin::new(0.25).expect("not negative");
    let mut kept = Kept::new(1 << 20);
    let boxes: Vec<Aabb> = (0..n).map(|i| at(i, 0.0)).collect();
    let margins = vec![margin; n];
    kept.set((0..n as u32).into(), &boxes, &margins, Report::Changes);
    assert!(
        matches!(kept.outgoing.indices(), Indices::Range { first: 0, count } if count as usize == n)
    );
    kept.send();
    // One in three leaves its margin.
    let moved: Vec<Aabb> = (0..n).map(|i| at(i, if i % 3 == 1 { 0.5 } else { 0.1 })).collect();
    let list: Vec<u32> = (0..n as u32).collect();
    let words = vec![u32::MAX; n.div_ceil(32)];
    let whole = (n / 32) * 32;
    for (indices, count) in [
        (Indices::from(&list), n),
        ((0..n as u32).into(), n),
        (Indices::Mask { first: 0, words: &words[..whole / 32] }, whole),
    ] {
        let sets = MarginedSets { indices, boxes: &moved[..count], margins: margin.into() };
        for threads in [Some(1), None, Some(2)] {
            kept.outgoing.clear();
            kept.outgoing.choose(&sets, &kept.now, (&kept.scene).into(), false, threads);
            assert_eq!(kept.outgoing.len(), count.div_ceil(3) - usize::from(count % 3 == 1));
            kept.outgoing.indices().for_each(|at, index| {
                assert_eq!(index as usize % 3, 1);
                assert_eq!(kept.outgoing.boxes()[at], margin.inflate(&moved[index as usize]));
            });
        }
    }
}
