// sweep_pairs: each entry against those behind it whose places its box reaches -> pairs.
//
// A thread tests a few; what is left of a long stretch is shared by the workgroup, so that a crowd on the axis
// keeps no thread waiting. A pair is told in the tube that holds the lower corner of the intersection, once.
// Source: Liu, Harada, Lee, Kim, "Real-time collision culling of a million bodies on graphics processing units",
// SIGGRAPH Asia 2010 (the sweep in parallel, its load shared, the other axes divided); Avril, Gouranton, Arnaldi 2014.

#import constants
#import sweep_params

@group(0) @binding(0) var<storage, read_write> control: array<atomic<u32>>;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
@group(0) @binding(2) var<storage, read> values: array<u32>;
@group(0) @binding(3) var<storage, read> sorted: array<vec4<i32>>;
@group(0) @binding(4) var<storage, read_write> found: array<vec2<u32>>;

// Tests of a thread before the workgroup takes the rest: as many as most entries of a scene with few pairs have.
const ALONE: u32 = 24u;
// Rounds of a row that are no tests, at the most: its own, and those that hand out.
const OTHER_ROUNDS: u32 = 4u;
// Pairs that a workgroup collects.
const WINDOW: u32 = 2u * BATCH_BOXES;

var<workgroup> window: array<vec2<u32>, WINDOW>;
var<workgroup> told: atomic<u32>;
var<workgroup> window_base: u32;
// Rows with a rest: the row, from, up to before.
var<workgroup> queue: array<vec3<u32>, BATCH_BOXES>;
var<workgroup> queued: atomic<u32>;
var<workgroup> rounds: atomic<u32>;
// Whether another workgroup has too much: then none goes on.
var<workgroup> is_over: u32;
var<workgroup> tested_sum: atomic<u32>;

// The row at hand: its box, its name, its tube and the first ones that its box lies in.
var<private> lo: vec3<i32>;
var<private> hi: vec3<i32>;
var<private> name: u32;
var<private> tube: vec2<u32>;
var<private> first_tube: vec2<u32>;
// The last key that it reaches.
var<private> last_key: u32;

fn take_row(row: u32) {
    let a = sorted[2u * row];
    let b = sorted[2u * row + 1u];
    lo = a.xyz;
    hi = vec3<i32>(a.w, b.xy);
    name = values[row];
    let number = keys[row] >> params.place_bits;
    tube = vec2<u32>(number & ((1u << params.tube_bits_0) - 1u), number >> params.tube_bits_0);
    let packed = bitcast<u32>(b.w);
    first_tube = vec2<u32>(packed & 0xffffu, packed >> 16u);
    last_key = (number << params.place_bits) | bitcast<u32>(b.z);
}

fn tell(pair: vec2<u32>) {
    let at = atomicAdd(&told, 1u);
    if (at < WINDOW) {
        window[at] = pair;
        return;
    }
    let place = atomicAdd(&control[FOUND], 1u);
    if (place < params.pair_capacity) {
        found[place] = pair;
    }
}

fn test(other: u32) {
    let a = sorted[2u * other];
    if (any(a.xyz > hi) || a.w < lo.x) {
        return;
    }
    let b = sorted[2u * other + 1u];
    if (any(b.xy < lo.yz)) {
        return;
    }
    let packed = bitcast<u32>(b.w);
    let home = max(first_tube, vec2<u32>(packed & 0xffffu, packed >> 16u));
    if (all(home == tube)) {
        let other_name = values[other];
        tell(vec2<u32>(min(name, other_name), max(name, other_name)));
    }
}

// The first entry from `start` on that the row does not reach.
fn end_of(start: u32, count: u32) -> u32 {
    var low = start;
    var high = count;
    while (low < high) {
        let middle = (low + high) / 2u;
        if (keys[middle] <= last_key) {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return low;
}

fn count_tests(tests: u32) {
    let before = atomicAdd(&control[TESTED], tests);
    if (before + tests < before) {
        atomicAdd(&control[TESTED + 1u], 1u);
    }
}

// All lanes call it, after a barrier.
fn hand_out(lane: u32) {
    let all = min(atomicLoad(&told), WINDOW);
    if (lane == 0u && all != 0u) {
        window_base = atomicAdd(&control[FOUND], all);
    }
    workgroupBarrier();
    for (var i = lane; i < all; i += BATCH_BOXES) {
        if (window_base + i < params.pair_capacity) {
            found[window_base + i] = window[i];
        }
    }
    workgroupBarrier();
    if (lane == 0u) {
        atomicStore(&told, 0u);
    }
    workgroupBarrier();
}

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    if (lane == 0u) {
        atomicStore(&told, 0u);
        atomicStore(&queued, 0u);
        atomicStore(&rounds, 0u);
        is_over = atomicLoad(&control[TOO_MUCH]);
        atomicStore(&tested_sum, 0u);
    }
    workgroupBarrier();
    let entries = atomicLoad(&control[ENTRIES]);
    let count = select(entries, 0u, entries > params.entry_capacity || is_over != 0u);
    let row = group.x * BATCH_BOXES + lane;
    if (row < count) {
        take_row(row);
        var at = row + 1u;
        let end = min(count, at + ALONE);
        while (at < end && keys[at] <= last_key) {
            test(at);
            at++;
        }
        if (at > row + 1u) {
            atomicAdd(&tested_sum, at - row - 1u);
        }
        if (at < count && at == end && keys[at] <= last_key) {
            let place = atomicAdd(&queued, 1u);
            let rest = end_of(at, count);
            queue[place] = vec3<u32>(row, at, rest);
            atomicAdd(&rounds, (rest - at) / BATCH_BOXES + OTHER_ROUNDS);
        }
    }
    workgroupBarrier();
    hand_out(lane);

    var waiting = atomicLoad(&queued);
    if (atomicLoad(&rounds) > params.thread_rounds) {
        atomicStore(&control[TOO_MUCH], 1u);
        waiting = 0u;
    }
    for (var i = 0u; i < waiting; i++) {
        let one = queue[i];
        take_row(one.x);
        for (var at = one.y + lane; at < one.z; at += BATCH_BOXES) {
            test(at);
        }
        if (lane == 0u) {
            count_tests(one.z - one.y);
        }
        workgroupBarrier();
        // Half full: the next row may find as many.
        let goes_out = atomicLoad(&told) > BATCH_BOXES || i + 1u == waiting;
        workgroupBarrier();
        if (goes_out) {
            hand_out(lane);
        }
    }
    if (lane == 0u) {
        count_tests(atomicLoad(&tested_sum));
    }
}
