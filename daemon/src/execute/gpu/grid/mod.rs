//! Engine `gpu-grid`: a uniform grid with levels on the GPU (GPU.md, "The grid").
//!
//! The grid of Avril et al. 2012, §4, as `cpu-grid` has it: each box has one home cell, by its min corner, in the finest
//! level on which it spans at most two cells an axis. Scenes that crowd a cell beyond a budget, or dense masks, are the
//! all-pairs engine's.

mod axis;
pub(super) mod layout;
pub mod plan;
mod ruled;
mod sample;
mod steps;
mod under_way;
mod workspace;

pub use self::ruled::takes_worlds;
pub use self::under_way::GridUnderWay;

use std::sync::{Arc, Mutex};

use pairmask_core::cancel::Cancel;
use pairmask_core::dispatch::Marks;
use pairmask_core::engine::{CullError, CullInput, CullReport, Engine, ReplyBuffer};
use pairmask_core::objects::Objects;
use pairmask_core::{BoxCount, BoxForm, Encoding, EngineName};
use pairmask_shaders::layouts::GridLayout;
use pairmask_shaders::{Found, GridStage, Rules, Stage};

use self::layout::Chooser;
use self::plan::LastFound;
use self::under_way::{Bundle, SharedWorkspace};
use self::workspace::{Ended, Requested, Tools, Workspace};
use super::all_pairs::no_pairs;
use super::all_pairs::plan::refusal;
use super::{
    Block, Capacity, Command, EngineOptions, Gpu, GpuError, MAX_STEPS, SUBMISSIONS, Sizes, StepTime,
};
use crate::execute::FrameMemory;
use crate::execute::frame_memory::Borrowed;
use crate::locked;

/// The levels that a scene gets. For measurements, and for the stages' mirror.
pub fn grid_layout<'a>(objects: impl Into<Objects<'a>>) -> GridLayout {
    Chooser::default().choose(objects)
}

const ENGINE: EngineName = EngineName::GpuGrid;

/// Most frames of a bundle: about as many as the steps of a submission hold. More would gain little,
/// since the link and the CPU are busy by then.
pub const BUNDLE_FRAMES: usize = 6;

const _: () = assert!(BUNDLE_FRAMES * GridStage::COUNT <= MAX_STEPS);

pub type Begun<M> = Result<GridUnderWay<M>, (CullError, Option<M>)>;

/// The engine. One thread uses it, for one frame at a time ([`Engine::cull`]) or for some submissions of
/// one frame or of several ([`Grid::begin`], [`Grid::begin_bundle`]), whose frames end in any order
/// ([`Grid::end`]).
pub struct Grid {
    tools: Tools,
    /// Those of each submission that may be under way. A frame that is alone takes the first.
    workspaces: [[SharedWorkspace; BUNDLE_FRAMES]; SUBMISSIONS],
    /// That of a frame that is waited for at once, regardless of what is under way.
    own_workspace: SharedWorkspace,
    bundles: Vec<Bundle>,
}

