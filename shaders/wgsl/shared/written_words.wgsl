// How `grid_write` writes a sparse mask: three sections behind the order, which is there already. They
// follow each other without gaps but those of their alignment, so that the reply depends on the boxes
// alone and not on the room for it.

// Three sections of `capacity` words: rows, blocks, bits.
@group(0) @binding(4) var<storage, read> found: array<u32>;
@group(0) @binding(5) var<storage, read_write> reply: array<u32>;

// The `entries` words from `base` on in the block of found words, to place `first` of `all_entries`.
fn write_entries(lane: u32, base: u32, first: u32, entries: u32, all_entries: u32) {
    let stride = (all_entries + SECTION_ALIGN - 1u) / SECTION_ALIGN * SECTION_ALIGN;
    let reply_rows = params.order_words;
    let reply_blocks = reply_rows + stride;
    let reply_bits = reply_blocks + stride;
    for (var i = lane; i < entries; i += BATCH_BOXES) {
        let slot = first + i;
        if (slot < all_entries) {
            reply[reply_rows + slot] = found[base + i];
            reply[reply_blocks + slot] = found[params.capacity + base + i];
            reply[reply_bits + slot] = found[2u * params.capacity + base + i];
        }
    }
}
