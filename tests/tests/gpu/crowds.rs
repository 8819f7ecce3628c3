//! Boxes that crowd one cell and hardly overlap, which no list of pairs gives away. A software adapter ends the loops
//! of a thread early and says nothing, so that what it cannot finish has to be refused before.

use pairmask_core::engine::Grid as CpuGrid;
use pairmask_core::scene::{QueryError, Scene};
use pairmask_tests::gpu::{grid, scene_tools};
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::Heard;
use pairmask_tests::stress_scenes::Rng;
use pairmaskd::execute::gpu::{GpuScene, Grid, GridOptions};

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
    let mut gpu = grid(&GridOptions::default());
    for (n, is_answered) in [(FEW, true), (MANY, has_no_limit(&gpu))] {
        let boxes = needles(n);
        let input = CullInput::boxes(&boxes).encoding(Encoding::List);
        let (mut expected, mut got) = (HeapReply::new(), HeapReply::new());
        let of_cores = CpuGrid::new().cull(&input, &mut expected).expect("an answer");
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

/// A scene on the cores, and one on the GPU.
struct Both {
    core: Scene,
    gpu: GpuScene,
    has_no_limit: bool,
}

impl Both {
    fn new() -> Self {
        let tools = scene_tools(0, &GridOptions::default());
        Self {
            core: Scene::new(SceneOptions::default()),
            gpu: GpuScene::new(&tools, SceneOptions::default()),
            has_no_limit: tools.gpu().limits().thread_rounds == u32::MAX,
        }
    }

    /// Sets boxes from an index on; whether the GPU told what the cores tell. Else it refused.
    fn set(&mut self, first: u32, boxes: &[Aabb], report: Report) -> bool {
        let indices = first..first + boxes.len() as u32;
        let steps = [Step::Set(Sets { indices: indices.into(), boxes })];
        self.core.edit(Edit { steps: &steps }, report).expect("an answer");
        match self.gpu.edit(Edit { steps: &steps }, report) {
            Ok(_) => {
                assert!(Heard::from(self.gpu.reported()) == Heard::from(self.core.reported()));
                true
            }
            Err(SceneError::Cull(CullError::TooCrowded { .. })) => false,
            Err(error) => panic!("{error}"),
        }
    }
}

#[test]
fn a_scene_that_is_crowded_reports_what_the_cores_report_or_nothing() {
    let boxes = needles(MANY);
    let mut both = Both::new();
    assert!(both.set(0, &boxes[..FEW], Report::Changes));
    assert!(both.set(7, &boxes[FEW..FEW + 40], Report::Changes));
    let mut both = Both::new();
    assert_eq!(both.set(0, &boxes, Report::Changes), both.has_no_limit);
    // Few rows beside many, and one at a time.
    let mut both = Both::new();
    assert!(both.set(0, &boxes, Report::Nothing));
    assert_eq!(both.set(5, &boxes[..20_000], Report::Moved), both.has_no_limit);
}

#[test]
fn queries_of_a_crowd_find_what_the_cores_find_or_nothing() {
    let boxes = needles(MANY);
    let mut both = Both::new();
    assert!(both.set(0, &boxes, Report::Nothing));
    // As few as are entries; more, which the grid of all boxes answers; in the crowd all the same.
    for (count, is_answered) in [(50, true), (20_000, both.has_no_limit)] {
        let queries = needles(count);
        let mut found = Vec::new();
        match both.gpu.query(&queries, QueryTags::None, &mut found) {
            Ok(_) if is_answered => {
                for [query, index] in &found {
                    let (a, b) = (&queries[*query as usize], &boxes[*index as usize]);
                    assert!(a.overlaps(b), "query {query}, box {index}");
                }
                let all =
                    (0..count).map(|q| boxes.iter().filter(|b| queries[q].overlaps(b)).count());
                assert_eq!(found.len(), all.sum::<usize>(), "{count} queries");
            }
            Err(QueryError::Cull(CullError::TooCrowded { .. })) if !is_answered => {}
            answer => panic!("{count} queries: {answer:?}"),
        }
    }
}
