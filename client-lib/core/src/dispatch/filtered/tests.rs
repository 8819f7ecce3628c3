//! Frames with rules against all pairs, one by one, of the oracle and [`Rules::meet`].

// Rules are filled as users fill them.
#![allow(clippy::field_reassign_with_default)]

use super::*;
use crate::aabb::Aabb;
use crate::engine::{EngineChoice, EngineName, HeapReply};
use crate::filters::{Filter, FilterData, FilterId, FilterTable, Owner};
use crate::mask::MaskView;
use crate::oracle::{self, Truth};
pub(super) use crate::random::Random;
use crate::units::BoxCount;

impl Random {
    pub fn boxes(&mut self, n: usize) -> Vec<Aabb> {
        let side = (n as f64).cbrt().ceil() as u64 * 2 + 4;
        let mut corner = || [0; 3].map(|_| self.below(side * 16) as f32 / 16.0);
        let mut boxes: Vec<Aabb> =
            (0..n).map(|_| corner()).map(|low| Aabb::new(low, low.map(|x| x + 2.0))).collect();
        for (at, b) in boxes.iter_mut().enumerate() {
            match at % 37 {
                11 => *b = Aabb::EMPTY,
                23 => b.min[1] = f32::NAN,
                _ => {}
            }
        }
        boxes
    }
}

/// What kinds of rules a frame has.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kind {
    worlds: &'static [i32],
    filters: u64,
    lists: bool,
}

pub(super) const KINDS: [Kind; 11] = [
    Kind { worlds: &[0], filters: 0, lists: false },
    Kind { worlds: &[0], filters: 70, lists: false },
    Kind { worlds: &[0], filters: 15, lists: false },
    Kind { worlds: &[7, -1], filters: 12, lists: true },
    Kind { worlds: &[7, -1], filters: 70, lists: true },
    Kind { worlds: &[0, 1, 2], filters: 0, lists: false },
    Kind { worlds: &[3, -1, 9, 9, 9, -4], filters: 0, lists: false },
    Kind { worlds: &[3, 3, -1, 9, i32::MIN, i32::MAX], filters: 9, lists: true },
    Kind { worlds: &[0, 1, 1, 1, 1, 1, 1, 1, 1, 1], filters: 70, lists: false },
    Kind { worlds: &[0, 1, 1, 1, 1, 1, 1, 1, 1, 1], filters: 3, lists: true },
    Kind { worlds: &[-1], filters: 0, lists: true },
];

pub(super) fn rules(random: &mut Random, n: usize, kind: Kind) -> Rules {
    let mut rules = Rules::default();
    if kind.filters > 0 {
        let filters: Vec<Filter> = (0..kind.filters)
            .map(|_| {
                Filter::new(random.below(8), random.below(8) | 1)
                    .with_group(random.below(3) as i32 - 1)
                    .with_static(random.below(6) == 0)
                    .with_either(random.below(2) == 0)
            })
            .collect();
        rules.table = FilterTable::new(&filters).expect("few filters");
    }
    // The last boxes have no filter data, and some name a filter that is not in the table.
    let past = u64::from(random.below(2) == 0);
    for _ in 0..n - n / 9 {
        let world = World(kind.worlds[random.below(kind.worlds.len() as u64) as usize]);
        let mut filter_data = FilterData::default().with_world(world);
        if kind.filters > 0 {
            filter_data = FilterData::new(
                world,
                Owner(random.below(5) as u32),
                FilterId(random.below(kind.filters + past) as u16),
            )
            .with_static(random.below(7) == 0);
        }
        rules.filter_data.push(filter_data);
    }
    if kind.lists && n > 1 {
        for _ in 0..n {
            let pair = [0; 2].map(|_| random.below(n as u64) as u32);
            if random.below(2) == 0 {
                rules.lists.include(pair, true);
            } else {
                rules.lists.exclude(pair, true);
            }
        }
    }
    rules
}

fn truth(boxes: &[Aabb], rules: &Rules) -> Truth {
    let mut truth = oracle::truth(boxes);
    truth.pairs.retain(|[a, b]| rules.meet(*a, *b));
    truth
}

/// The pairs of an answer, sorted, and its census, after its other facts were checked.
fn answered(
    engines: &mut CpuEngines,
    boxes: &[Aabb],
    rules: &Rules,
    known: Option<NonZeroU64>,
    options: &CullOptions,
) -> Truth {
    let mut reply = HeapReply::new();
    let answer = engines.cull_filtered_known(boxes, rules, known, options, &mut reply);
    let answer = answer.expect("an answer");
    let report = answer.answer.report;
    let n = BoxCount::new(boxes.len() as u32);
    let mask = MaskView::new(n, &report.shape, reply.words()).expect("as it was written");
    let mut pairs = mask.to_vec();
    assert_eq!(report.pair_count, pairs.len() as u64);
    assert!(report.skipped.pairs <= n.pair_count());
    if let EncodingChoice::Only(encoding) = options.encoding {
        assert_eq!(report.shape.encoding(), encoding);
    }
    check_ranges(&answer, &pairs, boxes.len(), rules);
    pairs.sort_unstable();
    Truth { pairs, census: report.census }
}

