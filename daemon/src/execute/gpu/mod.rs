//! The GPU: adapter choice, device, memory, frames, and the engines that run on it.
//!
//! The way of a frame: boxes in imported shared memory (or staged) → stages of
//! `pairmask-shaders`, recorded once ([`frame`]) → mask words in imported reply memory (or
//! staged). One thread owns an engine; a device that is lost is a typed error, after which
//! [`slot`] rebuilds it while CPU engines serve.

pub mod adapter;
pub mod all_pairs;
pub mod awake;
pub mod device;
pub mod error;
pub mod frame;
mod frame_cache;
pub mod grid;
mod growing;
pub mod health;
pub mod import;
pub mod memory;
pub mod pipeline;
pub mod shader;
pub mod slot;
mod transfers;
mod upload_ahead;

pub use adapter::{AdapterInfo, GpuChoice, list_adapters};
pub use all_pairs::{AllPairs, AllPairsOptions};
pub use device::{Gpu, HostImport};
pub use error::{GpuError, OpenError};
pub use grid::{Grid, GridOptions};
pub use shader::Checks;
pub use slot::GpuSlot;
pub use transfers::{SharedImports, Upload};
