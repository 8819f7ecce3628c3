//! The GPU that the executors of all sessions share, and what waits for it.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, Weak};
use std::time::{Duration, Instant};

use pairmask_core::dispatch::CullAnswer;
use pairmask_core::engine::CullError;
use pairmask_core::plan::{GpuCost, Plan};
use pairmask_core::spinner::Spinner;
use pairmask_core::{Encoding, EngineName};

use super::gpu::{Gpu, GridUnderWay};
use super::turns::{Turn, Turns};
use super::{FrameMemory, GpuService, Owner, Planned, no_gpu};
use crate::locked;

/// How long a look at a software adapter's frame waits for the next.
const SOFTWARE_REST: Duration = Duration::from_micros(200);

/// The time that frames wait for the GPU counts in steps of this, ns: a plan of about the same cost is
/// taken again, which spares 10 to 20 µs.
const QUEUE_STEP_NS: u64 = 32_768;

/// How long a thread spins for a GPU that others use: to sleep for a frame of 80 µs costs a wake-up of 50.
const SPIN: Duration = Duration::from_millis(1);
/// Then it looks so often: the GPU has long frames, or hangs.
const NAP: Duration = Duration::from_micros(200);

/// Of the predicted time of frames before it, the share that a frame is expected to wait. Frames of
/// several clients overlap on the GPU (8 clients of 100,000 boxes: 126 µs a frame, 170 of a lone
/// one), and a core beside busy clients takes about twice the time that it would alone.
const QUEUE_SHARE: f64 = 0.5;

/// What plans need to know of a GPU, while another thread uses it too.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Outlook {
    pub(super) cost: Option<GpuCost>,
    pub(super) under_way_boxes: Option<u32>,
    pub(super) is_software: bool,
    pub(super) is_opening: bool,
    pub(super) is_missing: bool,
}

impl Outlook {
    pub(super) fn can_join(&self, plan: &Plan) -> bool {
        let can_share = plan.engine.is_gpu() && plan.encoding != Encoding::Dense;
        let n = plan.stats.n.get();
        can_share && self.under_way_boxes.is_some_and(|least| (2..least).contains(&n))
    }

    pub(super) fn can_begin(&self, plan: &Plan) -> bool {
        plan.engine == EngineName::GpuGrid
            && plan.encoding != Encoding::Dense
            && self.under_way_boxes.is_some_and(|least| plan.stats.n.get() >= least)
    }
}

/// A GPU with a lock. One thread uses it at a time; frames that it works on by itself need none.
pub struct SharedGpu {
    /// Its place among those of the daemon.
    pub(super) number: usize,
    /// Taken by the thread whose turn it is.
    service: Mutex<GpuService>,
    turns: Turns,
    /// What is known of it, and the device that was there when it was used last.
    outlook: Mutex<(Outlook, Weak<Gpu>)>,
    /// Predicted time of the frames that wait for the GPU or are under way on it, ns.
    queued_ns: Arc<AtomicU64>,
}

impl SharedGpu {
    pub(super) fn new(service: GpuService, number: usize) -> Self {
        let outlook = Mutex::new(service.outlook());
        Self {
            number,
            service: Mutex::new(service),
            turns: Turns::default(),
            outlook,
            queued_ns: Arc::default(),
        }
    }

