// grid_scatter: the indices of each cell's boxes together, in the order of their slots.
// Mirror: none; `grid_slot` makes the order that the mirror has.

#import constants
#import grid_params

@group(0) @binding(0) var<storage, read> records: array<vec4<i32>>;
@group(0) @binding(1) var<storage, read> table: array<u32>;
@group(0) @binding(2) var<storage, read_write> ids: array<u32>;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = group.x * BATCH_BOXES + lane;
    if (index < params.n) {
        let home = bitcast<vec4<u32>>(records[params.plane + index]);
        ids[table[home.z] + (home.w & SLOT_MASK)] = index;
    }
}
