// Four rows a thread, PAIRS_WORKGROUP apart: each column read serves four tests.

const ROWS_PER_THREAD: u32 = 4u;
alias RowsI = vec4<i32>;
alias RowsU = vec4<u32>;

fn row_numbers(first: u32) -> RowsU {
    return first + PAIRS_WORKGROUP * RowsU(0u, 1u, 2u, 3u);
}

fn load_rows(first: u32) -> RowsI {
    return RowsI(
        keys[first],
        keys[first + PAIRS_WORKGROUP],
        keys[first + 2u * PAIRS_WORKGROUP],
        keys[first + 3u * PAIRS_WORKGROUP],
    );
}

fn store_rows(first: u32, words: RowsU) {
    store_word(first, words.x);
    store_word(first + PAIRS_WORKGROUP, words.y);
    store_word(first + 2u * PAIRS_WORKGROUP, words.z);
    store_word(first + 3u * PAIRS_WORKGROUP, words.w);
}

fn store_masks(first: u32, masks: RowsU) {
    strip_masks[first] = masks.x;
    strip_masks[first + PAIRS_WORKGROUP] = masks.y;
    strip_masks[first + 2u * PAIRS_WORKGROUP] = masks.z;
    strip_masks[first + 3u * PAIRS_WORKGROUP] = masks.w;
}

fn sum_rows(counts: RowsU) -> u32 {
    return counts.x + counts.y + counts.z + counts.w;
}
