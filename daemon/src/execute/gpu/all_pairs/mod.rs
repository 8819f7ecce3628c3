//! Engine `gpu-brute`: all pairs on the GPU. The all-pairs test and the dense string are Avril et al. 2012, §3; their
//! float mapping function is replaced by an integer search once a word (`pack_dense.wgsl`).

pub mod plan;
mod steps;

use std::sync::Arc;
use std::time::Duration;

use pairmask_core::aabb::{AABB_BYTES, KeyBox};
use pairmask_core::cancel::Cancel;
use pairmask_core::engine::{
    Census, CullError, CullInput, CullReport, Engine, EngineTimes, NAMED_INVALID, ReplyBuffer,
    StageClock, write_no_pairs,
};
use pairmask_core::mask::{MaskShape, Span};
use pairmask_core::objects::Objects;
use pairmask_core::{BoxClass, BoxCount, Encoding, EngineName, MaskWord};
use pairmask_shaders::Found;
use pairmask_shaders::constants::BATCH_BOXES;
use pairmask_shaders::layouts::BatchReport;

use self::plan::BandLimits;
use self::steps::{Recording, Scratch};
use super::{
    Block, BlockOffset, EngineOptions, Frame, FrameCache, FrameKey, Gpu, GpuError, ImportError,
    ImportId, MaskTarget, Pipelines, QueueRole, StepTime, Transfers, Tuning, UploadedBoxes,
};
use crate::execute::frame_memory::end_process;

/// Largest matrix of a band: more would not be faster, and memory is shared with others.
const MATRIX_BYTES: u64 = 256 << 20;

pub struct AllPairs {
    gpu: Arc<Gpu>,
    options: EngineOptions,
    limits: BandLimits,
    pipelines: Pipelines,
    transfers: Transfers,
    scratch: Scratch,
    frames: FrameCache,
    reports: Vec<BatchReport>,
    step_times: Vec<StepTime>,
}

const ENGINE: EngineName = EngineName::GpuBrute;

