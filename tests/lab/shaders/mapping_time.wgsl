// mapping_time: maps ids and keeps nothing, so that its time is that of the mapping. One thread a
// word of 32 ids.

#import constants
#import pair_ids
#import map

struct MappingTimeParams {
    n: u32,
    word_count: u32,
    // Workgroups of a dispatch row.
    groups_x: u32,
    // A sum that no thread is expected to have: the compiler cannot know, and so drops nothing.
    never: u32,
}

@group(0) @binding(0) var<storage, read_write> sink: array<u32>;
var<immediate> params: MappingTimeParams;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let word = (group.y * params.groups_x + group.x) * BATCH_BOXES + lane;
    if (word >= params.word_count) {
        return;
    }
    let first = Id(word) * Id(32);
    var pair = map_pair(params.n, first);
    var sum = 0u;
    for (var t = 1u; t < 32u; t++) {
        if (pair.x < pair.y) {
            sum += u32(pair.x) ^ (u32(pair.y) << 1u);
        }
        pair = next_pair(params.n, first + Id(t), pair);
    }
    sum += u32(pair.x) ^ u32(pair.y);
    if (sum == params.never) {
        sink[0] = sum;
    }
}
