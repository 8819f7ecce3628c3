// sweep_count: how many entries of a tile have each digit, and how many of all.

#import constants
#import sweep_params
#import sweep_digits

// Of each digit, the tiles one behind the other.
@group(0) @binding(2) var<storage, read_write> counts: array<u32>;

var<workgroup> tile_counts: array<atomic<u32>, DIGITS>;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    if (lane < DIGITS) {
        atomicStore(&tile_counts[lane], 0u);
    }
    workgroupBarrier();
    let count = entries_in_all();
    let first = group.x * TILE;
    for (var i = first + lane; i < min(first + TILE, count); i += BATCH_BOXES) {
        atomicAdd(&tile_counts[digit_of(keys[i])], 1u);
    }
    workgroupBarrier();
    if (lane < DIGITS) {
        let of_digit = atomicLoad(&tile_counts[lane]);
        counts[lane * params.tiles + group.x] = of_digit;
        if (of_digit != 0u) {
            atomicAdd(&control[DIGITS_AT + params.pass_number * DIGITS + lane], of_digit);
        }
    }
}