impl AllPairs {
    pub fn new(gpu: &Arc<Gpu>, options: EngineOptions) -> Result<Self, GpuError> {
        let binding_bytes = gpu.limits().binding_bytes();
        let matrix_bytes = options.matrix_bytes.unwrap_or(MATRIX_BYTES).min(binding_bytes);
        let limits = BandLimits {
            matrix_words: matrix_bytes / 4,
            // Less what aligning the binding's start may add.
            output_words: binding_bytes / 4 - 1024,
            binding_bytes,
        };
        let tunings: Vec<Tuning> = match options.tuning {
            Some(tuning) => vec![tuning],
            None => Tuning::all().collect(),
        };
        let pipelines = options.pipelines(gpu, steps::stages_of(&tunings))?;
        let transfers = Transfers::new(Arc::clone(gpu), options.imports.clone(), options.upload);
        Ok(Self {
            gpu: Arc::clone(gpu),
            options,
            limits,
            pipelines,
            transfers,
            scratch: Scratch::new(),
            frames: FrameCache::new(QueueRole::Frames),
            reports: Vec::new(),
            step_times: Vec::new(),
        })
    }

    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }

    /// See [`Imports::import_boxes`](super::import::Imports::import_boxes).
    pub fn import_boxes(&mut self, address: usize, bytes: usize) -> Result<ImportId, ImportError> {
        self.transfers.imports.lock().import_boxes(&self.gpu, address, bytes)
    }

    /// Ends an import. Call it when the mapping of the range ends.
    pub fn discard(&mut self, id: ImportId) {
        let discarded = self.transfers.imports.lock().discard(id);
        for block in discarded {
            self.drop_frames_of(&block);
        }
    }

    pub(in crate::execute) fn drop_frames_of(&mut self, block: &Arc<Block>) {
        self.frames.discard(|key| key.uses(block));
    }

    /// Times of the last frame's steps, band by band, if the engine is profiled.
    pub fn step_times(&self) -> &[StepTime] {
        &self.step_times
    }

    /// Runs all bands, some of them in a submission. `None` where it was cancelled between two of these.
    #[allow(clippy::too_many_arguments)] // Of one caller.
    fn run(
        &mut self,
        n: BoxCount,
        boxes: &UploadedBoxes,
        mask: &MaskTarget,
        shape: MaskShape,
        capacity: u64,
        mut replaced: bool,
        cancel: &Cancel,
    ) -> Result<Option<Outcome>, GpuError> {
        let encoding = shape.encoding();
        let tuning = self.options.tuning.unwrap_or_else(|| Tuning::for_frame(n, encoding));
        let bands = plan::bands(n, tuning, encoding, &self.limits);
        let stages = self.scratch.stages(&self.gpu, n, &bands, &mut replaced)?;
        if replaced {
            self.frames.clear();
        }
        self.step_times.clear();
        let pairs_per_band = n.pair_count() / bands.len().max(1) as u64;
        for (chunk, bands) in bands.chunks(steps::BANDS_PER_FRAME).enumerate() {
            if cancel.look() {
                return Ok(None);
            }
            let key = FrameKey {
                n: n.get(),
                form: boxes.form,
                encoding,
                capacity,
                chunk,
                input: BlockOffset::of(&boxes.part),
                output: BlockOffset::of(&mask.part),
                rules: None,
            };
            let recording = Recording {
                n,
                form: boxes.form,
                tuning,
                stages: &stages,
                mask: &mask.part,
                shape,
                capacity,
                offset_align: self.gpu.limits().storage_offset_align_bytes,
            };
            let pipelines = &mut self.pipelines;
            let frame = self.frames.frame(&self.gpu, key, self.options.profiled, || {
                recording.steps(pipelines, (chunk == 0).then_some(&boxes.part), bands)
            })?;
            let run = LentRun { frame, writes_reply: mask.is_reply };
            run.frame.run(timeout(pairs_per_band * bands.len() as u64))?;
            if self.options.profiled {
                self.step_times.extend(run.frame.step_times()?);
            }
        }
        let batches = n.get().div_ceil(BATCH_BOXES) as usize;
        self.reports.resize(batches, BatchReport::default());
        stages.reports.block.read(0, &mut self.reports);
        Ok(Some(Outcome::of(&self.reports)))
    }

    /// Finds the pairs of two objects or more. A mask whose size is known when it was found is tried with room for
    /// those of most scenes first.
    fn cull_two(
        &mut self,
        n: BoxCount,
        objects: Objects<'_>,
        encoding: Encoding,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let (found, limit) = (Found::of(encoding), reply.limit_words());
        let cancel = &Cancel::by(reply.asker());
        objects.check_room(encoding, reply)?;
        let room = match found {
            Some(found) => plan::room(found, n, limit)?,
            None if n.dense_words() > limit => {
                return Err(plan::refusal(n.dense_words(), limit).into());
            }
            None => 0,
        };
        let mut clock = StageClock::start();
        let mut replaced = false;
        let boxes = self.transfers.put(objects, &mut replaced).map_err(|e| self.cull_error(&e))?;
        clock.ingested();
        let mut capacity = found.map_or(0, |found| plan::first_capacity(found, n).min(room));
        loop {
            let shape = |entries| match found {
                Some(found) => plan::shape(found, n, capacity, entries),
                None => MaskShape::dense(n),
            };
            let whole = shape(capacity);
            // Each section is one binding, but for a dense mask's.
            let is_beyond = |span: Span| 4 * span.len > self.limits.binding_bytes;
            if found.is_some() && whole.spans().any(is_beyond) {
                // More than this device writes at a time; a CPU engine may.
                let needed_bytes = whole.mask_bytes();
                return Err(CullError::DeviceMemory { engine: ENGINE, needed_bytes });
            }
            let words = whole.extent_words();
            let reserved = &mut reply.reserve(words)?[..words as usize];
            let done = (|| {
                let mask = self.transfers.put_mask(reserved, &mut replaced)?;
                let outcome = self.run(n, &boxes, &mask, whole, capacity, replaced, cancel)?;
                Ok((outcome, mask))
            })();
            let (outcome, mask) = done.map_err(|e: GpuError| self.cull_error(&e))?;
            let outcome = outcome.ok_or(CullError::Cancelled)?;
            let entries = found.map_or(0, |found| outcome.entries(found));
            if let Some(found) = found.filter(|_| entries > room) {
                return Err(plan::refusal(plan::words(found, n, entries), limit).into());
            }
            if entries > capacity {
                // Counted, not written: come back with room for exactly that many.
                capacity = entries;
                replaced = false;
                continue;
            }
            clock.executed();
            let shape = shape(entries);
            mask.read_back(shape, reserved);
            return Ok(report(n, shape, &outcome, clock.published()));
        }
    }

    /// Finds the pairs of boxes in any form, or of spheres, which are decided exactly.
    pub fn cull_objects(
        &mut self,
        objects: Objects<'_>,
        encoding: Encoding,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let limit = plan::max_boxes(encoding, &self.limits);
        let n = BoxCount::of_len(objects.len())
            .filter(|n| u64::from(n.get()) <= limit)
            .ok_or(CullError::TooManyBoxes { engine: ENGINE, n: objects.len() as u64, limit })?;
        self.gpu.health().check().map_err(|e| self.cull_error(&e))?;
        if n.get() < 2 {
            return no_pairs(n, objects, encoding, reply);
        }
        self.cull_two(n, objects, encoding, reply)
    }

    fn cull_error(&self, error: &GpuError) -> CullError {
        self.gpu.cull_error(ENGINE, error)
    }
}

