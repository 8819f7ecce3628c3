//! A submission of a scene: an edit is applied, and what it leads to is searched for.

use std::time::Duration;

use pairmask_shaders::constants::CONTROL_HEADER_WORDS;
use pairmask_shaders::layouts::{GridLayout, GridParams, SceneMode, SceneParams};
use pairmask_shaders::{GridStage, SceneStage, Stage};

use super::memory::{Blocks, RECORD_BYTES, StageParts};
use super::plan;
use super::plan::{Question, Room, Sizes};
use super::upload::Uploaded;
use crate::execute::gpu::{Command, FrameCache, GpuError, Order, Part, Place, SceneTools};

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
    Pairs(Share),
    Queries(Queries<'a>),
}

impl Search<'_> {
    /// Has queries build their grid: what stood is gone.
    pub fn build(&mut self) {
        if let Self::Queries(Queries { way: Way::Grid { builds, .. }, .. }) = self {
            *builds = true;
        }
    }
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

#[derive(Clone, Copy)]
pub(super) struct Asked<'a> {
    pub question: Question,
    pub search: Search<'a>,
    pub layout: GridLayout,
    pub sizes: Sizes,
    /// What there is to be room for.
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
    /// What is applied first.
    pub edit: &'a Uploaded,
    pub blocks: &'a Blocks,
}

/// All that a recording depends on, but for blocks that are kept until all recordings are dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shape {
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

