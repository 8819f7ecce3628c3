// grid_cells: boxes as they lie in (shared) memory, in any form -> integer keys, home cells, census.
//
// One workgroup a batch, one box a thread. A box's level is the finest on which it spans at most two
// cells on each axis; what spans more on all of them is a giant. Giants, and boxes that overlap
// nothing, get cells by their index: UNPLACED_A_CELL consecutive boxes share one. Counting a box in its cell
// gives it a slot there, in any order threads come; `grid_slot` makes an order of it that does
// not depend on that. Where boxes are of several worlds, each world has cells of its own.
// Mirror: `mirror/grid_cells.rs`.

#import constants
#import box_batch
#import grid_params
#import grid_layout
#import box_worlds

// Binding 0: the boxes, of `box_batch`.
@group(0) @binding(1) var<storage, read> grid: GridLayout;
// Boxes of each cell; zero before this stage.
@group(0) @binding(2) var<storage, read_write> table: array<atomic<u32>>;
@group(0) @binding(3) var<storage, read_write> control: array<atomic<u32>>;
// First plane: min.x, min.y, min.z, max.x. Second: max.y, max.z, cell, level << 24 | slot.
@group(0) @binding(4) var<storage, read_write> records: array<vec4<i32>>;
@group(0) @binding(5) var<storage, read_write> totals: array<GridTotals>;
// Bit i % 32 of word i / 32: box i has a NaN.
@group(0) @binding(6) var<storage, read_write> invalid: array<u32>;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let batch = group.x;
    let index = batch * BATCH_BOXES + lane;
    if (index < SUPERS + params.super_count) {
        atomicStore(&control[index], 0u);
    }
    load_batch(batch, lane, params.n);

    if (index < params.n) {
        let box = take_keys(lane);
        var cell = grid.first_giant + parking_of(index);
        var level = grid.level_count;
        // The key of no number.
        if (box.lo.x == NOTHING_MIN) {
            cell = grid.first_nothing + parking_of(index);
            level = NO_LEVEL;
        } else {
            let low = plain3(box.lo);
            let high = plain3(box.hi);
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
        cell += world_of(index);
        let slot = atomicAdd(&table[cell], 1u);
        atomicAdd(&control[SUMS + cell / SCAN_CELLS], 1u);
#import record
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
