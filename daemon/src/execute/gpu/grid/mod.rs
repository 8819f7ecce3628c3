//! Engine `gpu-grid`: a uniform grid with levels on the GPU.
//!
//! The grid of Avril et al. 2012, §4, as `cpu-grid` has it: each box has one home cell, by its min
//! corner, in the finest level on which it spans at most two cells an axis. Six stages, one
//! submission:
//!
//! > `grid_cells` → `grid_scan` → `grid_scatter` → `grid_place` → `grid_pairs` → `grid_write`
//!
//! The first reads the boxes across the link, the last two write the reply across it. What the
//! dispatches depend on is known before: the levels come from a sample of the boxes on the CPU
//! ([`layout`]), sizes from their number ([`plan`]). So nothing waits for the host in between. Only
//! a reply that turns out larger than its allocation takes a second submission.
//!
//! Same boxes, same bytes: positions are by cell and index, words by row and block, and neither the
//! order in which threads come nor earlier frames show. ([`mirror`] is the same on the CPU.)
//!
//! Scenes that crowd a cell beyond a budget, or dense masks, are the all-pairs engine's.

mod axis;
mod layout;
pub mod mirror;
pub mod plan;
mod sample;
mod scratch;
mod steps;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask::engine::{
    Census, CullError, CullJob, CullReport, Engine, NAMED_INVALID, ReplyBuffer,
};
use pairmask::mask::MaskShape;
use pairmask::{Aabb, BoxCount, Encoding, EngineName, MaskWord};
use pairmask_shaders::layouts::GridSummary;
use pairmask_shaders::{GridStage, Stage};

use self::layout::Chooser;
use self::plan::Sizes;
use self::scratch::Scratch;
use self::steps::Recording;
use super::all_pairs::outcome::{Outcome, no_pairs, report};
use super::device::Gpu;
use super::error::GpuError;
use super::frame::{Command, Frame, StepTime, Wait};
use super::frame_cache::{FrameCache, FrameKey, Place};
use super::import::{ImportError, ImportId};
use super::memory::{Block, Part};
use super::pipeline::Pipelines;
use super::shader::Checks;
use super::transfers::{SharedImports, Transfers, Upload};

/// How the engine works. The default is what the daemon uses.
#[derive(Clone, Default)]
pub struct GridOptions {
    /// Shader checks.
    pub checks: Checks,
    /// Way of the boxes; `None` chooses by where they are and how many.
    pub upload: Option<Upload>,
    /// Take timestamps of each step.
    pub profiled: bool,
    /// Folder of the pipeline cache; `None` keeps none.
    pub cache_folder: Option<PathBuf>,
    /// How to wait; `None` spins on a real GPU and sleeps on a software adapter.
    pub wait: Option<Wait>,
    /// What is imported; to be shared by the engines of a device.
    pub imports: SharedImports,
}

const ENGINE: EngineName = EngineName::GpuGrid;

/// The engine. One thread uses it.
pub struct Grid {
    gpu: Arc<Gpu>,
    options: GridOptions,
    binding_bytes: u64,
    pipelines: Pipelines,
    transfers: Transfers,
    chooser: Chooser,
    scratch: Scratch,
    frames: FrameCache,
    /// Whether the blocks that must be zero between frames may not be.
    unclean: bool,
    /// Words of the last frame: what the next one's reply gets room for. The answer does not depend
    /// on it.
    last_words: u64,
    step_times: Vec<StepTime>,
}

/// What a submission said.
enum Ran {
    /// The frame's sums.
    Done(Outcome),
    /// Too much for a grid; nothing was looked for.
    OverBudget,
}

