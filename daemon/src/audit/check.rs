//! Compares a window of a mask with the oracle.

use pairmask_core::oracle::{Corners, Pair};

use super::sphere_oracle;
use super::window::Window;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    pub pairs: u64,
    /// Pairs that overlap, may meet and are not in the mask.
    pub missed: u64,
    /// Pairs that are in the mask and do not overlap, or may not meet.
    pub extra: u64,
    pub first: Option<Pair>,
}

impl Outcome {
    /// Counts a pair: whether it `is` one, and whether the mask or the scene `said` so.
    pub(super) fn note(&mut self, is: bool, said: bool, pair: impl FnOnce() -> Pair) {
        self.pairs += 1;
        if is != said {
            self.missed += u64::from(is);
            self.extra += u64::from(said);
            self.first.get_or_insert_with(pair);
        }
    }
}

/// Compares every row of a window with every column after it. A pair is one that `may_meet`, beside the window's rules.
pub(super) fn check(window: &Window, may_meet: impl Fn(u32, u32) -> bool) -> Outcome {
    if window.spheres.is_empty() {
        let corners: Vec<Corners> = window.boxes.iter().map(Corners::of).collect();
        compare(window, &corners, Corners::overlap, may_meet)
    } else {
        compare(window, &window.spheres, sphere_oracle::overlap, may_meet)
    }
}

/// `objects` holds the objects of the rows, then those of the columns.
fn compare<T>(
    window: &Window,
    objects: &[T],
    overlap: impl Fn(&T, &T) -> bool,
    may_meet: impl Fn(u32, u32) -> bool,
) -> Outcome {
    let span = &window.span;
    let (rows, columns) = objects.split_at(span.rows.len().min(objects.len()));
    let mut outcome = Outcome::default();
    for (row, (position, one)) in span.rows.clone().zip(rows).enumerate() {
        for (column, (other_position, other)) in span.columns.clone().zip(columns).enumerate() {
            if other_position <= position {
                continue;
            }
            let pair = || window.pair(row, column);
            let is = overlap(one, other) && {
                let [a, b] = pair();
                window.meet(a, b) && may_meet(a, b)
            };
            outcome.note(is, window.has(row, column), pair);
        }
    }
    outcome
}

#[cfg(test)]
mod tests {
    // Rules are filled as users fill them.
    #![allow(clippy::field_reassign_with_default)]
    use std::sync::Arc;

    use bytemuck::Zeroable;
    use pairmask_core::dispatch::{CpuEngines, CullOptions, SphereEngines};
    use pairmask_core::engine::{CullReport, HeapReply};
    use pairmask_core::filters::{FilterData, Owner, Rules};
    use pairmask_core::objects::Objects;
    use pairmask_core::{BoxCount, BoxForm, Encoding, EncodingChoice, EngineChoice, EngineName};
    use pairmask_tests::{SphereCase, lose_a_pair, stress_scenes as scenes};
    use pairmask_wire::{Page, RulesLayout, RulesReader, SceneSections, SentRules, page_count};

    use super::*;
    use crate::audit::window::{Reach, Span2};
    use crate::scene::Random;

    type Sent = Option<Arc<SentRules>>;

    fn audit(
        objects: Objects<'_>,
        rules: Sent,
        span: Span2,
        report: &CullReport,
        reply: &[u32],
    ) -> Outcome {
        let mut window = Window::default();
        window.take_mask(objects.len() as u32, span, &report.shape, reply);
        window.take_objects(objects);
        window.rules = rules;
        check(&window, |_, _| true)
    }

    /// A mask passes, and does not with a pair less. Whether one was lost within the window.
    fn hold(
        objects: Objects<'_>,
        rules: &Sent,
        mut report: CullReport,
        reply: &[u32],
        random: &mut Random,
    ) -> bool {
        let n = objects.len() as u32;
        let reach = match objects {
            Objects::Boxes(_) => Reach::BOXES,
            Objects::Spheres(_) => Reach::SPHERES,
        };
        let span = Span2::draw(None, n, reach, random);
        let is_whole = span.rows.len() == n as usize;
        let right = audit(objects, rules.clone(), span.clone(), &report, reply);
        assert_eq!((right.missed, right.extra), (0, 0), "{n}, {span:?}");
        assert!(!is_whole || right.pairs == BoxCount::new(n).pair_count());
        let (before, mut words) = (report.pair_count, reply.to_vec());
        lose_a_pair(&mut words, &mut report);
        let spoilt = audit(objects, rules.clone(), span, &report, &words);
        assert!(!is_whole || spoilt.missed == before - report.pair_count, "{n}");
        assert_eq!(spoilt.extra, 0);
        spoilt.missed > 0
    }

    fn options(engine: EngineName, encoding: Encoding) -> CullOptions {
        CullOptions {
            engine: EngineChoice::Only(engine),
            encoding: EncodingChoice::Only(encoding),
            ..CullOptions::default()
        }
    }

