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
/// Steps that all searches of a submission may take, of a group each: some 100 ms of a large GPU. What is left is the
/// cores'.
const ALL_STEPS: u32 = 1 << 26;
/// Steps that one search may take: some 50 ms, and so few that those of all that run at once fit into 32 bits.
const STEPS: u32 = 1 << 16;
/// Bytes of an item of the tree, of a candidate, and of the head of an answer.
const ITEM_BYTES: u64 = 32;
const CANDIDATE_BYTES: u64 = size_of::<Record>() as u64;
const HEAD_BYTES: u64 = size_of::<Head>() as u64;
/// Most of the closest boxes whose records lie with the answer, and one more that may be as near: the host reads answers one
/// after the other, and finds them in its caches.
const MOST_IN_ANSWER: u32 = 8;
/// Candidates in lists, with their heads, that there is room for at first, for each ray or sphere.
const LISTED: u64 = 2;
/// Most candidates in lists of a submission, 256 MiB of host memory. What has more is the cores'.
const MOST_LISTED: u64 = 1 << 23;
/// The order is found anew when more than one leaf in so many has grown too much.
const LOOSE_SHARE: u64 = 4;

/// Words of the control block: leaves that have grown too much, candidates and heads of lists, steps.
type Control = [u32; 3];
/// Of an answer: where its last list is, how many candidates follow, and 0 if those are all. Of a list: where the one before
/// it is, and how many follow.
type Head = [u32; 4];
const NO_LIST: u32 = u32::MAX;

frame_blocks! { Scratch, Parts:
    params in Host,
    order in Video,
    items in Video,
    edges in Video,
    control in Video,
    summary in Host,
    answers in Host,
    lists in Host,
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
    has_edges: bool,
    /// Whether the edges that leaves had in this order were lost.
    is_outgrown: bool,
    /// Whether boxes are where they are now.
    is_current: bool,
    /// Candidates in lists that the last search had, with their heads.
    last_listed: u64,
}

