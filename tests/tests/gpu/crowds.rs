//! Boxes that crowd one cell and hardly overlap, which no list of pairs gives away. A software adapter ends the loops
//! of a thread early and says nothing, so that what it cannot finish has to be refused before.

use pairmask_core::scene::QueryError;
use pairmask_tests::gpu::{grid, scene_tools};
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::BesideCore;
use pairmask_tests::stress_scenes::Rng;
use pairmaskd::execute::gpu::{EngineOptions, GpuScene, Grid};

/// As many as a software adapter gets through in a cell, and more than it gets through.
const FEW: usize = 3_500;
const MANY: usize = 70_000;

/// Needles as long as a cell, along each axis in turn, all in one cell.
fn needles(n: usize) -> Vec<Aabb> {
    const LONG: f32 = 0.9;
    const THIN: f32 = 2e-5;
    let mut random = Rng::new(11);
    (0..n)
        .map(|i| {
            let mut min = random.point().map(|x| LONG * x);
            let mut max = min.map(|x| x + THIN);
            (min[i % 3], max[i % 3]) = (0.0, LONG);
            Aabb { min, max }
        })
        .collect()
}

/// Whether the adapter of the tests gets through crowds of any size.
fn has_no_limit(grid: &Grid) -> bool {
    grid.gpu().limits().thread_rounds == u32::MAX
}

fn sorted_pairs(words: &[u32]) -> Vec<[u32; 2]> {
    let mut pairs: Vec<[u32; 2]> = words.as_chunks().0.to_vec();
    pairs.sort_unstable();
    pairs
}

#[test]
fn a_crowd_is_answered_as_by_the_cores_or_refused() {
    let mut gpu = grid(&EngineOptions::default());
    for (n, is_answered) in [(FEW, true), (MANY, has_no_limit(&gpu))] {
        let boxes = needles(n);
        let input = CullInput::boxes(&boxes).encoding(Encoding::List);
        let (mut expected, mut got) = (HeapReply::new(), HeapReply::new());
        let of_cores =
            best_engine(EngineName::CpuGrid).cull(&input, &mut expected).expect("an answer");
        match gpu.cull(&input, &mut got) {
            Ok(report) if is_answered => {
                let pairs = |report: &CullReport, reply: &HeapReply| {
                    let MaskShape::List { pairs } = report.shape else { panic!("no list") };
                    sorted_pairs(pairs.of(reply.words()).expect("a list that was written"))
                };
                assert!(pairs(&report, &got) == pairs(&of_cores, &expected), "{n} needles");
            }
            Err(CullError::TooCrowded { .. }) if !is_answered => {}
            answer => panic!("{n} needles: {answer:?}"),
        }
    }
}

/// Whether a GPU reported what the cores report. Else it refused.
fn is_reported(both: &mut BesideCore, step: Step<'_>, report: Report) -> bool {
    match both.try_edit(&[step], report) {
        Err(SceneError::Cull(CullError::TooCrowded { .. })) => false,
        reported => {
            reported.expect("an answer");
            true
        }
    }
}

#[test]
fn a_scene_that_is_crowded_reports_what_the_cores_report_or_nothing() {
    let tools = scene_tools(0, &EngineOptions::default());
    let has_no_limit = tools.gpu().limits().thread_rounds == u32::MAX;
    let (boxes, both) = (needles(MANY), || BesideCore::new(std::slice::from_ref(&tools)));
    let mut few = both();
    assert!(is_reported(&mut few, sets(0..FEW as u32, &boxes[..FEW]), Report::Changes));
    assert!(is_reported(&mut few, sets(7..47, &boxes[FEW..FEW + 40]), Report::Changes));
    let all = sets(0..MANY as u32, &boxes);
    assert_eq!(is_reported(&mut both(), all, Report::Changes), has_no_limit);
    // Few rows beside many, and one at a time.
    let mut many = both();
    assert!(is_reported(&mut many, all, Report::Nothing));
    let some = sets(5..20_005, &boxes[..20_000]);
    assert_eq!(is_reported(&mut many, some, Report::Moved), has_no_limit);
}

#[test]
fn queries_of_a_crowd_find_what_the_cores_find_or_nothing() {
    let tools = scene_tools(0, &EngineOptions::default());
    let has_no_limit = tools.gpu().limits().thread_rounds == u32::MAX;
    let boxes = needles(MANY);
    let mut gpu = GpuScene::new(&tools, SceneOptions::default());
    gpu.edit(Edit { steps: &sets_all(&boxes) }, Report::Nothing).expect("an answer");
    // As few as are entries; more, which the grid of all boxes answers; in the crowd all the same.
    for (count, is_answered) in [(50, true), (20_000, has_no_limit)] {
        let queries = needles(count);
        let mut found = Vec::new();
        match gpu.query(&queries, QueryFilterData::None, &mut found) {
            Ok(_) if is_answered => {
                let all = (0..).zip(&queries).flat_map(|(query, a)| {
                    let met = (0..).zip(&boxes).filter(|(_, b)| a.overlaps(b));
                    met.map(move |(index, _)| [query, index])
                });
                assert!(all.eq(found), "{count} queries");
            }
            Err(QueryError::Cull(CullError::TooCrowded { .. })) if !is_answered => {}
            answer => panic!("{count} queries: {answer:?}"),
        }
    }
}
