// What `grid_pairs` finds for a sparse mask: non-zero words, 32 positions to a word, and the order.

// Three sections of `capacity` words: rows, blocks, bits.
@group(0) @binding(5) var<storage, read_write> found: array<u32>;
// The reply: it starts with the order.
@group(0) @binding(6) var<storage, read_write> reply: array<u32>;

const WINDOW_ITEMS: u32 = WINDOW_WORDS;
// Blocks and bits of the words that `window_places` holds the places of.
var<workgroup> window_blocks: array<u32, WINDOW_WORDS>;
var<workgroup> window_bits: array<u32, WINDOW_WORDS>;

// The word at hand.
var<private> block: u32;
var<private> bits: u32;

// The box at the row's position.
fn name_row(name: u32) {
    reply[row] = name;
}

fn begin_row() {
    block = 0xffffffffu;
    bits = 0u;
}

// The row overlaps the box `name` at a later position than the last one.
fn note_overlap(position: u32, name: u32) {
    if (position / 32u != block) {
        finish_word();
        block = position / 32u;
    }
    bits |= 1u << (position % 32u);
}

fn end_row() {
    finish_word();
}

fn finish_word() {
    if (bits == 0u) {
        return;
    }
    if (again) {
        found[place + item_count] = row;
        found[params.capacity + place + item_count] = block;
        found[2u * params.capacity + place + item_count] = bits;
    } else {
        let at = atomicAdd(&items_seen, 1u);
        if (at < WINDOW_ITEMS) {
            window_places[at] = (row_lane << 24u) | item_count;
            window_blocks[at] = block;
            window_bits[at] = bits;
        }
    }
    item_count += 1u;
    pair_count += countOneBits(bits);
    bits = 0u;
}

// Item `i` of the window, of row `of_lane` of the batch, to `at` in the block of found items.
fn store_item(i: u32, at: u32, batch: u32, of_lane: u32) {
    found[at] = batch * BATCH_BOXES + of_lane;
    found[params.capacity + at] = window_blocks[i];
    found[2u * params.capacity + at] = window_bits[i];
}
