// mapping_mask: all pairs by the mapping function, one bit or one byte a pair. One thread a word
// of the output, so no two threads write to one word.

#import constants
#import pair_ids
#import map
#import mask_test

@group(0) @binding(1) var<storage, read_write> out_words: array<u32>;
var<immediate> params: MaskParams;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let word = (group.y * params.groups_x + group.x) * BATCH_BOXES + lane;
    if (word >= params.thread_count) {
        return;
    }
    var bits = 0u;
    for (var t = 0u; t < PAIRS_PER_WORD; t++) {
        let k = word * PAIRS_PER_WORD + t;
        if (k < params.pair_count && overlaps(params.n, map_pair(params.n, k))) {
            bits |= 1u << (t * (32u / PAIRS_PER_WORD));
        }
    }
    out_words[word] = bits;
}
