// One row a thread: most threads, for scenes too small to fill the GPU otherwise.

const ROWS_PER_THREAD: u32 = 1u;
alias RowsI = i32;
alias RowsU = u32;

// The rows of this thread in a tile: its lane.
fn row_numbers(first: u32) -> RowsU {
    return first;
}

fn load_rows(first: u32) -> RowsI {
    return keys[first];
}

fn store_rows(first: u32, words: RowsU) {
    store_word(first, words);
}

fn store_masks(first: u32, masks: RowsU) {
    strip_masks[first] = masks;
}

fn sum_rows(counts: RowsU) -> u32 {
    return counts;
}
