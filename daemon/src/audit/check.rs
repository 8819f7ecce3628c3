//! Compares a window of a mask with the oracle.

use pairmask_core::oracle::{Corners, Pair};

use super::sphere_oracle;
use super::window::Window;

/// The result of a check.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Pairs compared.
    pub pairs: u64,
    /// Pairs that overlap, may meet and are not in the mask.
    pub missed: u64,
    /// Pairs that are in the mask and do not overlap, or may not meet.
    pub extra: u64,
    /// The first wrong pair.
    pub first: Option<Pair>,
}

/// Compares every row of a window with every column after it.
pub fn check(window: &Window) -> Outcome {
    check_by_rules(window, |_, _| true)
}

/// As [`check`], where a pair is one that `may_meet` besides.
pub(super) fn check_by_rules(window: &Window, may_meet: impl Fn(u32, u32) -> bool) -> Outcome {
    if window.spheres().is_empty() {
        let corners: Vec<Corners> = window.boxes().iter().map(Corners::of).collect();
        compare(window, &corners, Corners::overlap, may_meet)
    } else {
        compare(window, window.spheres(), sphere_oracle::overlap, may_meet)
    }
}

/// `objects` holds the objects of the rows, then those of the columns.
fn compare<T>(
    window: &Window,
    objects: &[T],
    overlap: impl Fn(&T, &T) -> bool,
    may_meet: impl Fn(u32, u32) -> bool,
) -> Outcome {
    let span = window.span();
    let (rows, columns) = objects.split_at(span.rows.len().min(objects.len()));
    let mut outcome = Outcome::default();
    for (row, (position, one)) in span.rows.clone().zip(rows).enumerate() {
        for (column, (other_position, other)) in span.columns.clone().zip(columns).enumerate() {
            if other_position <= position {
                continue;
            }
            outcome.pairs += 1;
            let is = overlap(one, other) && {
                let (a, b) = window.pair(row, column);
                window.meet(a, b) && may_meet(a, b)
            };
            let said = window.has(row, column);
            if is != said {
                outcome.missed += u64::from(is);
                outcome.extra += u64::from(said);
                outcome.first.get_or_insert_with(|| window.pair(row, column));
            }
        }
    }
    outcome
}

#[cfg(test)]
mod tests {
    // Rules are filled as users fill them.
    #![allow(clippy::field_reassign_with_default)]

    use std::collections::BTreeSet;
    use std::sync::Arc;

    use bytemuck::Zeroable;
    use pairmask_core::dispatch::{CpuEngines, CullOptions, SphereEngines};
    use pairmask_core::engine::{BruteForce, CullInput, CullReport, Engine, Grid, HeapReply};
    use pairmask_core::filters::{Owner, Rules, Tag};
    use pairmask_core::mask::{MaskShape, MaskView};
    use pairmask_core::objects::Objects;
    use pairmask_core::oracle::truth;
    use pairmask_core::{Aabb, BoxCount, BoxForm, Encoding, EncodingChoice};
    use pairmask_tests::{SphereCase, lose_a_pair, stress_scenes as scenes};
    use pairmask_wire::{Page, RulesLayout, RulesReader, ScenePlace, page_count};

    use super::super::window::{Reach, Span2};
    use super::*;
    use crate::scene::Random;

    fn frame(
        engine: &mut dyn Engine,
        boxes: &[Aabb],
        encoding: Encoding,
    ) -> (HeapReply, pairmask_core::engine::CullReport) {
        let mut reply = HeapReply::new();
        let report =
            engine.cull(&CullInput::boxes(boxes).encoding(encoding), &mut reply).expect("memory");
        (reply, report)
    }

    fn audit(boxes: &[Aabb], span: Span2, shape: &MaskShape, reply: &[u32]) -> Outcome {
        let mut window = Window::default();
        window.take_mask(boxes.len() as u32, span, shape, reply);
        window.take_objects(Objects::Boxes(boxes.into()));
        check(&window)
    }

    fn engines() -> [Box<dyn Engine>; 2] {
        [Box::new(BruteForce::new()), Box::new(Grid::new())]
    }

