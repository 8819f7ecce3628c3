// grid_pairs: each row against the later boxes of the cells around it, 32 positions to a word.
//
// One row a thread. In its own level a row looks at its own line of cells from itself on and at the
// later ones of the eight lines around; in each coarser level at all cells that a box overlapping
// it can have its min corner in; and at all giants. Runs come by rising position, so the words of
// a row come out sorted. They are collected in workgroup memory as they come, put in order of
// (row, block) and written to the block of found items, a stretch a batch; `grid_write` puts the
// batches in order. Items are the words themselves or their pairs (`found_words`, `found_pairs`). A
// batch with more words than fit tests its rows a second time. Where a frame has rules, a row looks at
// cells of its own world, and at boxes that it may meet (`pair_rules`).
// Mirror: `mirror/grid_pairs.rs`.

#import constants
#import order_keys
#import grid_params
#import grid_layout
#import scan
#import pair_rules
#import found

@group(0) @binding(0) var<storage, read> grid: GridLayout;
@group(0) @binding(1) var<storage, read> table: array<u32>;
@group(0) @binding(2) var<storage, read> sorted: array<vec4<i32>>;
@group(0) @binding(3) var<storage, read_write> totals: array<GridTotals>;
@group(0) @binding(4) var<storage, read_write> control: array<atomic<u32>>;
// Bindings from 5 on: the block of found items, of `found`.

var<workgroup> level_starts: array<u32, GRID_LEVELS>;
var<workgroup> level_ends: array<u32, GRID_LEVELS>;
var<workgroup> used_levels: atomic<u32>;
var<workgroup> words_seen: atomic<u32>;
var<workgroup> pair_sum: atomic<u32>;
var<workgroup> compared_sum: atomic<u32>;
var<workgroup> batch_base: u32;
// Row in the batch << 24 | items of the row before the word; block; bits.
var<workgroup> window_slots: array<u32, WINDOW_WORDS>;
var<workgroup> window_blocks: array<u32, WINDOW_WORDS>;
var<workgroup> window_bits: array<u32, WINDOW_WORDS>;

// The row at hand.
var<private> row: u32;
var<private> row_lane: u32;
var<private> row_lo: vec3<i32>;
var<private> row_hi: vec3<i32>;
// The word at hand, items that the row had before it, and pairs and tests of the row.
var<private> block: u32;
var<private> bits: u32;
var<private> entry_count: u32;
var<private> pair_count: u32;
var<private> compared: u32;
// Second time: the row's items go to here in the block of found items, at once.
var<private> again: bool;
var<private> slot: u32;

#import row_object
fn finish_word() {
#import settle_word
    if (bits == 0u) {
        return;
    }
    if (again) {
        store_word(slot + entry_count, row, row_lane, block, bits);
    } else {
        let at = atomicAdd(&words_seen, 1u);
        if (at < WINDOW_WORDS) {
            window_slots[at] = (row_lane << 24u) | entry_count;
            window_blocks[at] = block;
            window_bits[at] = bits;
        }
    }
    entry_count += entries_of(bits);
    pair_count += countOneBits(bits);
    bits = 0u;
}

// Tests the row against the positions start .. end.
fn test_run(start: u32, table_end: u32) {
    // Regardless of what the table holds, a run ends.
    let end = min(table_end, params.n);
    compared += max(end, start) - start;
    if (compared > params.row_tests) {
        return;
    }
    for (var p = start; p < end; p++) {
#import test_position
    }
}

// Cells `first .. first + len` of an axis, folded: `wrapped` of them from 0 on, then the others.
fn folded(first: u32, wrapped: u32, i: u32) -> u32 {
    return select(first + (i - wrapped), i, i < wrapped);
}

fn test_level(index: u32, is_own: bool) {
    let low = cells_of(grid.levels[index], plain3(row_lo));
    var last = cells_of(grid.levels[index], plain3(row_hi));
    let count = vec3<i32>(grid.levels[index].count);
    let wraps = vec3<bool>((vec3<u32>(grid.levels[index].wraps) & vec3<u32>(1u, 2u, 4u)) != vec3<u32>(0u));
    var first = low - 1;
    // Where an axis does not wrap, there is no cell below 0.
    first = select(max(first, vec3<i32>(0)), first, wraps);
    let whole = wraps & (last - first >= count);
    first = select(first, vec3<i32>(0), whole);
    last = select(last, count - 1, whole);
    let len = vec3<u32>(clamp(last - first + 1, vec3<i32>(0), count));
    let start = vec3<u32>(first & grid.levels[index].fold);
    let end = start + len;
    let wrapped = max(end, vec3<u32>(count)) - vec3<u32>(count);

    let width = grid.levels[index].count.x;
    let height = grid.levels[index].count.y;
    let first_cell = world_cell() + grid.levels[index].first_cell;
    let home = vec3<u32>(low & grid.levels[index].fold);
    let own_line = home.z * height + home.y;
    let reach = u32(last.x - low.x);
    for (var k = 0u; k < len.z; k++) {
        let z = folded(start.z, wrapped.z, k);
        for (var j = 0u; j < len.y; j++) {
            let line = z * height + folded(start.y, wrapped.y, j);
            let cell = first_cell + line * width;
            if (is_own & (line <= own_line)) {
                if (line == own_line) {
                    test_run(row + 1u, table[cell + min(home.x + reach, width - 1u) + 1u]);
                    if (wraps.x & (home.x == 0u)) {
                        test_run(table[cell + width - 1u], table[cell + width]);
                    }
                }
                continue;
            }
            if (wrapped.x > 0u) {
                test_run(table[cell], table[cell + wrapped.x]);
            }
            test_run(table[cell + start.x], table[cell + end.x - wrapped.x]);
        }
    }
}

