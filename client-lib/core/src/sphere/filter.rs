//! Many spheres: a box engine finds the candidates among the spheres' bounds, and each is tested.

use std::time::Instant;

use super::Sphere;
use super::all_pairs::counted;
use super::bounds::bounds;
use super::exact::Ball;
use crate::aabb::Aabb;
use crate::engine::gather::PairTest;
use crate::engine::{CpuEngines, CullAnswer, CullError, CullWish, ReplyBuffer, nanoseconds_since};
use crate::floats;
use crate::mask::{Encoding, EncodingChoice};

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

    /// Writes the pair mask of `spheres` into memory of `reply`; `engines` find the candidates.
    ///
    /// # Errors
    /// [`CullError`]; nothing is published then.
    pub fn cull(
        &mut self,
        engines: &mut CpuEngines,
        spheres: &[Sphere],
        wish: &CullWish,
        encoding: Encoding,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        counted(spheres)?;
        let start = Instant::now();
        self.ingest(spheres);
        let bounds_ns = nanoseconds_since(start);
        // The engine that finds candidates soonest, whatever is made of them.
        let sparse = CullWish { encoding: EncodingChoice::Only(Encoding::Sparse), ..*wish };
        let plan_start = Instant::now();
        let mut plan = engines.plan(&*self.boxes, &sparse, None);
        plan.encoding = encoding;
        let plan_ns = nanoseconds_since(plan_start);
        let test: &dyn PairTest = &Balls(&self.balls);
        let mut report = engines.run_passing(&plan, &self.boxes, Some(test), reply)?;
        report.times.ingest_ns += bounds_ns;
        Ok(CullAnswer::new(&plan, report, start, plan_ns))
    }

    fn ingest(&mut self, spheres: &[Sphere]) {
        self.boxes.clear();
        self.balls.clear();
        floats::with_default(|| {
            for sphere in spheres {
                // Copied once: a client could write to it meanwhile.
                let sphere = *sphere;
                self.boxes.push(bounds(&sphere));
                self.balls.push(Ball::of(&sphere));
            }
        });
    }

    /// Bytes of scratch that is kept from frame to frame, beside that of the box engines.
    pub(super) fn scratch_bytes(&self) -> usize {
        self.boxes.capacity() * size_of::<Aabb>() + self.balls.capacity() * size_of::<Ball>()
    }
}

/// The exact test of a pair of spheres.
struct Balls<'a>(&'a [Ball]);

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
