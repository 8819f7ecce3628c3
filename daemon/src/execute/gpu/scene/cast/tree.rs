//! A tree of a scene's boxes in video memory, which stages of the GPU bring up to date and search. The order of its places is
//! the host's; it stays until too many groups have grown too much.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use pairmask_core::Aabb;
use pairmask_core::cast::{Hits, Shapes, near_order};
use pairmask_shaders::constants::CAST_LANES;
use pairmask_shaders::layouts::{CastGroupsParams, CastParams};
use pairmask_shaders::{SceneStage, Stage};

use super::copy::{Record, box_of_keys};
use super::plan::{self, Levels};
use crate::execute::gpu::scene::plan::groups;
use crate::execute::gpu::scene::search::TIMEOUT;
use crate::execute::gpu::scene::upload::Staging;
use crate::execute::gpu::{
    Block, BlockOffset, Command, Frame, FrameCache, GpuError, Growing, Home, Order, Part,
    QueueRole, SceneTools, frame_blocks,
};
use crate::locked;

/// Most of the closest boxes of each: a search has room for those, and for as many again that are as near.
pub(super) const MOST_CLOSEST: u32 = 32;
/// Steps that all searches of a submission may take, of two groups each: some 100 ms of a large GPU. What is left is the
/// cores'.
const ALL_STEPS: u32 = 1 << 26;
/// Steps that one search may take: some 100 ms, and so few that those of all fit into 32 bits.
const STEPS: u32 = 1 << 17;
/// Bytes of an item of the tree, of a candidate, and of an answer.
const ITEM_BYTES: u64 = 32;
const CANDIDATE_BYTES: u64 = size_of::<Record>() as u64;
const ANSWER_BYTES: u64 = size_of::<Answer>() as u64;
/// Candidates of a ray or a sphere that there is room for at first, beside those asked for: a head, and what is as near.
const SPARE_CANDIDATES: u64 = 4;
/// Most candidates of a submission, 256 MiB of host memory. What has more is the cores'.
const MOST_CANDIDATES: u64 = 1 << 23;
/// The order is found anew when more than one leaf in so many has grown too much.
const LOOSE_SHARE: u64 = 4;

/// Words of the control block: leaves that have grown too much, candidates with their heads, steps.
type Control = [u32; 3];
/// Where the last list of a search is, and 0 if it has all candidates.
type Answer = [u32; 2];
const NO_LIST: u32 = u32::MAX;

frame_blocks! { Scratch, Parts:
    params in Host,
    order in Video,
    items in Video,
    edges in Video,
    control in Video,
    summary in Host,
    answers in Host,
    candidates in Host,
}

/// What a recording depends on, but for blocks that are kept until all recordings are dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Shape {
    levels: Levels,
    /// Whether boxes are brought to where they are now first.
    follows: bool,
    stage: SceneStage,
    groups: u32,
    now: BlockOffset,
    questions: BlockOffset,
}

pub(in crate::execute::gpu::scene) struct DeviceTree {
    scratch: Scratch,
    questions: Staging,
    frames: FrameCache<Shape>,
    /// Places whose index the order says; `None` where it is to be found.
    ordered: Option<u32>,
    /// Whether the edges of leaves in this order are noted.
    is_built: bool,
    /// Whether boxes are where they are now.
    is_current: bool,
    /// Candidates that the last search had.
    last_candidates: u64,
}

/// What a search left to decide.
pub(in crate::execute::gpu::scene) struct Found {
    answers: Vec<Answer>,
    candidates: Part,
    /// Candidates with their heads.
    count: u32,
    slots: u32,
    is_wrong: AtomicBool,
    /// Boxes and groups that were looked at.
    pub looked_at: u64,
}

impl DeviceTree {
    pub fn new(tools: &SceneTools) -> Self {
        let params = Growing::new(Home::written(tools.gpu()));
        Self {
            scratch: Scratch { params, ..Scratch::new() },
            questions: Staging::default(),
            frames: FrameCache::new(QueueRole::Frames),
            ordered: None,
            is_built: false,
            is_current: false,
            last_candidates: 0,
        }
    }

    /// Bytes that are allocated, in video memory for the most part.
    pub fn bytes(&self) -> u64 {
        let Scratch { params, order, items, edges, control, summary, answers, candidates } =
            &self.scratch;
        let all = [params, order, items, edges, control, summary, answers, candidates];
        all.into_iter().map(Growing::held_bytes).sum()
    }

    /// Notes that boxes have changed.
    pub const fn note_edit(&mut self) {
        self.is_current = false;
    }

    pub const fn needs_order(&self) -> bool {
        self.ordered.is_none()
    }

