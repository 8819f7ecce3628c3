//! A frame of bounding spheres.

use pairmask_core::sphere::Sphere;
use pairmask_core::units::BoxCount;

use super::error::FrameError;
use super::frame::Filling;
use super::pending::PendingFrame;

/// Memory for the spheres of one frame.
///
/// [`spheres_mut`](Self::spheres_mut) is a plain slice in object order, as that of a
/// [`Frame`](super::Frame) is.
#[derive(Debug)]
pub struct SphereFrame {
    filling: Filling<Sphere>,
}

impl SphereFrame {
    pub(super) const fn new(filling: Filling<Sphere>) -> Self {
        Self { filling }
    }

    /// Spheres in this frame.
    pub const fn n(&self) -> BoxCount {
        self.filling.n()
    }

    /// Whether the spheres lie in shared memory.
    pub const fn is_shared(&self) -> bool {
        self.filling.is_shared()
    }

    /// The spheres, contents unspecified until written.
    pub fn spheres_mut(&mut self) -> &mut [Sphere] {
        self.filling.objects_mut()
    }

    /// The spheres as written so far.
    pub fn spheres(&self) -> &[Sphere] {
        self.filling.objects()
    }

    /// The spheres as four floats each: `x y z radius`.
    pub fn raw_mut(&mut self) -> &mut [[f32; 4]] {
        bytemuck::cast_slice_mut(self.spheres_mut())
    }

    /// Asks for the pairs. In process they are found before this returns.
    ///
    /// # Errors
    /// [`FrameError`]; the frame's memory is gone then.
    pub fn submit(self) -> Result<PendingFrame, FrameError> {
        self.filling.submit()
    }
}
