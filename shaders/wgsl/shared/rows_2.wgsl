// Two rows a thread, PAIRS_WORKGROUP apart so that neighbouring threads touch neighbouring words.

const ROWS_PER_THREAD: u32 = 2u;
alias RowsI = vec2<i32>;
alias RowsU = vec2<u32>;

fn row_numbers(first: u32) -> RowsU {
    return RowsU(first, first + PAIRS_WORKGROUP);
}

fn load_rows(first: u32) -> RowsI {
    return RowsI(keys[first], keys[first + PAIRS_WORKGROUP]);
}

fn store_rows(first: u32, words: RowsU) {
    store_word(first, words.x);
    store_word(first + PAIRS_WORKGROUP, words.y);
}

fn store_masks(first: u32, masks: RowsU) {
    strip_masks[first] = masks.x;
    strip_masks[first + PAIRS_WORKGROUP] = masks.y;
}

fn sum_rows(counts: RowsU) -> u32 {
    return counts.x + counts.y;
}