/// What is recorded of a search; of queries the workgroups that look, that prepare the sorting, and that sort.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SearchShape {
    Nothing,
    Pairs {
        is_shared: bool,
    },
    /// Where the records of the queries are, and how many bytes.
    Entries {
        records: [u64; 2],
        groups: [u32; 3],
    },
    Grid {
        boxes: Place,
        box_bytes: u64,
        builds: bool,
        groups: [u32; 3],
    },
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
        let items = |part: &Part, bytes: u64| part.bytes / bytes;
        let pairs = match self.asked.search {
            Search::Queries(_) => items(found, 8).min(items(unsorted, 8)).min(items(rows, 8)),
            Search::Nothing | Search::Pairs(_) => items(found, 8),
        };
        Room { entries: items(entries, 16).min(items(sorted, 32)), pairs }
    }

    fn params(&self, tools: &SceneTools) -> SceneParams {
        let Asked { question, search, sizes, epoch, naming, applies, .. } = self.asked;
        let &Uploaded { set_count, set_first, mark_count, .. } = self.edit;
        let room = self.room_made();
        let (share, query_count) = match search {
            Search::Nothing => (Share::WHOLE, 0),
            Search::Pairs(share) => (share, 0),
            Search::Queries(queries) => (Share::WHOLE, queries.count),
        };
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
            query_count,
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
        let items = question.items(rows_together(tools));
        let search = match *search {
            Search::Nothing => SearchShape::Nothing,
            Search::Pairs(share) => SearchShape::Pairs { is_shared: share.count > 1 },
            Search::Queries(Queries { count, way }) => {
                let count = u64::from(count);
                let groups = |looking| {
                    [plan::groups(looking), plan::groups(count), plan::groups_of_rows(count)]
                };
                match way {
                    Way::Entries => {
                        let first = u64::from(edit.set_first.unwrap_or(0));
                        let records = [first, count].map(|records| records * RECORD_BYTES);
                        SearchShape::Entries { records, groups: groups(items) }
                    }
                    Way::Grid { boxes, builds } => SearchShape::Grid {
                        boxes: Place::of(boxes),
                        box_bytes: boxes.bytes,
                        builds,
                        groups: groups(count * u64::from(QUERY_LANES)),
                    },
                }
            }
        };
        // A thread zeroes four words in the time that it takes to set a box.
        let zeroing = if search == SearchShape::Nothing { 0 } else { sizes.zeroed_words() / 16 };
        let sets = if *applies { u64::from(edit.set_count) } else { 0 };
        let marks = if *applies { edit.mark_count } else { 0 };
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

    /// All that stages bind, by their names.
    fn named(&self) -> Vec<(&'static str, &Part)> {
        let (edit, blocks) = (self.edit, self.blocks);
        let mut parts = blocks.stages.named();
        parts.extend([("now", &blocks.now), ("then", &blocks.then), ("named", &blocks.named)]);
        parts.extend([("boxes", &edit.boxes), ("indices", &edit.indices), ("marks", &edit.marks)]);
        // When pairs are dealt, where those of each query begin has become where they end.
        parts.push(("ends", &blocks.starts));
        if let Search::Queries(Queries { way: Way::Grid { boxes, .. }, .. }) = self.asked.search {
            parts.push(("queries", boxes));
        }
        parts
    }

    fn steps(&self, tools: &SceneTools, shape: &Shape) -> Result<Vec<Command>, GpuError> {
        use SceneStage::{Apply, Cells, Mark, Pairs, Place, SharedPairs};
        use SceneStage::{Query, QueryDeal, QueryRows, QuerySort, QueryStarts};
        let parts = self.named();
        // What queries find is put in order first.
        let query_parts = [parts.as_slice(), &[("found", &self.blocks.unsorted)]].concat();
        let stage = |stage: Stage, groups: u32| {
            let finds_of_queries = matches!(stage, Stage::Scene(Query | QueryRows));
            let parts = if finds_of_queries { &query_parts } else { &parts };
            // The scan's text declares parameters, and none of them is read.
            let params = GridParams::default();
            Command::stage(tools.pipeline(stage)?, parts, &params, [groups, 1])
        };
        let scene = |of: SceneStage, groups: u32| stage(Stage::Scene(of), groups);
        let zero = |part: Part| Command::Fill { part, word: 0 };
        let control = &self.blocks.control.block;
        let mut steps = Vec::new();
        // Whether the grid stands since the last submission.
        let stands = matches!(shape.search, SearchShape::Grid { builds: false, .. });
        if stands {
            steps.push(zero(Part::of(control, TALLY_OFFSET, TALLY_BYTES)));
        } else {
            steps.push(scene(Apply, shape.apply)?);
            if shape.mark != 0 {
                steps.push(scene(Mark, shape.mark)?);
            }
        }
        if !stands && shape.search != SearchShape::Nothing {
            steps.push(scene(Cells, shape.slots)?);
            steps.push(stage(Stage::Grid(GridStage::Scan), shape.scan)?);
            steps.push(scene(Place, shape.entries)?);
        }
        match shape.search {
            SearchShape::Nothing => {}
            SearchShape::Pairs { is_shared } => {
                steps.push(scene(if is_shared { SharedPairs } else { Pairs }, shape.rows)?);
            }
            SearchShape::Entries { groups: [looking, ..], .. } => {
                steps.push(zero(self.blocks.counts.clone()));
                steps.push(scene(QueryRows, looking)?);
            }
            SearchShape::Grid { groups: [looking, ..], .. } => {
                steps.push(scene(Query, looking)?);
            }
        }
        if let SearchShape::Entries { groups: [_, one_a_query, sorting], .. }
        | SearchShape::Grid { groups: [_, one_a_query, sorting], .. } = shape.search
        {
            steps.push(scene(QueryStarts, one_a_query)?);
            steps.push(scene(QueryDeal, sorting)?);
            steps.push(scene(QuerySort, sorting)?);
        }
        if let SearchShape::Entries { records: [first, bytes], .. } = shape.search {
            // Their records are without a box again, as all behind the scene's are.
            steps.push(zero(Part::of(&self.blocks.now.block, first, bytes)));
        }
        Ok(steps)
    }

    pub fn submit(&self, tools: &SceneTools, frames: &mut Frames) -> Result<(), GpuError> {
        self.blocks.params.block.write(0, &[self.params(tools)]);
        if !matches!(self.asked.search, Search::Nothing) {
            self.blocks.grid.block.write(0, &[self.asked.layout]);
        }
        let shape = self.shape(tools);
        let steps = || self.steps(tools, &shape);
        frames.frame(&tools.gpu, shape, tools.profiled, steps)?.submit_in(Order::Alone)
    }
}

/// How long a search within the budget may take before the device counts as hung.
pub(super) fn patience(tools: &SceneTools) -> Duration {
    PATIENCE[usize::from(tools.gpu.info().is_software())]
}