impl Grid {
    /// With the stages of whole frames of boxes compiled; those of spheres are when one comes.
    pub fn new(gpu: &Arc<Gpu>, options: &EngineOptions) -> Result<Self, GpuError> {
        let forms = Found::ALL.into_iter().flat_map(|found| BoxForm::ALL.map(|form| (form, found)));
        let stages =
            forms.flat_map(|(form, found)| GridStage::of_frame(form.into(), found, Rules::Without));
        let pipelines = options.pipelines(gpu, stages.map(Stage::Grid))?;
        let workspace = || Workspace::new(gpu, options).map(|made| Arc::new(Mutex::new(made)));
        Ok(Self {
            workspaces: try_array(|| try_array(workspace))?,
            own_workspace: workspace()?,
            bundles: Vec::with_capacity(SUBMISSIONS),
            tools: Tools {
                gpu: Arc::clone(gpu),
                pipelines,
                chooser: Chooser::default(),
                last_found: LastFound::default(),
                profiled: options.profiled,
                step_times: Vec::new(),
                poison: options.poison,
                binding_bytes: gpu.limits().binding_bytes(),
            },
        })
    }

    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.tools.gpu
    }

    pub(in crate::execute) fn drop_frames_of(&mut self, block: &Arc<Block>) {
        for workspace in self.all_workspaces() {
            locked(workspace).drop_frames_of(block);
        }
    }

    /// Times of the last frame's steps, in order, if the engine is profiled.
    pub fn step_times(&self) -> &[StepTime] {
        &self.tools.step_times
    }

    pub fn begin<M: FrameMemory>(&mut self, memory: M, encoding: Encoding) -> Begun<M> {
        match self.free_workspaces() {
            Some([workspace, ..]) => self.begin_in(workspace, memory, encoding, None),
            None => Err((NONE_FREE, Some(memory))),
        }
    }

    fn begin_in<M: FrameMemory>(
        &mut self,
        workspace: SharedWorkspace,
        memory: M,
        encoding: Encoding,
        marks: Option<&Arc<Marks>>,
    ) -> Begun<M> {
        let is_behind = self.all_workspaces().any(|workspace| !locked(workspace).is_free());
        let mut frame = GridUnderWay::new(workspace, memory);
        let begun = frame.with(|workspace, objects, reply| {
            let (n, capacity) = self.asked(objects.len(), encoding, reply)?;
            if marks.is_none() {
                objects.check_room(encoding, reply)?;
            }
            let requested = Requested { n, objects, capacity, is_behind, marks };
            workspace.begin(&mut self.tools, &requested, reply)
        });
        match begun {
            Ok(()) => Ok(frame),
            Err(error) => Err((error, frame.give_up())),
        }
    }

    /// Starts frames in one submission, with the answers of frames that are begun one by one.
    ///
    /// # Panics
    /// With more than [`BUNDLE_FRAMES`], and where steps are timed.
    pub fn begin_bundle<M: FrameMemory>(&mut self, frames: Vec<(M, Encoding)>) -> Vec<Begun<M>> {
        assert!(frames.len() <= BUNDLE_FRAMES, "{} frames", frames.len());
        let Some(workspaces) = self.free_workspaces() else {
            return frames.into_iter().map(|(memory, _)| Err((NONE_FREE, Some(memory)))).collect();
        };
        let bundle = match self.free_bundle() {
            Ok(bundle) => bundle,
            Err(error) => {
                let error = self.tools.gpu.cull_error(ENGINE, &error);
                let unserved = |(memory, _)| Err((error.clone(), Some(memory)));
                return frames.into_iter().map(unserved).collect();
            }
        };
        let mut steps: Vec<Vec<Command>> = Vec::with_capacity(frames.len());
        let mut begun = Vec::with_capacity(frames.len());
        for (workspace, (memory, encoding)) in workspaces.into_iter().zip(frames) {
            let mut frame = GridUnderWay::new(workspace, memory);
            let joined = frame.with(|workspace, objects, reply| {
                let (n, capacity) = self.asked(objects.len(), encoding, reply)?;
                objects.check_room(encoding, reply)?;
                let requested = Requested { n, objects, capacity, is_behind: false, marks: None };
                workspace.join(&mut self.tools, &requested, reply, &bundle)
            });
            begun.push(match joined {
                Ok(its_steps) => {
                    steps.push(its_steps);
                    Ok(frame)
                }
                Err(error) => Err((error, frame.give_up())),
            });
        }
        if let Err(error) = bundle.submit(steps) {
            let error = self.tools.gpu.cull_error(ENGINE, &error);
            let give_up = |frame: GridUnderWay<M>| Err((error.clone(), frame.give_up()));
            return begun.into_iter().map(|frame| frame.and_then(give_up)).collect();
        }
        begun
    }

    fn all_workspaces(&self) -> impl Iterator<Item = &SharedWorkspace> {
        self.workspaces.as_flattened().iter().chain([&self.own_workspace])
    }

    fn free_workspaces(&self) -> Option<[SharedWorkspace; BUNDLE_FRAMES]> {
        let is_free = |workspaces: &&[SharedWorkspace; BUNDLE_FRAMES]| {
            workspaces.iter().all(|workspace| locked(workspace).is_free())
        };
        self.workspaces.iter().find(is_free).cloned()
    }

    fn free_bundle(&mut self) -> Result<Bundle, GpuError> {
        if let Some(bundle) = self.bundles.iter().find(|bundle| bundle.is_free()) {
            return Ok(bundle.clone());
        }
        let bundle = Bundle::new(self.gpu())?;
        self.bundles.push(bundle.clone());
        Ok(bundle)
    }

    fn asked(
        &self,
        len: usize,
        encoding: Encoding,
        reply: &dyn ReplyBuffer,
    ) -> Result<(BoxCount, Capacity), CullError> {
        let limit = plan::max_boxes(self.tools.binding_bytes);
        let n = BoxCount::of_len(len)
            .filter(|n| u64::from(n.get()) <= limit)
            .ok_or(CullError::TooManyBoxes { engine: ENGINE, n: len as u64, limit })?;
        let why = "dense masks are all pairs'";
        let unavailable = CullError::Unavailable { engine: ENGINE, why };
        let found = Found::of(encoding).ok_or(unavailable)?;
        self.gpu().health().check().map_err(|e| self.tools.gpu.cull_error(ENGINE, &e))?;
        let limit = reply.limit_words();
        let room = plan::room(n, found, limit).ok_or_else(|| no_room(n, found, limit))?;
        Ok((n, self.capacity(n, found, self.tools.last_found.of(found), room)))
    }

    fn capacity(&self, n: BoxCount, found: Found, last_entries: u64, room: u64) -> Capacity {
        let bound = plan::room(n, found, self.tools.binding_bytes / 4).unwrap_or(0);
        Capacity::expected(n, found, last_entries, room.min(bound.max(last_entries)))
    }

    /// Waits for a frame and gives its memory back. The memory is `None` where the GPU keeps it, after
    /// [`CullError::DeviceLost`]. A frame of another engine is given up: its device is lost.
    pub fn end<M: FrameMemory>(
        &mut self,
        mut frame: GridUnderWay<M>,
    ) -> (Result<CullReport, CullError>, Option<M>) {
        (self.wait_for(&mut frame), frame.give_up())
    }

    /// As [`Self::end`], but the frame keeps the memory.
    pub(in crate::execute) fn wait_for<M: FrameMemory>(
        &mut self,
        frame: &mut GridUnderWay<M>,
    ) -> Result<CullReport, CullError> {
        if !self.all_workspaces().any(|workspace| frame.is_in(workspace)) {
            return Err(CullError::DeviceLost { engine: ENGINE });
        }
        frame.with(|workspace, objects, reply| self.end_in(workspace, objects, reply))
    }

    fn end_in(
        &mut self,
        workspace: &mut Workspace,
        objects: Objects<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        loop {
            match workspace.end(&mut self.tools, reply)? {
                Ended::Report(report) => return Ok(report),
                Ended::Again { n, found, entries, marks } => {
                    // Counted, not written: come back with room for that many.
                    let limit = reply.limit_words();
                    let room = plan::room(n, found, limit).filter(|room| entries <= *room);
                    let Some(room) = room else {
                        let needed = Sizes::of(n).reply_words(Capacity { found, entries });
                        return Err(refusal(needed, limit).into());
                    };
                    if Cancel::by(reply.asker()).look() {
                        return Err(CullError::Cancelled);
                    }
                    let capacity = self.capacity(n, found, entries, room);
                    let marks = marks.as_ref();
                    let requested = Requested { n, objects, capacity, is_behind: false, marks };
                    workspace.begin(&mut self.tools, &requested, reply)?;
                }
            }
        }
    }

    /// Finds the pairs of boxes in any form, or of spheres, which are decided exactly: the boxes around them have cells.
    pub fn cull_objects(
        &mut self,
        objects: Objects<'_>,
        encoding: Encoding,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        match BoxCount::of_len(objects.len()) {
            Some(n) if n.get() < 2 && Found::of(encoding).is_some() => {
                no_pairs(n, objects, encoding, reply)
            }
            _ => {
                let memory = Borrowed { objects, reply };
                let workspace = self.own_workspace.clone();
                let frame = self.begin_in(workspace, memory, encoding, None);
                self.end(frame.map_err(|(error, _)| error)?).0
            }
        }
    }
}

