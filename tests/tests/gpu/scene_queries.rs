//! Queries on scenes in video memory beside every box against every query, and edits that queries come between.

use std::sync::Arc;

use pairmask_core::scene::{QueryError, QueryFilterData};
use pairmask_tests::gpu::scene_tools;
use pairmask_tests::prelude::*;
use pairmask_tests::queried::Queries;
use pairmask_tests::scene_model::{Bare, Kind, hold_without_rules, options, overlap};
use pairmaskd::execute::gpu::{Checks, EngineOptions, GpuScene, SceneTools};

fn expected(queries: &[Aabb], boxes: &[Aabb]) -> Vec<[u32; 2]> {
    let pairs = (0..).zip(queries).flat_map(|(number, query)| {
        let met = (0..).zip(boxes).filter(|(_, b)| overlap(query, b));
        met.map(move |(index, _)| [number, index])
    });
    pairs.collect()
}

fn scene(options: &EngineOptions) -> GpuScene {
    GpuScene::new(&scene_tools(0, options), SceneOptions::default())
}

/// Queries between edits are right, with checked stages and in memory that held something else as well.
#[test]
fn queries_between_edits_are_right() {
    let poisoned = |word| EngineOptions { poison: Some(word), ..EngineOptions::default() };
    let checked = EngineOptions { checks: Checks::On, ..EngineOptions::default() };
    for (seed, options) in
        (0..).zip([EngineOptions::default(), checked, poisoned(0xa5a5_a5a5), poisoned(u32::MAX)])
    {
        let mut found = 0;
        // As few as are entries as well, the first time after an edit.
        for (largest, rounds) in [(200, 100), (3_000, 12)] {
            let (mut scene, mut queries) = (scene(&options), Queries::new(seed, largest, false));
            let counts = [1, 3, 70, 0, 200, 5].into_iter().cycle().take(rounds);
            found += counts.map(|count| queries.check(&mut scene, count)).sum::<usize>();
        }
        assert!(found > 1_000, "{found}");
    }
}

#[test]
fn queries_change_nothing_that_edits_report() {
    let tools = scene_tools(0, &EngineOptions::default());
    for (kind, edits) in [(Kind::Small, 300), (Kind::Large, 8)] {
        hold_without_rules(kind, 100_000, edits, |script| {
            Bare::asked(GpuScene::new(&tools, options(script)), 1)
        });
    }
}

/// A scene of boxes with indices from 0 on.
fn scene_of(tools: &Arc<SceneTools>, boxes: &[Aabb]) -> GpuScene {
    let mut scene = GpuScene::new(tools, SceneOptions::default());
    let steps = sets_all(boxes);
    scene.edit(Edit { steps: &steps }, Report::Nothing).expect("an answer");
    scene
}

/// Asks a scene that was just edited in all ways: as few queries as are entries, then all in a grid that is built, and
/// that stands.
fn check_all_ways(scene: &mut GpuScene, boxes: &[Aabb], queries: &[Aabb], what: &str) {
    let few = &queries[..queries.len().min(boxes.len() / 32)];
    let mut found = Vec::new();
    for (turn, queries) in [few, queries, queries, few].into_iter().enumerate() {
        scene.query(queries, QueryFilterData::None, &mut found).expect("an answer");
        let right = found == expected(queries, boxes);
        assert!(right, "{what}, {} queries, turn {turn}", queries.len());
    }
}

#[test]
fn every_hard_scene_is_queried() {
    let tools = scene_tools(0, &EngineOptions::default());
    for hard in stress_scenes::ALL {
        for (n, count) in [(345, 70), (1_234, 400), (70, 1_300)] {
            let boxes = hard.boxes(n, 21);
            let queries = hard.boxes(count, 22);
            let what = format!("{hard:?}, {n} boxes");
            check_all_ways(&mut scene_of(&tools, &boxes), &boxes, &queries, &what);
        }
    }
}

