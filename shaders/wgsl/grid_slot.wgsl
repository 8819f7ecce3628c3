// grid_slot: each box to its position: by cell, and within a cell by index.
//
// Its place in the cell is the number of smaller indices there, so positions do not depend on the
// order in which threads counted. A cell's boxes are compared with each other all the same, so
// crowded cells cost no more than the pairs stage does there.
// Mirror: `mirror/mod.rs`.

#import constants
#import grid_params

@group(0) @binding(0) var<storage, read> records: array<vec4<i32>>;
@group(0) @binding(1) var<storage, read> table: array<u32>;
@group(0) @binding(2) var<storage, read> ids: array<u32>;
@group(0) @binding(3) var<storage, read> control: array<u32>;
// Two words of four a position: min.x, min.y, min.z, max.x; max.y, max.z, index, level.
@group(0) @binding(4) var<storage, read_write> sorted: array<vec4<i32>>;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = group.x * BATCH_BOXES + lane;
    if (index >= params.n || control[WORK] > params.budget) {
        return;
    }
    let second = records[params.plane + index];
    let home = bitcast<vec2<u32>>(second.zw);
    let start = table[home.x];
    let end = min(table[home.x + 1u], params.n);
    var position = start;
    if (end - start > 1u) {
        for (var p = start; p < end; p++) {
            position += select(0u, 1u, ids[p] < index);
        }
    }
    sorted[2u * position] = records[index];
    let level = bitcast<i32>(home.y >> LEVEL_SHIFT);
    sorted[2u * position + 1u] = vec4<i32>(second.xy, bitcast<i32>(index), level);
}