    /// Puts boxes, index by index, in order.
    pub fn put_in_order(
        &mut self,
        tools: &SceneTools,
        boxes: &[Aabb],
        threads: usize,
    ) -> Result<(), GpuError> {
        let order = near_order(boxes, threads);
        let bytes = size_of_val(&order[..]) as u64;
        let mut replaced = false;
        let to = self.scratch.order.part(tools.gpu(), bytes, &mut replaced)?;
        if bytes > 0 {
            let staged = Block::new(tools.gpu(), Home::Host, bytes)?;
            staged.write(0, &order);
            let from = Part::of(&staged, 0, bytes);
            Frame::run_once(tools.gpu(), vec![Command::Copy { from, to }])?;
        }
        if replaced {
            self.frames.clear();
        }
        self.ordered = Some(order.len() as u32);
        (self.is_built, self.is_current) = (false, false);
        Ok(())
    }

    /// Looks for the boxes of records that shapes may hit. `None` where there are too many.
    pub fn search(
        &mut self,
        tools: &SceneTools,
        now: &Arc<Block>,
        slots: u32,
        shapes: Shapes<'_>,
        hits: Hits,
        threads: usize,
    ) -> Result<Option<Found>, GpuError> {
        let gpu = tools.gpu();
        let ordered = self.ordered.unwrap_or(0);
        let levels = Levels::of(ordered.max(slots));
        let closest = if let Hits::Closest(most) = hits { most } else { 0 };
        let expected = shapes.len() as u64 * (u64::from(closest) + SPARE_CANDIDATES);
        let mut room = expected.max(self.last_candidates + self.last_candidates / 4);
        let now = Part::of(now, 0, now.bytes().min(tools.binding_bytes));
        let mut replaced = false;
        let (questions, stage) = match shapes {
            Shapes::Rays(rays) => {
                (self.questions.copied(gpu, rays, threads, &mut replaced)?, SceneStage::CastRays)
            }
            Shapes::Spheres(spheres) => {
                let copied = self.questions.copied(gpu, spheres, threads, &mut replaced)?;
                (copied, SceneStage::CastSpheres)
            }
        };
        if replaced {
            self.frames.clear();
        }
        while room <= MOST_CANDIDATES {
            let parts = self.parts(tools, &levels, room, shapes.len() as u64)?;
            let room_made = (parts.candidates.bytes / CANDIDATE_BYTES) as u32;
            parts.params.block.write(
                0,
                &[CastParams {
                    slots,
                    ordered,
                    is_built: u32::from(!self.is_built),
                    queries: shapes.len() as u32,
                    closest,
                    any: u32::from(hits == Hits::Any),
                    room: room_made,
                    all_steps: ALL_STEPS,
                    steps: STEPS,
                    thread_rounds: gpu.limits().thread_rounds,
                    top: levels.top,
                    padding: 0,
                    levels: levels.layout(),
                }],
            );
            let shape = Shape {
                levels,
                follows: !self.is_current,
                stage,
                groups: plan::groups(shapes.len()),
                now: BlockOffset::of(&now),
                questions: BlockOffset::of(&questions),
            };
            let steps = || steps(tools, &shape, &parts, &now, &questions);
            let frame = self.frames.frame(gpu, shape, tools.profiled, steps)?;
            frame.submit_in(Order::default())?;
            frame.end(TIMEOUT[usize::from(gpu.is_software())])?;
            let mut summary: [Control; 1] = [[0; 3]];
            parts.summary.block.read(0, &mut summary);
            let [[loose, count, steps]] = summary;
            if shape.follows {
                self.is_current = true;
                let was_built = std::mem::replace(&mut self.is_built, true);
                if was_built && u64::from(loose) * LOOSE_SHARE > levels.leaves() {
                    // For the next search: this one is right.
                    self.ordered = None;
                }
            }
            self.last_candidates = count.into();
            if count <= room_made {
                let mut answers = vec![[0; 2]; shapes.len()];
                parts.answers.block.read(0, &mut answers);
                return Ok(Some(Found {
                    answers,
                    candidates: parts.candidates,
                    count,
                    slots,
                    is_wrong: AtomicBool::new(false),
                    looked_at: u64::from(steps) * u64::from(CAST_LANES),
                }));
            }
            room = u64::from(count);
        }
        self.last_candidates = 0;
        Ok(None)
    }

