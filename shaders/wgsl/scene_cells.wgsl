// scene_cells: records -> entries of the grid, counted in their cells, and rows beside the grid.
//
// Entries are the boxes that a pair must have one of: those that changed (or that the edit named), as
// the hull of what they were and are; as two entries where they have left their place. All others
// that collide are rows, which look at all entries around them; but boxes so large that they would look
// at many cells of finer levels are entries too (`wide`), so that those look at them. A dense search has
// no rows. Queries are entries, and all boxes of the scene are rows beside them.
// Held to `pairmask_core::scene` by the tests of scenes on GPUs.

#import constants
#import scene_params
#import scene_records
#import scene_history
#import grid_layout
#import scene_filter

@group(0) @binding(0) var<storage, read> params: SceneParams;
@group(0) @binding(1) var<storage, read> grid: GridLayout;
@group(0) @binding(2) var<storage, read> now: array<vec4<i32>>;
@group(0) @binding(3) var<storage, read> then: array<vec4<i32>>;
@group(0) @binding(4) var<storage, read> named: array<u32>;
@group(0) @binding(5) var<storage, read_write> table: array<atomic<u32>>;
@group(0) @binding(6) var<storage, read_write> control: array<atomic<u32>>;
// Name, cell, slot in the cell, level.
@group(0) @binding(7) var<storage, read_write> entries: array<vec4<u32>>;

var<workgroup> entry_count: atomic<u32>;
var<workgroup> row_bits: array<atomic<u32>, BATCH_WORDS>;
var<workgroup> row_count: atomic<u32>;
var<workgroup> moved_count: atomic<u32>;
var<workgroup> moved_static_count: atomic<u32>;
var<workgroup> entry_base: u32;

// The finest level in which a box spans at most two cells an axis.
fn level_of(low: vec3<f32>, high: vec3<f32>) -> u32 {
    for (var l = 0u; l < grid.level_count; l++) {
        let spans = cells_of(grid.levels[l], high) - cells_of(grid.levels[l], low);
        if (all(spans <= vec3<i32>(1))) {
            return l;
        }
    }
    return grid.level_count;
}

// Whether a box of a level would look at many lines of cells in finer ones.
fn is_wide(level: u32, low: vec3<f32>, high: vec3<f32>) -> bool {
    if (level == grid.level_count) {
        return true;
    }
    var lines = 0.0;
    for (var l = 0u; l < level; l++) {
        let spans = cells_of(grid.levels[l], high) - cells_of(grid.levels[l], low);
        lines += f32(spans.y + 2) * f32(spans.z + 2);
    }
    return lines > f32(WIDE_LINES);
}

// Counts an entry in its cell, and sets its bits of the filter.
fn home(index: u32, kinds: u32, level: u32, low: vec3<f32>, high: vec3<f32>) -> vec4<u32> {
    var cell = grid.first_giant + index / UNPLACED_A_CELL;
    if (level < grid.level_count) {
        let first = cells_of(grid.levels[level], low);
        cell = cell_at(grid.levels[level], first);
        if (params.dense == 0u) {
            let spans = cells_of(grid.levels[level], high) - first;
            // Three cells a line at the most, so a word or two.
            let run = (2u << u32(spans.x + 1)) - 1u;
            for (var z = -1; z <= spans.z; z++) {
                for (var y = -1; y <= spans.y; y++) {
                    let bit = filter_bit(level, first + vec3<i32>(-1, y, z));
                    let word = params.table_words + bit / 32u;
                    atomicOr(&table[word], run << (bit % 32u));
                    let rest = (run >> 1u) >> (31u - bit % 32u);
                    if (rest != 0u) {
                        let next = (bit / 32u + 1u) & (params.filter_words - 1u);
                        atomicOr(&table[params.table_words + next], rest);
                    }
                }
            }
        }
    }
    let slot = atomicAdd(&table[cell], 1u);
    atomicAdd(&control[SUMS + cell / SCAN_CELLS], 1u);
    return vec4<u32>((kinds << KINDS_SHIFT) | index, cell, slot, level);
}

fn entry(index: u32, kinds: u32, one: SceneBox) -> vec4<u32> {
    let low = plain3(one.lo);
    let high = plain3(one.hi);
    return home(index, kinds, level_of(low, high), low, high);
}

