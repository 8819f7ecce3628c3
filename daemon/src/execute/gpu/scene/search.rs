//! A submission of a scene: an edit is applied, and what it leads to is searched for.

use std::sync::Arc;
use std::time::Duration;

use pairmask_shaders::constants::CONTROL_HEADER_WORDS;
use pairmask_shaders::layouts::{GridLayout, GridParams, SceneMode, SceneParams, SceneSummary};
use pairmask_shaders::{GridStage, SceneStage, Stage};

use super::memory::{Blocks, RECORD_BYTES, StageBlocks};
use super::plan;
use super::plan::{Question, Room, Sizes};
use super::upload::{SetIndices, Uploaded};
use crate::execute::gpu::{
    Block, Command, Frame, FrameCache, GpuError, Order, Part, Place, QueueRole, SceneTools,
    StepTime,
};

/// Most tests of a search, in 2^32: 17 thousand million take an H200 tens of milliseconds. A scene that
/// crowds more in one place is another engine's.
pub(super) const BUDGET: u32 = 4;
/// Threads that look for the boxes of a query, as in `scene_query`.
const QUERY_LANES: u32 = 32;
/// What a search counts in the control block, from `FOUND` to `DONE` of the stages: zero before a search of a grid
/// that stands. `CONTROL_HEADER_WORDS` come first, then entries, rows, and two counts of moved boxes.
const TALLY_OFFSET: u64 = 4 * (CONTROL_HEADER_WORDS as u64 + 4);
const TALLY_BYTES: u64 = 4 * 7;
/// How long a search within the budget may take before the device counts as hung: on a real GPU, and on a
/// software adapter.
const PATIENCE: [Duration; 2] = [Duration::from_secs(20), Duration::from_secs(600)];

/// The stages that every scene needs.
pub(super) fn stages() -> impl Iterator<Item = Stage> {
    use SceneStage::{Apply, Cells, Mark, Pairs, Place};
    use SceneStage::{Query, QueryDeal, QueryRows, QuerySort, QueryStarts};
    let edits = [Apply, Mark, Cells, Place, Pairs];
    let queries = [Query, QueryRows, QueryStarts, QueryDeal, QuerySort];
    edits.into_iter().chain(queries).map(Stage::Scene).chain([Stage::Grid(GridStage::Scan)])
}

/// What a submission searches for.
#[derive(Clone, Copy)]
pub(super) enum Search<'a> {
    /// Nothing: an edit is applied.
    Nothing,
    /// The pairs of the question.
    Pairs(Share),
    /// The boxes that queries overlap.
    Queries(Queries<'a>),
}

/// Which part of a search a GPU does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Share {
    /// From 0 on.
    pub index: u32,
    /// GPUs that search.
    pub count: u32,
}

impl Share {
    /// All of it.
    pub const WHOLE: Self = Self { index: 0, count: 1 };
}

/// Queries of a submission.
#[derive(Clone, Copy)]
pub(super) struct Queries<'a> {
    /// How many.
    pub count: u32,
    pub way: Way<'a>,
}

/// How queries are answered.
#[derive(Clone, Copy)]
pub(super) enum Way<'a> {
    /// They are what the edit sets, behind the scene's records, and the entries of the grid. The boxes of the scene
    /// look for them.
    Entries,
    /// They lie here and look for boxes in the grid of all boxes, which is built first or stands since the last
    /// submission.
    Grid { boxes: &'a Part, builds: bool },
}

/// What a submission does.
pub(super) struct Task<'a> {
    pub question: Question,
    pub search: Search<'a>,
    pub layout: GridLayout,
    pub sizes: Sizes,
    /// The number of the history under way, of 56 bits.
    pub epoch: u64,
    /// The number that named boxes get; 0 where none is named.
    pub naming: u32,
    /// What is applied first.
    pub edit: &'a Uploaded,
    /// Whether it is applied: not again, where a search is repeated.
    pub applies: bool,
    pub blocks: &'a Blocks,
}

