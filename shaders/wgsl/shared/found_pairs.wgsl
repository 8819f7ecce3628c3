// What `grid_pairs` finds for a list: the pairs of its words, as two boxes each, smaller first. Rows and
// columns become names here, so that no order goes down.

@group(0) @binding(5) var<storage, read_write> found: array<vec2<u32>>;

// The box of each row of the batch.
var<workgroup> row_names: array<u32, BATCH_BOXES>;

// The box at the row's position.
fn name_row(name: u32) {
    row_names[row_lane] = name;
}

// Items of a word.
fn entries_of(word_bits: u32) -> u32 {
    return countOneBits(word_bits);
}

// A word of a row, which is row `of_lane` of the batch, to `at` in the block of found items.
fn store_word(at: u32, of_row: u32, of_lane: u32, word_block: u32, word_bits: u32) {
    let name = row_names[of_lane];
    var to = at;
    var left = word_bits;
    while (left != 0u) {
        let column = 32u * word_block + countTrailingZeros(left);
        left &= left - 1u;
        let other = bitcast<u32>(sorted[2u * column + 1u].z);
        found[to] = vec2<u32>(min(name, other), max(name, other));
        to++;
    }
}
