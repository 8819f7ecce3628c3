//! A workspace: one frame at a time, and the blocks and recorded frames that belong to it.

use std::sync::Arc;
use std::time::Duration;

use pairmask_core::dispatch::Marks;
use pairmask_core::engine::{
    Census, CullError, CullReport, NAMED_INVALID, ReplyBuffer, StageClock,
};
use pairmask_core::objects::Objects;
use pairmask_core::{BoxClass, BoxCount, MaskWord};
use pairmask_shaders::Found;
use pairmask_shaders::layouts::GridSummary;

use super::layout::Chooser;
use super::plan::LastFound;
use super::ruled::{RuleBlocks, Ruled};
use super::steps::{Blocks, Scratch};
use super::under_way::Bundle;
use super::{ENGINE, plan};
use crate::execute::gpu::transfers::UploadAhead;
use crate::execute::gpu::{
    Block, BlockOffset, Capacity, Command, EngineOptions, Frame, FrameCache, FrameKey, Gpu,
    GpuError, MaskTarget, Order, Part, Pipelines, QueueRole, Sizes, StepTime, Transfers,
    UploadedBoxes, wide,
};

pub(super) struct Tools {
    pub(super) gpu: Arc<Gpu>,
    pub(super) pipelines: Pipelines,
    pub(super) chooser: Chooser,
    /// What the last frames found, for the room of the next reply; no answer depends on it.
    pub(super) last_found: LastFound,
    pub(super) profiled: bool,
    pub(super) step_times: Vec<StepTime>,
    pub(super) poison: Option<u32>,
    pub(super) binding_bytes: u64,
}

pub(super) enum Ended {
    Report(CullReport),
    /// A mask that its reply had no room for.
    Again {
        n: BoxCount,
        found: Found,
        entries: u64,
        marks: Option<Arc<Marks>>,
    },
}

pub(super) struct Requested<'a> {
    pub(super) n: BoxCount,
    pub(super) objects: Objects<'a>,
    pub(super) capacity: Capacity,
    /// Whether another frame is under way: its boxes are brought to video memory meanwhile.
    pub(super) is_behind: bool,
    pub(super) marks: Option<&'a Arc<Marks>>,
}

pub(super) struct Uploaded {
    pub(super) n: BoxCount,
    pub(super) capacity: Capacity,
    boxes: UploadedBoxes,
    /// Where they are copied to before the frame; else the first stage reads them where they lie.
    ahead: Option<UploadedBoxes>,
    pub(super) mask: MaskTarget,
    pub(super) blocks: Blocks,
    pub(super) rules: Option<RuleBlocks>,
    clock: StageClock,
}

impl Uploaded {
    /// The boxes that the first stage reads.
    pub(super) fn read(&self) -> &UploadedBoxes {
        self.ahead.as_ref().unwrap_or(&self.boxes)
    }
}

pub(super) struct Workspace {
    transfers: Transfers,
    ahead: Option<UploadAhead>,
    scratch: Scratch,
    ruled: Ruled,
    frames: FrameCache,
    /// Whether the blocks that must be zero between frames may not be.
    unclean: bool,
    /// The frame under way. There until its end was seen.
    under_way: Option<Uploaded>,
    /// Its submission, where it shares one with others; else it is the last one of `frames`.
    bundle: Option<Bundle>,
    /// The pairs before those of each world, of the last frame whose list was ordered by world.
    pub(super) world_firsts: Vec<u32>,
}

impl Workspace {
    pub(super) fn new(gpu: &Arc<Gpu>, options: &EngineOptions) -> Result<Self, GpuError> {
        Ok(Self {
            transfers: Transfers::new(Arc::clone(gpu), options.imports.clone(), options.upload),
            ahead: UploadAhead::new(gpu, options.upload)?,
            scratch: Scratch::on(gpu),
            ruled: Ruled::new(gpu),
            frames: FrameCache::new(QueueRole::Frames),
            unclean: true,
            under_way: None,
            bundle: None,
            world_firsts: Vec::new(),
        })
    }

    pub(super) fn drop_frames_of(&mut self, block: &Arc<Block>) {
        self.frames.discard(|key| key.uses(block));
        if let Some(ahead) = &mut self.ahead {
            ahead.discard(block);
        }
    }

    pub(super) fn is_free(&self) -> bool {
        self.under_way.is_none()
    }

    pub(super) fn has_ended(&self) -> bool {
        match &self.bundle {
            Some(bundle) => bundle.has_ended(),
            None => self.frames.last().is_none_or(Frame::has_ended),
        }
    }

