//! Frames: stages recorded once, submitted many times, waited for by spinning.
//!
//! A frame keeps its blocks, pipelines and device alive until the device is done with them. Memory
//! that a block imports is another's: who lent it takes it back when [`Frame::is_pending`] says no,
//! and not before.
#![allow(unsafe_code)]

use std::sync::Arc;
use std::time::{Duration, Instant};

use ash::vk;
use bytemuck::NoUninit;

use super::pipeline::{IMMEDIATE_BYTES, WRONG_BINDINGS};
use super::{Block, Gpu, GpuError, Order, Part, Pipeline, QueueRole};

/// One step of a frame. Each step sees all that the steps before it wrote.
pub enum Command {
    Stage {
        pipeline: Arc<Pipeline>,
        /// What it binds, from binding 0 on.
        parts: Vec<Part>,
        immediates: Vec<u8>,
        groups: [u32; 2],
    },
    Copy {
        from: Part,
        /// To here, of the same size.
        to: Part,
    },
    Fill {
        /// All of this, a multiple of four bytes.
        part: Part,
        word: u32,
    },
}

impl Command {
    /// A stage with those of `parts` that it binds by their names, the last one of a name, and its parameters.
    pub(super) fn stage(
        pipeline: Arc<Pipeline>,
        parts: &[(&str, &Part)],
        params: &impl NoUninit,
        groups: [u32; 2],
    ) -> Result<Self, GpuError> {
        let fault = GpuError::Stage { stage: pipeline.label(), why: WRONG_BINDINGS };
        let part = |name: &String| {
            let found = parts.iter().rev().find(|(known, _)| known == name);
            found.map(|(_, part)| Part::clone(part))
        };
        let parts: Option<Vec<Part>> = pipeline.bindings.iter().map(part).collect();
        let immediates = bytemuck::bytes_of(params).to_vec();
        Ok(Self::Stage { pipeline, parts: parts.ok_or(fault)?, immediates, groups })
    }

