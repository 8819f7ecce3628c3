//! Devices and engine of the GPU tests.

use std::sync::Arc;
use std::time::Duration;

use pairmask_core::BoxCount;
use pairmask_core::dispatch::CullAnswer;
use pairmask_core::mask::MaskView;
use pairmask_core::oracle::Pair;
use pairmaskd::execute::gpu::{
    AllPairs, AllPairsOptions, Gpu, GpuChoice, Grid, GridOptions, HostImport, IfMissing, SceneTools,
};
use pairmaskd::execute::{Executor, GpuService};

use crate::frames::Sorted;

/// The names of the GPUs of the tests: what `PAIRMASK_TEST_GPU` lists, by default the software adapter.
fn names() -> String {
    std::env::var("PAIRMASK_TEST_GPU").unwrap_or_else(|_| "software".into())
}

pub fn name() -> String {
    name_at(0)
}

/// The name of the device at a place of tests that need several: the GPUs of the list in turn, so that one
/// adapter serves for all.
pub fn name_at(place: usize) -> String {
    let names = names();
    let count = names.split(',').count();
    names.split(',').nth(place % count).unwrap_or_default().trim().to_owned()
}

pub fn choice() -> GpuChoice {
    choice_at(0)
}

pub fn choice_at(place: usize) -> GpuChoice {
    name_at(place).parse().unwrap_or_default()
}

pub fn open(host_import: HostImport) -> Arc<Gpu> {
    open_at(0, host_import)
}

pub fn open_at(place: usize, host_import: HostImport) -> Arc<Gpu> {
    Gpu::open(&choice_at(place), host_import)
        .unwrap_or_else(|error| panic!("the GPU tests need a Vulkan adapter: {error}"))
}

pub fn engine(options: AllPairsOptions) -> AllPairs {
    AllPairs::new(&open(HostImport::IfPossible), options).unwrap_or_else(|error| panic!("{error}"))
}

pub fn grid(options: &GridOptions) -> Grid {
    Grid::new(&open(HostImport::IfPossible), options).unwrap_or_else(|error| panic!("{error}"))
}

pub fn scene_tools(place: usize, options: &GridOptions) -> Arc<SceneTools> {
    SceneTools::new(&open_at(place, HostImport::IfPossible), options)
        .unwrap_or_else(|error| panic!("{error}"))
}

pub fn shared_tools(gpus: usize) -> Vec<Arc<SceneTools>> {
    let options = GridOptions { shares_always: true, ..GridOptions::default() };
    (0..gpus).map(|at| scene_tools(at, &options)).collect()
}

pub fn executor(gpus: usize) -> Executor {
    let missing = IfMissing::Report(Arc::new(|error| panic!("a Vulkan adapter: {error}")));
    let open =
        |place| GpuService::opening(&choice_at(place), Duration::ZERO, None, missing.clone());
    let executor = Executor::new((0..gpus).map(open));
    for gpu in executor.gpus().iter() {
        while !gpu.is_there() {
            gpu.take_back();
            std::thread::sleep(Duration::from_millis(1));
        }
    }
    executor
}

pub fn pairs_of(n: usize, answer: &CullAnswer, words: &[u32]) -> Vec<Pair> {
    let n = BoxCount::new(n as u32);
    MaskView::new(n, &answer.report.shape, words).expect("a mask").sorted()
}
