//! Structs that both Rust and WGSL touch. A test compares each with what naga reflects.

use bytemuck::{Pod, Zeroable};

use crate::constants::{BATCH_BOXES, GRID_LEVELS, WORD_BITS};

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

/// The levels of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct GridLayout {
    /// Levels in use, finest first.
    pub level_count: u32,
    /// First cell of the boxes that no level takes.
    pub first_giant: u32,
    /// First cell of the boxes that overlap nothing.
    pub first_nothing: u32,
    /// One past the last cell.
    pub cell_end: u32,
    /// The levels.
    pub levels: [GridLevel; GRID_LEVELS as usize],
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
