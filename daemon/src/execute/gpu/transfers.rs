//! How boxes come to the GPU and masks go back: in memory that both see, or staged.
//!
//! A lone frame's first stage reads imported boxes across the link itself, which is the fastest way
//! for it, but then the stages wait for the link. With another frame under way the link and the
//! stages work at the same time instead, and a queue that only copies brings the boxes (the revised pipeline of Avril et al. 2009).
#![allow(unsafe_code)]

use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use ash::vk;
use pairmask_core::ObjectForm;
use pairmask_core::mask::MaskShape;
use pairmask_core::objects::Objects;

use super::{
    Access, Block, BlockOffset, Command, FrameCache, Gpu, GpuError, Growing, Home, Imports, Order,
    Part, QueueRole,
};
use crate::locked;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Upload {
    /// The first stage reads host memory across the link.
    KernelReads,
    /// The copy engine brings them to video memory first.
    DmaCopy,
    /// The CPU stores them into mapped video memory.
    MappedVideo,
}

/// Boxes up to this many bytes are stored by the CPU even where the kernel could read them across
/// the link: it waits longer for the first of them than the stores take (24 KB: 1.3 µs).
const STORED_FIRST_BYTES: u64 = 32 << 10;

/// Boxes up to this many bytes are stored by the CPU straight into video memory when they must be
/// copied anyway (24 KB: 1.3 µs on an H200); more go through host memory, which the kernel reads.
const MAPPED_VIDEO_BYTES: u64 = 64 << 10;

/// What stages read memory in.
const WORD_BYTES: u64 = size_of::<u32>() as u64;

/// The imports of a device, for all engines on it. Each is made once, whichever engine uses it.
#[derive(Clone, Default)]
pub struct SharedImports(Arc<Mutex<Imports>>);

impl SharedImports {
    /// A panic of another holder leaves the imports whole: each change is one call.
    pub fn lock(&self) -> MutexGuard<'_, Imports> {
        locked(&self.0)
    }

    /// The part of an imported block at an address, if it can be bound there.
    pub(super) fn part(
        &self,
        gpu: &Gpu,
        address: usize,
        bytes: u64,
        access: Access,
    ) -> Option<Part> {
        let imports = self.lock();
        let (block, offset) = imports.find(address, bytes as usize, access)?;
        // Of words, however fine the device's own steps are.
        let align = gpu.limits().storage_offset_align_bytes.max(WORD_BYTES);
        offset.is_multiple_of(align).then(|| Part::of(block, offset, bytes))
    }
}

pub(super) struct Transfers {
    gpu: Arc<Gpu>,
    pub(super) imports: SharedImports,
    upload: Option<Upload>,
    staged_boxes: Growing,
    mapped_boxes: Growing,
    staged_mask: Growing,
}

pub(super) struct UploadedBoxes {
    /// The memory, whole words.
    pub(super) part: Part,
    pub(super) form: ObjectForm,
}

pub(super) struct MaskTarget {
    pub(super) part: Part,
    /// Whether it is the reply itself; otherwise the mask must be copied from here to there.
    pub(super) is_reply: bool,
}

impl MaskTarget {
    /// Copies the sections of a mask to their places in the reply, where it was not written there.
    pub(super) fn read_back(&self, shape: MaskShape, reply: &mut [u32]) {
        if self.is_reply {
            return;
        }
        for section in shape.spans() {
            let start = section.start as usize;
            let to = &mut reply[start..start + section.len as usize];
            self.part.block.read(self.part.offset + 4 * section.start, to);
        }
    }
}

impl Transfers {
    /// `upload` forces a way of the boxes; `None` chooses by where they are and how many.
    pub(super) const fn new(gpu: Arc<Gpu>, imports: SharedImports, upload: Option<Upload>) -> Self {
        Self {
            gpu,
            imports,
            upload,
            staged_boxes: Growing::new(Home::Host),
            mapped_boxes: Growing::new(Home::MappedVideo),
            staged_mask: Growing::new(Home::Host),
        }
    }