/// Each pair stands in the range of its world, and ranges are side by side, by rising world.
fn check_ranges(answer: &FilteredAnswer<'_>, pairs: &[[u32; 2]], n: usize, rules: &Rules) {
    let Some(last) = answer.worlds.last() else { return };
    assert_eq!(last.pairs.end, pairs.len());
    let mut end = 0;
    for range in answer.worlds {
        assert_eq!(range.pairs.start, end);
        end = range.pairs.end;
        for [a, b] in &pairs[range.pairs.clone()] {
            let of = [*a, *b].map(|index| rules.filter_data(index).world);
            let world = if of[0] == World::ALL { of[1] } else { of[0] };
            assert_eq!(world, range.world, "{a} and {b}");
        }
    }
    assert!(answer.worlds.is_sorted_by(|a, b| a.world < b.world));
    for index in 0..n as u32 {
        assert!(answer.range_of(rules.filter_data(index).world).is_some());
    }
    assert_eq!(answer.range_of(World(123_456)), None);
}

fn options(engine: EngineChoice, encoding: EncodingChoice, threads: usize) -> CullOptions {
    CullOptions { engine, encoding, threads: Some(threads), ..CullOptions::default() }
}

/// The pairs of a mask of all that was filtered, sorted.
fn filtered(
    filter: &mut MaskFilter,
    boxes: &[Aabb],
    rules: &Rules,
    (engine, encoding, threads): (EngineName, Encoding, usize),
) -> Vec<[u32; 2]> {
    let options = options(EngineChoice::Only(engine), EncodingChoice::Only(encoding), threads);
    let mut reply = HeapReply::new();
    let answer = CpuEngines::new().cull(boxes, &options, &mut reply).expect("an answer");
    let (mut report, n) = (answer.report, BoxCount::new(boxes.len() as u32));
    let mut words = reply.words().to_vec();
    filter.filter(rules, n, &mut words, &mut report, threads).expect("as it was written");
    let mask = MaskView::new(n, &report.shape, &words).expect("a mask");
    mask.verify().expect("in order");
    let mut pairs = mask.to_vec();
    assert_eq!(pairs.len() as u64, report.pair_count);
    assert_eq!(report.skipped.zero_words, report.shape.zero_words(n));
    pairs.sort_unstable();
    pairs
}

fn check(random: &mut Random, engines: &mut CpuEngines, n: usize, threads: usize) {
    let mut filter = MaskFilter::default();
    for kind in KINDS {
        let boxes = random.boxes(n);
        let rules = rules(random, n, kind);
        let expected = truth(&boxes, &rules);
        let choices =
            EngineName::CPU.map(EngineChoice::Only).into_iter().chain([EngineChoice::Auto]);
        for engine in choices {
            let encodings = Encoding::ALL.map(EncodingChoice::Only);
            for encoding in encodings.into_iter().chain([EncodingChoice::Auto]) {
                let options = options(engine, encoding, threads);
                let answer = answered(engines, &boxes, &rules, None, &options);
                assert_eq!(answer, expected, "{n} boxes, {kind:?}, {options:?}");
            }
        }
        for engine in EngineName::CPU {
            for encoding in Encoding::ALL {
                let found = filtered(&mut filter, &boxes, &rules, (engine, encoding, threads));
                assert_eq!(found, expected.pairs, "{n} boxes, {kind:?}, {engine} {encoding}");
            }
        }
    }
}

pub(super) fn in_pool(threads: usize, work: impl FnOnce() + Send) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    pool.install(work);
}

#[test]
fn frames_of_all_sizes_and_threads_have_the_pairs_that_rules_let_meet() {
    let (mut random, mut engines) = (Random(41), CpuEngines::new());
    for n in 0..=70 {
        check(&mut random, &mut engines, n, 1);
    }
    for threads in 1..=3 {
        in_pool(threads, || {
            let (mut random, mut engines) = (Random(43), CpuEngines::new());
            for n in [345, 1_234, 4_097, 5_001] {
                check(&mut random, &mut engines, n, threads);
            }
        });
    }
}

#[test]
fn a_rule_that_is_ignored_is_noticed() {
    let (mut random, mut engines) = (Random(45), CpuEngines::new());
    for kind in &KINDS[1..7] {
        let boxes = random.boxes(600);
        let rules = rules(&mut random, 600, *kind);
        let ignored =
            answered(&mut engines, &boxes, &Rules::default(), None, &CullOptions::default());
        assert_ne!(ignored, truth(&boxes, &rules), "{kind:?}");
    }
}

