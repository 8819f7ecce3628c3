// How `grid_write` writes a list: its pairs, and nothing else.

@group(0) @binding(4) var<storage, read> found: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> reply: array<vec2<u32>>;

// The `entries` pairs from `base` on in the block of found pairs, to place `first` of `all_entries`. The
// first lane starts at a line of the reply, so that subgroups write whole lines across the link.
fn write_entries(lane: u32, base: u32, first: u32, entries: u32, all_entries: u32) {
    let skew = first % LINE_PAIRS;
    for (var i = lane; i < skew + entries; i += BATCH_BOXES) {
        let slot = first - skew + i;
        if (i >= skew && slot < all_entries) {
            reply[slot] = found[base + i - skew];
        }
    }
}