    fn label(&self) -> &'static str {
        match self {
            Self::Stage { pipeline, .. } => pipeline.label(),
            Self::Copy { .. } => "copy",
            Self::Fill { .. } => "fill",
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepTime {
    pub label: &'static str,
    pub ns: f64,
}

/// Most steps of a frame. Longer work is split, so that no submission runs into a watchdog.
pub const MAX_STEPS: usize = 40;

/// How long a frame that failed, or one that is run once, may take to end. A driver resets a device that hangs within seconds;
/// what it does not end by then it never does.
const LAST_TIMEOUT: Duration = Duration::from_secs(10);

const MAX_BINDINGS: u32 = 9;

pub struct Frame {
    gpu: Arc<Gpu>,
    role: QueueRole,
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    descriptors: vk::DescriptorPool,
    fence: vk::Fence,
    /// Timestamps before the first step and after each, in a profiled frame.
    queries: Option<vk::QueryPool>,
    steps: Vec<Command>,
    pending: bool,
}

// SAFETY: the handles are used through `&mut self` only, so by one thread at a time.
unsafe impl Send for Frame {}

impl Frame {
    /// An empty frame. `profiled` frames take timestamps, which costs about a microsecond a step.
    pub fn new(gpu: &Arc<Gpu>, profiled: bool) -> Result<Self, GpuError> {
        Self::of_role(gpu, QueueRole::Frames, profiled)
    }

    pub(super) fn of_role(
        gpu: &Arc<Gpu>,
        role: QueueRole,
        profiled: bool,
    ) -> Result<Self, GpuError> {
        let raw = &gpu.raw;
        let family = gpu.family(role).ok_or(GpuError::Lost)?;
        let mut frame = Self {
            gpu: Arc::clone(gpu),
            role,
            pool: vk::CommandPool::null(),
            commands: vk::CommandBuffer::null(),
            descriptors: vk::DescriptorPool::null(),
            fence: vk::Fence::null(),
            queries: None,
            steps: Vec::new(),
            pending: false,
        };
        let info = vk::CommandPoolCreateInfo::default()
            .queue_family_index(family)
            .flags(vk::CommandPoolCreateFlags::RESET_COMMAND_BUFFER);
        // SAFETY: the device outlives the frame (`gpu`); `frame` destroys what was made, also when
        // a later step fails. The same holds for the calls below.
        frame.pool = gpu.noticed(unsafe { raw.create_command_pool(&info, None) })?;
        let info = vk::CommandBufferAllocateInfo::default()
            .command_pool(frame.pool)
            .level(vk::CommandBufferLevel::PRIMARY)
            .command_buffer_count(1);
        // SAFETY: the pool was made above; the buffer goes with it.
        let made = gpu.noticed(unsafe { raw.allocate_command_buffers(&info) })?;
        frame.commands = made.first().copied().unwrap_or_default();
        let sizes = [vk::DescriptorPoolSize::default()
            .ty(vk::DescriptorType::STORAGE_BUFFER)
            .descriptor_count(MAX_STEPS as u32 * MAX_BINDINGS)];
        let info =
            vk::DescriptorPoolCreateInfo::default().max_sets(MAX_STEPS as u32).pool_sizes(&sizes);
        // SAFETY: as above.
        frame.descriptors = gpu.noticed(unsafe { raw.create_descriptor_pool(&info, None) })?;
        // SAFETY: as above.
        frame.fence =
            gpu.noticed(unsafe { raw.create_fence(&vk::FenceCreateInfo::default(), None) })?;
        if profiled {
            let info = vk::QueryPoolCreateInfo::default()
                .query_type(vk::QueryType::TIMESTAMP)
                .query_count(MAX_STEPS as u32 + 1);
            // SAFETY: as above.
            frame.queries = Some(gpu.noticed(unsafe { raw.create_query_pool(&info, None) })?);
        }
        Ok(frame)
    }

    /// Records steps in place of the former ones.
    ///
    /// # Panics
    /// With more than [`MAX_STEPS`] steps, a binding too many or too large immediates.
    pub fn record(&mut self, steps: Vec<Command>) -> Result<(), GpuError> {
        self.record_side_by_side(vec![steps])
    }

    /// Records the steps of several frames, none of which uses what another one writes, in place of the
    /// former ones: all first steps, then all second ones, and so on. A barrier is then waited for once
    /// for all of them, and what waits for the link in one frame is covered by the others. Panics beyond
    /// [`MAX_STEPS`] steps of all together, and with several frames where steps are timed.
    pub(super) fn record_side_by_side(
        &mut self,
        frames: Vec<Vec<Command>>,
    ) -> Result<(), GpuError> {
        assert!(frames.iter().map(Vec::len).sum::<usize>() <= MAX_STEPS && !self.pending);
        assert!(frames.len() <= 1 || self.queries.is_none());
        self.steps.clear();
        let (raw, gpu) = (&self.gpu.raw, &self.gpu);
        let commands = self.commands;
        // SAFETY: the frame is not pending, so neither the descriptors nor the commands are in
        // use; a command buffer of this pool may be begun again, which resets it.
        unsafe {
            gpu.noticed(
                raw.reset_descriptor_pool(self.descriptors, vk::DescriptorPoolResetFlags::empty()),
            )?;
            let begin = vk::CommandBufferBeginInfo::default();
            gpu.noticed(raw.begin_command_buffer(commands, &begin))?;
            if let Some(queries) = self.queries {
                raw.cmd_reset_query_pool(commands, queries, 0, MAX_STEPS as u32 + 1);
                let stage = vk::PipelineStageFlags::TOP_OF_PIPE;
                raw.cmd_write_timestamp(commands, stage, queries, 0);
            }
        }
        let rounds = frames.iter().map(Vec::len).max().unwrap_or(0);
        for round in 0..rounds {
            if round > 0 {
                self.barrier(vk::PipelineStageFlags::COMPUTE_SHADER, vk::AccessFlags::SHADER_READ);
            }
            for step in frames.iter().filter_map(|steps| steps.get(round)) {
                self.record_step(step)?;
            }
            if let Some(queries) = self.queries {
                let stage = vk::PipelineStageFlags::BOTTOM_OF_PIPE;
                // SAFETY: the pool has a query for each step.
                unsafe { raw.cmd_write_timestamp(commands, stage, queries, round as u32 + 1) };
            }
        }
        self.barrier(vk::PipelineStageFlags::HOST, vk::AccessFlags::HOST_READ);
        // SAFETY: recording was begun above.
        gpu.noticed(unsafe { raw.end_command_buffer(commands) })?;
        self.steps = frames.into_iter().flatten().collect();
        Ok(())
    }

    pub(super) fn run_once(gpu: &Arc<Gpu>, steps: Vec<Command>) -> Result<(), GpuError> {
        let mut frame = Self::new(gpu, false)?;
        frame.record(steps)?;
        frame.run(LAST_TIMEOUT)
    }

    pub(super) fn fill<'a>(
        gpu: &Arc<Gpu>,
        blocks: impl IntoIterator<Item = &'a Arc<Block>>,
        word: u32,
    ) -> Result<(), GpuError> {
        let fill = |block: &Arc<Block>| Command::Fill { part: Part::whole(block), word };
        Self::run_once(gpu, blocks.into_iter().map(fill).collect())
    }

    /// Drops the steps of a frame that is recorded anew before the next submission.
    pub(super) fn discard_steps(&mut self) {
        if !self.pending {
            self.steps.clear();
        }
    }

    /// What came before is done, and visible to what comes after.
    fn barrier(&self, next: vk::PipelineStageFlags, access: vk::AccessFlags) {
        if self.role == QueueRole::Upload {
            // Such a queue knows no stage but copies, and its one copy waits for nothing: the
            // semaphore orders it before the frame.
            return;
        }
        let work = vk::PipelineStageFlags::COMPUTE_SHADER | vk::PipelineStageFlags::TRANSFER;
        let written = vk::AccessFlags::SHADER_WRITE | vk::AccessFlags::TRANSFER_WRITE;
        let memory = [vk::MemoryBarrier::default()
            .src_access_mask(written)
            .dst_access_mask(access | written | vk::AccessFlags::TRANSFER_READ)];
        // SAFETY: called while recording.
        unsafe {
            self.gpu.raw.cmd_pipeline_barrier(
                self.commands,
                work,
                next | work,
                vk::DependencyFlags::empty(),
                &memory,
                &[],
                &[],
            );
        }
    }

    fn record_step(&self, step: &Command) -> Result<(), GpuError> {
        let raw = &self.gpu.raw;
        match step {
            Command::Copy { from, to } => {
                assert_eq!(from.bytes, to.bytes, "a copy keeps its size");
                let region = [vk::BufferCopy::default()
                    .src_offset(from.offset)
                    .dst_offset(to.offset)
                    .size(from.bytes)];
                let (from, to) = (from.block.buffer, to.block.buffer);
                // SAFETY: both parts lie in blocks that the frame keeps alive.
                unsafe { raw.cmd_copy_buffer(self.commands, from, to, &region) };
            }
            Command::Fill { part, word } => {
                let (buffer, offset, bytes) = (part.block.buffer, part.offset, part.bytes);
                // SAFETY: the part lies in a block that the frame keeps alive.
                unsafe { raw.cmd_fill_buffer(self.commands, buffer, offset, bytes, *word) };
            }
            Command::Stage { pipeline, parts, immediates, groups } => {
                assert_eq!(parts.len(), pipeline.bindings.len(), "one part a binding");
                assert!(immediates.len() <= IMMEDIATE_BYTES as usize);
                let set_layouts = [pipeline.set_layout];
                let info = vk::DescriptorSetAllocateInfo::default()
                    .descriptor_pool(self.descriptors)
                    .set_layouts(&set_layouts);
                // SAFETY: the pool holds MAX_STEPS sets of MAX_BINDINGS each.
                let sets = self.gpu.noticed(unsafe { raw.allocate_descriptor_sets(&info) })?;
                let set = sets.first().copied().unwrap_or_default();
                let buffers: Vec<_> = parts
                    .iter()
                    .map(|part| {
                        [vk::DescriptorBufferInfo::default()
                            .buffer(part.block.buffer)
                            .offset(part.offset)
                            .range(part.bytes)]
                    })
                    .collect();
                let writes: Vec<_> = buffers
                    .iter()
                    .zip(0u32..)
                    .map(|(buffer, binding)| {
                        vk::WriteDescriptorSet::default()
                            .dst_set(set)
                            .dst_binding(binding)
                            .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                            .buffer_info(buffer)
                    })
                    .collect();
                let point = vk::PipelineBindPoint::COMPUTE;
                // SAFETY: the parts lie in blocks, the pipeline and the set are alive as long as
                // the frame; the set has the pipeline's layout.
                unsafe {
                    raw.update_descriptor_sets(&writes, &[]);
                    raw.cmd_bind_pipeline(self.commands, point, pipeline.raw);
                    let layout = pipeline.layout;
                    raw.cmd_bind_descriptor_sets(self.commands, point, layout, 0, &sets, &[]);
                    let stage = vk::ShaderStageFlags::COMPUTE;
                    raw.cmd_push_constants(self.commands, layout, stage, 0, immediates);
                    raw.cmd_dispatch(self.commands, groups[0], groups[1], 1);
                }
            }
        }
        Ok(())
    }

    /// Submits the frame and waits for its end, `timeout` at most ([`GpuError::Hung`]).
    ///
    /// # Panics
    /// While it is under way.
    pub fn run(&mut self, timeout: Duration) -> Result<(), GpuError> {
        self.submit_in(Order::default())?;
        self.end(timeout)
    }

    /// Submits the frame before or after one of another queue. Nothing that it uses may be touched until
    /// it has ended. Panics while it is under way.
    pub(super) fn submit_in(&mut self, order: Order) -> Result<(), GpuError> {
        assert!(!self.pending, "a frame is under way once");
        // SAFETY: the frame is not pending, so its fence is not in use.
        self.gpu.noticed(unsafe { self.gpu.raw.reset_fences(&[self.fence]) })?;
        self.gpu.submit(self.role, self.commands, order, self.fence)?;
        self.pending = true;
        Ok(())
    }

    /// Whether the device may still use what the frame has: its end was not seen yet.
    pub fn is_pending(&self) -> bool {
        self.pending
    }

    /// Whether a submitted frame has ended, or never will.
    pub(super) fn has_ended(&self) -> bool {
        // SAFETY: the fence belongs to this device.
        !self.pending || unsafe { self.gpu.raw.get_fence_status(self.fence) } != Ok(false)
    }

    /// Waits for the end of a submitted frame, `timeout` at most.
    ///
    /// Where the wait fails, the frame is given [`LAST_TIMEOUT`] more: a device that was given up
    /// while it works must not write into memory that its owner takes back. One that does not end
    /// even then stays pending, for ever.
    pub(super) fn end(&mut self, timeout: Duration) -> Result<(), GpuError> {
        match self.wait(timeout) {
            Ok(()) => {
                self.pending = false;
                self.gpu.health().check()
            }
            Err(error) => {
                self.settle();
                Err(error)
            }
        }
    }

    /// Asks again and again: 15 µs less than sleeping, for the price of a core meanwhile. Software adapters need the
    /// core, and nobody waits for what keeps the clocks up.
    fn wait(&self, timeout: Duration) -> Result<(), GpuError> {
        let raw = &self.gpu.raw;
        let sleeps = self.gpu.is_software() || self.role == QueueRole::Awake;
        let start = Instant::now();
        loop {
            let ended = if sleeps {
                let slice = Duration::from_millis(20).as_nanos() as u64;
                // SAFETY: the fence belongs to this device.
                match unsafe { raw.wait_for_fences(&[self.fence], true, slice) } {
                    Ok(()) => Ok(true),
                    Err(vk::Result::TIMEOUT) => Ok(false),
                    Err(error) => Err(error),
                }
            } else {
                // The clock and the health are looked at now and then only.
                (0..256).try_fold(false, |ended, _| {
                    if ended {
                        return Ok(true);
                    }
                    std::hint::spin_loop();
                    // SAFETY: as above.
                    unsafe { raw.get_fence_status(self.fence) }
                })
            };
            if self.gpu.noticed(ended)? {
                return Ok(());
            }
            self.gpu.health().check()?;
            if start.elapsed() > timeout {
                return Err(GpuError::Hung);
            }
        }
    }

    /// Waits for a frame whose answer is not needed any more, [`LAST_TIMEOUT`] at most. Whether the
    /// device is done with it, so that it may be submitted, and its memory taken back.
    pub(super) fn settle(&mut self) -> bool {
        if !self.pending {
            return true;
        }
        let slice = LAST_TIMEOUT.as_nanos() as u64;
        // SAFETY: the fence belongs to this device.
        let settled = unsafe { self.gpu.raw.wait_for_fences(&[self.fence], true, slice) };
        // A driver reports a loss, at once, when the device works no more. Any other error says
        // nothing about the frame.
        self.pending = !matches!(settled, Ok(()) | Err(vk::Result::ERROR_DEVICE_LOST));
        !self.pending
    }

    pub fn step_times(&self) -> Result<Vec<StepTime>, GpuError> {
        let Some(queries) = self.queries else { return Ok(Vec::new()) };
        let mut ticks = vec![0u64; self.steps.len() + 1];
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        // SAFETY: the frame has ended, so all of its queries are written.
        self.gpu.noticed(unsafe {
            self.gpu.raw.get_query_pool_results(queries, 0, &mut ticks, flags)
        })?;
        let period = f64::from(self.gpu.limits().timestamp_period_ns);
        let ns = ticks.windows(2).map(|t| t[1].saturating_sub(t[0]) as f64 * period);
        Ok(self.steps.iter().zip(ns).map(|(s, ns)| StepTime { label: s.label(), ns }).collect())
    }
}

impl Drop for Frame {
    fn drop(&mut self) {
        if !self.settle() {
            // The device hangs with our memory in its hands: leaking it is the only safe end.
            log::error!("a GPU frame never ended; its memory is left to the device");
            std::mem::forget(std::mem::take(&mut self.steps));
            std::mem::forget(Arc::clone(&self.gpu));
            return;
        }
        let raw = &self.gpu.raw;
        // SAFETY: the frame has ended; null handles are ignored.
        unsafe {
            raw.destroy_command_pool(self.pool, None);
            raw.destroy_descriptor_pool(self.descriptors, None);
            raw.destroy_fence(self.fence, None);
            if let Some(queries) = self.queries {
                raw.destroy_query_pool(queries, None);
            }
        }
    }
}
