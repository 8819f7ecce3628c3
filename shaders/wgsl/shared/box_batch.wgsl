// A batch of boxes as they lie in (shared) memory -> order-preserving keys, and the census.
//
// One workgroup a batch, one box a thread. Each word is read once, regardless of what a hostile writer does
// to it meanwhile. In which form the boxes are is the business of `box_form`, which stands for one
// of boxes_f32, boxes_q16, boxes_q8 and boxes_f16: it has `box_bits`.
// Mirror: `pairmask::aabb::KeyBox::classify` of what `pairmask::precision::NarrowBoxes::get` gives.

#import order_keys

// Words of a batch. Every batch starts with a whole one: BATCH_BOXES is a multiple of four.
const RAW_WORDS: u32 = BATCH_BOXES * BOX_BYTES / 4u;

// The bits of the f32 that stand for a box's coordinates.
struct BoxBits {
    lo: vec3<u32>,
    hi: vec3<u32>,
}

struct KeyBox {
    lo: vec3<i32>,
    hi: vec3<i32>,
}

// A box that overlaps nothing.
const NOTHING: KeyBox = KeyBox(vec3<i32>(NOTHING_MIN), vec3<i32>(NOTHING_MAX));

#import box_form

@group(0) @binding(0) var<storage, read> boxes: array<u32>;

var<workgroup> raw: array<u32, RAW_WORDS>;
// The batch's boxes with a NaN, and how many have min > max on some axis.
var<workgroup> invalid_bits: array<atomic<u32>, BATCH_WORDS>;
var<workgroup> empty_count: atomic<u32>;

// Brings a batch of n boxes to workgroup memory. All lanes call it; it ends with a barrier.
fn load_batch(batch: u32, lane: u32, n: u32) {
    // Boxes of 6 bytes may end within a word. Its other half is bound and not looked at.
    let word_count = (n * BOX_BYTES + 3u) / 4u;
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
}

// The keys of the lane's box, which must be one of the n; NOTHING where it is empty or invalid,
// which is counted. The count is whole after another barrier.
fn take_keys(lane: u32) -> KeyBox {
    let bits = box_bits(lane);
    var keys = KeyBox(
        vec3<i32>(order_key(bits.lo.x), order_key(bits.lo.y), order_key(bits.lo.z)),
        vec3<i32>(order_key(bits.hi.x), order_key(bits.hi.y), order_key(bits.hi.z)),
    );
    let is_invalid = is_nan(bits.lo.x) | is_nan(bits.lo.y) | is_nan(bits.lo.z)
        | is_nan(bits.hi.x) | is_nan(bits.hi.y) | is_nan(bits.hi.z);
    let is_empty = any(keys.lo > keys.hi);
    if (is_invalid | is_empty) {
        if (is_invalid) {
            atomicOr(&invalid_bits[lane / 32u], 1u << (lane % 32u));
        } else {
            atomicAdd(&empty_count, 1u);
        }
        keys = NOTHING;
    }
    return keys;
}
