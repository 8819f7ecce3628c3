// scene_query_deal: pairs as they were found -> the pairs of each query together, in the order in which threads
// came. The start of each query becomes its end.
// Mirror: in the tests, `gpu_scene_queries`: every box against every query, in order.

#import constants
#import scene_params

@group(0) @binding(0) var<storage, read> params: SceneParams;
@group(0) @binding(1) var<storage, read> control: array<u32>;
@group(0) @binding(2) var<storage, read> unsorted: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> starts: array<atomic<u32>>;
@group(0) @binding(4) var<storage, read_write> rows: array<vec2<u32>>;

@compute @workgroup_size(BATCH_BOXES)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    // With more than there is room for, the host comes back.
    let count = select(control[FOUND], 0u, control[FOUND + 1u] != 0u || control[FOUND] > params.pair_capacity);
    for (var i = group.x * BATCH_BOXES + lane; i < count; i += groups.x * BATCH_BOXES) {
        let one = unsorted[i];
        let slot = atomicAdd(&starts[min(one.x, params.query_count - 1u)], 1u);
        if (slot < params.pair_capacity) {
            rows[slot] = one;
        }
    }
}
