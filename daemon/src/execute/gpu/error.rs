//! What can go wrong with a GPU.

use std::sync::atomic::{AtomicBool, Ordering};

use ash::vk;

use super::GpuChoice;

/// No GPU, or none that can be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The choice was `none`.
    #[error("GPUs are switched off (--gpu none)")]
    SwitchedOff,
    /// Nothing fits the choice.
    #[error("no GPU fits '{choice}'; there are: {}", list(.available))]
    NoAdapter {
        /// What was asked for.
        choice: GpuChoice,
        /// Names of the adapters found.
        available: Vec<String>,
    },
    /// The adapter does not speak Vulkan.
    #[error("adapter '{0}' has no Vulkan driver")]
    NotVulkan(String),
    /// The driver did not open the device.
    #[error("the driver did not open the device: {0}")]
    Driver(#[from] wgpu::hal::DeviceError),
    /// wgpu refused the opened device.
    #[error(transparent)]
    Request(#[from] wgpu::RequestDeviceError),
    /// The opened device does not work.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

fn list(names: &[String]) -> String {
    if names.is_empty() { "none (is a Vulkan driver installed?)".into() } else { names.join(", ") }
}

/// A GPU operation failed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GpuError {
    /// The device is gone: everything made on it is void, and a new one must be opened.
    #[error("the GPU device was lost")]
    Lost,
    /// A frame did not end in time. The device may still write to memory that it was given.
    #[error("the GPU did not finish a frame in time")]
    Hung,
    /// No memory of the kind that is needed.
    #[error("no GPU memory for {bytes} bytes")]
    OutOfMemory {
        /// Bytes asked for.
        bytes: u64,
    },
    /// The driver refused a call for another reason.
    #[error("the GPU driver refused: {0}")]
    Driver(vk::Result),
    /// A stage does not compile.
    #[error("stage {stage} does not compile: {why}")]
    Stage {
        /// The stage.
        stage: &'static str,
        /// What is wrong.
        why: StageFault,
    },
}

/// Why a stage does not compile. All of them are faults of the build, which tests find.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StageFault {
    /// Its parts do not fit together.
    #[error("an import is missing")]
    Compose,
    /// Not WGSL.
    #[error("the text does not parse")]
    Parse,
    /// Its bindings are not numbered from 0, or are not to be had.
    #[error("it binds what it cannot be given")]
    Bindings,
    /// Refused by the validator.
    #[error("the module is not valid")]
    Validate,
    /// Not expressible in SPIR-V.
    #[error("no SPIR-V for it")]
    Emit,
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
    /// Marks the device as lost.
    pub fn mark_lost(&self) {
        self.lost.store(true, Ordering::Release);
    }

    /// Whether the device is lost.
    pub fn is_lost(&self) -> bool {
        self.lost.load(Ordering::Acquire)
    }

    /// An error once the device is lost.
    ///
    /// # Errors
    /// [`GpuError::Lost`].
    pub fn check(&self) -> Result<(), GpuError> {
        if self.is_lost() { Err(GpuError::Lost) } else { Ok(()) }
    }
}
