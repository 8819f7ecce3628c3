// mapping_root_time: roots of x = 1 .. count and nothing else (Avril et al. 2012, table 4). One
// thread 32 numbers.

#import constants
#import root

struct RootParams {
    count: u32,
    word_count: u32,
    groups_x: u32,
    // As in mapping_time.
    never: u32,
}

@group(0) @binding(0) var<storage, read_write> sink: array<u32>;
var<immediate> params: RootParams;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let word = (group.y * params.groups_x + group.x) * BATCH_BOXES + lane;
    if (word >= params.word_count) {
        return;
    }
    var sum = 0u;
    for (var t = 1u; t <= 32u; t++) {
        sum += u32(root(f32(word * 32u + t)));
    }
    if (sum == params.never) {
        sink[0] = sum;
    }
}