    /// Blocks of which none is smaller than is needed. Where some are others, recordings are dropped, and what boxes were
    /// when the order was found is noted anew.
    fn parts(
        &mut self,
        tools: &SceneTools,
        levels: &Levels,
        room: u64,
        queries: u64,
    ) -> Result<Parts, GpuError> {
        let most = tools.binding_bytes;
        let mut replaced = false;
        let mut part = |growing: &mut Growing, bytes: u64| {
            if bytes > most {
                return Err(GpuError::OutOfMemory { bytes });
            }
            let block = growing.at_least(tools.gpu(), bytes.max(1), u64::MAX, &mut replaced)?;
            Ok(Part::of(block, 0, block.bytes().min(most)))
        };
        let s = &mut self.scratch;
        let parts = Parts {
            params: part(&mut s.params, size_of::<CastParams>() as u64)?,
            order: part(&mut s.order, 0)?,
            items: part(&mut s.items, ITEM_BYTES * levels.items())?,
            edges: part(&mut s.edges, size_of::<f32>() as u64 * levels.leaves())?,
            control: part(&mut s.control, size_of::<Control>() as u64)?,
            summary: part(&mut s.summary, size_of::<Control>() as u64)?,
            answers: part(&mut s.answers, ANSWER_BYTES * queries)?,
            candidates: part(&mut s.candidates, CANDIDATE_BYTES * room)?,
        };
        if replaced {
            if let Some(word) = tools.poison {
                let named = parts.named();
                let all = named.iter().filter(|(name, _)| !["params", "order"].contains(name));
                Frame::fill(tools.gpu(), all.map(|(_, part)| &part.block), word)?;
            }
            self.frames.clear();
            (self.is_built, self.is_current) = (false, false);
        }
        Ok(parts)
    }
}

fn steps(
    tools: &SceneTools,
    shape: &Shape,
    parts: &Parts,
    now: &Part,
    questions: &Part,
) -> Result<Vec<Command>, GpuError> {
    let mut named = parts.named();
    named.extend([("now", now), ("questions", questions)]);
    let stage = |stage: SceneStage, level: u32, groups: u32| {
        let pipeline = locked(&tools.pipelines).get(Stage::Scene(stage))?;
        Command::stage(pipeline, &named, &CastGroupsParams { level }, [groups, 1])
    };
    let counted = |part: &Part| Part::of(&part.block, 0, size_of::<Control>() as u64);
    let (control, summary) = (counted(&parts.control), counted(&parts.summary));
    let mut steps = vec![Command::Fill { part: control.clone(), word: 0 }];
    if shape.follows {
        let of = |level: u32| groups(u64::from(shape.levels.count(level)));
        steps.push(stage(SceneStage::CastBoxes, 0, of(0))?);
        for level in 1..shape.levels.top {
            steps.push(stage(SceneStage::CastGroups, level, of(level))?);
        }
    }
    steps.push(stage(shape.stage, 0, shape.groups)?);
    steps.push(Command::Copy { from: control, to: summary });
    Ok(steps)
}

impl Found {
    /// Numbers of the shapes whose candidates are not here.
    pub fn given_up(&self) -> Vec<u32> {
        let of = (0..).zip(&self.answers);
        of.filter(|(_, [_, ended])| *ended != 0).map(|(query, _)| query).collect()
    }

    /// The candidates of a shape; none of one that was given up.
    pub fn candidates(&self, query: u32, to: &mut Vec<(u32, Aabb)>) {
        let [mut head, ended] = self.answers.get(query as usize).copied().unwrap_or([NO_LIST, 1]);
        if ended != 0 {
            return;
        }
        while head != NO_LIST {
            // Lists are made one after the other: one that comes before itself is a fault of the device.
            let before = self.list(head, to).filter(|before| *before < head || *before == NO_LIST);
            let Some(before) = before else {
                // Relaxed: nothing is read by it.
                self.is_wrong.store(true, Ordering::Relaxed);
                to.clear();
                return;
            };
            head = before;
        }
    }

    /// Reads a list. Returns where the one before it is; `None` where it does not lie among the candidates, or names an
    /// index that has no record.
    fn list(&self, head: u32, to: &mut Vec<(u32, Aabb)>) -> Option<u32> {
        let rest = self.count.checked_sub(head)?.checked_sub(1)?;
        let read = |at: u32, words: &mut [u32]| {
            self.candidates.block.read(u64::from(at) * CANDIDATE_BYTES, words);
        };
        let mut words = [0; 2];
        read(head, &mut words);
        let [before, count] = words;
        if count > rest {
            return None;
        }
        for at in head + 1..=head + count {
            let mut record: Record = [0; 8];
            read(at, bytemuck::cast_slice_mut(&mut record));
            let index = record[6] as u32;
            if index >= self.slots {
                return None;
            }
            to.push((index, box_of_keys(&record)));
        }
        Some(before)
    }

    /// Whether the device said what no search can say.
    pub fn is_wrong(&self) -> bool {
        self.is_wrong.load(Ordering::Relaxed)
    }
}
