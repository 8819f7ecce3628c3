//! What can go wrong with a GPU.

use std::sync::atomic::{AtomicBool, Ordering};

use ash::vk;

use super::GpuChoice;

#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    #[error("GPUs are disabled (--gpu none)")]
    SwitchedOff,
    #[error("no GPU fits '{choice}'; there are: {}", list(.available))]
    NoAdapter { choice: GpuChoice, available: Vec<String> },
    #[error("adapter '{0}' has no Vulkan driver")]
    NotVulkan(String),
    #[error("the driver did not open the device: {0}")]
    Driver(#[from] wgpu::hal::DeviceError),
    #[error(transparent)]
    Request(#[from] wgpu::RequestDeviceError),
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

fn list(names: &[String]) -> String {
    if names.is_empty() { "none (is a Vulkan driver installed?)".into() } else { names.join(", ") }
}

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GpuError {
    /// The device is lost: everything made on it is void, and a new one must be opened.
    #[error("the GPU device was lost")]
    Lost,
    /// A frame did not end in time. The device may still write to memory that it was given.
    #[error("the GPU did not finish a frame in time")]
    Hung,
    #[error("no GPU memory for {bytes} bytes")]
    OutOfMemory { bytes: u64 },
    #[error("the GPU driver refused: {0}")]
    Driver(vk::Result),
    /// A fault of the build, which tests find.
    #[error("stage {stage} does not compile: {why}")]
    Stage { stage: &'static str, why: &'static str },
}

impl From<vk::Result> for GpuError {
    fn from(result: vk::Result) -> Self {
        match result {
            vk::Result::ERROR_DEVICE_LOST => Self::Lost,
            vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
                Self::OutOfMemory { bytes: 0 }
            }
            other => Self::Driver(other),
        }
    }
}

/// Set once, by the first of these to notice: the driver's answer to a call, wgpu's lost callback, or
/// an error that came outside of any call.
#[derive(Debug, Default)]
pub struct DeviceHealth {
    lost: AtomicBool,
}

impl DeviceHealth {
    pub fn mark_lost(&self) {
        self.lost.store(true, Ordering::Release);
    }

    pub fn is_lost(&self) -> bool {
        self.lost.load(Ordering::Acquire)
    }

    /// An error once the device is lost.
    pub fn check(&self) -> Result<(), GpuError> {
        if self.is_lost() { Err(GpuError::Lost) } else { Ok(()) }
    }
}
