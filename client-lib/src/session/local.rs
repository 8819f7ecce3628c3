//! The in-process side: engines and buffers that are used again and again.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::builder::Settings;
use super::frame::Written;
use super::pairs::{PairMask, ServedBy, Storage};
use crate::aabb::Aabb;
use crate::engine::{CpuEngines, CullError, CullWish, HeapReply};
use crate::plan::CalibrationChoice;
use crate::units::BoxCount;
use crate::wire::Reply;

/// Buffers that are kept: two frames under way, one being filled, and as many masks held.
const KEPT_BUFFERS: usize = 4;

/// Engines and spare buffers of one session.
pub(super) struct Local {
    engines: Mutex<CpuEngines>,
    replies: Mutex<Vec<HeapReply>>,
    boxes: Mutex<Vec<Vec<Aabb>>>,
    last_pairs: Mutex<Option<u64>>,
}

impl std::fmt::Debug for Local {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Local")
    }
}

/// A panic in an engine leaves scratch memory behind that the next frame overwrites: go on.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Local {
    pub(super) fn new(calibration: &CalibrationChoice) -> Self {
        let (calibration, _) = calibration.resolve();
        Self {
            engines: Mutex::new(CpuEngines::with_calibration(calibration)),
            replies: Mutex::new(Vec::with_capacity(KEPT_BUFFERS)),
            boxes: Mutex::new(Vec::with_capacity(KEPT_BUFFERS)),
            last_pairs: Mutex::default(),
        }
    }

    pub(super) fn take_boxes(&self, n: BoxCount) -> Vec<Aabb> {
        let mut boxes = lock(&self.boxes).pop().unwrap_or_default();
        boxes.resize(n.len(), Aabb::default());
        boxes
    }

    pub(super) fn give_boxes(&self, boxes: Vec<Aabb>) {
        keep(&self.boxes, boxes);
    }

    pub(super) fn give_reply(&self, reply: HeapReply) {
        keep(&self.replies, reply);
    }

    /// Finds the pairs here and now.
    pub(super) fn cull(
        self: &Arc<Self>,
        boxes: &[Aabb],
        written: Written,
        settings: &Settings,
    ) -> Result<PairMask, CullError> {
        let mut memory = lock(&self.replies).pop().unwrap_or_default();
        let wish = CullWish {
            engine: settings.engine,
            encoding: settings.encoding,
            threads: settings.threads,
            last_pairs: *lock(&self.last_pairs),
        };
        let answer = lock(&self.engines).cull(boxes, &wish, &mut memory)?;
        *lock(&self.last_pairs) = Some(answer.report.pair_count);
        let reply = Reply {
            box_count: BoxCount::new(boxes.len() as u32),
            engine: answer.engine,
            threads: answer.threads,
            report: answer.report,
            times: answer.times,
        };
        let storage = Storage::Own { memory, home: Arc::clone(self) };
        Ok(PairMask::new(storage, &reply, ServedBy::InProcess, written))
    }
}

fn keep<T>(shelf: &Mutex<Vec<T>>, item: T) {
    let mut shelf = lock(shelf);
    if shelf.len() < KEPT_BUFFERS {
        shelf.push(item);
    }
}