/// What a search left to decide.
pub(in crate::execute::gpu::scene) struct Found {
    answers: Part,
    answer_room: u32,
    shapes: u32,
    lists: Part,
    /// Candidates in lists, with their heads.
    listed: u32,
    slots: u32,
    is_wrong: AtomicBool,
    has_given_up: AtomicBool,
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
            has_edges: false,
            is_outgrown: false,
            is_current: false,
            last_listed: 0,
        }
    }

    /// Bytes that are allocated, in video memory for the most part.
    pub fn bytes(&self) -> u64 {
        let Scratch { params, order, items, edges, control, summary, answers, lists } =
            &self.scratch;
        let all = [params, order, items, edges, control, summary, answers, lists];
        all.into_iter().map(Growing::held_bytes).sum()
    }

    /// Notes that boxes have changed.
    pub const fn note_edit(&mut self) {
        self.is_current = false;
    }

    /// Drops recordings: the scene's records lie elsewhere.
    pub fn forget_frames(&mut self) {
        self.frames.clear();
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
        (self.has_edges, self.is_outgrown, self.is_current) = (false, false, false);
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
        let answer_room = closest.min(MOST_IN_ANSWER) + 1;
        let listed = LISTED + u64::from(closest.saturating_sub(MOST_IN_ANSWER));
        let last = (self.last_listed + self.last_listed / 4).min(MOST_LISTED);
        let mut room = (listed * shapes.len() as u64).max(last);
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
        while room <= MOST_LISTED {
            let answer_bytes = HEAD_BYTES + CANDIDATE_BYTES * u64::from(answer_room);
            let answers_bytes = answer_bytes * shapes.len() as u64;
            let parts = self.parts(tools, &levels, answers_bytes, room)?;
            let room_made = (parts.lists.bytes / CANDIDATE_BYTES) as u32;
            parts.params.block.write(
                0,
                &[CastParams {
                    slots,
                    ordered,
                    notes_edges: u32::from(!self.has_edges),
                    queries: shapes.len() as u32,
                    closest,
                    any: u32::from(hits == Hits::Any),
                    answer_room,
                    room: room_made,
                    all_steps: ALL_STEPS,
                    steps: STEPS,
                    thread_rounds: gpu.limits().thread_rounds,
                    top: levels.top,
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
            tools.note_frame();
            frame.submit_in(Order::default())?;
            frame.end(TIMEOUT[usize::from(gpu.is_software())])?;
            let mut summary: [Control; 1] = [[0; 3]];
            parts.summary.block.read(0, &mut summary);
            let [[loose, listed, steps]] = summary;
            if shape.follows {
                self.is_current = true;
                let had_edges = std::mem::replace(&mut self.has_edges, true);
                let is_loose = had_edges && u64::from(loose) * LOOSE_SHARE > levels.leaves();
                if is_loose || self.is_outgrown {
                    // For the next search: this one is right.
                    self.ordered = None;
                }
            }
            self.last_listed = listed.into();
            if listed <= room_made {
                return Ok(Some(Found {
                    answers: parts.answers,
                    answer_room,
                    shapes: shapes.len() as u32,
                    lists: parts.lists,
                    listed,
                    slots,
                    is_wrong: AtomicBool::new(false),
                    has_given_up: AtomicBool::new(false),
                    looked_at: u64::from(steps) * u64::from(CAST_LANES),
                }));
            }
            room = u64::from(listed);
        }
        self.last_listed = 0;
        Ok(None)
    }

    /// Blocks of which none is smaller than is needed. Where some are others, recordings are dropped; where those of the tree
    /// are, it is made anew.
    fn parts(
        &mut self,
        tools: &SceneTools,
        levels: &Levels,
        answers_bytes: u64,
        room: u64,
    ) -> Result<Parts, GpuError> {
        let most = tools.binding_bytes;
        let part = |growing: &mut Growing, bytes: u64, replaced: &mut bool| {
            if bytes > most {
                return Err(GpuError::OutOfMemory { bytes });
            }
            let Part { block, .. } = growing.part(tools.gpu(), bytes.max(1), replaced)?;
            Ok(Part::of(&block, 0, block.bytes().min(most)))
        };
        let (s, mut of_tree, mut others) = (&mut self.scratch, false, false);
        // The order is kept as it was put there.
        let order = s.order.at_least(tools.gpu(), 1, u64::MAX, &mut of_tree)?;
        let order = Part::of(order, 0, order.bytes().min(most));
        let parts = Parts {
            order,
            items: part(&mut s.items, ITEM_BYTES * levels.items(), &mut of_tree)?,
            edges: part(&mut s.edges, size_of::<f32>() as u64 * levels.leaves(), &mut of_tree)?,
            params: part(&mut s.params, size_of::<CastParams>() as u64, &mut others)?,
            control: part(&mut s.control, size_of::<Control>() as u64, &mut others)?,
            summary: part(&mut s.summary, size_of::<Control>() as u64, &mut others)?,
            answers: part(&mut s.answers, answers_bytes, &mut others)?,
            lists: part(&mut s.lists, CANDIDATE_BYTES * room, &mut others)?,
        };
        if let (true, Some(word)) = (of_tree || others, tools.poison) {
            let named = parts.named();
            let all = named.iter().filter(|(name, _)| !["params", "order"].contains(name));
            Frame::fill(tools.gpu(), all.map(|(_, part)| &part.block), word)?;
            of_tree = true;
        }
        if of_tree || others {
            self.frames.clear();
        }
        if of_tree {
            // Edges of now say nothing of those that leaves had when they were put in order.
            self.is_outgrown |= self.has_edges;
            (self.has_edges, self.is_current) = (false, false);
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
    const fn place(&self, query: u32) -> u64 {
        query as u64 * (HEAD_BYTES + CANDIDATE_BYTES * self.answer_room as u64)
    }

    fn head(&self, query: u32) -> Head {
        let mut head = [0; 4];
        self.answers.block.read(self.place(query), &mut head);
        head
    }

    /// Numbers of the shapes whose candidates are not here.
    pub fn given_up(&self) -> Vec<u32> {
        (0..self.shapes).filter(|query| self.head(*query)[2] != 0).collect()
    }

    /// The candidates of a shape; none of one that was given up.
    pub fn candidates(&self, query: u32, to: &mut Vec<(u32, Aabb)>) {
        if self.read(query, to).is_none() {
            // Relaxed here and below: nothing is read by it.
            self.is_wrong.store(true, Ordering::Relaxed);
            to.clear();
        }
    }

    /// `None` where the device says what no search can say.
    fn read(&self, query: u32, to: &mut Vec<(u32, Aabb)>) -> Option<()> {
        let [mut list, count, ended, _] = self.head(query);
        if ended != 0 {
            self.has_given_up.store(true, Ordering::Relaxed);
            return Some(());
        }
        let fits = count <= self.answer_room;
        let place = self.place(query) + HEAD_BYTES;
        fits.then(|| self.records(&self.answers, place, count, to))??;
        while list != NO_LIST {
            let mut head: Head = [0; 4];
            let rest = self.listed.checked_sub(list)?.checked_sub(1)?;
            let place = u64::from(list) * CANDIDATE_BYTES;
            self.lists.block.read(place, &mut head);
            let [before, count, ..] = head;
            // Lists are made one after the other: none comes before itself.
            let fits = count <= rest && (before < list || before == NO_LIST);
            fits.then(|| self.records(&self.lists, place + CANDIDATE_BYTES, count, to))??;
            list = before;
        }
        Some(())
    }

    /// Reads candidates from a place on; `None` where one names an index that has no record.
    fn records(
        &self,
        part: &Part,
        place: u64,
        count: u32,
        to: &mut Vec<(u32, Aabb)>,
    ) -> Option<()> {
        for at in 0..u64::from(count) {
            let mut record: Record = [0; 8];
            part.block.read(place + at * CANDIDATE_BYTES, &mut record);
            let index = record[6] as u32;
            if index >= self.slots {
                return None;
            }
            to.push((index, box_of_keys(&record)));
        }
        Some(())
    }

    /// Whether a shape whose candidates were asked for was given up.
    pub fn has_given_up(&self) -> bool {
        self.has_given_up.load(Ordering::Relaxed)
    }

    /// Whether the device said what no search can say.
    pub fn is_wrong(&self) -> bool {
        self.is_wrong.load(Ordering::Relaxed)
    }
}