/// All that a recording depends on, but for blocks that are kept until all recordings are dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Shape {
    apply: u32,
    mark: u32,
    slots: u32,
    scan: u32,
    entries: u32,
    rows: u32,
    search: SearchShape,
    boxes: Place,
    box_bytes: u64,
    /// Whole blocks: short lists lie in another one than long ones.
    indices: Place,
    marks: Place,
}

/// What is recorded of a search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SearchShape {
    Nothing,
    Pairs {
        is_shared: bool,
    },
    Queries {
        way: WayShape,
        /// Workgroups that look, that prepare the sorting, and that sort.
        groups: [u32; 3],
    },
}

/// What is recorded of the way of queries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum WayShape {
    /// Bytes of their records: where, and how many.
    Entries([u64; 2]),
    Grid {
        boxes: Place,
        box_bytes: u64,
        builds: bool,
    },
}

/// Recorded frames.
pub(super) struct Frames(FrameCache<Shape>);

impl Default for Frames {
    fn default() -> Self {
        Self(FrameCache::new(QueueRole::Frames))
    }
}

/// Rows that a thread looks at a time: one where it may not take many rounds.
fn rows_together(tools: &SceneTools) -> u64 {
    if tools.gpu.limits().thread_rounds == u32::MAX { plan::ROWS_TOGETHER } else { 1 }
}