    #[test]
    fn masks_of_boxes_pass_and_lost_pairs_are_found() {
        let (mut random, mut engines) = (Random::new(1), CpuEngines::new());
        let mut reply = HeapReply::new();
        let mut lost = 0;
        for n in [0u32, 1, 2, 31, 32, 33, 70, 345, 5_000] {
            for scene in scenes::ALL.iter().filter(|scene| n < 5_000 || scene.name() == "uniform") {
                let boxes = scene.boxes(n, 3);
                for engine in [EngineName::CpuBrute, EngineName::CpuGrid] {
                    for encoding in Encoding::ALL {
                        let options = options(engine, encoding);
                        let report =
                            engines.cull(&boxes, &options, &mut reply).expect("memory").report;
                        let objects = Objects::Boxes((&boxes).into());
                        let words = reply.words();
                        lost += usize::from(hold(objects, &None, report, words, &mut random));
                    }
                }
            }
        }
        assert!(lost > 50, "{lost} lost pairs were found");
    }

    /// A mask of pairs that rules part is right with them alone.
    #[test]
    fn masks_are_held_to_the_rules_of_their_frame() {
        let boxes = scenes::named("uniform").boxes(300, 3);
        let n = BoxCount::new(300);
        let mut rules = Rules::default();
        rules.filter_data =
            (0..300).map(|at| FilterData::default().with_owner(Owner(at % 3))).collect();
        let scene = SceneSections::first(BoxForm::F32, n);
        let layout = RulesLayout::of(&rules, n, scene.payload_bytes()).expect("no lists");
        let mut pages = vec![Page::zeroed(); page_count(layout.payload_bytes()) as usize];
        assert!(layout.write(&rules, &mut pages));
        let mut reader = RulesReader::default();
        let sent = reader.read(&layout.sections(), n, &pages).expect("as it was written");
        let (mut engines, mut reply, mut random) =
            (CpuEngines::new(), HeapReply::new(), Random::new(2));
        let span = Span2 { rows: 0..300, columns: 0..300 };
        for encoding in Encoding::ALL {
            let options = options(EngineName::CpuGrid, encoding);
            let all = engines.cull(&boxes, &options, &mut reply).expect("memory").report;
            let objects = Objects::Boxes((&boxes).into());
            let sent = Some(Arc::clone(sent));
            let outcome = audit(objects, sent.clone(), span.clone(), &all, reply.words());
            assert_eq!((outcome.missed, outcome.extra > 0), (0, true), "{encoding}");
            let done = engines.cull_filtered(&boxes, &rules, &options, &mut reply);
            let report = done.expect("memory").answer.report;
            assert!(hold(objects, &sent, report, reply.words(), &mut random), "{encoding}");
            let outcome = audit(objects, None, span.clone(), &report, reply.words());
            assert_eq!((outcome.missed > 0, outcome.extra), (true, 0), "{encoding}");
        }
    }

    #[test]
    fn spheres_are_held_to_their_own_oracle() {
        let (mut random, mut engines) = (Random::new(6), SphereEngines::new());
        let mut lost = 0;
        for seed in 0..60 {
            let SphereCase { spheres, .. } = SphereCase::new(seed);
            for encoding in Encoding::ALL {
                let encoding = EncodingChoice::Only(encoding);
                let options = CullOptions { encoding, ..CullOptions::default() };
                let mut reply = HeapReply::new();
                let report = engines.cull(&spheres, &options, &mut reply).expect("memory").report;
                let objects = Objects::Spheres(&spheres);
                lost += usize::from(hold(objects, &None, report, reply.words(), &mut random));
            }
        }
        assert!(lost > 50, "{lost} lost pairs were found");
    }

    /// Of one set, and of two: rows of the first, columns of the second.
    #[test]
    fn windows_of_large_frames_are_bounded_and_reach_everywhere() {
        let mut random = Random::new(4);
        for reach in [Reach::BOXES, Reach::SPHERES] {
            for (first, n) in [
                (None, 2_049),
                (None, 40_000),
                (None, u32::MAX),
                (Some(3_000), 3_001),
                (Some(10_000), 1_010_000),
                (Some(0), 5_000),
                (Some(5_000), 5_000),
            ] {
                let (mut low, mut high) = (u32::MAX, 0);
                for _ in 0..2_000 {
                    let span = Span2::draw(first.map(BoxCount::new), n, reach, &mut random);
                    assert!(span.rows.end <= first.unwrap_or(n) && span.columns.end <= n);
                    assert!(span.rows.is_empty() == (first == Some(0)));
                    assert_eq!(span.columns.start % 32, 0);
                    let tests = span.rows.len() as u64 * span.columns.len() as u64;
                    assert!(tests <= reach.tests, "{span:?}");
                    low = low.min(span.columns.start);
                    high = high.max(span.columns.end);
                }
                assert!(low <= first.unwrap_or(0) + n / 10 && high > n - n / 10, "{low} to {high}");
            }
        }
    }
}
