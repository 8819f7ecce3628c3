//! The GPU (GPU.md): adapter choice, device, memory, frames, and the engines that run on it.
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
mod device;
mod error;
mod frame;
mod frame_cache;
mod grid;
mod import;
mod listing;
mod memory;
mod options;
mod pipeline;
mod scene;
mod slot;
mod transfers;

pub use self::adapter::{GpuChoice, GpuChoices, choose, compute_alike, is_software, list_adapters};
pub use self::all_pairs::AllPairs;
pub use self::all_pairs::plan::{Tuning, first_capacity};
pub use self::awake::{Awake, DEFAULT_HOLD};
pub use self::device::{Gpu, GpuLimits, HostImport, SUBMISSIONS};
pub use self::error::{DeviceHealth, GpuError, OpenError};
pub use self::frame::{Command, Frame, MAX_STEPS, StepTime};
pub use self::grid::plan::{Capacity, Sizes};
pub use self::grid::{BUNDLE_FRAMES, Begun, Grid, GridUnderWay, grid_layout, takes_worlds};
pub use self::import::{ImportError, ImportId, Imports, Owner, ReadWriteMapping, SegmentError};
pub use self::listing::{ListedGpu, has_vulkan_loader, list_gpus};
pub use self::memory::{Block, Home, Part};
pub use self::options::EngineOptions;
pub use self::pipeline::{Checks, Pipeline, Pipelines, user_cache_folder};
pub use self::scene::{GpuScene, SceneTools, is_for_gpu};
pub use self::slot::{GpuSlot, IfMissing, Opener, SlotState};
pub use self::transfers::{SharedImports, Upload};
pub use wgpu::AdapterInfo;

use self::device::{Order, QueueRole};
use self::frame_cache::{BlockOffset, FrameCache, FrameKey};
use self::import::Access;
use self::memory::{Growing, frame_blocks};
use self::transfers::{MaskTarget, Transfers, UploadedBoxes};

/// A number of 64 bits as stages write it, the low word first.
fn wide([low, high]: [u32; 2]) -> u64 {
    u64::from(low) | u64::from(high) << 32
}
