//! Structs that both Rust and WGSL touch. A test compares each with what naga reflects.

use bytemuck::{Pod, Zeroable};

use crate::constants::{BATCH_BOXES, GRID_LEVELS, SCENE_SAMPLES, WORD_BITS};

/// Words of a batch's bitmap of invalid boxes.
pub const BATCH_WORDS: usize = (BATCH_BOXES / WORD_BITS) as usize;

/// Sums over the rows of a batch, kept in video memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct BatchTotals {
    /// Non-zero mask words.
    pub words: u32,
    /// Overlapping pairs.
    pub pairs: u32,
}

/// What the host learns of a batch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct BatchReport {
    /// Bit i: box i of the batch has a NaN.
    pub invalid: [u32; BATCH_WORDS],
    /// Boxes with `min > max` on some axis.
    pub empty: u32,
    /// Non-zero mask words.
    pub words: u32,
    /// Overlapping pairs.
    pub pairs: u32,
    /// Unused.
    pub padding: u32,
}

/// Parameters of the stage that keeps the clocks up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct AwakeParams {
    /// Steps of each thread.
    pub rounds: u32,
    /// The sum that is written down.
    pub written: u32,
}

/// Parameters of the keys stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct KeysParams {
    /// Boxes.
    pub n: u32,
    /// Words of a key plane: n rounded up to the padding.
    pub plane_words: u32,
}

/// Parameters of the pairs stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct PairsParams {
    /// Words of a key plane.
    pub plane_words: u32,
    /// First row of the band.
    pub row0: u32,
    /// Rows of the band's matrix.
    pub band_rows: u32,
    /// First strip of the band.
    pub strip0: u32,
    /// Rows from here on are counted by the next band.
    pub counted_end: u32,
}

/// Parameters of the stages `write_sparse` and `write_list`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct WriteParams {
    /// First row of the band.
    pub row0: u32,
    /// Rows of the band's matrix.
    pub band_rows: u32,
    /// First strip of the band.
    pub strip0: u32,
    /// One past the last strip.
    pub strip_end: u32,
    /// Column blocks of a strip.
    pub strip_blocks: u32,
    /// Words, or pairs of a list, that the reply has room for.
    pub capacity: u32,
}

/// Parameters of the `pack_dense` stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct PackParams {
    /// Boxes.
    pub n: u32,
    /// First row of the band.
    pub row0: u32,
    /// Rows whose pairs the band owns.
    pub owned_rows: u32,
    /// Rows of the band's matrix.
    pub band_rows: u32,
    /// First column block of the matrix.
    pub block0: u32,
    /// Words of the string that start in the band.
    pub word_count: u32,
    /// Bit, from the band's first pair, that the first of them starts with.
    pub first_bit: u32,
    /// Word of the output binding that the first of them goes to.
    pub out_offset: u32,
    /// Workgroups of a dispatch row.
    pub groups_x: u32,
}

/// Parameters of every stage of the grid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct GridParams {
    /// Boxes.
    pub n: u32,
    /// Boxes rounded up to whole batches.
    pub plane: u32,
    /// Batches.
    pub batch_count: u32,
    /// Groups of batches.
    pub super_count: u32,
    /// Workgroups of the scan.
    pub sum_count: u32,
    /// Mask words, or pairs, that the reply has room for.
    pub capacity: u32,
    /// Words of a sparse reply before its mask words: the order, rounded up.
    pub order_words: u32,
    /// Most work in crowded cells, in 2^20 tests.
    pub budget: u32,
    /// Most tests of a row.
    pub row_tests: u32,
}

/// A level of the grid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct GridLevel {
    /// Where cell 0 is centred.
    pub origin: [f32; 3],
    /// Number of the first cell in the table of all levels.
    pub first_cell: u32,
    /// Cells per unit.
    pub scale: [f32; 3],
    /// Cells.
    pub cell_count: u32,
    /// Lowest cell number.
    pub low: [f32; 3],
    /// Unused.
    pub padding_low: u32,
    /// Highest cell number.
    pub high: [f32; 3],
    /// Unused.
    pub padding_high: u32,
    /// Cell number to cell of the table: an AND.
    pub fold: [i32; 3],
    /// Unused.
    pub padding_fold: u32,
    /// Cells along each axis.
    pub count: [u32; 3],
    /// Bit a: axis a is folded.
    pub wraps: u32,
}

/// Where worlds have cells of their own, one world behind the other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct GridWorlds {
    /// Cells of a world.
    pub cells: u32,
    /// Cells of its giants, and as many of its boxes that overlap nothing.
    pub parking: u32,
    /// Worlds.
    pub count: u32,
    /// Unused.
    pub padding: u32,
}