@compute @workgroup_size(BATCH_BOXES)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    if (lane == 0u) {
        atomicStore(&row_count, 0u);
        atomicStore(&moved_count, 0u);
        atomicStore(&moved_static_count, 0u);
    }
    let batches = (params.slots + BATCH_BOXES - 1u) / BATCH_BOXES;
    for (var batch = group.x; batch < batches; batch += groups.x) {
        if (lane < BATCH_WORDS) {
            atomicStore(&row_bits[lane], 0u);
        }
        if (lane == 0u) {
            atomicStore(&entry_count, 0u);
        }
        workgroupBarrier();
        let index = batch * BATCH_BOXES + lane;
        var first = vec4<u32>(0u);
        var second = vec4<u32>(0u);
        var count = 0u;
        if (index < params.slots) {
            let b = now[2u * index + 1u];
            let is = colliding(now[2u * index], b);
            if (params.mode == MODE_CHANGES && has_changed(b)) {
                let was = colliding(then[2u * index], then[2u * index + 1u]);
                if ((bitcast<u32>(b.w) & (PRESENT | DISABLED)) == PRESENT) {
                    atomicAdd(&moved_count, 1u);
                    if (is.is_static) {
                        atomicAdd(&moved_static_count, 1u);
                    }
                }
                if (!is_nothing(was) && !is_nothing(is) && overlap(was, is)) {
                    first = entry(index, THEN | NOW, hull(was, is));
                    count = 1u;
                } else {
                    if (!is_nothing(was)) {
                        first = entry(index, THEN, was);
                        count = 1u;
                    }
                    if (!is_nothing(is)) {
                        second = entry(index, NOW, is);
                        if (count == 0u) {
                            first = second;
                        }
                        count++;
                    }
                }
            } else if (!is_nothing(is)) {
                var kinds = select(NOW, THEN | NOW, params.mode == MODE_CHANGES);
                var is_entry = params.dense != 0u;
                if (params.mode == MODE_MOVED && named[index] == params.naming) {
                    kinds = THEN | NOW;
                    is_entry = true;
                }
                if (params.mode == MODE_QUERY && index >= params.set_first) {
                    kinds = THEN | NOW;
                    is_entry = true;
                }
                let low = plain3(is.lo);
                let high = plain3(is.hi);
                let level = level_of(low, high);
                if (is_entry || is_wide(level, low, high)) {
                    first = home(index, kinds, level, low, high);
                    count = 1u;
                    if (params.mode == MODE_QUERY && !is_entry) {
                        atomicAdd(&moved_count, 1u);
                    }
                } else {
                    atomicOr(&row_bits[lane / 32u], 1u << (lane % 32u));
                }
            }
        }
        var at = 0u;
        if (count != 0u) {
            at = atomicAdd(&entry_count, count);
        }
        workgroupBarrier();
        if (lane < BATCH_WORDS) {
            let bits = atomicLoad(&row_bits[lane]);
            atomicStore(&table[params.table_words + params.filter_words + batch * BATCH_WORDS + lane], bits);
            if (bits != 0u) {
                atomicAdd(&row_count, countOneBits(bits));
            }
        }
        if (lane == 0u) {
            let all = atomicLoad(&entry_count);
            if (all != 0u) {
                entry_base = atomicAdd(&control[ENTRIES], all);
            }
        }
        workgroupBarrier();
        // Entries without room are counted only: the host comes back with room for all.
        if (count > 0u && entry_base + at < params.entry_capacity) {
            entries[entry_base + at] = first;
        }
        if (count > 1u && entry_base + at + 1u < params.entry_capacity) {
            entries[entry_base + at + 1u] = second;
        }
        workgroupBarrier();
    }
    // Once for all batches of the workgroup: thousands of additions to one word wait for each other.
    if (lane == 0u) {
        let rows = atomicLoad(&row_count);
        if (rows != 0u) {
            atomicAdd(&control[ROWS], rows);
        }
        if (atomicLoad(&moved_count) != 0u) {
            atomicAdd(&control[MOVED], atomicLoad(&moved_count));
            atomicAdd(&control[MOVED_STATIC], atomicLoad(&moved_static_count));
        }
    }
}