    /// Waits for this thread's turn: threads have it in the order in which they asked.
    pub(super) fn turn(&self) -> Turn<'_> {
        take_turn(&self.turns, self.is_software())
    }

    /// Uses the GPU when it is this thread's turn.
    pub(super) fn with<R>(&self, work: impl FnOnce(&mut GpuService) -> R) -> R {
        // It ends after the lock: the next thread finds that free.
        let _turn = self.turn();
        let mut service = locked(&self.service);
        let done = work(&mut service);
        // The device may be another one by now, or none.
        *locked(&self.outlook) = service.outlook();
        done
    }

    /// The device that was there when it was used last.
    pub(super) fn device(&self) -> Option<Arc<Gpu>> {
        locked(&self.outlook).1.upgrade()
    }

    /// Why a frame cannot have an engine of it, where it never had a device.
    pub(super) fn check_opened(&self, engine: EngineName) -> Result<(), CullError> {
        match self.outlook() {
            Outlook { is_opening: true, .. } => Err(CullError::Opening { engine }),
            Outlook { is_missing: true, .. } => Err(no_gpu(engine)),
            _ => Ok(()),
        }
    }

    /// A moment's rest: a software adapter's frames run on the same cores as this.
    pub fn rest(&self) {
        if self.is_software() {
            std::thread::sleep(SOFTWARE_REST);
        } else {
            std::hint::spin_loop();
        }
    }

    pub(super) fn outlook(&self) -> Outlook {
        locked(&self.outlook).0
    }

    /// Whether its adapter is a program on the cores; also `false` where there is none now.
    pub(super) fn is_software(&self) -> bool {
        self.outlook().is_software
    }

    /// Whether a device was there when it was used last.
    pub fn is_there(&self) -> bool {
        self.outlook().cost.is_some()
    }

    /// Predicted time of the frames before one that comes now, in steps of [`QUEUE_STEP_NS`].
    pub(super) fn queued_steps(&self) -> u64 {
        self.queued_ns.load(Ordering::Relaxed) / QUEUE_STEP_NS
    }

    /// What a frame costs that comes now, which waits for those before it.
    pub(super) fn cost(&self) -> Option<GpuCost> {
        let cost = self.outlook().cost?;
        let queued_ns = self.queued_steps() * QUEUE_STEP_NS;
        Some(GpuCost { fixed_ns: cost.fixed_ns + QUEUE_SHARE * queued_ns as f64, ..cost })
    }

    /// Has a frame, one of `frames` of a submission, count as waiting until the value is dropped.
    pub(super) fn queue(&self, plan: &Plan, frames: usize) -> Queued {
        let queued_ns = self.queued_ns.load(Ordering::Relaxed) as f64;
        // The prediction holds the frames before it, as far as they were there when it was planned. Those
        // of a submission take about the time of one.
        let ns =
            plan.expected_ns().saturating_sub((QUEUE_SHARE * queued_ns) as u64) / frames as u64;
        self.queued_ns.fetch_add(ns, Ordering::Relaxed);
        Queued { queued_ns: Arc::clone(&self.queued_ns), ns }
    }

    /// Gives up what the GPU keeps of disconnected clients, and takes a device in that was opened, or was lost and is
    /// back; to be called now and then.
    pub fn tidy(&self, segments: &[u64]) {
        if !self.outlook().is_missing {
            self.with(|gpu| gpu.tidy(segments));
        }
    }

    /// Has the GPU let go of memory of replies, none of which is lent. Whether nothing uses it now.
    pub fn release_reply(&self, range: &Range<usize>) -> bool {
        // One that is being opened has imported nothing, and imports no memory that is not lent.
        self.outlook().is_opening || self.with(|gpu| gpu.release_reply(range))
    }

    /// Leaves at most [`BUNDLE_FRAMES`](super::BUNDLE_FRAMES) frames to the GPU in one submission.
    /// [`Executor::answer`](super::Executor::answer) serves those that it does not take.
    #[allow(clippy::result_large_err)] // A box would be an allocation.
    pub fn begin_bundle<M: FrameMemory>(
        self: &Arc<Self>,
        frames: Vec<Joining<M>>,
    ) -> Vec<Result<CullUnderWay<M>, Unserved<M>>> {
        let count = frames.len();
        let mut waiting = Vec::with_capacity(count);
        let mut memories = Vec::with_capacity(count);
        for Joining { planned, owner, memory } in frames {
            memories.push((memory, owner, planned.plan.encoding));
            let planned = Planned { gpu: Some(Arc::clone(self)), ..planned };
            waiting.push((self.queue(&planned.plan, count), planned, owner));
        }
        let begun = self.with(|gpu| gpu.begin_bundle(memories));
        waiting
            .into_iter()
            .zip(begun)
            .map(|((queued, planned, owner), begun)| match begun {
                Ok(frame) => Ok(CullUnderWay { frame, owner, planned, queued }),
                Err((error, memory)) => Err(Unserved { error, planned, owner, memory }),
            })
            .collect()
    }
}

