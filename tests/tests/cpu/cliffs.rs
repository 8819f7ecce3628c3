//! Scenes that cells do not part, and few boxes far from all others: the pairs are right, and the comparisons, which are
//! counted and the same on every machine, few.

use std::collections::BTreeSet;

use pairmask_core::filters::{FilterData, FilterId, Owner, Rules, World};
use pairmask_core::scene::{Scene, between};
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::Received;
use pairmaskd::scene::{Random, Scene as Boxes, SceneName};

const N: u32 = 20_000;
const SEED: u64 = 3;
/// Where boxes are flung to.
const FAR: f32 = 1e5;
/// Scenes that cells do not part.
const CROWDED: [&str; 2] = ["woven", "rods"];

/// Ordinary boxes of which one, or some, are replaced. The one is at an index at which the sample of the grid looks.
fn with_outliers(name: &str) -> Vec<Aabb> {
    let mut boxes = stress_scenes::named("uniform").boxes(N, SEED);
    let (requested, n) = (1_024, N as usize);
    let sampled = |i: usize| {
        let (start, end) = (i * n / requested, (i + 1) * n / requested);
        let hash = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 33;
        start + hash as usize % (end - start)
    };
    let half = f32::MAX / 2.0;
    let one = match name {
        "far below" => Aabb::new([-1e7; 3], [-1e7 + 1.0; 3]),
        "far beyond" => Aabb::new([1e9; 3], [2e9; 3]),
        "a half-space" => Aabb::new([-half; 3], [half, 0.0, half]),
        "swept far" => Aabb::new([50.0; 3], [1e13; 3]),
        _ => Aabb::EMPTY,
    };
    boxes[sampled(300)] = one;
    if name == "flung" {
        for (b, flung) in boxes.iter_mut().zip(stress_scenes::named("outliers").boxes(N, SEED)) {
            *b = if flung.min[0].abs() > 200.0 { flung } else { *b };
        }
    }
    boxes
}

const OUTLIERS: [&str; 6] =
    ["none", "far below", "far beyond", "a half-space", "swept far", "flung"];

fn compared(n: usize, report: &CullReport) -> u64 {
    BoxCount::of_len(n).expect("few").pair_count() - report.skipped.pairs
}

fn pairs_of(boxes: &[Aabb], engine: EngineChoice) -> (EngineName, u64, Vec<Pair>) {
    let options = CullOptions { engine, threads: Some(1), ..CullOptions::default() };
    let mut reply = HeapReply::new();
    let answer = CpuEngines::new().cull(boxes, &options, &mut reply).expect("memory");
    let n = boxes.len() as u32;
    let mut pairs = naive_decoder::decode(reply.words(), &answer.report.shape, n).expect("a mask");
    pairs.sort_unstable();
    (answer.engine, compared(boxes.len(), &answer.report), pairs)
}

#[test]
fn few_boxes_far_away_do_not_crowd_the_cells_of_all_others() {
    let grid = EngineChoice::Only(EngineName::CpuGrid);
    let (_, ordinary, _) = pairs_of(&with_outliers("none"), grid);
    for name in OUTLIERS {
        let boxes = with_outliers(name);
        let (_, tests, pairs) = pairs_of(&boxes, grid);
        let (_, _, swept) = pairs_of(&boxes, EngineChoice::Only(EngineName::CpuSap));
        assert!(pairs == swept, "{name}");
        // A box that covers the scene is compared with every box.
        assert!(tests < 2 * ordinary + 2 * u64::from(N), "{name}: {tests} tests, {ordinary}");
    }
}

