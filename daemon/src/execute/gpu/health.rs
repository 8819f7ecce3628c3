//! Whether a device is still there.

use std::sync::atomic::{AtomicBool, Ordering};

use super::error::GpuError;

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
