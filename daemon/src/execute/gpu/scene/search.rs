//! A submission of a scene: an edit is applied, and what it leads to is searched for.

use std::time::Duration;

use pairmask_shaders::constants::CONTROL_HEADER_WORDS;
use pairmask_shaders::layouts::{GridLayout, GridParams, SceneMode, SceneParams};
use pairmask_shaders::{GridStage, SceneStage, Stage};

use super::memory::{Blocks, RECORD_BYTES, StageParts};
use super::plan;
use super::plan::{Question, Room, Sizes};
use super::upload::Uploaded;
use crate::execute::gpu::{BlockOffset, Command, FrameCache, GpuError, Order, Part, SceneTools};
use crate::locked;

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
pub(super) const TIMEOUT: [Duration; 2] = [Duration::from_secs(20), Duration::from_secs(600)];

/// The stages that every scene needs: all but those of shares and of casts.
pub(super) fn stages() -> impl Iterator<Item = Stage> {
    use SceneStage::{CastBoxes, CastGroups, CastRays, CastSpheres, SharedPairs};
    let of_few = [SharedPairs, CastBoxes, CastGroups, CastRays, CastSpheres];
    let scene = SceneStage::ALL.into_iter().filter(move |stage| !of_few.contains(stage));
    scene.map(Stage::Scene).chain([Stage::Grid(GridStage::Scan)])
}

#[derive(Clone, Copy)]
pub(super) enum Search<'a> {
    /// Nothing: an edit is applied.
    Nothing,
    Pairs(Share),
    /// So many queries, which are what the edit sets, behind the scene's records, and the entries of the grid. The boxes
    /// of the scene look for them.
    Entries(u32),
    /// Queries that lie here and look for boxes in the grid of all boxes, which is built first or stands since the last
    /// submission.
    Grid {
        count: u32,
        boxes: &'a Part,
        builds: bool,
    },
}

impl Search<'_> {
    const fn queries(&self) -> u32 {
        match self {
            Self::Nothing | Self::Pairs(_) => 0,
            Self::Entries(count) | Self::Grid { count, .. } => *count,
        }
    }

    const fn stage(&self) -> Option<SceneStage> {
        match self {
            Self::Nothing => None,
            Self::Pairs(Share { count: 0 | 1, .. }) => Some(SceneStage::Pairs),
            Self::Pairs(_) => Some(SceneStage::SharedPairs),
            Self::Entries(_) => Some(SceneStage::QueryRows),
            Self::Grid { .. } => Some(SceneStage::Query),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Share {
    /// From 0 on.
    pub index: u32,
    pub count: u32,
}

#[derive(Clone, Copy)]
pub(super) struct Asked<'a> {
    pub question: Question,
    pub search: Search<'a>,
    pub layout: GridLayout,
    pub sizes: Sizes,
    pub room: Room,
    /// The number of the history under way, of 56 bits.
    pub epoch: u64,
    /// The number that named boxes get; 0 where none is named.
    pub naming: u32,
    /// Whether the edit is applied first: not again, where a search is repeated.
    pub applies: bool,
}

pub(super) struct Task<'a> {
    pub asked: Asked<'a>,
    pub edit: &'a Uploaded,
    pub blocks: &'a Blocks,
}

/// All that a recording depends on, but for blocks that are kept until all recordings are dropped. Stages are named by
/// their workgroups.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shape {
    apply: u32,
    /// None where it is 0.
    mark: u32,
    slots: u32,
    scan: u32,
    entries: u32,
    looking: Option<(SceneStage, u32)>,
    /// Of queries: those of the stages that prepare the sorting, and that sort.
    sorting: Option<[u32; 2]>,
    /// Whether the grid is built, and not that of the last submission.
    builds: bool,
    /// Where records are emptied at the end, and how many bytes.
    emptied: [u64; 2],
    /// The boxes that are set and the queries that lie apart, and how many bytes.
    boxes: [Option<(BlockOffset, u64)>; 2],
    /// Whole blocks: short lists lie in another one than long ones.
    indices: BlockOffset,
    marks: BlockOffset,
}

