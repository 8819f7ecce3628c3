// keys: boxes as they lie in (shared) memory, in any form -> integer keys in planes, and the census.
//
// One workgroup a batch. Rows past n up to the end of the planes get keys that overlap nothing, so
// that no later stage has to ask whether a row or a column exists.
// Mirror: `pairmask::aabb::KeyBox::classify` of `pairmask::precision::NarrowBoxes::get`.

#import constants
#import box_batch
#import batch

struct KeysParams {
    // Boxes.
    n: u32,
    // Words of one key plane; the dispatch covers BATCH_BOXES * workgroups = plane_words rows.
    plane_words: u32,
}

// Binding 0: the boxes, of `box_batch`.
// Six planes: min.x, min.y, min.z, max.x, max.y, max.z.
@group(0) @binding(1) var<storage, read_write> keys: array<i32>;
@group(0) @binding(2) var<storage, read_write> totals: array<BatchTotals>;
@group(0) @binding(3) var<storage, read_write> reports: array<BatchReport>;
var<immediate> params: KeysParams;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let batch = group.x;
    load_batch(batch, lane, params.n);
    let index = batch * BATCH_BOXES + lane;
    var box = NOTHING;
    if (index < params.n) {
        box = take_keys(lane);
    }
    let plane = params.plane_words;
#import key_planes

    workgroupBarrier();
    if (lane < BATCH_WORDS) {
        reports[batch].invalid[lane] = atomicLoad(&invalid_bits[lane]);
    }
    if (lane == 0u) {
        reports[batch].empty = atomicLoad(&empty_count);
        totals[batch] = BatchTotals(0u, 0u);
    }
}
