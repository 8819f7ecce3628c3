//! Numbers that WGSL and Rust share. Each is declared here and nowhere else.

/// Declares constants, and a list of them for WGSL.
macro_rules! constants {
    ($($(#[$doc:meta])* $name:ident = $value:expr;)+) => {
        $($(#[$doc])* pub const $name: u32 = $value;)+

        const ALL: &[(&str, u32)] = &[$((stringify!($name), $name)),+];
    };
}

constants! {
    /// Bits, and so columns, of a mask word.
    WORD_BITS = 32;

    /// Boxes of a batch: a workgroup of the stages that go box by box, and the unit of the census and
    /// of the totals. Larger batches mean fewer reports to add up on the host, smaller ones more
    /// workgroups for small scenes.
    BATCH_BOXES = 256;

    /// Invocations of a workgroup of the pairs stage: two subgroups of 32, so that even a thousand
    /// boxes give every multiprocessor of a large GPU work.
    PAIRS_WORKGROUP = 64;

    /// Words that a batch collects in workgroup memory before it writes them out: three arrays of
    /// this many words, 12 KiB of the 16 KiB that every device has.
    WINDOW_WORDS = 1024;

    /// Pairs of a list in a line of 128 bytes, the largest piece of a reply that a subgroup writes across
    /// the link at once: less than a line costs as much as a line.
    LINE_PAIRS = 16;

    /// Rows and columns are padded to a multiple of this, so that no stage checks whether one exists:
    /// the largest strip of columns, and a multiple of a batch.
    PADDING = 512;

    /// Most column blocks of a strip: its columns take 12 KiB of workgroup memory.
    MAX_STRIP_BLOCKS = PADDING / WORD_BITS;

    /// Words of a box of f32.
    BOX_WORDS = 6;

    /// Most levels of a grid. Levels of doubling cells cover 16 octaves of sizes, of quadrupling ones 32;
    /// what is larger is a giant and looks at everything.
    GRID_LEVELS = 16;

    /// Boxes without a place in a level that share a cell, by index: as few as keep sorting them by
    /// index a matter of one short list.
    UNPLACED_A_CELL = 32;

    /// Cells of a workgroup of the scan: eight a thread, two loads of 16 bytes.
    SCAN_CELLS = 8 * BATCH_BOXES;

    /// Batches whose words are also summed together, so that no batch adds up thousands of others.
    SUPER_BATCHES = 64;

    /// Most groups of batches: as many as there are workgroups along one dimension of a dispatch.
    SUPERS_MOST = 65_536 / SUPER_BATCHES;

    /// First words of the control block, before the sums.
    CONTROL_HEADER_WORDS = 8;

    /// Bit of a home word at which the level starts; the slot in the cell is below.
    LEVEL_SHIFT = 24;

    /// Level of boxes that overlap nothing.
    NO_LEVEL = u32::MAX >> LEVEL_SHIFT;

    /// Lines of cells in finer levels that a box beside the grid of a scene looks at, at most; a box that
    /// would look at more is an entry, so that the others look at it.
    WIDE_LINES = 32;

    /// Entries of a scene's grid that the host learns: what it chooses the next grid by.
    SCENE_SAMPLES = 128;

    /// Pairs of a query that the GPU sorts, at most: each is compared with all others. The host sorts longer rows.
    SORTED_ROW = 256;

    /// Invocations of a workgroup that looks for a ray or a sphere, and boxes of a group of a tree in video memory: a
    /// subgroup of most devices.
    CAST_LANES = 32;

    /// Most levels of such a tree: those of 2^30 boxes.
    CAST_LEVELS = 6;

    /// What a scene's pair is reported as: it began, or why it ended.
    REPORT_BEGUN = 0;
    /// A box of it was removed.
    REPORT_REMOVED = 1;
    /// A box of it is disabled, or both are static.
    REPORT_FILTERED = 2;
    /// Its boxes overlap no more.
    REPORT_SEPARATED = 3;

    /// A mark of a scene's box: the edit names it.
    MARK_NAMES = 1 << 8;
    /// The edit removes it (and may have set it anew).
    MARK_REMOVES = 1 << 9;
    /// Its filter data changes: its pairs are reported as ended and as begun, and the host decides which of them did.
    MARK_TOUCHES = 1 << 10;

    /// Words of a batch's bitmap, a bit a box.
    BATCH_WORDS = BATCH_BOXES / WORD_BITS;

    /// Words to a multiple of which the sections of a mask are rounded up.
    SECTION_ALIGN = pairmask_core::mask::SECTION_ALIGN_WORDS as u32;

    /// The slot of a home word.
    SLOT_MASK = (1 << LEVEL_SHIFT) - 1;

    MARKED_KINDS = pairmask_core::dispatch::MARKED_KINDS as u32;
    RANK_SHIFT = pairmask_core::dispatch::RANK_SHIFT;
}

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
    ALL.iter().fold(String::new(), |text, (name, value)| {
        text + &format!("const {name}: u32 = {value}u;\n")
    })
}
