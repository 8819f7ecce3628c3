// keys: boxes as they lie in (shared) memory -> integer keys in planes, and the census.
//
// One workgroup a batch. Each box is read once, whatever a hostile writer does to it meanwhile.
// Rows past n up to the end of the planes get keys that overlap nothing, so that no later stage
// has to ask whether a row or a column exists.
// Mirror: `pairmask::aabb::KeyBox::classify`.

#import constants
#import order_keys
#import batch

struct KeysParams {
    // Boxes.
    n: u32,
    // Words of one key plane; the dispatch covers BATCH_BOXES * workgroups = plane_words rows.
    plane_words: u32,
}

@group(0) @binding(0) var<storage, read> boxes: array<u32>;
// Six planes: min.x, min.y, min.z, max.x, max.y, max.z.
@group(0) @binding(1) var<storage, read_write> keys: array<i32>;
@group(0) @binding(2) var<storage, read_write> totals: array<BatchTotals>;
@group(0) @binding(3) var<storage, read_write> reports: array<BatchReport>;
var<immediate> params: KeysParams;

var<workgroup> raw: array<u32, RAW_WORDS>;
var<workgroup> invalid_bits: array<atomic<u32>, BATCH_WORDS>;
var<workgroup> empty_count: atomic<u32>;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let batch = group.x;
    let word_count = params.n * BOX_WORDS;
    // Neighbouring lanes read neighbouring words: over the link every byte crosses once.
    for (var i = lane; i < RAW_WORDS; i += BATCH_BOXES) {
        let word = batch * RAW_WORDS + i;
        if (word < word_count) {
            raw[i] = boxes[word];
        }
    }
    if (lane < BATCH_WORDS) {
        atomicStore(&invalid_bits[lane], 0u);
    }
    if (lane == 0u) {
        atomicStore(&empty_count, 0u);
    }
    workgroupBarrier();

    let index = batch * BATCH_BOXES + lane;
    var lo = vec3<i32>(NOTHING_MIN);
    var hi = vec3<i32>(NOTHING_MAX);
    if (index < params.n) {
        let at = lane * BOX_WORDS;
        let lo_bits = vec3<u32>(raw[at], raw[at + 1u], raw[at + 2u]);
        let hi_bits = vec3<u32>(raw[at + 3u], raw[at + 4u], raw[at + 5u]);
        let key_lo = vec3<i32>(order_key(lo_bits.x), order_key(lo_bits.y), order_key(lo_bits.z));
        let key_hi = vec3<i32>(order_key(hi_bits.x), order_key(hi_bits.y), order_key(hi_bits.z));
        let invalid = is_nan(lo_bits.x) | is_nan(lo_bits.y) | is_nan(lo_bits.z)
            | is_nan(hi_bits.x) | is_nan(hi_bits.y) | is_nan(hi_bits.z);
        if (invalid) {
            atomicOr(&invalid_bits[lane / 32u], 1u << (lane % 32u));
        } else if (any(key_lo > key_hi)) {
            atomicAdd(&empty_count, 1u);
        } else {
            lo = key_lo;
            hi = key_hi;
        }
    }
    let plane = params.plane_words;
    keys[index] = lo.x;
    keys[plane + index] = lo.y;
    keys[2u * plane + index] = lo.z;
    keys[3u * plane + index] = hi.x;
    keys[4u * plane + index] = hi.y;
    keys[5u * plane + index] = hi.z;

    workgroupBarrier();
    if (lane < BATCH_WORDS) {
        reports[batch].invalid[lane] = atomicLoad(&invalid_bits[lane]);
    }
    if (lane == 0u) {
        reports[batch].empty = atomicLoad(&empty_count);
        totals[batch] = BatchTotals(0u, 0u);
    }
}
