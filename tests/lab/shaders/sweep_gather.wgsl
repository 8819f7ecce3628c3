// sweep_gather: the records of the entries, in their order.

#import constants
#import sweep_params

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read> values: array<u32>;
@group(0) @binding(2) var<storage, read> records: array<vec4<i32>>;
@group(0) @binding(3) var<storage, read_write> sorted: array<vec4<i32>>;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let at = group.x * BATCH_BOXES + lane;
    if (at < min(control[ENTRIES], params.entry_capacity)) {
        let index = values[at];
        sorted[2u * at] = records[2u * index];
        sorted[2u * at + 1u] = records[2u * index + 1u];
    }
}
