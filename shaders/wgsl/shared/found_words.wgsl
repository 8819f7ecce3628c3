// What `grid_pairs` finds for a sparse mask: its non-zero words. The order of the boxes goes down at
// once.

// Three sections of `capacity` words: rows, blocks, bits.
@group(0) @binding(5) var<storage, read_write> found: array<u32>;
// The reply: it starts with the order.
@group(0) @binding(6) var<storage, read_write> reply: array<u32>;

// The box at the row's position.
fn name_row(name: u32) {
    reply[row] = name;
}

// Items of a word.
fn entries_of(word_bits: u32) -> u32 {
    return 1u;
}

// A word of a row, which is row `of_lane` of the batch, to `at` in the block of found items.
fn store_word(at: u32, of_row: u32, of_lane: u32, word_block: u32, word_bits: u32) {
    found[at] = of_row;
    found[params.capacity + at] = word_block;
    found[2u * params.capacity + at] = word_bits;
}
