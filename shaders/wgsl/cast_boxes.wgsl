// cast_boxes: records -> boxes of a tree in floats, each at its place, bounds of 32 together, and how many of those have
// grown too much since the tree was put in order.
//
// Floats are as far out as the boxes, or farther: what devices may take for zero or infinite does not come into it.
// Held to `pairmask_core::cast` by the tests of casts on GPUs.

#import constants
#import cast_params
#import scene_records
#import cast_bounds

@group(0) @binding(0) var<storage, read> params: CastParams;
@group(0) @binding(1) var<storage, read> now: array<vec4<i32>>;
// The index of each place.
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read_write> items: array<vec4<u32>>;
// Edges of the bounds of each leaf when the tree was put in order.
@group(0) @binding(4) var<storage, read_write> edges: array<f32>;
@group(0) @binding(5) var<storage, read_write> control: array<atomic<u32>>;

// A leaf has grown too much when the edges of its bounds are so many times as long as they were.
const TOO_LONG: f32 = 2.0;

const SMALLEST_BITS: u32 = 0x00800000u;

var<workgroup> loose_count: atomic<u32>;

// A coordinate by its key, within the outermost ones, and rounded away from `inward` where devices may take it for 0.
fn coordinate(key: i32, inward: f32) -> f32 {
    // The way from a number to its key is the way back.
    let bits = bitcast<u32>(order_key(bitcast<u32>(key)));
    let magnitude = bits & MAGNITUDE_BITS;
    if (magnitude < SMALLEST_BITS) {
        let is_negative = (bits & SIGN_BIT) != 0u;
        return select(0.0, -inward * SMALLEST, magnitude != 0u && is_negative == (inward > 0.0));
    }
    if (magnitude >= bitcast<u32>(OUTERMOST)) {
        return select(OUTERMOST, -OUTERMOST, (bits & SIGN_BIT) != 0u);
    }
    return bitcast<f32>(bits);
}

fn corner(keys: vec3<i32>, inward: f32) -> vec3<f32> {
    return vec3<f32>(coordinate(keys.x, inward), coordinate(keys.y, inward), coordinate(keys.z, inward));
}

// Whether a coordinate is one that was not rounded.
fn is_plain(key: i32) -> bool {
    let magnitude = bitcast<u32>(order_key(bitcast<u32>(key))) & MAGNITUDE_BITS;
    return magnitude == 0u || magnitude >= SMALLEST_BITS;
}

fn are_plain(keys: vec3<i32>) -> bool {
    return is_plain(keys.x) && is_plain(keys.y) && is_plain(keys.z);
}

struct Item {
    lo: vec3<f32>,
    hi: vec3<f32>,
    index: u32,
    is_exact: bool,
}

// What is at a place: a box, or nothing.
fn item_at(place: u32) -> Item {
    var index = place;
    if (place < params.ordered) {
        index = order[place];
    }
    var item = Item(vec3<f32>(BEYOND), vec3<f32>(-BEYOND), 0u, false);
    if (index >= params.slots) {
        return item;
    }
    let b = colliding(now[2u * index], now[2u * index + 1u]);
    if (is_nothing(b)) {
        return item;
    }
    item = Item(corner(b.lo, 1.0), corner(b.hi, -1.0), index, are_plain(b.lo) && are_plain(b.hi));
    // Cut off at an outermost coordinate a box is smaller than it was, but for one that lies out there.
    item.is_exact = item.is_exact && all(item.lo < vec3<f32>(OUTERMOST)) && all(item.hi > vec3<f32>(-OUTERMOST));
    return item;
}

@compute @workgroup_size(BATCH_BOXES)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let places = params.levels[0].count;
    for (var first = group.x * BATCH_BOXES; first < places; first += groups.x * BATCH_BOXES) {
        let place = first + lane;
        if (lane == 0u) {
            atomicStore(&loose_count, 0u);
        }
        var item = Item(vec3<f32>(BEYOND), vec3<f32>(-BEYOND), 0u, false);
        if (place < places) {
            item = item_at(place);
            items[2u * place] = vec4<u32>(bitcast<vec3<u32>>(item.lo), item.index);
            items[2u * place + 1u] = vec4<u32>(bitcast<vec3<u32>>(item.hi), select(0u, 1u, item.is_exact));
        }
        bound_groups(lane, item.lo, item.hi);
        if (lane % FAN_OUT == 0u && place < places) {
            let leaf = place / FAN_OUT;
            if (params.top > 0u) {
                put_group(params.levels[1].first + leaf, lane);
            }
            let all_edges = max(group_max[lane] - group_min[lane], vec3<f32>(0.0));
            let length = all_edges.x + all_edges.y + all_edges.z;
            if (params.notes_edges != 0u) {
                edges[leaf] = length;
            } else if (place >= params.ordered || length > TOO_LONG * edges[leaf]) {
                atomicAdd(&loose_count, 1u);
            }
        }
        workgroupBarrier();
        if (lane == 0u && atomicLoad(&loose_count) > 0u) {
            atomicAdd(&control[LOOSE], atomicLoad(&loose_count));
        }
        workgroupBarrier();
    }
}
