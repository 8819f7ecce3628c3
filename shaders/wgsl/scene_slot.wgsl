// scene_slot: each entry to its position: by cell, within a cell in the order in which threads came.
// Answers are sorted, so that order does not show.
// Held to `pairmask_core::scene` by the tests of scenes on GPUs.

#import constants
#import scene_params
#import scene_records
#import scene_history

@group(0) @binding(0) var<storage, read> params: SceneParams;
@group(0) @binding(1) var<storage, read> now: array<vec4<i32>>;
@group(0) @binding(2) var<storage, read> then: array<vec4<i32>>;
@group(0) @binding(3) var<storage, read> table: array<u32>;
@group(0) @binding(4) var<storage, read> control: array<u32>;
@group(0) @binding(5) var<storage, read> entries: array<vec4<u32>>;
// Two words of four a position: min.x, min.y, min.z, max.x; max.y, max.z, name, level.
@group(0) @binding(6) var<storage, read_write> sorted: array<vec4<i32>>;

@compute @workgroup_size(BATCH_BOXES)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let count = control[ENTRIES];
    if (count > params.entry_capacity) {
        return;
    }
    let threads = groups.x * BATCH_BOXES;
    for (var i = group.x * BATCH_BOXES + lane; i < count; i += threads) {
        let one = entries[i];
        let index = one.x & INDEX_MASK;
        let kinds = one.x >> KINDS_SHIFT;
        let b = now[2u * index + 1u];
        var here = colliding(now[2u * index], b);
        if (params.mode == MODE_CHANGES && has_changed(b) && (kinds & THEN) != 0u) {
            let was = colliding(then[2u * index], then[2u * index + 1u]);
            if (kinds == THEN) {
                here = was;
            } else {
                here = hull(was, here);
            }
        }
        let position = table[one.y] + one.z;
        sorted[2u * position] = vec4<i32>(here.lo, here.hi.x);
        sorted[2u * position + 1u] = vec4<i32>(here.hi.yz, bitcast<vec2<i32>>(one.xw));
    }
}