    /// Brings the objects where the GPU sees them, as they are. `replaced` is set if a block was.
    pub(super) fn put(
        &mut self,
        objects: Objects<'_>,
        replaced: &mut bool,
    ) -> Result<UploadedBoxes, GpuError> {
        let (form, memory) = (objects.form(), objects.as_bytes());
        // Boxes of 6 bytes may end within a word, and stages read words: all of the last one is
        // bound. It is there, since blocks and imports are whole pages.
        let bytes = (memory.len() as u64).next_multiple_of(WORD_BYTES);
        let mappable = self.gpu.limits().mapped_video_memory;
        let stored_up_to = |limit| match self.upload {
            Some(upload) => upload == Upload::MappedVideo,
            None => bytes <= limit && mappable,
        };
        if !stored_up_to(STORED_FIRST_BYTES)
            && let Some(part) =
                self.imports.part(&self.gpu, memory.as_ptr() as usize, bytes, Access::Read)
        {
            return Ok(UploadedBoxes { part, form });
        }
        let mapped = stored_up_to(MAPPED_VIDEO_BYTES);
        let staged = if mapped { &mut self.mapped_boxes } else { &mut self.staged_boxes };
        let part = staged.part(&self.gpu, bytes, replaced)?;
        part.block.write(0, memory);
        Ok(UploadedBoxes { part, form })
    }

    /// Where the mask goes that belongs into `mask`.
    pub(super) fn put_mask(
        &mut self,
        mask: &[u32],
        replaced: &mut bool,
    ) -> Result<MaskTarget, GpuError> {
        let bytes = size_of_val(mask) as u64;
        let address = mask.as_ptr() as usize;
        if let Some(part) = self.imports.part(&self.gpu, address, bytes, Access::Write) {
            return Ok(MaskTarget { part, is_reply: true });
        }
        let part = self.staged_mask.part(&self.gpu, bytes, replaced)?;
        Ok(MaskTarget { part, is_reply: false })
    }
}

/// Smaller boxes are read by the first stage also behind another frame: a copy takes 10 µs to begin,
/// in which the link brings as many bytes.
const LEAST_BYTES: u64 = 512 << 10;

pub(super) struct UploadAhead {
    gpu: Arc<Gpu>,
    /// Whether lone frames and small ones take it too. For tests.
    always: bool,
    boxes: Growing,
    /// By where boxes are copied from and to, and how many bytes.
    uploads: FrameCache<([BlockOffset; 2], u64)>,
    /// Signalled by each upload, waited for by the frame after it.
    uploaded: vk::Semaphore,
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
        let uploaded = gpu.noticed(unsafe { gpu.raw.create_semaphore(&info, None) })?;
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
    pub(super) fn pays(&self, boxes: &UploadedBoxes, is_behind: bool) -> bool {
        let boxes = &boxes.part;
        let crosses = boxes.block.home == Home::Imported && boxes.bytes >= LEAST_BYTES;
        self.always || is_behind && crosses
    }

    pub(super) fn put(
        &mut self,
        boxes: &UploadedBoxes,
        replaced: &mut bool,
    ) -> Result<UploadedBoxes, GpuError> {
        let mut is_new = false;
        let part = self.boxes.part(&self.gpu, boxes.part.bytes, &mut is_new)?;
        if is_new {
            self.uploads.clear();
            *replaced = true;
        }
        Ok(UploadedBoxes { part, form: boxes.form })
    }

    /// Starts to copy; the frame of the boxes is submitted in the order that comes back.
    pub(super) fn begin(
        &mut self,
        from: &UploadedBoxes,
        to: &UploadedBoxes,
    ) -> Result<Order, GpuError> {
        let (from, to) = (&from.part, &to.part);
        let key = ([from, to].map(BlockOffset::of), from.bytes);
        let copy = || Ok(vec![Command::Copy { from: from.clone(), to: to.clone() }]);
        let upload = self.uploads.frame(&self.gpu, key, false, copy)?;
        upload.submit_in(Order { before: Some(self.uploaded), ..Order::default() })?;
        self.is_under_way = true;
        Ok(Order { after: Some(self.uploaded), ..Order::default() })
    }

    /// To be called when the frame after it has ended, and so the upload.
    pub(super) fn end(&mut self, timeout: Duration) -> Result<(), GpuError> {
        if !std::mem::take(&mut self.is_under_way) {
            return Ok(());
        }
        self.uploads.last_mut().map_or(Ok(()), |upload| upload.end(timeout))
    }

    pub(super) fn discard(&mut self, block: &Arc<Block>) {
        self.uploads.discard(|(slots, _)| slots.iter().any(|put| put.is_in(block)));
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
        unsafe { self.gpu.raw.destroy_semaphore(self.uploaded, None) };
    }
}
