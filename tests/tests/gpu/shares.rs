//! A frame that several GPUs share has the bytes of one GPU, wherever the borders are.

use pairmask_core::engine::{CullInput, CullReport, Engine, HeapReply};
use pairmask_core::precision::Precision;
use pairmask_core::{Aabb, Bounds, Encoding};
use pairmask_tests::frame_memory::TestFrame;
use pairmask_tests::{gpu, oracle, stress_scenes};
use pairmaskd::execute::gpu::{Borders, Grid, GridOptions, HostImport, ShareWork, cull_shared};

const ENCODINGS: [Encoding; 2] = [Encoding::Sparse, Encoding::List];

/// Grids on devices of their own.
fn grids(count: usize) -> Vec<Grid> {
    let grid = |at| {
        // What no stage wrote must not show.
        let options = GridOptions { poison: Some(0x5a5a_0000 + at), ..GridOptions::default() };
        Grid::new(&gpu::open_at(at as usize, HostImport::IfPossible), &options).expect("a grid")
    };
    (0..count as u32).map(grid).collect()
}

/// Borders that were moved by this, which gives another place for each turn.
fn moved(gpus: usize, turn: u64) -> Borders {
    let mut borders = Borders::new(gpus);
    for step in 0..turn % 5 {
        let work = |at: u64| ShareWork {
            compared: (turn * 7 + at * 13 + step * 3) % 11 * 1_000,
            ..ShareWork::default()
        };
        borders.note(&(0..gpus as u64).map(work).collect::<Vec<_>>());
    }
    borders
}

/// Culls with one grid and with all, and compares. Returns what all found.
fn compare(
    grids: &mut [Grid],
    precision: &Precision,
    boxes: &[Aabb],
    encoding: Encoding,
    turn: u64,
) -> Result<u64, String> {
    let memory = TestFrame::on_heap(precision, boxes);
    let slice = memory.boxes.boxes();
    let input = CullInput::boxes(slice).encoding(encoding);
    let (mut one, mut all) = (HeapReply::new(), HeapReply::new());
    let expected = grids[0].cull(&input, &mut one).map_err(|error| error.to_string())?;
    let mut borders = moved(grids.len(), turn);
    let mut members: Vec<&mut Grid> = grids.iter_mut().collect();
    // A first frame may find more than there is room for, and is left to one; the second has room.
    let found = cull_shared(&mut members, &input, &mut borders, &mut all)
        .or_else(|_| cull_shared(&mut members, &input, &mut borders, &mut all))
        .map_err(|error| error.to_string())?;
    same(&expected, one.words(), &found, all.words())?;
    Ok(found.pair_count)
}

fn same(expected: &CullReport, one: &[u32], found: &CullReport, all: &[u32]) -> Result<(), String> {
    let facts = |report: &CullReport| (report.shape, report.census, report.pair_count);
    if facts(expected) != facts(found) || expected.skipped != found.skipped {
        return Err(format!("{expected:?} by one, {found:?} by all"));
    }
    let words = expected.shape.extent_words() as usize;
    let sections = expected.shape.spans();
    let is_same = sections.into_iter().all(|section| {
        let range = section.start as usize..(section.start + section.len) as usize;
        one[range.clone()] == all[range]
    });
    if is_same { Ok(()) } else { Err(format!("other bytes, of {words} words")) }
}

#[test]
fn shares_have_the_bytes_of_one_gpu() {
    let mut all = grids(4);
    for gpus in [1, 2, 4] {
        for (scene, turn) in stress_scenes::ALL.iter().zip(0..) {
            for n in [2, 33, 345, 1_234] {
                let boxes = scene.boxes(n, turn);
                let encoding = ENCODINGS[turn as usize % 2];
                let done = compare(&mut all[..gpus], &Precision::Exact, &boxes, encoding, turn);
                let pairs = done
                    .unwrap_or_else(|e| panic!("{}, {n} boxes, {gpus} GPUs: {e}", scene.name()));
                if n == 345 {
                    assert_eq!(pairs, oracle::truth(&boxes).pairs.len() as u64, "{}", scene.name());
                }
            }
        }
    }
}

#[test]
fn shares_of_narrow_boxes_and_large_scenes_have_the_bytes_of_one_gpu() {
    let mut all = grids(2);
    let boxes = stress_scenes::named("uniform").boxes(20_001, 5);
    let bounds = Bounds::around(&boxes);
    let precisions =
        [Precision::Exact, Precision::Q16(bounds), Precision::Q8(bounds), Precision::F16];
    for (precision, turn) in precisions.iter().zip(0..) {
        for encoding in ENCODINGS {
            compare(&mut all, precision, &boxes, encoding, turn).unwrap_or_else(|e| panic!("{e}"));
        }
    }
}

/// Boxes that end at a border, begin there and lie across it, where the border is known: a row of boxes
/// along the axis in whose order cells are.
#[test]
fn boxes_at_the_borders_are_found_once() {
    let mut all = grids(2);
    let one = |at: usize| {
        let z = (at / 3) as f32 * 0.5;
        let shift = [0.0, 0.5, -0.5][at % 3];
        Aabb::from([0.0, 0.0, z + shift, 1.0, 1.0, z + shift + 1.0])
    };
    let mut boxes: Vec<Aabb> = (0..900).map(one).collect();
    // Giants, empties and boxes without a number among them.
    boxes[100] = Aabb::from([-1e9, -1e9, -1e9, 1e9, 1e9, 1e9]);
    boxes[200] = Aabb::EMPTY;
    boxes[300].min[1] = f32::NAN;
    for turn in 0..25 {
        for encoding in ENCODINGS {
            let pairs = compare(&mut all, &Precision::Exact, &boxes, encoding, turn);
            let pairs = pairs.unwrap_or_else(|e| panic!("turn {turn}: {e}"));
            assert_eq!(pairs, oracle::truth(&boxes).pairs.len() as u64);
        }
    }
}

#[test]
fn the_comparison_can_fail() {
    let mut all = grids(1);
    let boxes = stress_scenes::named("uniform").boxes(70, 5);
    let mut reply = HeapReply::new();
    let input = CullInput::boxes(&boxes).encoding(Encoding::List);
    let report = all[0].cull(&input, &mut reply).expect("an answer");
    assert!(report.pair_count > 0, "or the test shows nothing");
    let mut spoiled = reply.words().to_vec();
    spoiled[0] ^= 1;
    assert!(same(&report, reply.words(), &report, reply.words()).is_ok());
    assert!(same(&report, reply.words(), &report, &spoiled).is_err());
    let other = CullReport { pair_count: report.pair_count + 1, ..report };
    assert!(same(&report, reply.words(), &other, reply.words()).is_err());
}

#[test]
fn a_lost_device_is_an_error_of_the_team_and_others_go_on() {
    let mut all = grids(2);
    let boxes = stress_scenes::named("uniform").boxes(2_000, 5);
    compare(&mut all, &Precision::Exact, &boxes, Encoding::List, 0).expect("shared");
    all[1].gpu().destroy();
    let (mut reply, mut borders) = (HeapReply::new(), Borders::new(2));
    let input = CullInput::boxes(&boxes).encoding(Encoding::List);
    let mut members: Vec<&mut Grid> = all.iter_mut().collect();
    let lost = cull_shared(&mut members, &input, &mut borders, &mut reply);
    assert!(matches!(lost, Err(pairmask_core::engine::CullError::DeviceLost { .. })), "{lost:?}");
    let report = all[0].cull(&input, &mut reply).expect("the other one");
    assert_eq!(report.pair_count, oracle::truth(&boxes).pairs.len() as u64);
}