impl Engine for Grid {
    fn name(&self) -> EngineName {
        ENGINE
    }

    /// The mask is that of the f32 boxes that stand for boxes in other forms. Dense masks are refused
    /// ([`CullError::Unavailable`]): all pairs writes them faster. Crowds are, too
    /// ([`CullError::TooCrowded`]).
    fn cull(
        &mut self,
        input: &CullInput<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        self.cull_objects(input.boxes_alone(ENGINE)?.into(), input.encoding, reply)
    }
}

const NONE_FREE: CullError =
    CullError::Unavailable { engine: ENGINE, why: "all of its submissions are under way" };

fn try_array<T, const N: usize>(
    mut make: impl FnMut() -> Result<T, GpuError>,
) -> Result<[T; N], GpuError> {
    let made = (0..N).map(|_| make()).collect::<Result<Vec<T>, _>>()?;
    // There are N of them.
    made.try_into().map_err(|_| GpuError::Lost)
}

fn no_room(n: BoxCount, found: Found, limit_words: u64) -> CullError {
    match found {
        // All pairs needs no room for an order.
        Found::Words => CullError::TooCrowded { engine: ENGINE },
        Found::Pairs => {
            let needed = Sizes::of(n).reply_words(Capacity { found, entries: 1 });
            refusal(needed, limit_words).into()
        }
    }
}
