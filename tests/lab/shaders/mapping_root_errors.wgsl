// mapping_root_errors: for x = 1 .. count, compares the integer part of a root with that of the
// built-in one, and with the exact one (Avril et al. 2012, table 3). One thread 32 numbers.
// Mirror: `pairmaskd::study::mapping::root_errors`.

#import constants
#import root

struct RootParams {
    count: u32,
    word_count: u32,
    groups_x: u32,
    // As in mapping_time.
    never: u32,
}

struct RootTally {
    // Other than the built-in root; other than the exact one.
    other: atomic<u32>,
    inexact: atomic<u32>,
}

@group(0) @binding(0) var<storage, read_write> tally: RootTally;
var<immediate> params: RootParams;

// Integer root of x < 2^31.
fn exact_root(x: u32) -> u32 {
    var r = u32(sqrt(f32(x)));
    // The guess is at most one too large, and too small by no more.
    if (r * r > x) {
        r--;
    } else if ((r + 1u) * (r + 1u) <= x) {
        r++;
    }
    return r;
}

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let word = (group.y * params.groups_x + group.x) * BATCH_BOXES + lane;
    var other = 0u;
    var inexact = 0u;
    for (var t = 1u; t <= 32u; t++) {
        let x = word * 32u + t;
        if (word < params.word_count && x <= params.count) {
            let part = u32(root(f32(x)));
            other += u32(part != u32(sqrt(f32(x))));
            inexact += u32(part != exact_root(x));
        }
    }
    if (other > 0u) {
        atomicAdd(&tally.other, other);
    }
    if (inexact > 0u) {
        atomicAdd(&tally.inexact, inexact);
    }
}