impl Grid {
    /// An engine on `gpu`, with all stages compiled.
    ///
    /// # Errors
    /// [`GpuError`].
    pub fn new(gpu: &Arc<Gpu>, options: GridOptions) -> Result<Self, GpuError> {
        let mut pipelines = Pipelines::new(gpu, options.checks, options.cache_folder.as_deref())?;
        for stage in GridStage::ALL {
            pipelines.get(Stage::Grid(stage))?;
        }
        pipelines.save();
        Ok(Self {
            gpu: Arc::clone(gpu),
            binding_bytes: gpu.limits().storage_binding_bytes.min(1 << 31),
            pipelines,
            transfers: Transfers::new(Arc::clone(gpu), options.imports.clone(), options.upload),
            chooser: Chooser::default(),
            scratch: Scratch::new(gpu),
            frames: FrameCache::default(),
            unclean: true,
            last_words: 0,
            step_times: Vec::new(),
            options,
        })
    }

    /// The device.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// Imports shared memory at an address range of this process, so that boxes or replies within
    /// it need no copy. See [`super::import::Imports::import`].
    ///
    /// # Errors
    /// [`ImportError`]; the staged path serves then.
    pub fn import(&mut self, address: usize, bytes: usize) -> Result<ImportId, ImportError> {
        self.transfers.imports().import(&self.gpu, address, bytes)
    }

    /// Drops what was recorded for an import that has ended.
    pub fn drop_frames_of(&mut self, block: &Arc<Block>) {
        self.frames.forget(block);
    }

    /// Times of the last frame's steps, in order, if the engine is profiled.
    pub fn step_times(&self) -> &[StepTime] {
        &self.step_times
    }

    fn wait(&self) -> Wait {
        let software = self.gpu.info().is_software();
        self.options.wait.unwrap_or(if software { Wait::Block } else { Wait::Spin })
    }

    /// Runs all stages, the mask to `shape` of `mask`.
    fn run(
        &mut self,
        boxes: &[Aabb],
        n: BoxCount,
        placed: &Part,
        mask: &Part,
        capacity: u64,
        mut replaced: bool,
    ) -> Result<Ran, GpuError> {
        let sizes = Sizes::of(n);
        let blocks =
            self.scratch.blocks(&self.gpu, &sizes, capacity, &mut replaced, &mut self.unclean)?;
        if replaced {
            self.frames.clear();
        }
        let (wait, patience) = (self.wait(), self.patience(n));
        if self.unclean {
            let zero = [&blocks.table, &blocks.control].map(|b| Command::Zero(Part::whole(b)));
            let mut frame = Frame::new(&self.gpu, false)?;
            frame.record(zero.into())?;
            frame.run(wait, patience)?;
        }
        blocks.layout.write(0, &[self.chooser.choose(boxes)]);
        let key = FrameKey {
            n: n.get(),
            encoding: Encoding::Sparse,
            capacity,
            chunk: 0,
            input: Place::of(placed),
            output: Place::of(mask),
        };
        let recording = Recording {
            sizes,
            params: sizes.params(capacity as u32),
            blocks: &blocks,
            boxes: placed,
            reply: mask,
        };
        let pipelines = &mut self.pipelines;
        let frame = self
            .frames
            .frame(&self.gpu, key, self.options.profiled, || recording.steps(pipelines))?;
        // A frame that does not end leaves its blocks as they are.
        self.unclean = true;
        frame.run(wait, patience)?;
        self.unclean = false;
        if self.options.profiled {
            self.step_times = frame.step_times()?;
        }
        let mut summary = [GridSummary::default()];
        blocks.summary.read(0, &mut summary);
        let [summary] = summary;
        if plan::is_over_budget(summary.work, summary.giant_work) {
            return Ok(Ran::OverBudget);
        }
        let wide = |[low, high]: [u32; 2]| u64::from(low) | u64::from(high) << 32;
        let outcome = Outcome {
            census: census(&summary, &blocks.invalid, sizes.plane()),
            words: wide(summary.words),
            pairs: wide(summary.pairs),
            compared: wide(summary.compared),
        };
        Ok(Ran::Done(outcome))
    }

