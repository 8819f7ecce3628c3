//! The GPU that the executors of all sessions share, and what waits for it.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use pairmask_core::plan::{GpuCost, Plan};

use super::{GpuService, engine_ns};

/// How long a look at a software adapter's frame waits for the next.
const SOFTWARE_REST: Duration = Duration::from_micros(200);

/// The time that frames wait for the GPU counts in steps of this, ns: a plan of about the same cost is
/// taken again, which spares 10 to 20 µs.
const QUEUE_STEP_NS: u64 = 32_768;

/// What plans need to know of a GPU, while another thread uses it too.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Outlook {
    /// What frames cost on the device of now.
    cost: Option<GpuCost>,
    /// Fewest boxes of a frame that is left to it.
    under_way_boxes: Option<u32>,
    is_software: bool,
}

impl Outlook {
    fn of(service: &GpuService) -> Self {
        Self {
            cost: service.cost(),
            under_way_boxes: service.under_way_boxes(),
            is_software: service.is_software(),
        }
    }

    /// Whether a frame of this plan may be left to the GPU.
    pub(super) fn can_begin(&self, plan: &Plan) -> bool {
        self.under_way_boxes.is_some_and(|least| GpuService::can_begin(plan, least))
    }
}

/// A GPU with a lock. One thread uses it at a time; frames that it works on by itself need none.
pub(super) struct SharedGpu {
    service: Mutex<GpuService>,
    outlook: Mutex<Outlook>,
    /// Predicted time of the frames that wait for the GPU or are under way on it, ns.
    queued_ns: Arc<AtomicU64>,
}

impl SharedGpu {
    pub(super) fn new(service: GpuService) -> Self {
        let outlook = Mutex::new(Outlook::of(&service));
        Self { service: Mutex::new(service), outlook, queued_ns: Arc::default() }
    }

    /// The GPU, as soon as no other thread uses it.
    pub(super) fn lock(&self) -> MutexGuard<'_, GpuService> {
        self.service.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Uses the GPU as soon as no other thread does.
    pub(super) fn with<R>(&self, work: impl FnOnce(&mut GpuService) -> R) -> R {
        let mut service = self.lock();
        let done = work(&mut service);
        // The device may be another one by now, or none.
        let outlook = Outlook::of(&service);
        *self.outlook.lock().unwrap_or_else(PoisonError::into_inner) = outlook;
        done
    }

    /// Gives the core away for a moment where the GPU needs it: a software adapter's frames run on
    /// the same cores as this.
    pub(super) fn rest(&self) {
        if self.outlook().is_software {
            std::thread::sleep(SOFTWARE_REST);
        } else {
            std::hint::spin_loop();
        }
    }

    /// What is known of it, without waiting for it.
    pub(super) fn outlook(&self) -> Outlook {
        *self.outlook.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What a frame costs that comes now: it waits for those before it. So the plan gives a frame to a
    /// core that would be done sooner.
    pub(super) fn cost(&self) -> Option<GpuCost> {
        let cost = self.outlook().cost?;
        let queued_ns = self.queued_ns.load(Ordering::Relaxed) / QUEUE_STEP_NS * QUEUE_STEP_NS;
        Some(GpuCost { fixed_ns: cost.fixed_ns + queued_ns as f64, ..cost })
    }

    /// Has a frame of this plan wait for the GPU, or be under way on it, until the value is dropped.
    pub(super) fn queue(&self, plan: &Plan) -> Queued {
        let queued_ns = self.queued_ns.load(Ordering::Relaxed);
        // The prediction holds the frames before it, as far as they were there when it was planned.
        let ns = engine_ns(plan).saturating_sub(queued_ns);
        self.queued_ns.fetch_add(ns, Ordering::Relaxed);
        Queued { queued_ns: Arc::clone(&self.queued_ns), ns }
    }
}

/// A frame in the queue of a GPU.
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
