//! Numbers that WGSL and Rust share. Each is declared here and nowhere else.

use std::fmt::Write;

use pairmask_core::dispatch::{MARKED_KINDS, RANK_SHIFT};

/// Bits, and so columns, of a mask word.
pub const WORD_BITS: u32 = 32;

/// Boxes of a batch: a workgroup of the stages that go box by box, and the unit of the census and
/// of the totals. Larger batches mean fewer reports to add up on the host, smaller ones more
/// workgroups for small scenes.
pub const BATCH_BOXES: u32 = 256;

/// Invocations of a workgroup of the pairs stage: two subgroups of 32, so that even a thousand
/// boxes give every multiprocessor of a large GPU work.
pub const PAIRS_WORKGROUP: u32 = 64;

/// Words that a batch collects in workgroup memory before it writes them out: three arrays of
/// this many words, 12 KiB of the 16 KiB that every device has.
pub const WINDOW_WORDS: u32 = 1024;

/// Pairs of a list in a line of 128 bytes, the largest piece of a reply that a subgroup writes across
/// the link at once: less than a line costs as much as a line.
pub const LINE_PAIRS: u32 = 16;

/// Rows and columns are padded to a multiple of this, so that no stage checks whether one exists:
/// the largest strip of columns, and a multiple of a batch.
pub const PADDING: u32 = 512;

/// Most column blocks of a strip: its columns take 12 KiB of workgroup memory.
pub const MAX_STRIP_BLOCKS: u32 = PADDING / WORD_BITS;

/// Words of a box of f32.
pub const BOX_WORDS: u32 = 6;

/// Most levels of a grid. Levels of doubling cells cover 16 octaves of sizes, of quadrupling ones 32;
/// what is larger is a giant and looks at everything.
pub const GRID_LEVELS: u32 = 16;

/// Boxes without a place in a level that share a cell, by index: as few as keep sorting them by
/// index a matter of one short list.
pub const PARKED: u32 = 32;

/// Cells of a workgroup of the scan: eight a thread, two loads of 16 bytes.
pub const SCAN_CELLS: u32 = 8 * BATCH_BOXES;

/// Batches whose words are also summed together, so that no batch adds up thousands of others.
pub const SUPER_BATCHES: u32 = 64;

/// Most groups of batches: as many as there are workgroups along one dimension of a dispatch.
pub const SUPERS_MOST: u32 = 65_536 / SUPER_BATCHES;

/// First words of the control block, before the sums.
pub const CONTROL_HEADER_WORDS: u32 = 8;

/// Bit of a home word at which the level starts; the slot in the cell is below.
pub const LEVEL_SHIFT: u32 = 24;

/// Level of boxes that overlap nothing.
pub const NO_LEVEL: u32 = u32::MAX >> LEVEL_SHIFT;

/// Lines of cells in finer levels that a box beside the grid of a scene looks at, at most; a box that
/// would look at more is an entry, so that the others look at it.
pub const WIDE_LINES: u32 = 32;

/// Entries of a scene's grid that the host learns: what it chooses the next grid by.
pub const SCENE_SAMPLES: u32 = 128;

/// Pairs of a query that the GPU sorts, at most: each is compared with all others. The host sorts longer rows.
pub const SORTED_ROW: u32 = 256;

/// What a scene's pair is told as: it began, or why it ended.
pub const TOLD_BEGUN: u32 = 0;
/// A box of it was removed.
pub const TOLD_REMOVED: u32 = 1;
/// A box of it is switched off, or both are static.
pub const TOLD_FILTERED: u32 = 2;
/// Its boxes overlap no more.
pub const TOLD_SEPARATED: u32 = 3;

/// A mark of a scene's box: the edit names it.
pub const MARK_NAMES: u32 = 1 << 8;
/// The edit removes it (and may have set it anew).
pub const MARK_REMOVES: u32 = 1 << 9;
/// Its filter data change: its pairs are told as ended and as begun, and the host decides which of them did.
pub const MARK_TOUCHES: u32 = 1 << 10;

const _: () = assert!(SCENE_SAMPLES <= BATCH_BOXES, "one workgroup samples");
const _: () = assert!(GRID_LEVELS < NO_LEVEL && GRID_LEVELS <= 32);
const _: () =
    assert!(SUPER_BATCHES <= BATCH_BOXES, "a thread adds up at most one batch of its own");
const _: () = assert!(PADDING.is_multiple_of(BATCH_BOXES));
const _: () = assert!(BATCH_BOXES.is_multiple_of(4), "a batch of any form is whole words");
const _: () = assert!(BATCH_BOXES <= 256, "a row of a batch and a place share a word of a window");
const _: () = assert!(
    WINDOW_WORDS == 1024 && WINDOW_WORDS.is_multiple_of(BATCH_BOXES),
    "`write_list` searches a window in ten steps, and gives each lane as many of its words"
);
const _: () = assert!(BATCH_BOXES.is_multiple_of(4 * PAIRS_WORKGROUP));
const _: () = assert!(pairmask_core::aabb::AABB_BYTES == BOX_WORDS as usize * 4);

/// The constants as WGSL, what `#import constants` stands for.
pub(crate) fn as_wgsl() -> String {
    let mut text = String::new();
    for (name, value) in [
        ("BATCH_BOXES", BATCH_BOXES),
        ("BATCH_WORDS", BATCH_BOXES / WORD_BITS),
        ("BOX_WORDS", BOX_WORDS),
        ("PAIRS_WORKGROUP", PAIRS_WORKGROUP),
        ("WINDOW_WORDS", WINDOW_WORDS),
        ("LINE_PAIRS", LINE_PAIRS),
        ("SECTION_ALIGN", pairmask_core::mask::SECTION_ALIGN_WORDS as u32),
        ("GRID_LEVELS", GRID_LEVELS),
        ("PARKED", PARKED),
        ("SCAN_CELLS", SCAN_CELLS),
        ("SUPER_BATCHES", SUPER_BATCHES),
        ("SUPERS_MOST", SUPERS_MOST),
        ("CONTROL_HEADER_WORDS", CONTROL_HEADER_WORDS),
        ("LEVEL_SHIFT", LEVEL_SHIFT),
        ("SLOT_MASK", (1 << LEVEL_SHIFT) - 1),
        ("NO_LEVEL", NO_LEVEL),
        ("MARKED_KINDS", MARKED_KINDS as u32),
        ("RANK_SHIFT", RANK_SHIFT),
        ("WIDE_LINES", WIDE_LINES),
        ("SCENE_SAMPLES", SCENE_SAMPLES),
        ("SORTED_ROW", SORTED_ROW),
        ("TOLD_BEGUN", TOLD_BEGUN),
        ("TOLD_REMOVED", TOLD_REMOVED),
        ("TOLD_FILTERED", TOLD_FILTERED),
        ("TOLD_SEPARATED", TOLD_SEPARATED),
        ("MARK_NAMES", MARK_NAMES),
        ("MARK_REMOVES", MARK_REMOVES),
        ("MARK_TOUCHES", MARK_TOUCHES),
    ] {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "const {name}: u32 = {value}u;");
    }
    text
}
