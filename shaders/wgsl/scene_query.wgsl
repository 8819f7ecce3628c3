// scene_query: queries as they lie in (shared) memory, against the grid of all boxes -> each query with the boxes
// that it overlaps, and how many those are.
//
// QUERY_LANES threads share the lines of cells around a query: a box has few, so that none waits for long, and
// the loads of a query's lines are under way together. Boxes that no level takes are shared in the same way.
// Held to every box against every query by the tests of scenes on GPUs.

#import scene_found

// Six f32 each: min.x min.y min.z max.x max.y max.z.
@group(0) @binding(4) var<storage, read> queries: array<u32>;
// Pairs of each query.
@group(0) @binding(5) var<storage, read_write> counts: array<u32>;

// Threads of a query.
const QUERY_LANES: u32 = 32u;
// Queries of a workgroup at a time.
const TOGETHER: u32 = BATCH_BOXES / QUERY_LANES;

var<workgroup> raw: array<u32, BOX_WORDS * TOGETHER>;
var<workgroup> pair_counts: array<atomic<u32>, TOGETHER>;

// The query at hand: its number, its place among those of the workgroup, its box.
var<private> number: u32;
var<private> own: u32;
var<private> row_lo: vec3<i32>;
var<private> row_hi: vec3<i32>;
var<private> tested: u32;

// Tests the query against the positions start .. end.
fn test_run(start: u32, table_end: u32, step: u32) {
    // Regardless of what the table holds, a run ends.
    let end = min(table_end, params.entry_capacity);
    let length = (max(end, start) - start + step - 1u) / step;
    tested += length;
    if (!may_take_rounds(length)) {
        return;
    }
    for (var p = start; p < end; p += step) {
        let a = sorted[2u * p];
        if (all(a.xyz <= row_hi) & (row_lo.x <= a.w)) {
            let b = sorted[2u * p + 1u];
            if (all(row_lo.yz <= b.xy)) {
                atomicAdd(&pair_counts[own], 1u);
                report(vec2<u32>(number, bitcast<u32>(b.z) & INDEX_MASK));
            }
        }
    }
}

// Tests the query against the entries of a level: this thread's share of its lines, from `share` on.
fn test_level(index: u32, share: u32) {
    let around = cells_around(index, row_lo, row_hi);
    let width = grid.levels[index].count.x;
    let height = grid.levels[index].count.y;
    for (var line = share; line < around.len.y * around.len.z; line += QUERY_LANES) {
        let z = folded(around.start.z, around.wrapped.z, line / around.len.y);
        let y = folded(around.start.y, around.wrapped.y, line % around.len.y);
        let cell = grid.levels[index].first_cell + (z * height + y) * width;
        // Two runs: before and behind where the axis wraps.
        if (around.wrapped.x > 0u) {
            test_run(table[cell], table[cell + around.wrapped.x], 1u);
        }
        test_run(table[cell + around.start.x], table[cell + around.end.x - around.wrapped.x], 1u);
    }
}

// Takes the box of the query at hand; whether it can overlap anything.
fn take_query() -> bool {
    let at = BOX_WORDS * own;
    let lo = vec3<u32>(raw[at], raw[at + 1u], raw[at + 2u]);
    let hi = vec3<u32>(raw[at + 3u], raw[at + 4u], raw[at + 5u]);
    row_lo = vec3<i32>(order_key(lo.x), order_key(lo.y), order_key(lo.z));
    row_hi = vec3<i32>(order_key(hi.x), order_key(hi.y), order_key(hi.z));
    let is_invalid = is_nan(lo.x) | is_nan(lo.y) | is_nan(lo.z) | is_nan(hi.x) | is_nan(hi.y) | is_nan(hi.z);
    return !is_invalid && all(row_lo <= row_hi);
}

fn search(group: u32, groups: u32, lane: u32) {
    begin_search(lane);
    if (is_too_much != 0u) {
        return;
    }
    own = lane / QUERY_LANES;
    let share = lane % QUERY_LANES;
    for (var first = group * TOGETHER; first < params.query_count; first += groups * TOGETHER) {
        if (lane < BOX_WORDS * TOGETHER && BOX_WORDS * first + lane < BOX_WORDS * params.query_count) {
            raw[lane] = queries[BOX_WORDS * first + lane];
        }
        if (lane < TOGETHER) {
            atomicStore(&pair_counts[lane], 0u);
        }
        if (lane == 0u) {
            is_too_much = select(0u, 1u, atomicLoad(&control[TESTED + 1u]) >= params.budget);
        }
        workgroupBarrier();
        if (is_too_much != 0u) {
            break;
        }
        number = first + own;
        tested = 0u;
        if (number < params.query_count && take_query()) {
            var levels = atomicLoad(&used_levels);
            while (levels != 0u) {
                let level = countTrailingZeros(levels);
                levels &= levels - 1u;
                test_level(level, share);
            }
            test_run(table[grid.first_giant] + share, table[grid.first_nothing], QUERY_LANES);
        }
        count_tests(tested);
        note_rounds();
        workgroupBarrier();
        if (lane < TOGETHER && first + lane < params.query_count) {
            counts[first + lane] = atomicLoad(&pair_counts[lane]);
        }
        hand_out(lane);
        workgroupBarrier();
    }
}

@compute @workgroup_size(BATCH_BOXES)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    search(group.x, groups.x, lane);
    end_search(groups.x, lane);
}
