// What `grid_pairs` finds for a list: pairs of box names, smaller first. A test reads the name of the
// column with its keys, so that no name is looked up later and no order goes down.

@group(0) @binding(5) var<storage, read_write> found: array<vec2<u32>>;

const WINDOW_ITEMS: u32 = WINDOW_PAIRS;
// The other box of the pairs that `window_places` holds the places of.
var<workgroup> window_names: array<u32, WINDOW_PAIRS>;
// The box of each row of the batch.
var<workgroup> row_names: array<u32, BATCH_BOXES>;

// The box at the row's position.
fn name_row(name: u32) {
    row_names[row_lane] = name;
}

fn begin_row() {
}

fn named_pair(a: u32, b: u32) -> vec2<u32> {
    return vec2<u32>(min(a, b), max(a, b));
}

// The row overlaps the box `name` at a later position than the last one.
fn note_overlap(position: u32, name: u32) {
    if (again) {
        found[place + item_count] = named_pair(row_names[row_lane], name);
    } else {
        let at = atomicAdd(&items_seen, 1u);
        if (at < WINDOW_ITEMS) {
            window_places[at] = (row_lane << 24u) | item_count;
            window_names[at] = name;
        }
    }
    item_count += 1u;
}

fn end_row() {
    pair_count = item_count;
}

// Item `i` of the window, of row `of_lane` of the batch, to `at` in the block of found items.
fn store_item(i: u32, at: u32, batch: u32, of_lane: u32) {
    found[at] = named_pair(row_names[of_lane], window_names[i]);
}