/// A share of the boxes flung away, to places at any distance or through the floor.
#[test]
fn boxes_flung_away_by_the_thousand_are_parted_too() {
    let grid = EngineChoice::Only(EngineName::CpuGrid);
    let ordinary = Boxes::new(SceneName::Mixed, N as usize, SEED).boxes().to_vec();
    let (_, few, _) = pairs_of(&ordinary, grid);
    for share in [0.02, 0.1, 0.3] {
        for reach in [1e4, 1e6, 1e9, 1e30f32] {
            for axes in [[1.0; 3], [0.0, 0.0, 1.0]] {
                let mut random = Random::new(SEED);
                let mut boxes = ordinary.clone();
                for b in &mut boxes {
                    let to = [0, 1, 2].map(|axis| axes[axis] * reach * (random.unit() - 0.5));
                    if random.unit() < share {
                        b.min = [0, 1, 2].map(|axis| b.min[axis] + to[axis]);
                        b.max = [0, 1, 2].map(|axis| b.max[axis] + to[axis]);
                    }
                }
                let (_, tests, pairs) = pairs_of(&boxes, grid);
                let (_, _, swept) = pairs_of(&boxes, EngineChoice::Only(EngineName::CpuSap));
                let case = format!("{share} flung by {reach} along {axes:?}");
                assert!(pairs == swept, "{case}");
                assert!(tests < 2 * few, "{case}: {tests} tests, {few} before");
            }
        }
    }
}

/// One box in a thousand of the sample may be the only one of its size: it hands no frame over.
#[test]
fn a_giant_among_far_rows_leaves_them_to_the_cells() {
    let half = f32::MAX / 2.0;
    let at = |i: u32| {
        let (place, step) = ((i % 3) as f32 * 1e7, (i / 3) as f32);
        Aabb::new(
            [place + 0.5 * step, place, place],
            [place + 0.5 * step + 1.0, place + 1.0, place + 1.0],
        )
    };
    let mut boxes: Vec<Aabb> = (0..N).map(at).collect();
    let (_, ordinary, _) = pairs_of(&boxes, EngineChoice::Auto);
    for giant in 0..32u32 {
        boxes[(7 + 613 * giant) as usize] = Aabb::new([-half; 3], [half; 3]);
        let (engine, tests, pairs) = pairs_of(&boxes, EngineChoice::Auto);
        let (_, _, same) = pairs_of(&boxes, EngineChoice::Only(EngineName::CpuTree));
        assert!(pairs == same && engine != EngineName::CpuTree, "{engine}, {giant} giants");
        let giants = u64::from(giant) + 1;
        assert!(tests < 2 * ordinary + 2 * giants * u64::from(N), "{tests} tests, {ordinary}");
    }
}

#[test]
fn what_cells_do_not_part_is_handed_over_to_the_tree() {
    for name in CROWDED {
        let boxes = stress_scenes::named(name).boxes(N, SEED);
        let (engine, tests, pairs) = pairs_of(&boxes, EngineChoice::Auto);
        assert_eq!(engine, EngineName::CpuTree, "{name}");
        assert!(tests < 400 * u64::from(N), "{name}: {tests} tests");
        for forced in [EngineName::CpuGrid, EngineName::CpuSap] {
            let (engine, _, same) = pairs_of(&boxes, EngineChoice::Only(forced));
            assert!(engine == forced && same == pairs, "{name} on {forced}");
        }
    }
}

/// The test of pairs is laid out in the order of the engine that began the frame, and again in the tree's.
#[test]
fn filters_hold_in_frames_that_are_handed_over() {
    for name in CROWDED {
        let boxes = stress_scenes::named(name).boxes(N, SEED);
        let (_, _, mut expected) = pairs_of(&boxes, EngineChoice::Auto);
        // Boxes of one owner do not meet.
        let filter_data =
            |i: u32| FilterData::new(World::default(), Owner(1 + i % 3), FilterId::default());
        let mut rules = Rules::default();
        rules.filter_data = (0..N).map(filter_data).collect();
        expected.retain(|[a, b]| a % 3 != b % 3);
        let (mut engines, mut reply) = (CpuEngines::new(), HeapReply::new());
        for threads in [1, 2] {
            let options = CullOptions { threads: Some(threads), ..CullOptions::default() };
            let filtered = engines.cull_filtered(&boxes, &rules, &options, &mut reply);
            let answer = filtered.expect("memory").answer;
            assert_eq!(answer.engine, EngineName::CpuTree, "{name}");
            let shape = &answer.report.shape;
            let mut pairs = naive_decoder::decode(reply.words(), shape, N).expect("a mask");
            pairs.sort_unstable();
            assert!(pairs == expected && !pairs.is_empty(), "{name}, {threads} threads");
        }
    }
}

