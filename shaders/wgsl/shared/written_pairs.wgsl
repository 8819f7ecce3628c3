// How `grid_write` writes a list: its pairs, and nothing else.

@group(0) @binding(4) var<storage, read> found: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> reply: array<vec2<u32>>;

// The `items` pairs from `base` on in the block of found pairs, to place `first` of `all_items`. The
// first lane starts at a line of the reply, so that subgroups write whole lines across the link.
fn write_items(lane: u32, base: u32, first: u32, items: u32, all_items: u32) {
    let skew = first % LINE_PAIRS;
    for (var i = lane; i < skew + items; i += BATCH_BOXES) {
        let place = first - skew + i;
        if (i >= skew && place < all_items) {
            reply[place] = found[base + i - skew];
        }
    }
}