/// Many boxes around a point, points in few large boxes, large queries over many small boxes.
#[test]
fn sizes_that_differ_much_and_piles_are_queried() {
    let tools = scene_tools(0, &EngineOptions::default());
    let grid = |n: u32, step: f32, size: f32| -> Vec<Aabb> {
        let at = |i: u32| [i % 16, i / 16 % 16, i / 256].map(|x| step * x as f32);
        (0..n).map(|i| Aabb { min: at(i), max: at(i).map(|x| x + size) }).collect()
    };
    let pile = |n: usize| vec![Aabb { min: [3.0; 3], max: [4.0; 3] }; n];
    let cases = [
        ("points in large boxes", grid(2_000, 1.0, 40.0), grid(300, 1.01, 0.0)),
        ("large boxes around points", grid(2_000, 1.0, 0.0), grid(300, 1.01, 9.0)),
        ("a pile", pile(700), pile(300)),
        ("queries in a pile, boxes apart", grid(2_000, 1.0, 0.4), pile(900)),
        ("boxes in a pile, queries apart", pile(2_000), grid(900, 0.5, 0.4)),
        ("queries much larger than all", grid(3_000, 1.0, 0.9), grid(40, 1e-3, 1e9)),
    ];
    for (what, boxes, queries) in cases {
        let mut scene = scene_of(&tools, &boxes);
        // The second time with another layout and with room for all.
        for _ in 0..2 {
            check_all_ways(&mut scene, &boxes, &queries, what);
        }
    }
}

/// More pairs than may be are an error, and the next query is answered.
#[test]
fn queries_find_no_more_pairs_than_may_be() {
    let tools = scene_tools(0, &EngineOptions::default());
    let boxes = stress_scenes::named("uniform").boxes(2_000, 3);
    let right = expected(&boxes, &boxes);
    let mut found = Vec::new();
    for queries in [&boxes[..50], &boxes[..]] {
        let mut scene = scene_of(&tools, &boxes);
        let count = right.iter().filter(|[query, _]| (*query as usize) < queries.len()).count();
        scene.limit_query_pairs(count as u64 - 1);
        for _ in 0..2 {
            let refused = scene.query(queries, QueryFilterData::None, &mut found);
            assert!(matches!(refused, Err(QueryError::Cull(CullError::Reserve(_)))), "{refused:?}");
            assert!(found.is_empty());
        }
        scene.limit_query_pairs(count as u64);
        scene.query(queries, QueryFilterData::None, &mut found).expect("an answer");
        assert!(found == right[..count]);
    }
}

/// More queries than one submission takes.
#[test]
fn queries_of_several_submissions_are_numbered_on() {
    let tools = scene_tools(0, &EngineOptions::default());
    let boxes = stress_scenes::named("uniform").boxes(500, 3);
    let mut scene = scene_of(&tools, &boxes);
    let count = (1 << 18) + 300;
    let mut queries = vec![Aabb::EMPTY; count];
    for at in [0, 7, (1 << 18) - 1, 1 << 18, count - 1] {
        queries[at] = boxes[at % boxes.len()];
    }
    let mut found = Vec::new();
    scene.query(&queries, QueryFilterData::None, &mut found).expect("an answer");
    assert!(found == expected(&queries, &boxes));
    assert!(found.len() >= 5);
}

#[test]
fn a_query_on_a_lost_device_is_an_error() {
    let tools = scene_tools(0, &EngineOptions::default());
    let boxes = stress_scenes::named("uniform").boxes(50, 3);
    let mut scene = scene_of(&tools, &boxes);
    let mut found = vec![[7; 2]];
    tools.gpu().destroy();
    let lost = scene.query(&boxes, QueryFilterData::None, &mut found);
    assert!(matches!(lost, Err(QueryError::Cull(CullError::DeviceLost { .. }))), "{lost:?}");
    assert!(found.is_empty());
}
