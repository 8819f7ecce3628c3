// grid_scan: boxes of each cell -> first position of each cell, in place.
//
// A workgroup takes SCAN_CELLS cells. The boxes of all cells before it are the sum of what
// `grid_cells` counted for each workgroup here, so that one dispatch does it without waiting for
// one another. What crowded cells will cost is added up on the way.
// Mirror: `mirror/mod.rs`.

#import constants
#import grid_params
#import order_keys
#import grid_layout
#import scan

@group(0) @binding(0) var<storage, read> grid: GridLayout;
@group(0) @binding(1) var<storage, read_write> table: array<vec4<u32>>;
@group(0) @binding(2) var<storage, read_write> control: array<atomic<u32>>;

var<workgroup> earlier_sum: atomic<u32>;
var<workgroup> work_sum: atomic<u32>;

fn sum4(v: vec4<u32>) -> u32 {
    return v.x + v.y + v.z + v.w;
}

// First positions of four cells of which `before` boxes come before.
fn starts4(counts: vec4<u32>, before: u32) -> vec4<u32> {
    let y = before + counts.x;
    let z = y + counts.y;
    return vec4<u32>(before, y, z, z + counts.z);
}

// Tests within crowded cells, in units of 2^20; nothing for the others.
fn work4(counts: vec4<u32>) -> u32 {
    let crowd = counts >> vec4<u32>(10u);
    return sum4(crowd * crowd);
}

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    // The entry after the last cell is the number of boxes.
    if (group.x * SCAN_CELLS > grid.cell_end) {
        return;
    }
    if (lane == 0u) {
        atomicStore(&earlier_sum, 0u);
        atomicStore(&work_sum, 0u);
    }
    let at = group.x * (SCAN_CELLS / 4u) + 2u * lane;
    let a = table[at];
    let b = table[at + 1u];
    var earlier = 0u;
    for (var i = lane; i < group.x; i += BATCH_BOXES) {
        earlier += atomicLoad(&control[SUMS + i]);
    }
    let own = sum4(a) + sum4(b);
    scan[lane] = own;
    workgroupBarrier();
    if (earlier != 0u) {
        atomicAdd(&earlier_sum, earlier);
    }
    let work = work4(a) + work4(b);
    if (work != 0u) {
        atomicAdd(&work_sum, work);
    }
    sum_up(lane);
    let start = atomicLoad(&earlier_sum) + scan[lane] - own;
    table[at] = starts4(a, start);
    table[at + 1u] = starts4(b, start + sum4(a));
    if (lane == 0u) {
        let total = atomicLoad(&work_sum);
        if (total != 0u) {
            atomicAdd(&control[WORK], total);
        }
    }
}