fn test_row(own_level: u32) {
    block = 0xffffffffu;
    bits = 0u;
    entry_count = 0u;
    pair_count = 0u;
    compared = 0u;
    var levels = atomicLoad(&used_levels) & (0xffffffffu << own_level);
    while (levels != 0u) {
        let level = countTrailingZeros(levels);
        levels &= levels - 1u;
        if (!is_empty_here(level)) {
            test_level(level, level == own_level);
        }
    }
    let giants = table[world_cell() + grid.first_giant];
    test_run(max(giants, row + 1u), table[world_cell() + grid.first_nothing]);
    finish_word();
}

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let batch = group.x;
    if (lane == 0u) {
        atomicStore(&used_levels, 0u);
        atomicStore(&words_seen, 0u);
        atomicStore(&pair_sum, 0u);
        atomicStore(&compared_sum, 0u);
    }
    workgroupBarrier();
    if (lane < grid.level_count) {
        let first = grid.levels[lane].first_cell;
        if (has_boxes(first, first + grid.levels[lane].cell_count)) {
            atomicOr(&used_levels, 1u << lane);
        }
    }
    workgroupBarrier();

    // Too much for a grid: the host sees it too, and takes another engine.
    let giant_count = table[grid.first_nothing] - table[grid.first_giant];
    let giant_work = (giant_count >> 10u) * (params.n >> 10u);
    let within_budget = atomicLoad(&control[WORK]) <= params.budget && giant_work <= params.budget;
    let batch_row = batch * BATCH_BOXES;
    row = batch_row + lane;
    row_lane = lane;
    again = false;
    entry_count = 0u;
    var own_level = NO_LEVEL;
    if (row < params.n && within_budget) {
        let a = sorted[2u * row];
        let b = sorted[2u * row + 1u];
#import take_row
        own_level = bitcast<u32>(b.w);
        name_row(bitcast<u32>(b.z));
        take_rules(bitcast<u32>(b.z));
        if (own_level != NO_LEVEL && is_row_within_budget()) {
            test_row(own_level);
            if (compared > params.row_tests) {
                // The host sees it as work.
                atomicMax(&control[WORK], params.budget + 1u);
            }
            if (pair_count != 0u) {
                atomicAdd(&pair_sum, pair_count);
            }
            atomicAdd(&compared_sum, compared);
        }
    }
    let own = entry_count;

    scan[lane] = own;
    workgroupBarrier();
    sum_up(lane);
    let batch_entries = scan[BATCH_BOXES - 1u];
    let own_start = scan[lane] - own;
    note_row(own_start);
    if (lane == 0u) {
        var base = 0u;
        if (batch_entries != 0u) {
            base = atomicAdd(&control[CURSOR], batch_entries);
            atomicAdd(&control[SUPERS + batch / SUPER_BATCHES], batch_entries);
        }
        batch_base = base;
        totals[batch].entries = batch_entries;
        totals[batch].pairs = atomicLoad(&pair_sum);
        totals[batch].compared = atomicLoad(&compared_sum);
        totals[batch].base = base;
    }
    workgroupBarrier();
    let base = batch_base;
    // Items that do not fit are counted only: the host comes back with room for all.
    if (batch_entries == 0u || base > params.capacity || batch_entries > params.capacity - base) {
        return;
    }
    let batch_words = atomicLoad(&words_seen);
    if (batch_words <= WINDOW_WORDS) {
        for (var i = lane; i < batch_words; i += BATCH_BOXES) {
            let of_lane = window_slots[i] >> 24u;
            var before = 0u;
            if (of_lane > 0u) {
                before = scan[of_lane - 1u];
            }
            let at = base + before + (window_slots[i] & 0xffffffu);
            let of_row = batch_row + of_lane;
            store_word(at, of_row, of_lane, window_blocks[i], window_bits[i]);
        }
    } else if (own != 0u) {
        again = true;
        slot = base + own_start;
        test_row(own_level);
    }
}
