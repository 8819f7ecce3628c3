// How `grid_write` writes a sparse mask: three sections behind the order, which is there already. They
// follow each other without gaps but those of their alignment, so that the reply depends on the boxes
// alone and not on the room for it.

// Three sections of `capacity` words: rows, blocks, bits.
@group(0) @binding(4) var<storage, read> found: array<u32>;
@group(0) @binding(5) var<storage, read_write> reply: array<u32>;

// The `items` words from `base` on in the block of found words, to place `first` of `all_items`.
fn write_items(lane: u32, base: u32, first: u32, items: u32, all_items: u32) {
    let stride = (all_items + SECTION_ALIGN - 1u) / SECTION_ALIGN * SECTION_ALIGN;
    let reply_rows = params.order_words;
    let reply_blocks = reply_rows + stride;
    let reply_bits = reply_blocks + stride;
    for (var i = lane; i < items; i += BATCH_BOXES) {
        let place = first + i;
        if (place < all_items) {
            reply[reply_rows + place] = found[base + i];
            reply[reply_blocks + place] = found[params.capacity + base + i];
            reply[reply_bits + place] = found[2u * params.capacity + base + i];
        }
    }
}
