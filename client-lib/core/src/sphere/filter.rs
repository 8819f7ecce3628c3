//! Many spheres: a box engine finds the candidates among the spheres' bounds, and each is tested.

use super::Sphere;
use super::bounds::bounds;
use super::exact::Ball;
use crate::aabb::Aabb;
use crate::cancel::{BOX_TESTS, Cancel, Pace};
use crate::engine::{CullError, EngineName, PairTest, counted};
use crate::floats;

/// Spheres through the box engines: exact, in O(n + pairs) where those are.
///
/// The bounds are rounded outward ([`Sphere::bounds`]), so the boxes' pairs hold all of the
/// spheres'; the exact test of a pair takes the rest out. It is made by the engine's tasks, some
/// thousand pairs at a time, so that what does not pass takes no memory.
#[derive(Default)]
pub struct SphereFilter {
    boxes: Vec<Aabb>,
    balls: Vec<Ball>,
}

impl SphereFilter {
    /// A filter with empty scratch memory.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes spheres: their bounds, and the test that candidates among these have to pass.
    ///
    /// # Errors
    /// [`CullError::TooManyBoxes`], and [`CullError::Cancelled`].
    pub(crate) fn candidates(
        &mut self,
        spheres: &[Sphere],
        cancel: &Cancel,
    ) -> Result<(&[Aabb], Balls<'_>), CullError> {
        counted(spheres, EngineName::CpuBrute)?;
        self.ingest(spheres, cancel);
        if cancel.is_cancelled() {
            return Err(CullError::Cancelled);
        }
        Ok((&self.boxes, Balls(&self.balls)))
    }

    fn ingest(&mut self, spheres: &[Sphere], cancel: &Cancel) {
        self.boxes.clear();
        self.balls.clear();
        floats::with_default(|| {
            let mut pace = Pace::default();
            for sphere in spheres {
                if cancel.look_after(BOX_TESTS, &mut pace) {
                    return;
                }
                // Copied once: a client could write to it meanwhile.
                let sphere = *sphere;
                self.boxes.push(bounds(&sphere));
                self.balls.push(Ball::of(&sphere));
            }
        });
    }

    /// Bytes of scratch that is kept from frame to frame, beside that of the box engines.
    pub(crate) fn scratch_bytes(&self) -> usize {
        self.boxes.capacity() * size_of::<Aabb>() + self.balls.capacity() * size_of::<Ball>()
    }
}

/// The exact test of a pair of spheres.
pub(crate) struct Balls<'a>(&'a [Ball]);

impl PairTest for Balls<'_> {
    fn passing(&self, row: u32, block: u32, bits: u32, order: &[u32]) -> u32 {
        let ball = |position: u32| {
            let position = position as usize;
            let index = order.get(position).map_or(position, |index| *index as usize);
            &self.0[index]
        };
        let one = ball(row);
        let (mut passing, mut rest) = (0, bits);
        while rest != 0 {
            let column = rest.trailing_zeros();
            passing |= u32::from(one.overlaps(ball(32 * block + column))) << column;
            rest &= rest - 1;
        }
        passing
    }
}