/// Takes the next turn. With `naps`, the awaited thread needs this one's core.
fn take_turn(turns: &Turns, naps: bool) -> Turn<'_> {
    let (begin, mut spinner) = (Instant::now(), Spinner::default());
    turns.take(|| {
        if naps || begin.elapsed() > SPIN {
            std::thread::sleep(NAP);
        } else {
            spinner.turn();
        }
    })
}

#[derive(Debug)]
pub(super) struct Queued {
    queued_ns: Arc<AtomicU64>,
    ns: u64,
}

impl Drop for Queued {
    fn drop(&mut self) {
        self.queued_ns.fetch_sub(self.ns, Ordering::Relaxed);
    }
}

/// A frame that the GPU works on. Owns its memory; dropped, it waits for the GPU first.
pub struct CullUnderWay<M: FrameMemory> {
    pub(super) frame: GridUnderWay<M>,
    pub(super) owner: Owner,
    pub(super) planned: Planned,
    pub(super) queued: Queued,
}

impl<M: FrameMemory> CullUnderWay<M> {
    /// Waits for the frame; [`Executor::answer`](super::Executor::answer) serves it after an error.
    #[allow(clippy::result_large_err)] // A box would be an allocation.
    pub fn end(self) -> Result<Ended<M>, Unserved<M>> {
        let Self { frame, owner, planned, queued } = self;
        let lost = CullError::DeviceLost { engine: planned.plan.engine };
        let (done, memory) = match &planned.gpu {
            Some(gpu) => gpu.with(|gpu| gpu.end(frame, &planned.plan)),
            None => (Err(lost), frame.give_up()),
        };
        drop(queued);
        match done {
            Ok((report, engine)) => Ok((Ok(planned.answer(report, engine)), memory)),
            Err(error) => Err(Unserved { error, planned, owner, memory }),
        }
    }

    /// Whether it has ended, so that [`Executor::end`](super::Executor::end) does not wait.
    pub fn has_ended(&self) -> bool {
        self.frame.has_ended()
    }
}

/// An answer, with the memory of the frame; `None` where a device that hangs keeps it.
pub type Ended<M> = (Result<CullAnswer, CullError>, Option<M>);

/// A frame that is to share a submission with others ([`SharedGpu::begin_bundle`]).
pub struct Joining<M> {
    pub(super) planned: Planned,
    pub(super) owner: Owner,
    pub(super) memory: M,
}

impl<M> Joining<M> {
    pub fn gpu_index(&self) -> usize {
        self.planned.gpu_index()
    }
}

pub struct Unserved<M> {
    pub(super) error: CullError,
    pub(super) planned: Planned,
    pub(super) owner: Owner,
    pub(super) memory: Option<M>,
}

impl<M> Unserved<M> {
    /// Threads that the CPU's engines may use for it; `None` leaves it to the plan.
    pub fn threads(&self) -> Option<usize> {
        self.planned.options.threads
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_come_in_the_order_in_which_they_were_asked_for() {
        for naps in [false, true] {
            let turns = Turns::default();
            let served = Mutex::new(Vec::new());
            let first = take_turn(&turns, naps);
            std::thread::scope(|scope| {
                let (turns, served) = (&turns, &served);
                for thread in 1..=8 {
                    scope.spawn(move || {
                        let _turn = take_turn(turns, naps);
                        served.lock().expect("no panic").push(thread);
                    });
                    while turns.asked() <= thread {
                        std::thread::yield_now();
                    }
                }
                assert!(served.lock().expect("no panic").is_empty(), "the first one goes on");
                drop(first);
            });
            assert_eq!(served.into_inner().expect("no panic"), [1, 2, 3, 4, 5, 6, 7, 8]);
        }
    }
}
