//! Queries on scenes in video memory beside every box against every query, and edits that queries come between.

use std::collections::BTreeMap;
use std::sync::Arc;

use pairmask_core::Aabb;
use pairmask_core::engine::CullError;
use pairmask_core::scene::{
    Edit, QueryError, QueryTags, Scene, SceneCopy, SceneOptions, Sets, Step, Want,
};
use pairmask_tests::gpu::open;
use pairmask_tests::scene_edits::{EditMaker, same_told};
use pairmask_tests::stress_scenes::{self, Rng};
use pairmask_tests::tier;
use pairmaskd::execute::gpu::{Checks, GpuScene, GridOptions, HostImport, SceneTools};

fn tools(options: &GridOptions) -> Arc<SceneTools> {
    SceneTools::new(&open(HostImport::IfPossible), options)
        .unwrap_or_else(|error| panic!("{error}"))
}

/// Whether a box holds a point, by its numbers.
fn is_solid(b: &Aabb) -> bool {
    b.min.iter().zip(&b.max).all(|(low, high)| low <= high)
}

/// Every box against every query.
fn expected<'b>(
    queries: &[Aabb],
    boxes: &(impl Iterator<Item = (u32, &'b Aabb)> + Clone),
) -> Vec<[u32; 2]> {
    let mut pairs = Vec::new();
    for (number, query) in queries.iter().enumerate().filter(|(_, query)| is_solid(query)) {
        for (index, b) in boxes.clone() {
            let overlaps =
                |axis: usize| query.min[axis] <= b.max[axis] && b.min[axis] <= query.max[axis];
            if is_solid(b) && (0..3).all(overlaps) {
                pairs.push([number as u32, index]);
            }
        }
    }
    pairs
}

/// Says where two lists of pairs differ.
fn same(got: &[[u32; 2]], expected: &[[u32; 2]]) -> Result<(), String> {
    let at = (0..got.len().max(expected.len())).find(|at| got.get(*at) != expected.get(*at));
    at.map_or(Ok(()), |at| Err(format!("pair {at}: {:?} for {:?}", got.get(at), expected.get(at))))
}

/// Queries of many kinds around boxes of a scene.
fn some_queries(random: &mut Rng, count: usize, boxes: &[Aabb]) -> Vec<Aabb> {
    const ALL: f32 = f32::INFINITY;
    let some_box = |random: &mut Rng| match boxes.len() {
        0 => Aabb { min: [0.0; 3], max: [1.0; 3] },
        n => boxes[random.below(n as u32) as usize],
    };
    let one = |random: &mut Rng| {
        let b = some_box(random);
        match random.below(24) {
            0 => Aabb::EMPTY,
            1 => Aabb { min: [f32::NAN, 0.0, 0.0], max: [1.0; 3] },
            2 => Aabb { min: [0.0, -ALL, -ALL], max: [ALL, f32::NAN, ALL] },
            3 => Aabb { min: [-ALL; 3], max: [ALL; 3] },
            4 => Aabb { min: [-ALL, b.min[1], b.min[2]], max: [ALL, b.max[1], b.max[2]] },
            5 => Aabb { min: [ALL; 3], max: [ALL; 3] },
            6 => Aabb { min: [-0.0; 3], max: [-0.0; 3] },
            7 => Aabb { min: [-3e38; 3], max: b.max },
            8 => Aabb { min: b.max, max: b.min },
            // Points: of a corner, and of a face from the other side.
            9 | 10 => Aabb { min: b.min, max: b.min },
            11 => Aabb { min: b.max, max: b.max },
            // Beside a box, by the least there is.
            12 => Aabb { min: b.max.map(f32::next_up), max: b.max.map(|x| x + 1.0) },
            13 => Aabb { min: b.max, max: b.max.map(|x| x + 1.0) },
            14 => Aabb { min: b.min.map(|x| x - 8.0), max: b.max.map(|x| x + 8.0) },
            15 => Aabb { min: [1e-45; 3], max: [2e-40; 3] },
            _ => {
                let shift = random.point().map(|x| 2.0 * x - 1.0);
                let moved = |x: [f32; 3]| std::array::from_fn(|axis| x[axis] + shift[axis]);
                Aabb { min: moved(b.min), max: moved(b.max) }
            }
        }
    };
    (0..count).map(|_| one(random)).collect()
}

/// Edits at random with queries between them: queries are right, and edits tell what they tell without.
fn run(tools: &Arc<SceneTools>, seed: u64, edits: usize, largest: usize) {
    let mut maker = EditMaker::new(seed, largest);
    let mut random = Rng::new(seed ^ 0x9e7);
    let options = SceneOptions::default();
    let (mut core, mut gpu) = (Scene::new(options), GpuScene::new(tools, options));
    let mut copy = SceneCopy::new(options.most_boxes);
    let mut found = vec![[7; 2]];
    for edit in 0..edits {
        let what = format!("seed {seed}, edit {edit}");
        let next = maker.next_edit();
        let wants = [Want::Changes, Want::Changes, Want::Moved, Want::All, Want::Nothing];
        let want = wants[maker.below(wants.len())];
        let way = maker.below(3);
        next.with(way, |edit| {
            copy.check(edit).expect("a right edit");
            copy.apply(edit);
            let expected = core.edit(edit, want).map(|_| ());
            assert_eq!(gpu.edit(edit, want).map(|_| ()), expected, "{what}");
        });
        for _ in 0..random.below(4) {
            let boxes: BTreeMap<u32, Aabb> = maker.boxes().clone();
            let count = match random.below(5) {
                0 => random.below(3),
                1 => random.below(largest as u32 + 1),
                // As few as are entries, the first time after an edit.
                2 | 3 => random.below(boxes.len() as u32 / 32 + 1),
                _ => random.below(71),
            };
            let values: Vec<Aabb> = boxes.values().copied().collect();
            let queries = some_queries(&mut random, count as usize, &values);
            gpu.query(&queries, QueryTags::None, &mut found)
                .unwrap_or_else(|e| panic!("{what}: {e}"));
            let is_on = |index| copy.kept(index).is_some_and(|kept| kept.is_on);
            let on = boxes.iter().map(|(i, b)| (*i, b)).filter(|(i, _)| is_on(*i));
            let on: Vec<(u32, &Aabb)> = on.collect();
            same(&found, &expected(&queries, &on.into_iter()))
                .unwrap_or_else(|e| panic!("{what}, {count} queries: {e}"));
            same_told(gpu.told(), core.told()).expect("the last answer stays");
        }
        same_told(gpu.told(), core.told()).unwrap_or_else(|e| panic!("{what}, {want:?}: {e}"));
        assert_eq!(gpu.len(), core.len(), "{what}");
        // The last answer can be taken after queries too.
        if !maker.one_in(4) {
            core.take();
            gpu.take();
        }
    }
}

#[test]
fn queries_between_edits_are_right_and_change_nothing_that_is_told() {
    let tools = tools(&GridOptions::default());
    for seed in 0..4 {
        run(&tools, seed, 120, 200);
    }
    run(&tools, 10, 20, 3_000);
}

#[test]
fn queries_are_the_same_with_checked_stages_and_poisoned_memory() {
    run(&tools(&GridOptions { checks: Checks::On, ..GridOptions::default() }), 40, 60, 300);
    for word in [0xa5a5_a5a5, u32::MAX] {
        let poisoned = tools(&GridOptions { poison: Some(word), ..GridOptions::default() });
        run(&poisoned, 41, 60, 300);
        run(&poisoned, 42, 20, 2_000);
    }
}

/// A scene of boxes with indices from 0 on.
fn scene_of(tools: &Arc<SceneTools>, boxes: &[Aabb]) -> GpuScene {
    let mut scene = GpuScene::new(tools, SceneOptions::default());
    let steps = [Step::Set(Sets { indices: (0..boxes.len() as u32).into(), boxes })];
    scene.edit(Edit { steps: &steps }, Want::Nothing).expect("an answer");
    scene
}

fn numbered(boxes: &[Aabb]) -> impl Iterator<Item = (u32, &Aabb)> + Clone {
    boxes.iter().enumerate().map(|(index, b)| (index as u32, b))
}

/// Asks a scene that was just edited in all ways: as few queries as are entries, then all in a grid that is built, and
/// that stands.
fn check_all_ways(scene: &mut GpuScene, boxes: &[Aabb], queries: &[Aabb], what: &str) {
    let few = &queries[..queries.len().min(boxes.len() / 32)];
    let mut found = Vec::new();
    for (turn, queries) in [few, queries, queries, few].into_iter().enumerate() {
        scene.query(queries, QueryTags::None, &mut found).expect("an answer");
        same(&found, &expected(queries, &numbered(boxes)))
            .unwrap_or_else(|e| panic!("{what}, {} queries, turn {turn}: {e}", queries.len()));
    }
}

#[test]
fn every_small_size_and_every_hard_scene_is_queried() {
    let tools = tools(&GridOptions::default());
    let mut found = Vec::new();
    let mut random = Rng::new(5);
    let uniform = stress_scenes::named("uniform");
    for n in tier::small_sizes() {
        let boxes = uniform.boxes(n, u64::from(n));
        let mut scene = scene_of(&tools, &boxes);
        for count in [0, 1, n as usize, 70 - n as usize] {
            let queries = some_queries(&mut random, count, &boxes);
            scene.query(&queries, QueryTags::None, &mut found).expect("an answer");
            same(&found, &expected(&queries, &numbered(&boxes)))
                .unwrap_or_else(|e| panic!("{n} boxes, {count} queries: {e}"));
        }
    }
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
    let tools = tools(&GridOptions::default());
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

#[test]
fn static_boxes_are_found_and_those_switched_off_and_removed_are_not() {
    let tools = tools(&GridOptions::default());
    let boxes = vec![Aabb { min: [0.0; 3], max: [1.0; 3] }; 5];
    let mut scene = scene_of(&tools, &boxes);
    let steps = [
        Step::Static((&[0, 1]).into(), true),
        Step::Switch((&[1, 2]).into(), false),
        Step::Remove((&[3]).into()),
    ];
    scene.edit(Edit { steps: &steps }, Want::Changes).expect("an answer");
    let mut found = vec![[9; 2]; 3];
    let tested =
        scene.query(&[Aabb { min: [1.0; 3], max: [2.0; 3] }; 2], QueryTags::None, &mut found);
    assert_eq!(found, [[0, 0], [0, 4], [1, 0], [1, 4]]);
    assert!(tested.expect("an answer") >= 4);
    let steps = [Step::Switch((&[0, 4]).into(), false)];
    scene.edit(Edit { steps: &steps }, Want::Changes).expect("an answer");
    assert_eq!(scene.query(&boxes, QueryTags::None, &mut found), Ok(0));
    assert!(found.is_empty());
    let mut none = GpuScene::new(&tools, SceneOptions::default());
    assert_eq!(none.query(&boxes, QueryTags::None, &mut found), Ok(0));
}

/// More pairs than may be are an error, and the next query is answered.
#[test]
fn queries_find_no_more_pairs_than_may_be() {
    let tools = tools(&GridOptions::default());
    let boxes = stress_scenes::named("uniform").boxes(2_000, 3);
    let right = expected(&boxes, &numbered(&boxes));
    let mut found = Vec::new();
    for queries in [&boxes[..50], &boxes[..]] {
        let mut scene = scene_of(&tools, &boxes);
        let count = right.iter().filter(|[query, _]| (*query as usize) < queries.len()).count();
        scene.limit_query_pairs(count as u64 - 1);
        for _ in 0..2 {
            let refused = scene.query(queries, QueryTags::None, &mut found);
            assert!(matches!(refused, Err(QueryError::Cull(CullError::Reserve(_)))), "{refused:?}");
            assert!(found.is_empty());
        }
        scene.limit_query_pairs(count as u64);
        scene.query(queries, QueryTags::None, &mut found).expect("an answer");
        same(&found, &right[..count]).unwrap_or_else(|e| panic!("{e}"));
    }
}

/// More queries than one submission takes.
#[test]
fn queries_of_several_submissions_are_numbered_on() {
    let tools = tools(&GridOptions::default());
    let boxes = stress_scenes::named("uniform").boxes(500, 3);
    let mut scene = scene_of(&tools, &boxes);
    let count = (1 << 18) + 300;
    let mut queries = vec![Aabb::EMPTY; count];
    for at in [0, 7, (1 << 18) - 1, 1 << 18, count - 1] {
        queries[at] = boxes[at % boxes.len()];
    }
    let mut found = Vec::new();
    scene.query(&queries, QueryTags::None, &mut found).expect("an answer");
    same(&found, &expected(&queries, &numbered(&boxes))).unwrap_or_else(|e| panic!("{e}"));
    assert!(found.len() >= 5);
}

#[test]
fn a_query_on_a_lost_device_is_an_error() {
    let tools = tools(&GridOptions::default());
    let boxes = stress_scenes::named("uniform").boxes(50, 3);
    let mut scene = scene_of(&tools, &boxes);
    let mut found = vec![[7; 2]];
    tools.gpu().destroy();
    let lost = scene.query(&boxes, QueryTags::None, &mut found);
    assert!(matches!(lost, Err(QueryError::Cull(CullError::DeviceLost { .. }))), "{lost:?}");
    assert!(found.is_empty());
}

#[test]
fn the_comparator_notices_what_differs() {
    let pairs = [[0, 1], [0, 2], [3, 0]];
    same(&pairs, &pairs).expect("the same");
    for other in [&pairs[..2], &[[0, 1], [0, 2], [3, 1]], &[[0, 2], [0, 1], [3, 0]], &[]] {
        assert!(same(other, &pairs).is_err() && same(&pairs, other).is_err());
    }
    let [low, high] =
        [Aabb { min: [0.0; 3], max: [1.0; 3] }, Aabb { min: [1.0; 3], max: [2.0; 3] }];
    let boxes = [low, high, Aabb::EMPTY];
    assert_eq!(expected(&[high, Aabb::EMPTY], &numbered(&boxes)), [[0, 0], [0, 1]]);
}
