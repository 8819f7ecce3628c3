// scene_query_starts: pairs of each query -> the first place of each query in the sorted list.
//
// A workgroup adds up the counts of all queries before its own, so that none waits for another.
// Mirror: in the tests, `gpu_scene_queries`: every box against every query, in order.

#import constants
#import scene_params
#import scan

@group(0) @binding(0) var<storage, read> params: SceneParams;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read_write> starts: array<u32>;

var<workgroup> earlier_sum: atomic<u32>;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let first = group.x * BATCH_BOXES;
    if (first >= params.query_count) {
        return;
    }
    if (lane == 0u) {
        atomicStore(&earlier_sum, 0u);
    }
    // Four loads at a time are under way together. The queries before are whole batches of lanes.
    var earlier = 0u;
    var i = lane;
    for (; i + 3u * BATCH_BOXES < first; i += 4u * BATCH_BOXES) {
        let four = vec4<u32>(
            counts[i],
            counts[i + BATCH_BOXES],
            counts[i + 2u * BATCH_BOXES],
            counts[i + 3u * BATCH_BOXES],
        );
        earlier += four.x + four.y + four.z + four.w;
    }
    for (; i < first; i += BATCH_BOXES) {
        earlier += counts[i];
    }
    let query = first + lane;
    var own = 0u;
    if (query < params.query_count) {
        own = counts[query];
    }
    scan[lane] = own;
    workgroupBarrier();
    if (earlier != 0u) {
        atomicAdd(&earlier_sum, earlier);
    }
    sum_up(lane);
    if (query < params.query_count) {
        starts[query] = atomicLoad(&earlier_sum) + scan[lane] - own;
    }
}
