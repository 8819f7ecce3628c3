//! Queries on scenes in video memory beside every box against every query, and edits that queries come between.

use std::sync::Arc;

use pairmask::cast::{Hits, Ray, Shapes};
use pairmask_core::scene::{Cast, Indices, QueryError, QueryFilterData, Scene};
use pairmask_tests::gpu::scene_tools;
use pairmask_tests::prelude::*;
use pairmask_tests::queried::Queries;
use pairmask_tests::scene_model::{Bare, Kind, hold_without_rules, options, overlap};
use pairmask_tests::stress_scenes::Rng;
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

/// The copy that casts look at follows edits, and is read again after some without a cast.
#[test]
fn casts_follow_edits() {
    let tools = scene_tools(0, &EngineOptions::default());
    let boxes: Vec<Aabb> = (0..400).map(|index| at(index as f32)).collect();
    let mut gpu = scene_of(&tools, &boxes);
    let mut core = Scene::new(SceneOptions::default());
    core.edit(Edit { steps: &sets_all(&boxes) }, Report::Nothing).expect("an answer");
    // It hits all boxes; from 32 casts on there is a tree.
    let ray = [Ray::new([-9.0, 0.5, 0.5], [1.0, 0.0, 0.0])];
    let cast = Cast {
        shapes: Shapes::Rays(&ray),
        hits: Hits::All,
        filter_data: QueryFilterData::None,
        most_hits: 1 << 20,
    };
    let mut random = Rng::new(3);
    let mut found = [Vec::new(), Vec::new()];
    for round in 0..200 {
        let index = random.below(400);
        let one = Indices::Range { first: index, count: 1 };
        let moved = [at(random.below(900) as f32)];
        let (is_there, set) = (core.get(index).is_some(), sets(index..index + 1, &moved));
        let on = Step::Enable(one, random.below(2) == 0);
        let steps: &[Step<'_>] = match random.below(6) {
            0 if is_there => &[Step::Remove(one)],
            1 if is_there => &[Step::Remove(one), set, on],
            2 | 3 if is_there => &[on],
            4 => &[on, set],
            _ => &[set],
        };
        let edit = if random.below(30) == 0 { &sets_all(&boxes)[..] } else { steps };
        for _ in 0..if random.below(20) == 0 { 12 } else { 1 } {
            core.edit(Edit { steps: edit }, Report::Nothing).expect("right");
            gpu.edit(Edit { steps: edit }, Report::Nothing).expect("right");
            if edit.iter().any(|step| matches!(step, Step::Remove(_))) {
                break;
            }
        }
        core.cast(&cast, &mut found[0]).expect("hits");
        gpu.cast(&cast, &mut found[1]).expect("hits");
        assert!(found[0] == found[1], "round {round}: {steps:?}");
        assert!(found[0].len() > 200);
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