impl Task<'_> {
    /// Items that found pairs and entries have room for: what lies in their blocks.
    pub fn room_made(&self, tools: &SceneTools) -> Room {
        let items = |block: &Block, bytes: u64| block.bytes().min(tools.binding_bytes) / bytes;
        let found = items(&self.blocks.found, 8);
        let StageBlocks { unsorted, rows, .. } = &self.blocks.stages;
        let pairs = match self.search {
            Search::Queries(_) => found.min(items(unsorted, 8)).min(items(rows, 8)),
            Search::Nothing | Search::Pairs(_) => found,
        };
        Room { entries: items(&self.blocks.entries, 16).min(items(&self.blocks.sorted, 32)), pairs }
    }

    fn params(&self, tools: &SceneTools) -> SceneParams {
        let SetIndices { count, first } = self.edit.sets;
        let room = self.room_made(tools);
        let share = match self.search {
            Search::Pairs(share) => share,
            Search::Nothing | Search::Queries(_) => Share::WHOLE,
        };
        let (set_count, mark_count) =
            if self.applies { (count, self.edit.mark_count) } else { (0, 0) };
        SceneParams {
            slots: self.question.slots as u32,
            mode: self.question.mode as u32,
            dense: u32::from(self.question.is_dense()),
            epoch_low: self.epoch as u32,
            epoch_high: (self.epoch >> 32) as u32,
            set_count,
            set_first: first.unwrap_or(0),
            set_is_range: u32::from(first.is_some()),
            mark_count,
            naming: if self.question.mode == SceneMode::Moved { self.naming } else { 0 },
            entry_capacity: room.entries as u32,
            pair_capacity: room.pairs as u32,
            table_words: self.sizes.table_words as u32,
            filter_words: self.sizes.filter_words as u32,
            control_words: self.sizes.control_words as u32,
            budget: BUDGET,
            query_count: match self.search {
                Search::Queries(queries) => queries.count,
                Search::Nothing | Search::Pairs(_) => 0,
            },
            thread_rounds: self.row_rounds(tools),
            rows_together: rows_together(tools) as u32,
            share_count: share.count,
            share: share.index,
        }
    }

    /// Rounds that a row may take, so that a thread stays within its own, whichever rows it gets.
    fn row_rounds(&self, tools: &SceneTools) -> u32 {
        let of_thread = tools.gpu.limits().thread_rounds;
        if of_thread == u32::MAX {
            return of_thread;
        }
        of_thread / self.question.rows_a_thread(rows_together(tools))
    }

    fn shape(&self, tools: &SceneTools) -> Shape {
        let Self { question, sizes, edit, .. } = self;
        let items = question.items(rows_together(tools));
        let search = match self.search {
            Search::Nothing => SearchShape::Nothing,
            Search::Pairs(share) => SearchShape::Pairs { is_shared: share.count > 1 },
            Search::Queries(Queries { count, way }) => {
                let count = u64::from(count);
                let (way, looking) = match way {
                    Way::Entries => {
                        let first = u64::from(edit.sets.first.unwrap_or(0));
                        let bytes = [first, count].map(|records| records * RECORD_BYTES);
                        (WayShape::Entries(bytes), items)
                    }
                    Way::Grid { boxes, builds } => {
                        let (place, box_bytes) = (Place::of(boxes), boxes.bytes);
                        let way = WayShape::Grid { boxes: place, box_bytes, builds };
                        (way, count * u64::from(QUERY_LANES))
                    }
                };
                let [looking, one_a_query] = [looking, count].map(plan::groups);
                let groups = [looking, one_a_query, plan::groups_of_rows(count)];
                SearchShape::Queries { way, groups }
            }
        };
        // A thread zeroes four words in the time that it takes to set a box.
        let zeroing = if search == SearchShape::Nothing { 0 } else { sizes.zeroed_words() / 16 };
        let sets = if self.applies { u64::from(edit.sets.count) } else { 0 };
        let marks = if self.applies { edit.mark_count } else { 0 };
        Shape {
            apply: plan::groups(sets.max(zeroing)),
            mark: if marks == 0 { 0 } else { plan::groups(u64::from(marks)) },
            slots: plan::groups(question.slots),
            scan: plan::groups_of_scan(sizes.sums),
            entries: plan::groups(question.entries()),
            rows: plan::groups(items),
            search,
            boxes: Place::of(&edit.boxes),
            box_bytes: edit.boxes.bytes,
            indices: Place::of(&edit.indices),
            marks: Place::of(&edit.marks),
        }
    }

    /// The edit, and the grid of its search.
    fn first_steps(&self, tools: &SceneTools, shape: &Shape) -> Result<Vec<Command>, GpuError> {
        let b = self.blocks;
        let whole = |block: &Arc<Block>| whole(tools, block);
        let [params, layout, table, control] =
            [&b.params, &b.layout, &b.table, &b.control].map(whole);
        let [now, then, named] = [&b.now, &b.then, &b.named].map(whole);
        let [entries, sorted] = [&b.entries, &b.sorted].map(whole);
        let Uploaded { boxes, indices, marks, .. } = self.edit;
        let scene = |of, groups, parts: &[&Part]| stage(tools, Stage::Scene(of), groups, parts);
        let parts = [boxes, &params, indices, &now, &then, &named, &table, &control];
        let mut steps = vec![scene(SceneStage::Apply, shape.apply, &parts)?];
        if shape.mark != 0 {
            let parts = [&params, marks, &now, &then, &named];
            steps.push(scene(SceneStage::Mark, shape.mark, &parts)?);
        }
        if shape.search == SearchShape::Nothing {
            return Ok(steps);
        }
        let parts = [&params, &layout, &now, &then, &named, &table, &control, &entries];
        steps.push(scene(SceneStage::Cells, shape.slots, &parts)?);
        let scan = Stage::Grid(GridStage::Scan);
        steps.push(stage(tools, scan, shape.scan, &[&layout, &table, &control])?);
        let parts = [&params, &now, &then, &table, &control, &entries, &sorted];
        steps.push(scene(SceneStage::Place, shape.entries, &parts)?);
        Ok(steps)
    }

    fn steps(&self, tools: &SceneTools, shape: &Shape) -> Result<Vec<Command>, GpuError> {
        let b = self.blocks;
        let whole = |block: &Arc<Block>| whole(tools, block);
        let [params, layout, table, sorted] =
            [&b.params, &b.layout, &b.table, &b.sorted].map(whole);
        let [control, found, summary] = [&b.control, &b.found, &b.summary].map(whole);
        let [now, then] = [&b.now, &b.then].map(whole);
        let scene = |of, groups, parts: &[&Part]| stage(tools, Stage::Scene(of), groups, parts);
        let mut steps = match self.search {
            Search::Queries(Queries { way: Way::Grid { builds: false, .. }, .. }) => {
                let tally = Part::of(&b.control, TALLY_OFFSET, TALLY_BYTES);
                vec![Command::Fill { part: tally, word: 0 }]
            }
            _ => self.first_steps(tools, shape)?,
        };
        let (SearchShape::Queries { way, groups }, Search::Queries(queries)) =
            (shape.search, self.search)
        else {
            if let SearchShape::Pairs { is_shared } = shape.search {
                let of = if is_shared { SceneStage::SharedPairs } else { SceneStage::Pairs };
                let parts =
                    [&params, &layout, &table, &sorted, &now, &then, &control, &found, &summary];
                steps.push(scene(of, shape.rows, &parts)?);
            }
            return Ok(steps);
        };
        let StageBlocks { unsorted, rows, counts, starts, .. } = &b.stages;
        let [unsorted, rows, counts, starts] = [unsorted, rows, counts, starts].map(whole);
        let [looking, one_a_query, sorting] = groups;
        let mut parts =
            [&params, &layout, &table, &sorted, &now, &counts, &control, &unsorted, &summary];
        if let Way::Grid { boxes, .. } = queries.way {
            parts[4] = boxes;
            steps.push(scene(SceneStage::Query, looking, &parts)?);
        } else {
            steps.push(Command::Fill { part: counts.clone(), word: 0 });
            steps.push(scene(SceneStage::QueryRows, looking, &parts)?);
        }
        steps.push(scene(SceneStage::QueryStarts, one_a_query, &[&params, &counts, &starts])?);
        let parts = [&params, &control, &unsorted, &starts, &rows];
        steps.push(scene(SceneStage::QueryDeal, sorting, &parts)?);
        let parts = [&params, &control, &counts, &starts, &rows, &found];
        steps.push(scene(SceneStage::QuerySort, sorting, &parts)?);
        if let WayShape::Entries([first, bytes]) = way {
            // Their records are without a box again, as all behind the scene's are.
            steps.push(Command::Fill { part: Part::of(&b.now, first, bytes), word: 0 });
        }
        Ok(steps)
    }
}