    fn cull_sparse(
        &mut self,
        n: BoxCount,
        boxes: &[Aabb],
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let start = Instant::now();
        let mut replaced = false;
        let placed =
            self.transfers.place_boxes(boxes, &mut replaced).map_err(|e| self.cull_error(&e))?;
        let ingested = start.elapsed();
        let sizes = Sizes::of(n);
        let mut capacity = plan::capacity(n, self.last_words);
        loop {
            let words = sizes.reply_words(capacity);
            if 4 * words > self.binding_bytes {
                // The reply is one binding; all pairs binds its sections one by one.
                return Err(CullError::TooCrowded { engine: ENGINE });
            }
            let reserved = &mut reply.reserve(words)?[..words as usize];
            let done = (|| {
                let mask = self.transfers.place_mask(reserved, &mut replaced)?;
                let ran = self.run(boxes, n, &placed, &mask.part, capacity, replaced)?;
                Ok((ran, mask))
            })();
            let (ran, mask) = done.map_err(|e: GpuError| self.cull_error(&e))?;
            let Ran::Done(outcome) = ran else {
                return Err(CullError::TooCrowded { engine: ENGINE });
            };
            self.last_words = outcome.words;
            if outcome.words > capacity {
                // Counted, not written: come back with room for that many.
                capacity = plan::capacity(n, outcome.words);
                replaced = false;
                continue;
            }
            let executed = start.elapsed();
            let shape = sizes.shape(outcome.words);
            if !mask.is_reply
                && let MaskShape::Sparse { rows, blocks, bits, order } = shape
            {
                for section in [rows, blocks, bits].into_iter().chain(order) {
                    let start = section.start as usize;
                    let to = &mut reserved[start..start + section.len as usize];
                    mask.part.block.read(mask.part.offset + 4 * section.start, to);
                }
            }
            let zero_words = n.sparse_words_max() - outcome.words;
            let mut report =
                report(shape, &outcome, zero_words, [ingested, executed, start.elapsed()]);
            report.skipped.pairs = n.pair_count() - outcome.compared;
            return Ok(report);
        }
    }

    /// How long a run may take before the device counts as hung: ten seconds, and what the worst
    /// scene within the budget takes.
    fn patience(&self, n: BoxCount) -> Duration {
        let tests_a_second =
            if self.gpu.info().is_software() { 50_000_000 } else { 20_000_000_000 };
        Duration::from_secs(10 + n.pair_count() / tests_a_second)
    }

    /// What the caller can do about a fault of the GPU.
    fn cull_error(&self, error: &GpuError) -> CullError {
        self.gpu.cull_error(ENGINE, error)
    }
}

/// The census of a frame; the bits of invalid boxes are looked at only where there are some.
fn census(summary: &GridSummary, invalid: &Block, plane: u32) -> Census {
    let mut census = Census { invalid: summary.invalid, empty: summary.empty, ..Census::default() };
    let mut named = 0;
    let wanted = (summary.invalid as usize).min(NAMED_INVALID);
    let mut place = 0;
    while named < wanted && place < plane {
        let mut word = [0u32];
        invalid.read(u64::from(place / 8), &mut word);
        for bit in MaskWord(word[0]).bits() {
            if let Some(slot) = census.first_invalid.get_mut(named) {
                *slot = place + bit;
                named += 1;
            }
        }
        place += 32;
    }
    census
}

impl Engine for Grid {
    fn name(&self) -> EngineName {
        ENGINE
    }

    /// Dense masks are refused ([`CullError::Unavailable`]): they have all pairs' words, which the
    /// all-pairs engine writes faster. Crowds are, too ([`CullError::TooCrowded`]).
    fn cull(
        &mut self,
        boxes: &[Aabb],
        job: &CullJob,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let limit = plan::max_boxes(self.binding_bytes);
        let n = BoxCount::of_len(boxes.len())
            .filter(|n| u64::from(n.get()) <= limit)
            .ok_or(CullError::TooManyBoxes { engine: ENGINE, n: boxes.len() as u64, limit })?;
        self.gpu.health().check().map_err(|e| self.cull_error(&e))?;
        match job.encoding {
            Encoding::Dense => {
                Err(CullError::Unavailable { engine: ENGINE, why: "dense masks are all pairs'" })
            }
            Encoding::Sparse if n.get() < 2 => no_pairs(n, boxes, job.encoding, reply),
            Encoding::Sparse => self.cull_sparse(n, boxes, reply),
        }
    }
}
