//! A short measurement of this machine when a worker starts beside a GPU.
//!
//! Without it, the plan would give frames to a CPU twice as slow as that of the built-in constants where the GPU is
//! faster.

use std::time::{Duration, Instant};

use pairmask_core::dispatch::nanoseconds_since;
use pairmask_core::engine::{
    AvailableIsa, CullError, CullInput, Engine, EngineName, HeapReply, cpu_engine,
};
use pairmask_core::plan::{Calibration, SceneStats, Term, Work};
use pairmask_core::{Aabb, BoxCount, Encoding, MaskView};

use crate::scene::{Scene, SceneName};

/// Boxes of the scenes that are timed: one small enough to compare all pairs, one that suits the grid.
const SIZES: [usize; 2] = [512, 4_096];
/// Every start has the same boxes.
const SEED: u64 = 1;
/// Frames of each engine, at least and at most. The shortest counts: the first touch memory, and other processes may
/// disturb some.
const FRAMES: (usize, usize) = (7, 22);
/// No further frame of a scene begins after this time, once there are enough: 15 ms in all on the machine of the
/// built-in constants.
const TIME: Duration = Duration::from_millis(5);

/// Measured over predicted time of an engine's frame; `None` is the client, which visits its pairs.
type Ratio = (Option<EngineName>, f64);

/// The constants of `start` scaled to this machine and `isa`: each engine by itself on one thread, and those of masks
/// by the time of visiting their pairs.
///
/// # Errors
/// [`CullError`] of an engine.
pub(super) fn glance(start: &Calibration, isa: AvailableIsa) -> Result<Calibration, CullError> {
    let mut ratios: Vec<Ratio> = Vec::new();
    for n in SIZES {
        ratios.extend(measure(Scene::new(SceneName::Uniform, n, SEED).boxes(), start, isa)?);
    }
    let mut scaled = *start;
    for term in Term::ALL {
        let own = ratios.iter().filter(|(owner, _)| *owner == term.owner());
        let (count, log) = own.fold((0.0, 0.0), |(n, log), (_, ratio)| (n + 1.0, log + ratio.ln()));
        scaled.ns[term.index()] *= f64::exp(log / f64::max(count, 1.0));
    }
    Ok(scaled)
}

/// An engine, and the shortest times of its frames, ns.
struct Timed {
    name: EngineName,
    engine: Box<dyn Engine>,
    cull_ns: u64,
    visit_ns: u64,
    pairs: u64,
}

impl Timed {
    fn frame(
        &mut self,
        boxes: &[Aabb],
        isa: AvailableIsa,
        reply: &mut HeapReply,
    ) -> Result<(), CullError> {
        let start = Instant::now();
        let input = CullInput::boxes(boxes).encoding(Encoding::Sparse).threads(1);
        let report = self.engine.cull(&input, reply)?;
        self.cull_ns = self.cull_ns.min(nanoseconds_since(start));
        let start = Instant::now();
        let n = BoxCount::new(boxes.len() as u32);
        // An engine's mask is well-formed.
        if let Ok(mask) = MaskView::new(n, &report.shape, reply.words()) {
            let mut indices = 0;
            mask.with_isa(isa).for_each(|a, b| indices ^= a ^ b);
            std::hint::black_box(indices);
        }
        self.visit_ns = self.visit_ns.min(nanoseconds_since(start));
        self.pairs = report.pair_count;
        Ok(())
    }

    fn ratios(&self, boxes: &[Aabb], start: &Calibration) -> [Ratio; 2] {
        let stats = SceneStats::glance(boxes, Some(self.pairs));
        let ratio = |ns: u64, work: &Work| ns.max(1) as f64 / start.time_ns(work).max(1.0);
        let cull = Work::of(self.name, Encoding::Sparse, &stats);
        let visit = Work::of_visit(self.name, Encoding::Sparse, &stats);
        let cull_ratio = cull.map_or(1.0, |cull| ratio(self.cull_ns, &cull));
        [(Some(self.name), cull_ratio), (None, ratio(self.visit_ns, &visit))]
    }
}

/// The ratios of one scene. The engines take turns frame by frame, so that a busy moment disturbs all of them.
fn measure(
    boxes: &[Aabb],
    start: &Calibration,
    isa: AvailableIsa,
) -> Result<Vec<Ratio>, CullError> {
    let mut timed = Vec::new();
    for name in EngineName::CPU {
        let engine = cpu_engine(name, isa.get())?;
        timed.push(Timed { name, engine, cull_ns: u64::MAX, visit_ns: u64::MAX, pairs: 0 });
    }
    let (least, most) = FRAMES;
    let (begin, mut reply) = (Instant::now(), HeapReply::new());
    for frame in 0..most {
        if frame >= least && begin.elapsed() > TIME {
            break;
        }
        for timed in &mut timed {
            timed.frame(boxes, isa, &mut reply)?;
        }
    }
    Ok(timed.iter().flat_map(|timed| timed.ratios(boxes, start)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_engine_is_scaled_by_itself() {
        let isa = AvailableIsa::best();
        let built_in = Calibration::built_in(isa.get());
        let mut slower = built_in;
        for ns in &mut slower.ns {
            *ns *= 1000.0;
        }
        let (found, found_of_slower) =
            (glance(&built_in, isa).expect("a look"), glance(&slower, isa).expect("a look"));
        for (term, (ns, of_slower)) in
            Term::ALL.iter().zip(found.ns.iter().zip(&found_of_slower.ns))
        {
            // The start is forgotten, whatever else runs on this machine.
            assert!((0.05..20.0).contains(&(ns / of_slower)), "{term:?}: {ns} {of_slower}");
        }
    }
}
