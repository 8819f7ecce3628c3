// sweep_keys: boxes -> records, and an entry for each tube that a box lies in: the tube's number and the box's
// place along the axis of the sort.
//
// A box that overlaps nothing has no entry. Where entries come to lie does not matter: they are sorted.

#import constants
#import order_keys
#import grid_layout
#import sweep_params

// Six f32 each: min.x min.y min.z max.x max.y max.z.
@group(0) @binding(0) var<storage, read> boxes: array<u32>;
@group(0) @binding(1) var<storage, read_write> control: array<atomic<u32>>;
// Keys of a box along the three axes of the sweep: min, first of max; rest of max, limit, first tubes.
@group(0) @binding(2) var<storage, read_write> records: array<vec4<i32>>;
@group(0) @binding(3) var<storage, read_write> keys: array<u32>;
@group(0) @binding(4) var<storage, read_write> values: array<u32>;

var<workgroup> entry_count: atomic<u32>;
var<workgroup> entry_base: u32;

// Number of a step along an axis: monotone, whatever f32 rounds.
fn step_of(key: i32, origin: f32, scale: f32, bits: u32) -> u32 {
    let most = f32((1u << bits) - 1u);
    return u32(clamp((plain(key) - origin) * scale, 0.0, most));
}

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    if (lane == 0u) {
        atomicStore(&entry_count, 0u);
    }
    workgroupBarrier();
    let index = group.x * BATCH_BOXES + lane;
    var lo = vec3<i32>(NOTHING_MIN);
    var hi = vec3<i32>(NOTHING_MAX);
    var tube_lo = vec2<u32>(0u);
    var tube_hi = vec2<u32>(0u);
    var place = 0u;
    var count = 0u;
    if (index < params.n) {
        var is_invalid = false;
        for (var number = 0u; number < 3u; number++) {
            let at = 6u * index + axis(number);
            let low = boxes[at];
            let high = boxes[at + 3u];
            is_invalid = is_invalid | is_nan(low) | is_nan(high);
            lo[number] = order_key(low);
            hi[number] = order_key(high);
        }
        if (!is_invalid && all(lo <= hi)) {
            tube_lo = vec2<u32>(
                step_of(lo.y, params.origin_1, params.scale_1, params.tube_bits_0),
                step_of(lo.z, params.origin_2, params.scale_2, params.tube_bits_1),
            );
            tube_hi = vec2<u32>(
                step_of(hi.y, params.origin_1, params.scale_1, params.tube_bits_0),
                step_of(hi.z, params.origin_2, params.scale_2, params.tube_bits_1),
            );
            place = step_of(lo.x, params.origin_0, params.scale_0, params.place_bits);
            let limit = step_of(hi.x, params.origin_0, params.scale_0, params.place_bits);
            let spans = tube_hi - tube_lo + 1u;
            count = spans.x * spans.y;
            records[2u * index] = vec4<i32>(lo, hi.x);
            records[2u * index + 1u] =
                vec4<i32>(hi.y, hi.z, bitcast<i32>(limit), bitcast<i32>(tube_lo.x | (tube_lo.y << 16u)));
        }
    }
    var own = 0u;
    if (count != 0u) {
        own = atomicAdd(&entry_count, count);
    }
    workgroupBarrier();
    if (lane == 0u) {
        entry_base = atomicAdd(&control[ENTRIES], atomicLoad(&entry_count));
    }
    workgroupBarrier();
    // More entries than there is room for: the host sees how many, and takes fewer tubes.
    if (count == 0u || entry_base + own + count > params.entry_capacity) {
        return;
    }
    var at = entry_base + own;
    for (var z = tube_lo.y; z <= tube_hi.y; z++) {
        for (var y = tube_lo.x; y <= tube_hi.x; y++) {
            let tube = (z << params.tube_bits_0) | y;
            keys[at] = (tube << params.place_bits) | place;
            values[at] = index;
            at++;
        }
    }
}