/// A frame whose reply is lent for a call: however the call ends, the device is done with the reply.
struct LentRun<'a> {
    frame: &'a mut Frame,
    writes_reply: bool,
}

impl Drop for LentRun<'_> {
    fn drop(&mut self) {
        if !self.frame.settle() && self.writes_reply {
            end_process();
        }
    }
}

impl Engine for AllPairs {
    fn name(&self) -> EngineName {
        ENGINE
    }

    /// The mask is that of the f32 boxes that stand for boxes in other forms.
    fn cull(
        &mut self,
        input: &CullInput<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        self.cull_objects(input.boxes_alone(ENGINE)?.into(), input.encoding, reply)
    }
}

/// When the device counts as hung: a software adapter does some 10^8 pairs a second.
fn timeout(pairs: u64) -> Duration {
    Duration::from_secs(10 + pairs / 50_000_000)
}

const _: () = assert!(AABB_BYTES == 24, "the plan's limits count 24 bytes a box");

/// What a run said, summed over its batches.
#[derive(Debug, PartialEq, Eq)]
struct Outcome {
    census: Census,
    words: u64,
    pairs: u64,
}

impl Outcome {
    fn of(reports: &[BatchReport]) -> Self {
        let mut outcome = Self { census: Census::default(), words: 0, pairs: 0 };
        for (batch, first) in reports.iter().zip((0..).step_by(BATCH_BOXES as usize)) {
            outcome.words += u64::from(batch.words);
            outcome.pairs += u64::from(batch.pairs);
            outcome.census.empty += batch.empty;
            for (bits, put) in batch.invalid.iter().zip((0u32..).step_by(32)) {
                let census = &mut outcome.census;
                let invalid = census.invalid;
                // No more than are named are looked at one by one.
                for bit in MaskWord(*bits).bits().take(NAMED_INVALID) {
                    census.note(first + put + bit, BoxClass::Invalid);
                }
                census.invalid = invalid + bits.count_ones();
            }
        }
        outcome
    }

    const fn entries(&self, found: Found) -> u64 {
        match found {
            Found::Words => self.words,
            Found::Pairs => self.pairs,
        }
    }
}

/// The answer for fewer than two boxes: nothing for a GPU to do.
pub(in crate::execute::gpu) fn no_pairs(
    n: BoxCount,
    objects: Objects<'_>,
    encoding: Encoding,
    reply: &mut dyn ReplyBuffer,
) -> Result<CullReport, CullError> {
    let mut census = Census::default();
    for index in 0..objects.len() {
        let class = match objects {
            Objects::Boxes(boxes) => boxes.get(index).map(|b| KeyBox::classify(&b).1),
            Objects::Spheres(spheres) => spheres.get(index).map(|sphere| { *sphere }.class()),
        };
        if let Some(class) = class {
            census.note(index as u32, class);
        }
    }
    let shape = write_no_pairs(n, encoding, reply)?;
    let outcome = Outcome { census, words: 0, pairs: 0 };
    Ok(report(n, shape, &outcome, EngineTimes::default()))
}

fn report(n: BoxCount, shape: MaskShape, outcome: &Outcome, times: EngineTimes) -> CullReport {
    // Every pair is compared.
    CullReport::new(n, shape, outcome.census, outcome.pairs, n.pair_count(), times)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_add_up_and_the_first_invalid_boxes_are_named_in_order() {
        let mut reports = [BatchReport::default(); 3];
        for (batch, word, bits) in [(0, 7, 1 << 31), (1, 0, 0b101), (1, 3, u32::MAX)] {
            reports[batch].invalid[word] = bits;
        }
        reports[2] = BatchReport { words: u32::MAX, pairs: u32::MAX, empty: 9, ..reports[2] };
        reports[0].words = 1;
        let outcome = Outcome::of(&reports);
        assert_eq!((outcome.words, outcome.pairs), (1 << 32, u64::from(u32::MAX)));
        assert_eq!((outcome.census.invalid, outcome.census.empty), (35, 9));
        assert_eq!(outcome.census.first_invalid, [255, 256, 258, 352, 353, 354, 355, 356]);
        assert_eq!(Outcome::of(&[]).census, Census::default());
    }
}
