//! The GPU's grid with rules: the pairs that the oracle and the rules leave, world by world.

use std::sync::Arc;

use pairmask_core::dispatch::{Marks, WorldRange};
use pairmask_core::filters::{FilterData, Rules, World};
use pairmask_tests::filtered_frames::{FilteredFrame, KINDS};
use pairmask_tests::gpu;
use pairmask_tests::prelude::*;
use pairmaskd::execute::gpu::{EngineOptions, Grid, takes_worlds};

const ENCODINGS: [Encoding; 2] = [Encoding::Sparse, Encoding::List];

fn grid() -> Grid {
    // What no stage wrote must not show.
    gpu::grid(&EngineOptions { poison: Some(0x5a5a_0007), ..EngineOptions::default() })
}

struct Answer {
    pairs: Vec<Pair>,
    list: Vec<Pair>,
    ranges: Vec<WorldRange>,
}

fn found(grid: &mut Grid, boxes: &[Aabb], marks: &Arc<Marks>, encoding: Encoding) -> Answer {
    let (mut reply, mut ranges) = (HeapReply::new(), Vec::new());
    let report = grid.cull_ruled(BoxSlice::from(boxes), marks, encoding, &mut reply, &mut ranges);
    let report = report.expect("an answer");
    let n = BoxCount::new(boxes.len() as u32);
    let mask = MaskView::new(n, &report.shape, reply.words()).expect("a mask");
    mask.verify().expect("in order");
    let mut pairs = mask.to_vec();
    assert_eq!(pairs.len() as u64, report.pair_count);
    let list = match encoding {
        Encoding::List => reply.words()[..2 * pairs.len()].as_chunks().0.to_vec(),
        _ => Vec::new(),
    };
    pairs.sort_unstable();
    Answer { pairs, list, ranges }
}

fn check_ranges(rules: &Rules, marks: &Marks, ranges: &[WorldRange], list: &[[u32; 2]]) {
    let worlds: Vec<World> = ranges.iter().map(|range| range.world).collect();
    assert_eq!(worlds, marks.worlds(), "each world once, rising");
    let mut next = 0;
    for range in ranges {
        assert_eq!(range.pairs.start, next, "side by side");
        next = range.pairs.end;
        for index in list[range.pairs.clone()].as_flattened() {
            assert_eq!(rules.filter_data(*index).world, range.world);
        }
    }
    assert!(ranges.is_empty() || next == list.len());
}

/// Giants, empties, crowds, infinities, folded levels: each world has its own.
#[test]
fn scenes_of_every_kind_in_several_worlds() {
    let mut grid = grid();
    for (scene, turn) in stress_scenes::ALL.iter().zip(0..) {
        for (n, worlds) in [(345, 1), (345, 2), (1_234, 13), (1_234, 150)] {
            let boxes = scene.boxes(n, turn);
            let mut rules = Rules::default();
            let world = |at: u32| World((at * 7 % worlds) as i32 * 3);
            rules.filter_data =
                (0..n).map(|at| FilterData::default().with_world(world(at))).collect();
            let marks = Arc::new(Marks::of(&rules, boxes.len(), 1).expect("worlds alone"));
            let mut expected = oracle::truth(&boxes).pairs;
            expected.retain(|[a, b]| rules.meet(*a, *b));
            let encoding = ENCODINGS[turn as usize % 2];
            let Answer { pairs, list, ranges } = found(&mut grid, &boxes, &marks, encoding);
            assert_eq!(pairs, expected, "{}, {n} boxes of {worlds} worlds", scene.name());
            if encoding == Encoding::List {
                check_ranges(&rules, &marks, &ranges, &list);
            }
        }
    }
}

#[test]
fn worlds_too_small_or_uneven_get_no_grid() {
    let marks = |world: &dyn Fn(usize) -> usize, n| {
        let mut rules = Rules::default();
        let filter_data = |at| FilterData::default().with_world(World(world(at) as i32));
        rules.filter_data = (0..n).map(filter_data).collect();
        Marks::of(&rules, n, 1).expect("worlds alone")
    };
    assert!(takes_worlds(&marks(&|at| at / 8, 800), 800));
    assert!(!takes_worlds(&marks(&|at| at / 7, 700), 700), "seven boxes a world");
    let uneven = |at: usize| if at < 800 { 0 } else { at / 10 };
    assert!(!takes_worlds(&marks(&uneven, 1_000), 1_000), "most boxes of one of many worlds");
    assert!(takes_worlds(&marks(&|_| 5, 9), 9), "one world of any size");
}

#[test]
fn a_list_without_room_is_found_again_with_room_for_all() {
    let mut grid = grid();
    let mut rules = Rules::default();
    rules.filter_data =
        (0..400).map(|at| FilterData::default().with_world(World(at % 2))).collect();
    let boxes = vec![Aabb::new([0.0; 3], [1.0; 3]); 400];
    let marks = Arc::new(Marks::of(&rules, boxes.len(), 1).expect("worlds alone"));
    // Two pairs a box is what a first frame has room for.
    for encoding in [Encoding::List, Encoding::Sparse, Encoding::List] {
        let answer = found(&mut grid, &boxes, &marks, encoding);
        assert_eq!(answer.pairs.len(), 2 * (200 * 199 / 2));
        if encoding == Encoding::List {
            check_ranges(&rules, &marks, &answer.ranges, &answer.list);
        }
    }
}

/// Boxes of a world that all overlap are refused before they are tested, and the next frame is served.
#[test]
fn crowded_worlds_are_refused() {
    let mut grid = grid();
    let n = 280_000;
    let mut rules = Rules::default();
    rules.filter_data = (0..n).map(|at| FilterData::default().with_world(World(at % 2))).collect();
    let everywhere = Aabb::new([f32::NEG_INFINITY; 3], [f32::INFINITY; 3]);
    let mut boxes = vec![everywhere; n as usize];
    // The other world is an easy one.
    for (at, b) in boxes.iter_mut().enumerate().filter(|(at, _)| at % 2 == 0) {
        let x = at as f32;
        *b = Aabb::new([x, 0.0, 0.0], [x + 0.5, 0.5, 0.5]);
    }
    let marks = Arc::new(Marks::of(&rules, boxes.len(), 1).expect("worlds alone"));
    let (mut reply, mut ranges) = (HeapReply::new(), Vec::new());
    let list = Encoding::List;
    let crowded = grid.cull_ruled(BoxSlice::from(&boxes), &marks, list, &mut reply, &mut ranges);
    assert!(matches!(crowded, Err(CullError::TooCrowded { .. })), "{crowded:?}");
    let frame = FilteredFrame::drawn(1_235, KINDS[3], 5);
    let marks = Arc::new(Marks::of(&frame.rules, 1_235, 1).expect("worlds alone"));
    assert_eq!(found(&mut grid, &frame.boxes, &marks, list).pairs, frame.pairs);
}
