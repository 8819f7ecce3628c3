// grid_cells: boxes as they lie in (shared) memory -> integer keys, home cells, census.
//
// One workgroup a batch, one box a thread; each box is read once. A box's level is the finest on
// which it spans at most two cells on each axis; what spans more on all of them is a giant. Giants,
// and boxes that overlap nothing, get cells by their index: PARKED consecutive boxes share one.
// Counting a box in its cell gives it a slot there, in whatever order threads come; `grid_place`
// makes an order of it that does not depend on that.
// Mirror: `grid/mirror.rs`, `homes`.

#import constants
#import order_keys
#import grid_params
#import grid_layout

@group(0) @binding(0) var<storage, read> boxes: array<u32>;
@group(0) @binding(1) var<storage, read> grid: GridLayout;
// Boxes of each cell; zero before this stage.
@group(0) @binding(2) var<storage, read_write> table: array<atomic<u32>>;
@group(0) @binding(3) var<storage, read_write> control: array<atomic<u32>>;
// First plane: min.x, min.y, min.z, max.x. Second: max.y, max.z, cell, level << 24 | slot.
@group(0) @binding(4) var<storage, read_write> records: array<vec4<i32>>;
@group(0) @binding(5) var<storage, read_write> totals: array<GridTotals>;
// Bit i % 32 of word i / 32: box i has a NaN.
@group(0) @binding(6) var<storage, read_write> invalid: array<u32>;

var<workgroup> raw: array<u32, RAW_WORDS>;
var<workgroup> invalid_bits: array<atomic<u32>, BATCH_WORDS>;
var<workgroup> empty_count: atomic<u32>;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let batch = group.x;
    let word_count = params.n * BOX_WORDS;
    // Neighbouring lanes read neighbouring words: over the link every byte crosses once.
    for (var i = lane; i < RAW_WORDS; i += BATCH_BOXES) {
        let word = batch * RAW_WORDS + i;
        if (word < word_count) {
            raw[i] = boxes[word];
        }
    }
    if (lane < BATCH_WORDS) {
        atomicStore(&invalid_bits[lane], 0u);
    }
    if (lane == 0u) {
        atomicStore(&empty_count, 0u);
    }
    let index = batch * BATCH_BOXES + lane;
    if (index < SUPERS + params.super_count) {
        atomicStore(&control[index], 0u);
    }
    workgroupBarrier();

    if (index < params.n) {
        let at = lane * BOX_WORDS;
        let lo_bits = vec3<u32>(raw[at], raw[at + 1u], raw[at + 2u]);
        let hi_bits = vec3<u32>(raw[at + 3u], raw[at + 4u], raw[at + 5u]);
        var lo = vec3<i32>(order_key(lo_bits.x), order_key(lo_bits.y), order_key(lo_bits.z));
        var hi = vec3<i32>(order_key(hi_bits.x), order_key(hi_bits.y), order_key(hi_bits.z));
        let is_invalid = is_nan(lo_bits.x) | is_nan(lo_bits.y) | is_nan(lo_bits.z)
            | is_nan(hi_bits.x) | is_nan(hi_bits.y) | is_nan(hi_bits.z);
        let is_empty = any(lo > hi);
        var cell = grid.first_giant + index / PARKED;
        var level = grid.level_count;
        if (is_invalid | is_empty) {
            if (is_invalid) {
                atomicOr(&invalid_bits[lane / 32u], 1u << (lane % 32u));
            } else {
                atomicAdd(&empty_count, 1u);
            }
            lo = vec3<i32>(NOTHING_MIN);
            hi = vec3<i32>(NOTHING_MAX);
            cell = grid.first_nothing + index / PARKED;
            level = NO_LEVEL;
        } else {
            let low = plain3(lo);
            let high = plain3(hi);
            for (var l = 0u; l < grid.level_count; l++) {
                let first = cells_of(grid.levels[l], low);
                let last = cells_of(grid.levels[l], high);
                if (all(last - first <= vec3<i32>(1))) {
                    cell = cell_at(grid.levels[l], first);
                    level = l;
                    break;
                }
            }
        }
        let slot = atomicAdd(&table[cell], 1u);
        atomicAdd(&control[SUMS + cell / SCAN_CELLS], 1u);
        records[index] = vec4<i32>(lo, hi.x);
        let home = bitcast<vec2<i32>>(vec2<u32>(cell, (level << LEVEL_SHIFT) | slot));
        records[params.plane + index] = vec4<i32>(hi.y, hi.z, home.x, home.y);
    }

    workgroupBarrier();
    if (lane < BATCH_WORDS) {
        invalid[batch * BATCH_WORDS + lane] = atomicLoad(&invalid_bits[lane]);
    }
    if (lane == 0u) {
        totals[batch].empty = atomicLoad(&empty_count);
        var count = 0u;
        for (var i = 0u; i < BATCH_WORDS; i++) {
            count += countOneBits(atomicLoad(&invalid_bits[i]));
        }
        totals[batch].invalid = count;
    }
}