#[test]
fn many_worlds_give_the_same_bytes_on_all_thread_counts() {
    let mut random = Random(47);
    let boxes = random.boxes(6_000);
    let mut rules = Rules::default();
    // Some worlds are runs of indices, others are mixed; one is much larger than the others.
    rules.filter_data = (0..6_000)
        .map(|at| match at {
            0..2_000 => at / 25,
            2_000..4_000 => 100 + random.below(60) as i32,
            4_000..4_010 => -1,
            _ => 500,
        })
        .map(|world| FilterData::default().with_world(World(world)))
        .collect();
    let mut first: Option<Vec<u32>> = None;
    for threads in [1, 2, 3, 5] {
        in_pool(threads, || {
            let (mut engines, mut reply) = (CpuEngines::new(), HeapReply::new());
            let options = options(EngineChoice::Auto, EncodingChoice::Auto, threads);
            for _ in 0..2 {
                engines.cull_filtered(&boxes, &rules, &options, &mut reply).expect("an answer");
                let words = first.get_or_insert_with(|| reply.words().to_vec());
                assert!(words == reply.words(), "{threads} threads");
            }
        });
    }
    let pairs = first.as_deref().unwrap_or_default().as_chunks().0;
    assert_eq!(oracle::pair_set_hash(pairs), 0x88B6_79CF_D030_8191);
}

#[test]
fn a_list_that_does_not_fit_becomes_a_smaller_mask_or_an_error() {
    let boxes = vec![Aabb::new([0.0; 3], [1.0; 3]); 200];
    let mut rules = Rules::default();
    rules.filter_data =
        (0..200).map(|at| FilterData::default().with_world(World(at / 100))).collect();
    let mut reply = HeapReply::with_limit_bytes(8_000);
    let mut engines = CpuEngines::new();
    let answer =
        engines.cull_filtered(&boxes, &rules, &CullOptions::default(), &mut reply).expect("dense");
    assert_eq!(answer.answer.report.shape.encoding(), Encoding::Dense);
    assert_eq!(answer.answer.report.pair_count, 2 * 4_950);
    assert!(answer.worlds.is_empty());
    let list = options(EngineChoice::Auto, EncodingChoice::Only(Encoding::List), 1);
    let refused = engines.cull_filtered(&boxes, &rules, &list, &mut reply);
    assert!(matches!(refused, Err(CullError::Reserve(_))));
    let gpu = EngineName::ALL.into_iter().find(|engine| engine.is_gpu()).expect("one");
    let on_gpu = options(EngineChoice::Only(gpu), EncodingChoice::Auto, 1);
    let refused = engines.cull_filtered(&boxes, &rules, &on_gpu, &mut reply);
    assert!(matches!(refused, Err(CullError::Unavailable { .. })));
}

#[test]
fn scratch_of_many_worlds_is_given_back() {
    let (mut random, mut engines) = (Random(49), CpuEngines::new());
    let boxes = random.boxes(5_000);
    let rules = rules(&mut random, 5_000, KINDS[7]);
    answered(&mut engines, &boxes, &rules, None, &CullOptions::default());
    assert!(engines.scratch_bytes() > 0);
    engines.give_back();
    assert_eq!(engines.scratch_bytes(), CpuEngines::new().scratch_bytes());
}

#[test]
fn rules_of_a_known_number_are_looked_at_once_and_others_anew() {
    let mut random = Random(91);
    let mut engines = CpuEngines::new();
    let mut count = 0;
    let options = CullOptions::default();
    let mut check = |boxes: &[Aabb], rules: &Rules, number: u64| {
        let known = NonZeroU64::new(number);
        let found = answered(&mut engines, boxes, rules, known, &options);
        assert_eq!(found, truth(boxes, rules), "{} boxes, rules {number}", boxes.len());
        if number.is_multiple_of(3) {
            engines.give_back();
        }
    };
    for kind in KINDS {
        for n in [2, 70, 345] {
            let rules = rules(&mut random, n, kind);
            count += 1;
            // The boxes change and the rules do not, with a frame of rules without a number between.
            for number in [count, count, 0, count] {
                check(&random.boxes(n), &rules, number);
            }
            // The same rules for fewer boxes.
            check(&random.boxes(n - 1), &rules, count);
        }
    }
}

#[test]
fn rules_that_keep_the_number_of_others_are_not_looked_at() {
    let of_worlds = |worlds: [i32; 4]| {
        let mut rules = Rules::default();
        rules.filter_data =
            worlds.map(|world| FilterData::default().with_world(World(world))).to_vec();
        rules
    };
    let boxes = [Aabb::new([0.0; 3], [1.0; 3]); 4];
    let mut engines = CpuEngines::new();
    let mut pairs = |worlds, number| {
        let (mut reply, options) = (HeapReply::new(), CullOptions::default());
        let known = NonZeroU64::new(number);
        let rules = of_worlds(worlds);
        let done = engines.cull_filtered_known(&boxes, &rules, known, &options, &mut reply);
        done.expect("an answer").answer.report.pair_count
    };
    assert_eq!(pairs([1, 1, 2, 2], 7), 2);
    // What is known of the number is taken.
    assert_eq!(pairs([1, 1, 1, 2], 7), 2);
    assert_eq!(pairs([1, 1, 1, 2], 8), 3);
}
