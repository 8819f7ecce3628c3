//! Devices and engine of the GPU tests.

use std::sync::Arc;
use std::time::Duration;

use pairmask_core::dispatch::{CpuEngines, CullAnswer};
use pairmask_core::engine::{CullInput, CullReport, Engine, HeapReply};
use pairmask_core::mask::MaskView;
use pairmask_core::oracle::Pair;
use pairmask_core::precision::BoxSlice;
use pairmask_core::{Aabb, BoxCount, Encoding, EngineName, Precision};
use pairmaskd::execute::gpu::{
    AllPairs, EngineOptions, Gpu, GpuChoice, Grid, HostImport, IfMissing, SceneTools,
};
use pairmaskd::execute::{CullUnderWay, Executor, GpuService, Owner};
use pairmaskd::precision::as_sent;

use crate::frame_memory::TestFrame;
use crate::frames::{Sorted, culled_by};

pub fn name() -> String {
    name_at(0)
}

/// The name of the device at a place of tests that need several: the GPUs that `PAIRMASK_TEST_GPU` lists in turn, by
/// default the software adapter, so that one adapter serves for all.
pub fn name_at(slot: usize) -> String {
    let names = std::env::var("PAIRMASK_TEST_GPU").unwrap_or_else(|_| "software".into());
    let count = names.split(',').count();
    names.split(',').nth(slot % count).unwrap_or_default().trim().to_owned()
}

pub fn choice() -> GpuChoice {
    choice_at(0)
}

pub fn choice_at(slot: usize) -> GpuChoice {
    name_at(slot).parse().unwrap_or_default()
}

pub fn open(host_import: HostImport) -> Arc<Gpu> {
    open_at(0, host_import)
}

pub fn open_at(slot: usize, host_import: HostImport) -> Arc<Gpu> {
    Gpu::open(&choice_at(slot), host_import)
        .unwrap_or_else(|error| panic!("the GPU tests need a Vulkan adapter: {error}"))
}

pub fn engine(options: EngineOptions) -> AllPairs {
    AllPairs::new(&open(HostImport::IfPossible), options).unwrap_or_else(|error| panic!("{error}"))
}

pub fn grid(options: &EngineOptions) -> Grid {
    Grid::new(&open(HostImport::IfPossible), options).unwrap_or_else(|error| panic!("{error}"))
}

pub fn scene_tools(slot: usize, options: &EngineOptions) -> Arc<SceneTools> {
    SceneTools::new(&open_at(slot, HostImport::IfPossible), options)
        .unwrap_or_else(|error| panic!("{error}"))
}

pub fn shared_tools(gpus: usize) -> Vec<Arc<SceneTools>> {
    let options = EngineOptions { shares_always: true, ..EngineOptions::default() };
    (0..gpus).map(|at| scene_tools(at, &options)).collect()
}

pub fn executor(gpus: usize) -> Executor {
    let missing = IfMissing::Report(Arc::new(|error| panic!("a Vulkan adapter: {error}")));
    let open = |slot| GpuService::opening(&choice_at(slot), Duration::ZERO, None, missing.clone());
    let executor = Executor::new((0..gpus).map(open));
    for gpu in executor.gpus().iter() {
        while !gpu.is_there() {
            gpu.tidy(&[]);
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    executor
}

/// A frame of a client that is left to a GPU.
pub type LeftToGpu = CullUnderWay<TestFrame<HeapReply>>;

/// Leaves a frame to the grid of a GPU: at which place, and with a token that shows whether its memory exists.
pub fn begin(
    executor: &mut Executor,
    client: u64,
    boxes: &[Aabb],
    precision: &Precision,
) -> (LeftToGpu, usize, Arc<()>) {
    let memory = TestFrame::on_heap(precision, boxes);
    let token = Arc::clone(&memory.token);
    let options = culled_by(EngineName::GpuGrid);
    let planned = executor.plan(memory.boxes.boxes(), &options, u64::MAX);
    assert!(executor.can_begin(&planned));
    let slot = planned.gpu_index();
    let begun = executor.begin(planned, Owner::Client(client), memory);
    (begun.unwrap_or_else(|_| panic!("answered at once")), slot, token)
}

/// Waits for a frame that was left to a GPU: its answer, and the words of its reply.
pub fn end(executor: &mut Executor, frame: LeftToGpu) -> (CullAnswer, Vec<u32>) {
    let (answer, memory) = executor.end(frame);
    let memory = memory.expect("the GPU is done with its memory");
    (answer.expect("an answer"), memory.reply.words().to_vec())
}

/// The pairs of boxes as they are sent, by `cpu-grid`, which is fast enough for many and is held to the oracle.
pub fn pairs_by_cpu(boxes: &[Aabb], precision: &Precision) -> Vec<Pair> {
    let mut reply = HeapReply::new();
    let (sent, options) = (as_sent(precision, boxes), culled_by(EngineName::CpuGrid));
    let answer = CpuEngines::new().cull(&sent, &options, &mut reply).expect("memory");
    pairs_of(boxes.len(), &answer, reply.words())
}

/// A frame of an engine.
pub fn cull<'a>(
    engine: &mut dyn Engine,
    boxes: impl Into<BoxSlice<'a>>,
    encoding: Encoding,
) -> (CullReport, HeapReply) {
    let boxes = boxes.into();
    let mut reply = HeapReply::new();
    let report = engine
        .cull(&CullInput::boxes(boxes).encoding(encoding), &mut reply)
        .unwrap_or_else(|error| panic!("{} boxes, {encoding}: {error}", boxes.len()));
    (report, reply)
}

pub fn pairs_of(n: usize, answer: &CullAnswer, words: &[u32]) -> Vec<Pair> {
    let n = BoxCount::new(n as u32);
    MaskView::new(n, &answer.report.shape, words).expect("a mask").sorted()
}
