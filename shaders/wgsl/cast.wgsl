// cast: rays or spheres, and a tree of boxes -> of each, the boxes that it may hit, among them all that the answer is
// made of. The host decides which those are.
//
// A workgroup looks for one ray or sphere at a time, from the top of the tree down, the nearest groups first: two groups
// of 16 a step, an item a lane. What it leaves to the host is no more than rounding leaves open, and what is as near.
// Held to `pairmask_core::cast` by the tests of casts on GPUs.

#import constants
#import cast_params
#import scene_records

@group(0) @binding(0) var<storage, read> params: CastParams;
@group(0) @binding(1) var<storage, read> now: array<vec4<i32>>;
@group(0) @binding(2) var<storage, read> items: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> control: array<atomic<u32>>;
// Binding 4: the rays or spheres.
// Of each, the head of its last list of candidates, and how it ended.
@group(0) @binding(5) var<storage, read_write> answers: array<vec2<u32>>;
// Lists: a head, which says where the head of the list before is and how many follow, and boxes as their records say,
// with the index in place of the history.
@group(0) @binding(6) var<storage, read_write> candidates: array<vec4<i32>>;

// Bounds are off by less than this share: six roundings and a quotient, with room.
const ROUNDING: f32 = 9.5367431640625e-7;
// Numbers that are taken as they are: 0, and magnitudes of their bits from 1e-15 to 1e15.
const LEAST_USUAL: u32 = 0x26901d7du;
const MOST_USUAL: u32 = 0x58635fa9u;

// The key of what is not hit. Others are the bits of numbers from 0 on, which sort like them.
const MISSED: u32 = 0xffffffffu;

fn key_of(x: f32) -> u32 {
    return bitcast<u32>(x) & MAGNITUDE_BITS;
}

fn are_usual(bits: vec3<u32>) -> bool {
    let magnitudes = bits & vec3<u32>(MAGNITUDE_BITS);
    let in_range = (magnitudes >= vec3<u32>(LEAST_USUAL)) & (magnitudes <= vec3<u32>(MOST_USUAL));
    return all(in_range | (magnitudes == vec3<u32>(0u)));
}

#import cast_question

// Groups to look at: a level adds 31 at most, those of two groups but for what was taken, and a group that was left over.
const STACK: u32 = 31u * CAST_LEVELS + 1u;
// Candidates at hand.
const FOUND: u32 = 128u;
const FOUND_A_LANE: u32 = FOUND / CAST_LANES;
// A step takes so many rounds of loops, and so many with each candidate to sort.
const STEP_ROUNDS: u32 = CAST_LANES + 1u;

const LEVEL_BITS: u32 = 28u;
const NO_LIST: u32 = 0xffffffffu;
// How a search ends: with all candidates, or without them.
const ANSWERED: u32 = 0u;
const GIVEN_UP: u32 = 1u;

struct Found {
    index: u32,
    lower: u32,
    // MISSED where it may not be hit.
    upper: u32,
}

// Level and number of a group, and the key of its bounds.
var<workgroup> stack: array<vec2<u32>, STACK>;
var<workgroup> stack_count: u32;
var<workgroup> found: array<Found, FOUND>;
var<workgroup> found_count: atomic<u32>;
// Of groups that a step has found.
var<workgroup> keys: array<u32, CAST_LANES>;
// What is farther is of no use; of what is at 0, indices beyond this are not.
var<workgroup> limit: u32;
var<workgroup> limit_index: u32;
var<workgroup> is_hit: u32;
var<workgroup> is_too_much: u32;
var<workgroup> list: u32;

var<private> rounds: u32;

// Puts the candidates at hand into a list behind another. Returns where its head is.
fn hand_out(lane: u32, before: u32) -> u32 {
    let count = atomicLoad(&found_count);
    if (lane == 0u) {
        list = atomicAdd(&control[CANDIDATES], count + 1u);
    }
    workgroupBarrier();
    let head = list;
    if (head < params.room && count < params.room - head) {
        if (lane == 0u) {
            candidates[2u * head] = vec4<i32>(bitcast<i32>(before), i32(count), 0, 0);
        }
        for (var at = lane; at < count; at += CAST_LANES) {
            let index = found[at].index;
            let to = 2u * (head + 1u + at);
            candidates[to] = now[2u * index];
            candidates[to + 1u] = vec4<i32>(now[2u * index + 1u].xy, bitcast<i32>(index), 0);
        }
    }
    workgroupBarrier();
    if (lane == 0u) {
        atomicStore(&found_count, 0u);
    }
    workgroupBarrier();
    return head;
}