    /// A mask of pairs that rules part is right without them alone, and wrong with a pair less.
    #[test]
    fn masks_are_held_to_the_rules_of_their_frame() {
        let boxes = scenes::named("uniform").boxes(300, 3);
        let n = BoxCount::new(300);
        let mut rules = Rules::default();
        rules.tags = (0..300).map(|at| Tag::default().with_owner(Owner(at % 3))).collect();
        let scene = ScenePlace::first(BoxForm::F32, n);
        let layout = RulesLayout::of(&rules, n, scene.payload_bytes()).expect("no lists");
        let mut pages = vec![Page::zeroed(); page_count(layout.payload_bytes()) as usize];
        assert!(layout.write(&rules, &mut pages));
        let mut reader = RulesReader::default();
        let sent = reader.read(&layout.place(), n, &pages).expect("as it was written");
        for encoding in Encoding::ALL {
            let options =
                CullOptions { encoding: EncodingChoice::Only(encoding), ..CullOptions::default() };
            let (mut engines, mut reply) = (CpuEngines::new(), HeapReply::new());
            let all = engines.cull(&boxes, &options, &mut reply).expect("memory").report;
            let audit = |rules: bool, report: &CullReport, reply: &[u32]| {
                let mut window = Window::default();
                window.take_mask(
                    300,
                    Span2::draw(300, Reach::BOXES, &mut Random::new(1)),
                    &report.shape,
                    reply,
                );
                window.take_objects(Objects::Boxes((&boxes).into()));
                window.take_rules(rules.then(|| Arc::clone(sent)));
                check(&window)
            };
            let outcome = audit(true, &all, reply.words());
            assert_eq!((outcome.missed, outcome.extra > 0), (0, true), "{encoding}");
            let done = engines.cull_filtered(&boxes, &rules, &options, &mut reply);
            let mut report = done.expect("memory").answer.report;
            let outcome = audit(true, &report, reply.words());
            assert_eq!((outcome.missed, outcome.extra), (0, 0), "{encoding}");
            let outcome = audit(false, &report, reply.words());
            assert_eq!((outcome.missed > 0, outcome.extra), (true, 0), "{encoding}");
            let mut words = reply.words().to_vec();
            lose_a_pair(&mut words, &mut report);
            let outcome = audit(true, &report, &words);
            assert_eq!((outcome.missed, outcome.extra), (1, 0), "{encoding}");
        }
    }

    #[test]
    fn right_masks_pass_in_every_window() {
        let mut random = Random::new(1);
        for n in [0u32, 1, 2, 31, 32, 33, 70, 345] {
            for scene in scenes::ALL {
                let boxes = scene.boxes(n, 3);
                for mut engine in engines() {
                    for encoding in Encoding::ALL {
                        let (reply, report) = frame(engine.as_mut(), &boxes, encoding);
                        let below = |bound: u32, random: &mut Random| {
                            random.below(u64::from(bound) + 1) as u32
                        };
                        let (row, column) =
                            (below(n, &mut random), below(n, &mut random) / 32 * 32);
                        let part = Span2 { rows: row..n, columns: column..n };
                        for span in [Span2 { rows: 0..n, columns: 0..n }, part] {
                            let outcome = audit(&boxes, span, &report.shape, reply.words());
                            assert_eq!((outcome.missed, outcome.extra), (0, 0), "{scene:?}, {n}");
                        }
                        let whole = Span2::draw(n, Reach::BOXES, &mut random);
                        let outcome = audit(&boxes, whole, &report.shape, reply.words());
                        assert_eq!(outcome.pairs, BoxCount::new(n).pair_count());
                    }
                }
            }
        }
    }

    #[test]
    fn a_pair_that_is_lost_or_made_up_is_found() {
        let boxes = scenes::named("clustered").boxes(345, 1);
        let all = truth(&boxes).pairs;
        for mut engine in engines() {
            for encoding in Encoding::ALL {
                let (mut reply, mut report) = frame(engine.as_mut(), &boxes, encoding);
                let mut words = reply.words().to_vec();
                lose_a_pair(&mut words, &mut report);
                let n = BoxCount::new(345);
                let view = MaskView::new(n, &report.shape, &words).expect("a mask");
                let left: BTreeSet<_> = view.pairs().collect();
                let lost: Vec<_> = all.iter().filter(|pair| !left.contains(pair)).collect();
                assert_eq!(lost.len(), 1);
                let span = Span2 { rows: 0..345, columns: 0..345 };
                let outcome = audit(&boxes, span.clone(), &report.shape, &words);
                assert_eq!((outcome.missed, outcome.extra), (1, 0));
                assert_eq!(outcome.first.as_ref(), Some(lost[0]));

                // The same mask, with one box moved away.
                let mut moved = boxes.clone();
                moved[lost[0].0 as usize] = Aabb::EMPTY;
                let (_, right) = frame(engine.as_mut(), &boxes, encoding);
                let reserved = reply.words().len();
                reply.fill(0);
                assert!(reserved > 0 && right.pair_count > 0);
                let outcome = audit(&moved, span, &report.shape, &words);
                assert!(outcome.extra > 0 && outcome.missed == 0, "{outcome:?}");
            }
        }
    }

