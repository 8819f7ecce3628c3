// mapping_pairs: ids -> pairs, one thread an id. Shows what a variant does on this device.

#import constants
#import pair_ids
#import map

struct MappingPairsParams {
    n: u32,
    id_count: u32,
}

// Low and high half of each id.
@group(0) @binding(0) var<storage, read> ids: array<vec2<u32>>;
@group(0) @binding(1) var<storage, read_write> pairs: array<vec2<i32>>;
var<immediate> params: MappingPairsParams;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(global_invocation_id) thread: vec3<u32>) {
    if (thread.x >= params.id_count) {
        return;
    }
    let halves = ids[thread.x];
    pairs[thread.x] = map_pair(params.n, id_of(halves.x, halves.y));
}