pub(super) type Frames = FrameCache<Shape>;

/// Rows that a thread looks at a time: one where it may not take many rounds.
fn rows_together(tools: &SceneTools) -> u64 {
    if tools.gpu.limits().thread_rounds == u32::MAX { plan::ROWS_TOGETHER } else { 1 }
}

impl Task<'_> {
    /// Items that found pairs and entries have room for: what lies in their blocks.
    pub fn room_made(&self) -> Room {
        let StageParts { unsorted, rows, entries, sorted, found, .. } = &self.blocks.stages;
        let elements = |part: &Part, bytes: u64| part.bytes / bytes;
        let pairs = match self.asked.search {
            Search::Nothing | Search::Pairs(_) => elements(found, 8),
            _ => elements(found, 8).min(elements(unsorted, 8)).min(elements(rows, 8)),
        };
        Room { entries: elements(entries, 16).min(elements(sorted, 32)), pairs }
    }

    fn params(&self, tools: &SceneTools) -> SceneParams {
        let Asked { question, search, sizes, epoch, naming, applies, .. } = self.asked;
        let &Uploaded { set_count, set_first, mark_count, .. } = self.edit;
        let room = self.room_made();
        let whole = Share { index: 0, count: 1 };
        let share = if let Search::Pairs(share) = search { share } else { whole };
        let (set_count, mark_count) = if applies { (set_count, mark_count) } else { (0, 0) };
        SceneParams {
            slots: question.slots as u32,
            mode: question.mode as u32,
            dense: u32::from(question.is_dense()),
            epoch_low: epoch as u32,
            epoch_high: (epoch >> 32) as u32,
            set_count,
            set_first: set_first.unwrap_or(0),
            set_is_range: u32::from(set_first.is_some()),
            mark_count,
            naming: if question.mode == SceneMode::Moved { naming } else { 0 },
            entry_capacity: room.entries as u32,
            pair_capacity: room.pairs as u32,
            table_words: sizes.table_words as u32,
            filter_words: sizes.filter_words as u32,
            control_words: sizes.control_words as u32,
            budget: BUDGET,
            query_count: search.queries(),
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
        of_thread / self.asked.question.rows_a_thread(rows_together(tools))
    }

    fn shape(&self, tools: &SceneTools) -> Shape {
        let (edit, Asked { question, search, sizes, applies, .. }) = (self.edit, &self.asked);
        let elements = question.elements(rows_together(tools));
        let queries = u64::from(search.queries());
        let of = |boxes: &Part| (BlockOffset::of(boxes), boxes.bytes);
        let (mut looking, mut apart, mut builds, mut emptied) = (elements, None, true, [0; 2]);
        match *search {
            Search::Entries(_) => {
                let first = u64::from(edit.set_first.unwrap_or(0));
                emptied = [first, queries].map(|records| records * RECORD_BYTES);
            }
            Search::Grid { boxes, builds: is_built, .. } => {
                looking = queries * u64::from(QUERY_LANES);
                (apart, builds) = (Some(of(boxes)), is_built);
            }
            _ => {}
        }
        // A thread zeroes four words in the time that it takes to set a box.
        let zeroing = search.stage().map_or(0, |_| sizes.zeroed_words() / 16);
        let sets = if *applies { u64::from(edit.set_count) } else { 0 };
        let marks = if *applies { edit.mark_count } else { 0 };
        Shape {
            apply: plan::groups(sets.max(zeroing)),
            mark: if marks == 0 { 0 } else { plan::groups(u64::from(marks)) },
            slots: plan::groups(question.slots),
            // It has no loop over batches.
            scan: sizes.sums.next_power_of_two(),
            entries: plan::groups(question.entries()),
            looking: search.stage().map(|stage| (stage, plan::groups(looking))),
            sorting: (queries > 0).then(|| [plan::groups(queries), plan::groups_of_rows(queries)]),
            builds,
            emptied,
            boxes: [Some(of(&edit.boxes)), apart],
            indices: BlockOffset::of(&edit.indices),
            marks: BlockOffset::of(&edit.marks),
        }
    }

    fn named(&self) -> Vec<(&'static str, &Part)> {
        let (edit, blocks) = (self.edit, self.blocks);
        let mut parts = blocks.stages.named();
        parts.extend([("now", &blocks.now), ("then", &blocks.then), ("named", &blocks.named)]);
        parts.extend([("boxes", &edit.boxes), ("indices", &edit.indices), ("marks", &edit.marks)]);
        // When pairs are dealt, where those of each query begin has become where they end.
        parts.push(("ends", &blocks.starts));
        if let Search::Grid { boxes, .. } = self.asked.search {
            parts.push(("queries", boxes));
        }
        parts
    }

    fn steps(&self, tools: &SceneTools, shape: &Shape) -> Result<Vec<Command>, GpuError> {
        use SceneStage::{Apply, Cells, Mark, Slot};
        use SceneStage::{Query, QueryDeal, QueryRows, QuerySort, QueryStarts};
        let parts = self.named();
        // What queries find is put in order first.
        let query_parts = [parts.as_slice(), &[("found", &self.blocks.unsorted)]].concat();
        let stage = |stage: Stage, groups: u32| {
            let finds_of_queries = matches!(stage, Stage::Scene(Query | QueryRows));
            let parts = if finds_of_queries { &query_parts } else { &parts };
            // The scan's text declares parameters, and none of them is read.
            let params = GridParams::default();
            Command::stage(locked(&tools.pipelines).get(stage)?, parts, &params, [groups, 1])
        };
        let scene = |of: SceneStage, groups: u32| stage(Stage::Scene(of), groups);
        let zero = |part: Part| Command::Fill { part, word: 0 };
        let control = &self.blocks.control.block;
        let mut steps = Vec::new();
        if shape.builds {
            steps.push(scene(Apply, shape.apply)?);
            if shape.mark != 0 {
                steps.push(scene(Mark, shape.mark)?);
            }
        } else {
            steps.push(zero(Part::of(control, TALLY_OFFSET, TALLY_BYTES)));
        }
        if shape.builds && shape.looking.is_some() {
            steps.push(scene(Cells, shape.slots)?);
            steps.push(stage(Stage::Grid(GridStage::Scan), shape.scan)?);
            steps.push(scene(Slot, shape.entries)?);
        }
        if let Some((looks, groups)) = shape.looking {
            if looks == QueryRows {
                steps.push(zero(self.blocks.counts.clone()));
            }
            steps.push(scene(looks, groups)?);
        }
        if let Some([one_a_query, sorting]) = shape.sorting {
            steps.push(scene(QueryStarts, one_a_query)?);
            steps.push(scene(QueryDeal, sorting)?);
            steps.push(scene(QuerySort, sorting)?);
        }
        let [first, bytes] = shape.emptied;
        if bytes > 0 {
            // Their records are without a box again, as all behind the scene's are.
            steps.push(zero(Part::of(&self.blocks.now.block, first, bytes)));
        }
        Ok(steps)
    }

    pub fn submit(&self, tools: &SceneTools, frames: &mut Frames) -> Result<(), GpuError> {
        self.blocks.params.block.write(0, &[self.params(tools)]);
        if self.asked.search.stage().is_some() {
            self.blocks.grid.block.write(0, &[self.asked.layout]);
        }
        let shape = self.shape(tools);
        let steps = || self.steps(tools, &shape);
        tools.note_frame();
        frames.frame(&tools.gpu, shape, tools.profiled, steps)?.submit_in(Order::default())
    }
}
