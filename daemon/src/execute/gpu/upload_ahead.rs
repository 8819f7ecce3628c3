//! Boxes brought to video memory by the copy engine while the stages of another frame run.
//!
//! A lone frame's first stage reads imported boxes across the link itself, which is the fastest way
//! for it, but then the stages wait for the link. With another frame under way the link and the
//! stages work at the same time instead (the revised pipeline of Avril et al. 2009).
#![allow(unsafe_code)]

use std::sync::Arc;
use std::time::Duration;

use ash::vk;
use pairmask_core::Encoding;

use super::device::{Gpu, Order, QueueRole};
use super::error::GpuError;
use super::frame::{Command, Wait};
use super::frame_cache::{FrameCache, FrameKey, Place};
use super::growing::Growing;
use super::memory::{Block, Home, Part};
use super::transfers::{PlacedBoxes, Upload};

/// Smaller boxes are read by the first stage also behind another frame: a copy takes 10 µs to begin,
/// in which the link brings as many bytes.
const LEAST_BYTES: u64 = 512 << 10;

/// A workspace's way ahead.
pub(super) struct UploadAhead {
    gpu: Arc<Gpu>,
    /// Whether lone frames and small ones take it too. For tests.
    always: bool,
    boxes: Growing,
    uploads: FrameCache,
    /// Signalled by each upload, waited for by the frame after it.
    uploaded: vk::Semaphore,
    /// Whether the last upload is to be ended.
    is_under_way: bool,
}

// SAFETY: the semaphore is used through `&mut self` only, so by one thread at a time.
unsafe impl Send for UploadAhead {}

impl UploadAhead {
    /// `None` where the device has no queue that only copies, and where another way is forced.
    /// Forced itself, it is there on any device, and every frame takes it.
    pub(super) fn new(gpu: &Arc<Gpu>, forced: Option<Upload>) -> Result<Option<Self>, GpuError> {
        let always = forced == Some(Upload::DmaCopy);
        if !always && (forced.is_some() || !gpu.has_own_queue(QueueRole::Upload)) {
            return Ok(None);
        }
        let info = vk::SemaphoreCreateInfo::default();
        // SAFETY: the device outlives the semaphore (`gpu` is kept).
        let uploaded = gpu.noticed(unsafe { gpu.raw().create_semaphore(&info, None) })?;
        Ok(Some(Self {
            gpu: Arc::clone(gpu),
            always,
            boxes: Growing::new(Home::Video),
            uploads: FrameCache::new(QueueRole::Upload),
            uploaded,
            is_under_way: false,
        }))
    }

    /// Whether these boxes are better brought ahead, `is_behind` another frame or alone.
    pub(super) fn pays(&self, boxes: &PlacedBoxes, is_behind: bool) -> bool {
        let boxes = &boxes.part;
        let crosses = boxes.block.home() == Home::Imported && boxes.bytes >= LEAST_BYTES;
        self.always || is_behind && crosses
    }

    /// Where boxes will be in video memory.
    pub(super) fn place(
        &mut self,
        boxes: &PlacedBoxes,
        replaced: &mut bool,
    ) -> Result<PlacedBoxes, GpuError> {
        let bytes = boxes.part.bytes;
        let mut is_new = false;
        let block = self.boxes.at_least(&self.gpu, bytes, &mut is_new)?;
        let part = Part::of(block, 0, bytes);
        if is_new {
            self.uploads.clear();
            *replaced = true;
        }
        Ok(PlacedBoxes { part, form: boxes.form })
    }

    /// Starts to copy; the frame of the boxes is submitted in the order that comes back.
    pub(super) fn begin(
        &mut self,
        n: u32,
        from: &PlacedBoxes,
        to: &PlacedBoxes,
    ) -> Result<Order, GpuError> {
        let (form, from, to) = (from.form, &from.part, &to.part);
        let key = FrameKey {
            n,
            form,
            encoding: Encoding::Sparse,
            capacity: 0,
            chunk: 0,
            input: Place::of(from),
            output: Place::of(to),
            rules: None,
        };
        let copy = || Ok(vec![Command::Copy { from: from.clone(), to: to.clone() }]);
        let upload = self.uploads.frame(&self.gpu, key, false, copy)?;
        upload.submit_in(Order::Before(self.uploaded))?;
        self.is_under_way = true;
        Ok(Order::After(self.uploaded))
    }

    /// To be called when the frame after it has ended, and so the upload.
    pub(super) fn end(&mut self, patience: Duration) -> Result<(), GpuError> {
        if !std::mem::take(&mut self.is_under_way) {
            return Ok(());
        }
        self.uploads.last_mut().map_or(Ok(()), |upload| upload.end(Wait::Spin, patience))
    }

    /// Drops what was recorded for an import that has ended.
    pub(super) fn forget(&mut self, block: &Arc<Block>) {
        self.uploads.forget(block);
    }

    /// Waits for what is under way. Whether the device is done with it.
    pub(super) fn settle(&mut self) -> bool {
        self.is_under_way = false;
        self.uploads.settle()
    }

    /// Leaves the semaphore to a device that may wait for it for ever.
    pub(super) fn abandon(&mut self) {
        self.uploaded = vk::Semaphore::null();
    }
}

impl Drop for UploadAhead {
    fn drop(&mut self) {
        if !self.uploads.settle() {
            self.abandon();
        }
        // SAFETY: the uploads have ended, and so have the frames that wait for it (their workspace's
        // `drop`), or nothing is destroyed: a null handle is ignored.
        unsafe { self.gpu.raw().destroy_semaphore(self.uploaded, None) };
    }
}
