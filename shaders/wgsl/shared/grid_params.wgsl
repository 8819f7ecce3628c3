// What every stage of the grid reads, and the words of the control block. Mirror: `layouts.rs`.

struct GridParams {
    // Boxes.
    n: u32,
    // Boxes rounded up to whole batches: where the second half of the records starts.
    plane: u32,
    // Batches of rows (and of boxes).
    batch_count: u32,
    // Groups of SUPER_BATCHES batches.
    super_count: u32,
    // Workgroups of the scan.
    sum_count: u32,
    // Items (mask words or pairs) that the reply, and the block of found items, have room for.
    capacity: u32,
    // Words of a sparse reply before its mask words: the order, rounded up.
    order_words: u32,
    // Crowded cells beyond this many 2^20 tests are left to another engine.
    budget: u32,
    // Most tests of a row: a scene that asks for more is left to another engine.
    row_tests: u32,
}

var<immediate> params: GridParams;

// Words of the control block, at the same place for any n: the sums are zero between frames, the
// others are zeroed by `grid_cells`.
const CURSOR: u32 = 0u;
const WORK: u32 = 1u;
const SUPERS: u32 = CONTROL_HEADER_WORDS;
const SUMS: u32 = SUPERS + SUPERS_MOST;

// What is known of a batch: items, pairs, compared and base of its 256 rows (positions); empty and
// invalid of its 256 boxes.
struct GridTotals {
    // What its rows found: non-zero mask words, or pairs.
    entries: u32,
    // Overlapping pairs.
    pairs: u32,
    // Pairs that were compared.
    compared: u32,
    // First of its items in the block of found items.
    base: u32,
    // Boxes with min > max on some axis.
    empty: u32,
    // Boxes with a NaN.
    invalid: u32,
    padding: array<u32, 2>,
}
