//! Device and engine of the GPU tests.

use std::sync::Arc;

use pairmaskd::execute::gpu::{AllPairs, AllPairsOptions, Gpu, GpuChoice, HostImport};

/// The name of the GPU of the tests: what `PAIRMASK_TEST_GPU` says, by default the software adapter.
pub fn name() -> String {
    std::env::var("PAIRMASK_TEST_GPU").unwrap_or_else(|_| "software".into())
}

/// The GPU of the tests.
pub fn choice() -> GpuChoice {
    name().parse().unwrap_or_default()
}

/// The GPU of the tests: what `PAIRMASK_TEST_GPU` names, by default the software adapter.
///
/// # Panics
/// Without an adapter: a GPU test that cannot run fails.
pub fn open(host_import: HostImport) -> Arc<Gpu> {
    Gpu::open(&choice(), host_import)
        .unwrap_or_else(|error| panic!("the GPU tests need a Vulkan adapter: {error}"))
}

/// An engine on a device of its own.
///
/// # Panics
/// When it cannot be made.
pub fn engine(options: AllPairsOptions) -> AllPairs {
    AllPairs::new(&open(HostImport::IfPossible), options).unwrap_or_else(|error| panic!("{error}"))
}