    pub(super) fn begin(
        &mut self,
        tools: &mut Tools,
        requested: &Requested<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<(), CullError> {
        let uploaded = self.put(tools, requested, reply)?;
        self.submit(tools, &uploaded).map_err(|e| tools.gpu.cull_error(ENGINE, &e))?;
        self.under_way = Some(uploaded);
        Ok(())
    }

    /// Gets a frame ready for a bundle: its steps are submitted with it, or it is given up.
    pub(super) fn join(
        &mut self,
        tools: &mut Tools,
        requested: &Requested<'_>,
        reply: &mut dyn ReplyBuffer,
        bundle: &Bundle,
    ) -> Result<Vec<Command>, CullError> {
        let uploaded = self.put(tools, requested, reply)?;
        let steps = uploaded.steps(tools).map_err(|e| tools.gpu.cull_error(ENGINE, &e))?;
        // A frame that does not end leaves its blocks as they are.
        self.unclean = true;
        self.bundle = Some(bundle.clone());
        self.under_way = Some(uploaded);
        Ok(steps)
    }

    fn put(
        &mut self,
        tools: &mut Tools,
        requested: &Requested<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<Uploaded, CullError> {
        let Requested { n, objects, capacity, is_behind, marks } = *requested;
        let sizes = Sizes::of(n);
        let words = sizes.reply_words(capacity);
        if 4 * words > tools.binding_bytes {
            // The reply is one binding; all pairs binds its sections one by one.
            return Err(CullError::TooCrowded { engine: ENGINE });
        }
        let mask = &reply.reserve(words)?[..words as usize];
        assert!(self.under_way.is_none(), "one frame a workspace");
        let mut clock = StageClock::start();
        let layout = match marks {
            None => tools.chooser.choose(objects),
            Some(marks) => {
                let layout = tools.chooser.choose_worlds(objects, marks.worlds().len() as u32);
                layout.ok_or(CullError::TooCrowded { engine: ENGINE })?
            }
        };
        let uploaded = (|| {
            let mut replaced = false;
            let uploaded = self.transfers.put(objects, &mut replaced)?;
            let ahead = self.ahead.as_mut().filter(|ahead| ahead.pays(&uploaded, is_behind));
            let ahead = ahead.map(|ahead| ahead.put(&uploaded, &mut replaced)).transpose()?;
            let mask = self.transfers.put_mask(mask, &mut replaced)?;
            clock.ingested();
            let rules = marks
                .map(|marks| self.ruled.blocks(&tools.gpu, marks, &sizes, &mut replaced))
                .transpose()?;
            let blocks = self.blocks(tools, &sizes, capacity, replaced)?;
            blocks.grid.block.write(0, &[layout]);
            Ok(Uploaded { n, capacity, boxes: uploaded, ahead, mask, blocks, rules, clock })
        })();
        uploaded.map_err(|e: GpuError| tools.gpu.cull_error(ENGINE, &e))
    }

    fn wait(&mut self, tools: &mut Tools) -> Result<(), GpuError> {
        let began = self.under_way.as_ref().ok_or(GpuError::Lost)?;
        let timeout = timeout(&tools.gpu, began.n);
        if let Some(bundle) = &self.bundle {
            return bundle.end(timeout);
        }
        let frame = self.frames.last_mut().ok_or(GpuError::Lost)?;
        frame.end(timeout)?;
        if let Some(ahead) = &mut self.ahead {
            ahead.end(timeout)?;
        }
        if tools.profiled {
            tools.step_times = frame.step_times()?;
        }
        Ok(())
    }

    /// Waits for what is under way, and drops it. `false` where the device may write for ever.
    pub(super) fn give_up(&mut self) -> bool {
        let writes_reply = self.under_way.take().is_some_and(|frame| frame.mask.is_reply);
        self.settle() || !writes_reply
    }

    fn settle(&mut self) -> bool {
        let frames = self.frames.settle();
        let bundle = self.bundle.take_if(|bundle| bundle.settle());
        let is_ended = bundle.is_some() || self.bundle.is_none();
        self.ahead.as_mut().is_none_or(UploadAhead::settle) && frames && is_ended
    }

    fn blocks(
        &mut self,
        tools: &Tools,
        sizes: &Sizes,
        capacity: Capacity,
        mut replaced: bool,
    ) -> Result<Blocks, GpuError> {
        let gpu = &tools.gpu;
        let blocks = self.scratch.blocks(gpu, sizes, capacity, &mut replaced, &mut self.unclean)?;
        if replaced {
            self.frames.clear();
        }
        let fill = |parts: &[(&str, &Part)], word| {
            Frame::fill(gpu, parts.iter().map(|(_, part)| &part.block), word)
        };
        if let (true, Some(word)) = (replaced, tools.poison) {
            self.unclean = true;
            fill(&blocks.named(), word)?;
        }
        if self.unclean {
            fill(&[("table", &blocks.table), ("control", &blocks.control)], 0)?;
        }
        Ok(blocks)
    }

    fn submit(&mut self, tools: &mut Tools, uploaded: &Uploaded) -> Result<(), GpuError> {
        let read = uploaded.read();
        let key = FrameKey {
            n: uploaded.n.get(),
            form: read.form,
            encoding: uploaded.capacity.found.encoding(),
            capacity: uploaded.capacity.entries,
            chunk: 0,
            input: BlockOffset::of(&read.part),
            output: BlockOffset::of(&uploaded.mask.part),
            rules: uploaded.rules.as_ref().map(|rules| BlockOffset::of(&rules.marks)),
        };
        let (gpu, profiled) = (Arc::clone(&tools.gpu), tools.profiled);
        let frame = self.frames.frame(&gpu, key, profiled, || uploaded.steps(tools))?;
        // A frame that does not end leaves its blocks as they are.
        self.unclean = true;
        let order = match (&mut self.ahead, &uploaded.ahead) {
            (Some(ahead), Some(there)) => ahead.begin(&uploaded.boxes, there)?,
            _ => Order::default(),
        };
        frame.submit_in(order)
    }

    /// Waits for the frame under way, on which the device may work after an error.
    pub(super) fn end(
        &mut self,
        tools: &mut Tools,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<Ended, CullError> {
        self.wait(tools).map_err(|e| tools.gpu.cull_error(ENGINE, &e))?;
        let Some(uploaded) = self.under_way.take() else {
            return Err(CullError::DeviceLost { engine: ENGINE });
        };
        let Uploaded { n, capacity, mask, blocks, rules, mut clock, .. } = uploaded;
        self.bundle = None;
        self.unclean = false;
        let mut summary = [GridSummary::default()];
        blocks.summary.block.read(0, &mut summary);
        let [summary] = summary;
        if plan::is_over_budget(summary.work, summary.giant_work) {
            return Err(CullError::TooCrowded { engine: ENGINE });
        }
        let (entries, found) = (wide(summary.entries), capacity.found);
        if entries > plan::most_entries(n, found) || wide(summary.compared) > n.pair_count() {
            // No scene has as many: the device does not do what the stages say.
            let fault = GpuError::Driver(ash::vk::Result::ERROR_UNKNOWN);
            return Err(tools.gpu.cull_error(ENGINE, &fault));
        }
        if entries > capacity.entries {
            let marks = rules.map(|rules| rules.of);
            return Ok(Ended::Again { n, found, entries, marks });
        }
        tools.last_found.note(found, entries, wide(summary.pairs));
        if let Some(rules) = &rules {
            rules.read_world_firsts(&mut self.world_firsts);
        }
        clock.executed();
        let sizes = Sizes::of(n);
        let shape = sizes.shape(found, entries);
        if !mask.is_reply {
            let room = sizes.reply_words(capacity);
            let reserved = &mut reply.reserve(room)?[..room as usize];
            mask.read_back(shape, reserved);
        }
        let census = census(&summary, &blocks.invalid.block, sizes.plane());
        let (pairs, compared) = (wide(summary.pairs), wide(summary.compared));
        let report = CullReport::new(n, shape, census, pairs, compared, clock.published());
        Ok(Ended::Report(report))
    }
}

impl Drop for Workspace {
    fn drop(&mut self) {
        // Frames that wait for an upload end before its semaphore is destroyed.
        if !self.settle()
            && let Some(ahead) = &mut self.ahead
        {
            ahead.abandon();
        }
    }
}

/// How long a frame may take before the device counts as hung: some seconds, and what the worst scene within the
/// budget takes. A software adapter compiles its stages in the first frame: those of spheres took ten seconds on two
/// busy cores.
fn timeout(gpu: &Gpu, n: BoxCount) -> Duration {
    let (seconds, tests_a_second) =
        if gpu.is_software() { (60, 50_000_000) } else { (10, 20_000_000_000) };
    Duration::from_secs(seconds + n.pair_count() / tests_a_second)
}

/// The census of a frame; the bits of invalid boxes are looked at only where there are some.
fn census(summary: &GridSummary, invalid: &Block, plane: u32) -> Census {
    let mut census = Census::default();
    let requested = summary.invalid.min(NAMED_INVALID as u32);
    for put in (0..plane).step_by(32) {
        if census.invalid >= requested {
            break;
        }
        let mut word = [0u32];
        invalid.read(u64::from(put / 8), &mut word);
        MaskWord(word[0]).bits().for_each(|bit| census.note(put + bit, BoxClass::Invalid));
    }
    Census { invalid: summary.invalid, empty: summary.empty, ..census }
}