/// Holds the pairs of a scene, as its reports of changes add up, to those of its boxes, and what each of its edits tests
/// to some number for each box of the scene. One in three of the moving boxes may be flung away, or come back.
fn check_edits(name: &str, mut boxes: Vec<Aabb>, tests_a_box: u64, flings: bool) {
    let mut scene = Scene::new(SceneOptions::default().with_threads(1));
    let mut known = BTreeSet::<Pair>::new();
    for turn in 0..12u32 {
        let moved: Vec<u32> = (0..N).filter(|i| turn == 0 || i % 50 == turn).collect();
        let mut set = Vec::new();
        for index in &moved {
            let b = &mut boxes[*index as usize];
            let far = if b.min[0] < FAR / 2.0 { FAR } else { -FAR };
            let step = if flings && turn > 0 && index % 3 == 0 { far } else { 0.25 };
            for axis in 0..2 {
                b.min[axis] += step;
                b.max[axis] += step;
            }
            set.push(*b);
        }
        let steps = [sets(moved.as_slice(), &set)];
        let reported = scene.edit(Edit { steps: &steps }, Report::Changes).expect("an edit");
        Received::from(reported).teach(&mut known);
        let tested = reported.skipped().tested;
        // The first edits cull.
        let most = if turn < 3 { tests_a_box.max(1_000) } else { tests_a_box };
        assert!(tested < most * u64::from(N), "{name}, turn {turn}: {tested} tests");
        scene.acknowledge();
        let (_, _, expected) = pairs_of(&boxes, EngineChoice::Auto);
        assert!(known.iter().eq(&expected), "{name}, turn {turn}");
    }
}

#[test]
fn edits_of_crowded_scenes_cost_no_more_than_a_cull_and_report_each_change_once() {
    for name in CROWDED {
        check_edits(name, stress_scenes::named(name).boxes(N, SEED), 1_000, false);
    }
}

/// Boxes of many lengths in a plane or in space, some of which were flung away: to any place, or to others near them.
#[test]
fn edits_test_few_boxes_where_others_were_flung_away() {
    for height in [0.3f32, 70.0] {
        for (share, middle, reach) in [(0.0, 0.0, 0.0), (0.1, FAR, 1e3f32), (0.3, 0.0, 1e9)] {
            let mut random = Random::new(SEED);
            let boxes = (0..N).map(|_| {
                let edge = 10f32.powf(-2.0 * random.unit());
                let mut min = [70.0, 70.0, height].map(|side| side * random.unit());
                if random.unit() < share {
                    min = [0; 3].map(|_| middle + reach * (random.unit() - 0.5));
                }
                Aabb::new(min, min.map(|x| x + edge))
            });
            let name = format!("height {height}, {share} flung by {middle} and {reach}");
            let boxes: Vec<Aabb> = boxes.collect();
            check_edits(&name, boxes.clone(), 2, false);
            check_edits(&name, boxes, 64, true);
        }
    }
}

#[test]
fn queries_of_crowded_scenes_find_what_each_box_compared_with_each_finds() {
    for name in CROWDED {
        let boxes = stress_scenes::named(name).boxes(N, SEED);
        let queries = stress_scenes::named(name).boxes(3_000, SEED + 1);
        let mut scene = Scene::new(SceneOptions::default().with_threads(1));
        let steps = [sets(0..N, &boxes)];
        scene.edit(Edit { steps: &steps }, Report::Nothing).expect("an edit");
        let expected: Vec<Pair> = (0..)
            .zip(&queries)
            .flat_map(|(query, a)| {
                let met = (0..).zip(&boxes).filter(|(_, b)| a.overlaps(b));
                met.map(move |(index, _)| [query, index])
            })
            .collect();
        for asked in [300, 3_000] {
            let mut found = Vec::new();
            let tested = scene.query(&queries[..asked], QueryFilterData::None, &mut found);
            let of_asked = expected.partition_point(|[query, _]| *query < asked as u32);
            assert!(found == expected[..of_asked], "{name}, {asked} queries");
            assert!(tested.is_ok_and(|tested| tested <= 400 * u64::from(N)), "{name}");
            let most = u64::from(u32::MAX);
            between(&queries[..asked], &boxes, Some(1), most, &mut found).expect("memory");
            assert!(found == expected[..of_asked], "{name}, {asked} boxes against all");
        }
    }
}
