// grid_write: the found items, words or pairs, to the reply, in order of the rows, and the frame's sums.
//
// One workgroup a batch of rows: the items of earlier batches are added up from the totals, so each
// item's place is known before it is written (`written_words`, `written_pairs`). On the way the table
// of cells and the sums of the scan are zeroed for the next frame: the link is what this stage waits
// for.
// Mirror: none; it copies the items that `mirror/grid_pairs.rs` has.

#import constants
#import order_keys
#import grid_params
#import grid_layout
#import written_worlds
#import written

struct GridSummary {
    // 64 bits each, low span first.
    entries: vec2<u32>,
    pairs: vec2<u32>,
    compared: vec2<u32>,
    empty: u32,
    invalid: u32,
    // Crowded cells, and giants, in 2^20 tests: beyond the budget nothing was looked for.
    work: u32,
    giant_work: u32,
    padding: vec2<u32>,
}

@group(0) @binding(0) var<storage, read> grid: GridLayout;
@group(0) @binding(1) var<storage, read_write> table: array<u32>;
@group(0) @binding(2) var<storage, read> totals: array<GridTotals>;
@group(0) @binding(3) var<storage, read_write> control: array<u32>;
// Bindings 4 and 5: the block of found items and the reply, of `written`.
@group(0) @binding(6) var<storage, read_write> summary: GridSummary;

var<workgroup> earlier_sum: atomic<u32>;
var<workgroup> total_sum: atomic<u32>;
var<workgroup> sums: array<array<u32, BATCH_BOXES>, 8>;
var<workgroup> giant_work: u32;

// a + b of 64 bits.
fn add64(a: vec2<u32>, b: vec2<u32>) -> vec2<u32> {
    let low = a.x + b.x;
    return vec2<u32>(low, a.y + b.y + select(0u, 1u, low < a.x));
}

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let batch = group.x;
    if (lane == 0u) {
        atomicStore(&earlier_sum, 0u);
        atomicStore(&total_sum, 0u);
    }
    workgroupBarrier();
    let super_batch = batch / SUPER_BATCHES;
    var earlier = 0u;
    var total = 0u;
    for (var i = lane; i < params.super_count; i += BATCH_BOXES) {
        let entries = control[SUPERS + i];
        total += entries;
        earlier += select(0u, entries, i < super_batch);
    }
    let in_super = super_batch * SUPER_BATCHES + lane;
    if (in_super < batch) {
        earlier += totals[in_super].entries;
    }
    if (earlier != 0u) {
        atomicAdd(&earlier_sum, earlier);
    }
    if (total != 0u) {
        atomicAdd(&total_sum, total);
    }
    workgroupBarrier();

    let first = atomicLoad(&earlier_sum);
    let base = totals[batch].base;
    let entries = totals[batch].entries;
    // All or nothing: the host comes back where there is no room for all. (A total beyond 32 bits
    // may look small here, but then some batch did not fit, and the host has the true one.)
    let all_entries = atomicLoad(&total_sum);
    if (all_entries <= params.capacity && base <= all_entries && entries <= all_entries - base) {
        write_entries(lane, base, first, entries, all_entries);
    }
    let thread = batch * BATCH_BOXES + lane;
    report_worlds(thread, first);
    let thread_count = params.batch_count * BATCH_BOXES;
    for (var i = thread; i < params.sum_count; i += thread_count) {
        control[SUMS + i] = 0u;
    }
    // All that the scan wrote, but for two starts: the first workgroup reads them below.
    let table_end = (grid.cell_end / SCAN_CELLS + 1u) * SCAN_CELLS;
    for (var i = thread; i < table_end; i += thread_count) {
        if (i != grid.first_giant && i != grid.first_nothing) {
            table[i] = 0u;
        }
    }
    if (batch != 0u) {
        return;
    }

    if (lane == 0u) {
        let giants = table[grid.first_nothing] - table[grid.first_giant];
        giant_work = (giants >> 10u) * (params.n >> 10u);
        table[grid.first_giant] = 0u;
        table[grid.first_nothing] = 0u;
    }
    var entry_sum = vec2<u32>(0u);
    var pair_sum = vec2<u32>(0u);
    var compared_sum = vec2<u32>(0u);
    var empty = 0u;
    var invalid = 0u;
    for (var i = lane; i < params.batch_count; i += BATCH_BOXES) {
        let one = totals[i];
        entry_sum = add64(entry_sum, vec2<u32>(one.entries, 0u));
        pair_sum = add64(pair_sum, vec2<u32>(one.pairs, 0u));
        compared_sum = add64(compared_sum, vec2<u32>(one.compared, 0u));
        empty += one.empty;
        invalid += one.invalid;
    }
    sums[0][lane] = entry_sum.x;
    sums[1][lane] = entry_sum.y;
    sums[2][lane] = pair_sum.x;
    sums[3][lane] = pair_sum.y;
    sums[4][lane] = compared_sum.x;
    sums[5][lane] = compared_sum.y;
    sums[6][lane] = empty;
    sums[7][lane] = invalid;
    for (var span = BATCH_BOXES / 2u; span > 0u; span /= 2u) {
        workgroupBarrier();
        if (lane < span) {
            let other = lane + span;
            for (var i = 0u; i < 6u; i += 2u) {
                let a = vec2<u32>(sums[i][lane], sums[i + 1u][lane]);
                let b = vec2<u32>(sums[i][other], sums[i + 1u][other]);
                let both = add64(a, b);
                sums[i][lane] = both.x;
                sums[i + 1u][lane] = both.y;
            }
            sums[6][lane] += sums[6][other];
            sums[7][lane] += sums[7][other];
        }
    }
    if (lane == 0u) {
        summary.entries = vec2<u32>(sums[0][0], sums[1][0]);
        summary.pairs = vec2<u32>(sums[2][0], sums[3][0]);
        summary.compared = vec2<u32>(sums[4][0], sums[5][0]);
        summary.empty = sums[6][0];
        summary.invalid = sums[7][0];
        summary.work = control[WORK];
        summary.giant_work = giant_work;
    }
}