    #[test]
    fn windows_of_large_frames_are_bounded_and_reach_everywhere() {
        let mut random = Random::new(4);
        for reach in [Reach::BOXES, Reach::SPHERES] {
            for n in [2_049, 5_000, 40_000, 1_000_000, u32::MAX] {
                let (mut low, mut high) = (u32::MAX, 0);
                for _ in 0..2_000 {
                    let span = Span2::draw(n, reach, &mut random);
                    assert!(span.rows.end <= n && span.columns.end <= n && !span.rows.is_empty());
                    assert_eq!(span.columns.start % 32, 0);
                    let tests = span.rows.len() as u64 * span.columns.len() as u64;
                    assert!(tests <= reach.tests, "{span:?}");
                    low = low.min(span.rows.start);
                    high = high.max(span.columns.end);
                }
                assert!(low < n / 10 && high > n - n / 10, "{n}: {low} to {high}");
            }
        }
    }

    #[test]
    fn windows_of_two_large_sets_hold_rows_of_the_first_and_columns_of_the_second() {
        let mut random = Random::new(6);
        for (first, n) in [(1, 2_049), (3_000, 3_001), (10_000, 1_010_000), (40_000, 90_000)] {
            let (mut low, mut high) = (u32::MAX, 0);
            for _ in 0..2_000 {
                let first_set = BoxCount::new(first);
                let span = Span2::draw_between(first_set, n, Reach::BOXES, &mut random);
                assert!(!span.rows.is_empty() && span.rows.end <= first, "{span:?}");
                assert!(span.columns.end > first && span.columns.end <= n, "{span:?}");
                assert_eq!(span.columns.start % 32, 0);
                let tests = span.rows.len() as u64 * span.columns.len() as u64;
                assert!(tests <= Reach::BOXES.tests, "{span:?}");
                low = low.min(span.columns.start);
                high = high.max(span.columns.end);
            }
            assert!(low <= first + n / 10 && high > n - n / 10, "{n}: {low} to {high}");
        }
        // A set may be empty.
        for (first, n) in [(0, 5_000), (5_000, 5_000)] {
            let first_set = BoxCount::new(first);
            let span = Span2::draw_between(first_set, n, Reach::BOXES, &mut random);
            assert!(span.rows.end <= n && span.columns.end <= n, "{span:?}");
        }
    }

    #[test]
    fn large_frames_pass_in_windows_drawn_at_random() {
        let boxes = scenes::named("uniform").boxes(5_000, 1);
        let mut random = Random::new(5);
        let mut pairs = 0;
        for mut engine in engines() {
            for encoding in Encoding::ALL {
                let (reply, report) = frame(engine.as_mut(), &boxes, encoding);
                for _ in 0..3 {
                    let span = Span2::draw(5_000, Reach::BOXES, &mut random);
                    let outcome = audit(&boxes, span, &report.shape, reply.words());
                    assert_eq!((outcome.missed, outcome.extra), (0, 0));
                    pairs += outcome.pairs;
                }
            }
        }
        assert!(pairs > 1_000_000, "{pairs} pairs were compared");
    }

    #[test]
    fn spheres_are_held_to_their_own_oracle() {
        let mut random = Random::new(6);
        let mut engines = SphereEngines::new();
        let mut lost = 0;
        for seed in 0..60 {
            let SphereCase { spheres, .. } = SphereCase::new(seed);
            let n = spheres.len() as u32;
            for encoding in Encoding::ALL {
                let options = CullOptions {
                    encoding: EncodingChoice::Only(encoding),
                    ..CullOptions::default()
                };
                let mut reply = HeapReply::new();
                let mut report =
                    engines.cull(&spheres, &options, &mut reply).expect("memory").report;
                let mut words = reply.words().to_vec();
                let span = Span2::draw(n, Reach::SPHERES, &mut random);
                let whole = u64::from(n) <= 256;
                let audit = |shape: &MaskShape, words: &[u32]| {
                    let mut window = Window::default();
                    window.take_mask(n, span.clone(), shape, words);
                    window.take_objects(Objects::Spheres(&spheres));
                    check(&window)
                };
                let outcome = audit(&report.shape, &words);
                assert_eq!((outcome.missed, outcome.extra), (0, 0), "case {seed}");
                assert!(!whole || outcome.pairs == BoxCount::new(n).pair_count());
                let before = report.pair_count;
                lose_a_pair(&mut words, &mut report);
                let missed = audit(&report.shape, &words).missed;
                assert!(!whole || missed == before - report.pair_count, "case {seed}");
                lost += missed;
            }
        }
        assert!(lost > 50, "{lost} lost pairs were found");
    }
}