// Finds the limit anew, and drops those of so many candidates that are beyond it.
fn settle(lane: u32, count: u32) {
    for (var at = lane; at < count; at += CAST_LANES) {
        let own = found[at];
        if (own.upper == MISSED) {
            continue;
        }
        var rank = 0u;
        for (var other = 0u; other < count; other++) {
            let upper = found[other].upper;
            rank += select(0u, 1u, upper < own.upper || (upper == own.upper && found[other].index < own.index));
        }
        if (rank == params.closest - 1u) {
            limit = min(limit, own.upper);
            limit_index = select(MISSED, own.index, own.upper == 0u);
        }
    }
    workgroupBarrier();
    var kept: array<Found, FOUND_A_LANE>;
    var kept_count = 0u;
    for (var at = lane; at < count; at += CAST_LANES) {
        let own = found[at];
        let is_late = own.upper == 0u && own.index > limit_index;
        if (own.lower <= limit && !is_late) {
            kept[kept_count] = own;
            kept_count++;
        }
    }
    workgroupBarrier();
    if (lane == 0u) {
        atomicStore(&found_count, 0u);
    }
    workgroupBarrier();
    for (var own = 0u; own < kept_count; own++) {
        found[atomicAdd(&found_count, 1u)] = kept[own];
    }
    rounds += 2u * count;
    workgroupBarrier();
}

// Looks at two groups of the stack, of which there are so many, or the last one.
fn step_down(lane: u32, count: u32) {
    let taken = min(count, CAST_LANES / FAN_OUT);
    var key = MISSED;
    var item = vec2<u32>(0u);
    if (lane / FAN_OUT < taken) {
        let group = stack[count - 1u - lane / FAN_OUT];
        item = vec2<u32>(group.x >> LEVEL_BITS, (group.x & ((1u << LEVEL_BITS) - 1u)) * FAN_OUT + lane % FAN_OUT);
        let level = params.levels[item.x];
        if (group.y <= limit && item.y < level.count) {
            let low = items[2u * (level.first + item.y)];
            let high = items[2u * (level.first + item.y) + 1u];
            let lo = bitcast<vec3<f32>>(low.xyz);
            let hi = bitcast<vec3<f32>>(high.xyz);
            if (lo.x <= hi.x) {
                key = lower_key(lo, hi);
            }
            if (key > limit) {
                key = MISSED;
            }
            if (key != MISSED && item.x == 0u) {
                var upper = MISSED;
                if (high.w != 0u) {
                    upper = upper_key(lo, hi);
                }
                found[atomicAdd(&found_count, 1u)] = Found(low.w, key, upper);
                if (upper != MISSED) {
                    is_hit = 1u;
                }
            }
        }
    }
    let is_group = key != MISSED && item.x > 0u;
    keys[lane] = select(MISSED, key, is_group);
    workgroupBarrier();
    var groups = 0u;
    var behind = 0u;
    for (var other = 0u; other < CAST_LANES; other++) {
        let there = keys[other];
        groups += select(0u, 1u, there != MISSED);
        behind += select(0u, 1u, there != MISSED && (there > key || (there == key && other > lane)));
    }
    if (is_group) {
        stack[count - taken + behind] = vec2<u32>(((item.x - 1u) << LEVEL_BITS) | item.y, key);
    }
    workgroupBarrier();
    if (lane == 0u) {
        stack_count = count - taken + groups;
    }
    rounds += STEP_ROUNDS;
    workgroupBarrier();
}

fn search(query: u32, lane: u32) {
    if (lane == 0u) {
        stack_count = 1u;
        stack[0] = vec2<u32>(params.top << LEVEL_BITS, 0u);
        atomicStore(&found_count, 0u);
        limit = MISSED;
        limit_index = MISSED;
        is_hit = 0u;
        is_too_much = select(0u, 1u, atomicLoad(&control[STEPS]) >= params.all_steps);
    }
    workgroupBarrier();
    let is_taken = take_question(query) && is_too_much == 0u;
    if (lane == 0u) {
        limit = most_key();
    }
    workgroupBarrier();
    var ended = select(GIVEN_UP, ANSWERED, is_taken);
    var before = NO_LIST;
    var steps = 0u;
    var settled = 0u;
    var count = 1u;
    var goes_on = true;
    while (ended == ANSWERED && count > 0u && goes_on) {
        step_down(lane, count);
        steps++;
        count = stack_count;
        goes_on = params.any == 0u || is_hit == 0u;
        var at_hand = atomicLoad(&found_count);
        workgroupBarrier();
        if (params.closest > 0u && at_hand > settled) {
            settle(lane, at_hand);
            at_hand = atomicLoad(&found_count);
            settled = at_hand;
            workgroupBarrier();
        }
        if (at_hand > FOUND - CAST_LANES) {
            // Of the closest, all that there are so far must be at hand.
            if (params.closest > 0u) {
                ended = GIVEN_UP;
            } else {
                before = hand_out(lane, before);
            }
        }
        if (steps >= params.steps || rounds > params.thread_rounds) {
            ended = GIVEN_UP;
        }
    }
    if (ended == ANSWERED && atomicLoad(&found_count) > 0u) {
        before = hand_out(lane, before);
    }
    if (lane == 0u) {
        answers[query] = vec2<u32>(before, ended);
        atomicAdd(&control[STEPS], steps);
    }
    workgroupBarrier();
}

@compute @workgroup_size(CAST_LANES)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    for (var query = group.x; query < params.queries; query += groups.x) {
        search(query, lane);
    }
}