/// As much of a block as a stage sees.
fn whole(tools: &SceneTools, block: &Arc<Block>) -> Part {
    Part::of(block, 0, block.bytes().min(tools.binding_bytes))
}

fn stage(
    tools: &SceneTools,
    stage: Stage,
    groups: u32,
    parts: &[&Part],
) -> Result<Command, GpuError> {
    Ok(Command::Stage {
        pipeline: tools.pipeline(stage)?,
        parts: parts.iter().copied().cloned().collect(),
        // The scan's text declares parameters, and none of them is read.
        immediates: bytemuck::bytes_of(&GridParams::default()).to_vec(),
        groups: [groups, 1],
    })
}

impl Frames {
    /// Forgets all recordings: a block that they use was replaced.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Runs a task and waits for it. What the search found lies in its blocks then.
    pub fn run(&mut self, tools: &SceneTools, task: &Task<'_>) -> Result<SceneSummary, GpuError> {
        self.submit(tools, task)?;
        self.wait(tools)?;
        let mut summary = [bytemuck::Zeroable::zeroed()];
        if !matches!(task.search, Search::Nothing) {
            task.blocks.summary.read(0, &mut summary);
        }
        Ok(summary[0])
    }

    /// Has the GPU begin a task. [`Self::wait`] comes next.
    pub fn submit(&mut self, tools: &SceneTools, task: &Task<'_>) -> Result<(), GpuError> {
        task.blocks.params.write(0, &[task.params(tools)]);
        if !matches!(task.search, Search::Nothing) {
            task.blocks.layout.write(0, &[task.layout]);
        }
        let shape = task.shape(tools);
        let steps = || task.steps(tools, &shape);
        self.0.frame(&tools.gpu, shape, tools.profiled, steps)?.submit_in(Order::Alone)
    }

    /// Waits for the task that was begun last.
    pub fn wait(&mut self, tools: &SceneTools) -> Result<(), GpuError> {
        let patience = PATIENCE[usize::from(tools.gpu.info().is_software())];
        self.0.last_mut().map_or(Ok(()), |frame| frame.end(tools.wait, patience))
    }

    /// Times of the last task's steps, if frames are profiled.
    pub fn step_times(&self) -> Result<Vec<StepTime>, GpuError> {
        self.0.last().map_or(Ok(Vec::new()), Frame::step_times)
    }
}
