// mapping_mask_or: as mapping_mask, the paper's way (section 3.4): one thread a pair, which ORs
// its bit or byte into a zeroed output.

#import constants
#import pair_ids
#import map
#import mask_test

@group(0) @binding(1) var<storage, read_write> out_words: array<atomic<u32>>;
var<immediate> params: MaskParams;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let k = (group.y * params.groups_x + group.x) * BATCH_BOXES + lane;
    if (k >= params.thread_count) {
        return;
    }
    if (overlaps(params.n, map_pair(params.n, k))) {
        let bit = 1u << (k % PAIRS_PER_WORD * (32u / PAIRS_PER_WORD));
        atomicOr(&out_words[k / PAIRS_PER_WORD], bit);
    }
}