/// The levels of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct GridLayout {
    /// Levels in use, finest first.
    pub level_count: u32,
    /// First cell of the boxes that no level takes. Here and below, cells are those of the first world.
    pub first_giant: u32,
    /// First cell of the boxes that overlap nothing.
    pub first_nothing: u32,
    /// One past the last cell of all worlds.
    pub cell_end: u32,
    /// The levels.
    pub levels: [GridLevel; GRID_LEVELS as usize],
    /// Where its boxes are of several worlds.
    pub worlds: GridWorlds,
}

/// What the stages of the grid know of a batch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct GridTotals {
    /// What its rows found: non-zero mask words, or pairs.
    pub items: u32,
    /// Pairs of its rows.
    pub pairs: u32,
    /// Pairs compared for its rows.
    pub compared: u32,
    /// First of its items in the block of found items.
    pub base: u32,
    /// Its boxes with `min > max` on some axis.
    pub empty: u32,
    /// Its boxes with a NaN.
    pub invalid: u32,
    /// Unused.
    pub padding: [u32; 2],
}

/// What the host learns of a frame of the grid. 64-bit numbers are two words, the low one first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct GridSummary {
    /// What was found: non-zero mask words, or pairs.
    pub items: [u32; 2],
    /// Pairs.
    pub pairs: [u32; 2],
    /// Pairs compared.
    pub compared: [u32; 2],
    /// Boxes with `min > max` on some axis.
    pub empty: u32,
    /// Boxes with a NaN.
    pub invalid: u32,
    /// Tests within crowded cells, in 2^20.
    pub work: u32,
    /// Tests of giants, in 2^20.
    pub giant_work: u32,
    /// Unused.
    pub padding: [u32; 2],
}

/// What a search of a scene looks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum SceneMode {
    /// Pairs that began or ended since the history began.
    #[default]
    Changes = 0,
    /// Pairs of now with a box that the edit named.
    Moved = 1,
    /// All pairs of now, or queries against all boxes.
    All = 2,
    /// Pairs of a query and a box. The queries are what is set.
    Query = 3,
}

/// Parameters of every stage of a scene. They lie in memory, so that a frame is recorded once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct SceneParams {
    /// Indices that have a record.
    pub slots: u32,
    /// A [`SceneMode`].
    pub mode: u32,
    /// 1: every box that collides is an entry of the grid.
    pub dense: u32,
    /// The history under way, low 32 bits.
    pub epoch_low: u32,
    /// The same, high 24 bits.
    pub epoch_high: u32,
    /// Boxes that the edit sets.
    pub set_count: u32,
    /// Index of the first of them, if they are a range.
    pub set_first: u32,
    /// 1: they are a range.
    pub set_is_range: u32,
    /// Boxes that the edit removes or flags.
    pub mark_count: u32,
    /// The number that named boxes get; 0: none is named.
    pub naming: u32,
    /// Entries that there is room for.
    pub entry_capacity: u32,
    /// Found pairs that there is room for.
    pub pair_capacity: u32,
    /// Words of the table of cells.
    pub table_words: u32,
    /// Words of the filter, a power of two.
    pub filter_words: u32,
    /// Words of the control block that are zeroed.
    pub control_words: u32,
    /// Most tests, in 2^32.
    pub budget: u32,
    /// Queries.
    pub query_count: u32,
    /// Rounds of loops that a row or an entry of a search may take.
    pub thread_rounds: u32,
    /// Rows beside the grid that a thread looks at a time: 1 to 4.
    pub rows_together: u32,
    /// GPUs that share the search, at least 1.
    pub share_count: u32,
    /// Which of them this one is, from 0 on.
    pub share: u32,
}

/// What the host learns of a search. 64-bit numbers are two words, the low one first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct SceneSummary {
    /// Pairs to be reported.
    pub found: [u32; 2],
    /// Those of them that ended.
    pub ended: [u32; 2],
    /// Pairs compared.
    pub tested: [u32; 2],
    /// Entries of the grid.
    pub entries: u32,
    /// Rows beside the grid.
    pub rows: u32,
    /// Boxes that collide and have changed.
    pub moved: u32,
    /// Those of them that are static.
    pub moved_static: u32,
    /// Entries in `samples`.
    pub sampled: u32,
    /// Unused.
    pub padding: u32,
    /// Bits of min and max of some entries.
    pub samples: [[u32; 6]; SCENE_SAMPLES as usize],
}
