// scene_query_sort: the pairs of each query together -> the same by index, where the host reads them.
//
// A pair's place is the number of smaller indices of its query: no two are the same. Rows of more than SORTED_ROW
// pairs stay as they are, and the host sorts them: they would be compared with themselves for too long.
// Held to every box against every query, in order, by the tests of scenes on GPUs.

#import constants
#import scene_params

@group(0) @binding(0) var<storage, read> params: SceneParams;
@group(0) @binding(1) var<storage, read> control: array<u32>;
@group(0) @binding(2) var<storage, read> counts: array<u32>;
@group(0) @binding(3) var<storage, read> ends: array<u32>;
@group(0) @binding(4) var<storage, read> rows: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> found: array<vec2<u32>>;

@compute @workgroup_size(BATCH_BOXES)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    // With more than there is room for, the host comes back.
    let count = select(control[FOUND], 0u, control[FOUND + 1u] != 0u || control[FOUND] > params.pair_capacity);
    for (var i = group.x * BATCH_BOXES + lane; i < count; i += groups.x * BATCH_BOXES) {
        let one = rows[i];
        let query = min(one.x, params.query_count - 1u);
        let length = counts[query];
        var slot = i;
        if (length <= SORTED_ROW) {
            let start = ends[query] - length;
            slot = start;
            for (var j = start; j < start + length; j++) {
                slot += select(0u, 1u, rows[j].y < one.y);
            }
        }
        if (slot < params.pair_capacity) {
            found[slot] = one;
        }
    }
}
