//! The GPU: adapter choice, device, memory, frames, and the engines that run on it.
//!
//! The way of a frame: boxes in imported shared memory (or staged) → stages of
//! `pairmask-shaders`, recorded once ([`Frame`]) → mask words in imported reply memory (or
//! staged). One thread owns an engine; a device that is lost is a typed error, after which
//! [`GpuSlot`] rebuilds it while CPU engines serve.
//!
//! The modules are private. What is public lets no device write to memory that Rust has taken back:
//!
//! * Engines are lent a reply for a call that does not return before the device is done with it, or
//!   own it ([`GridUnderWay`]). Importing memory for replies is `unsafe`.
//! * Frames that others record ([`Frame`], [`Command`]) use blocks that were allocated for them
//!   ([`Block::new`]), which they keep. Those of engines and imports are not handed out.

mod adapter;
mod all_pairs;
mod awake;
mod choices;
mod device;
mod driver_thread;
mod error;
mod frame;
mod frame_cache;
mod grid;
mod growing;
mod health;
mod import;
mod memory;
mod pipeline;
mod scene;
mod shader;
mod slot;
mod transfers;
mod upload_ahead;

pub use adapter::{AdapterInfo, GpuChoice, choose, list_adapters};
pub use all_pairs::plan::{Counted, Tuning};
pub use all_pairs::{AllPairs, AllPairsOptions};
pub use awake::{Awake, DEFAULT_HOLD};
pub use choices::GpuChoices;
pub use device::{Gpu, GpuLimits, HostImport, SUBMISSIONS};
pub use driver_thread::{DriverThread, Progress};
pub use error::{GpuError, OpenError, StageFault};
pub use frame::{Command, Frame, MAX_STEPS, StepTime, Wait};
pub use grid::plan::{Capacity, Sizes};
pub use grid::{
    BUNDLE_FRAMES, Begun, Grid, GridOptions, GridUnderWay, cell_count, grid_layout, takes_worlds,
};
pub use health::DeviceHealth;
pub use import::{ImportError, ImportId, Imports, ReadWriteMapping, SegmentError};
pub use memory::{Block, Home, Part};
pub use pipeline::{Pipeline, Pipelines, user_cache_folder};
pub use scene::{EditTimes, GpuScene, SceneTools};
pub use shader::Checks;
pub use slot::{GpuSlot, IfMissing, Opener, SlotState};
pub use transfers::{SharedImports, Upload};
