// cast: rays or spheres, and a tree of boxes -> of each, the boxes that it may hit, among them all that the answer is
// made of. The host decides which those are.
//
// A workgroup looks for one ray or sphere at a time, from the top of the tree down, the nearest groups first: a group of 32
// a step, an item a lane. What it leaves to the host is no more than rounding leaves open, and what is as near.
// Held to `pairmask_core::cast` by the tests of casts on GPUs.

#import constants
#import cast_params
#import scene_records

@group(0) @binding(0) var<storage, read> params: CastParams;
@group(0) @binding(1) var<storage, read> now: array<vec4<i32>>;
@group(0) @binding(2) var<storage, read> items: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> control: array<atomic<u32>>;
// Binding 4: the rays or spheres.
// Of each, where the head of its last list is, how many candidates follow here, how it ended; and those: boxes as their
// records say, with the index in place of the history.
@group(0) @binding(5) var<storage, read_write> answers: array<vec4<i32>>;
// Lists of further candidates: a head, which says where the head of the list before is and how many follow, and those.
@group(0) @binding(6) var<storage, read_write> lists: array<vec4<i32>>;

// Bounds are off by less than this share: six roundings and a quotient, with room.
const ROUNDING: f32 = 9.5367431640625e-7;
// Numbers that are taken as they are: 0, and magnitudes of their bits from here (1e-15), or from others, to 1e15.
const LEAST_USUAL: u32 = 0x26901d7du;
const MOST_USUAL: u32 = 0x58635fa9u;

// The key of what is not hit. Others are the bits of numbers from 0 on, which sort like them.
const MISSED: u32 = 0xffffffffu;

fn key_of(x: f32) -> u32 {
    return bitcast<u32>(x) & MAGNITUDE_BITS;
}

fn are_usual(bits: vec3<u32>, least: u32) -> bool {
    let magnitudes = bits & vec3<u32>(MAGNITUDE_BITS);
    let in_range = (magnitudes >= vec3<u32>(least)) & (magnitudes <= vec3<u32>(MOST_USUAL));
    return all(in_range | (magnitudes == vec3<u32>(0u)));
}

fn are_finite(bits: vec3<u32>) -> bool {
    return all((bits & vec3<u32>(MAGNITUDE_BITS)) < vec3<u32>(INFINITY_BITS));
}

// What a ray or a sphere is: one of numbers that are taken as they are, one that the cores look for, or one that finds
// nothing.
const USUAL: u32 = 0u;
const UNUSUAL: u32 = 1u;
const INVALID: u32 = 2u;

#import cast_question

// Groups to look at. Where there are this many less what a search straight down adds, an item less than a group a level,
// it goes straight down.
const STACK: u32 = 448u;
const STRAIGHT_DOWN: u32 = STACK - (CAST_LANES - 1u) * CAST_LEVELS - 1u;
// Candidates at hand.
const FOUND: u32 = 128u;
const FOUND_A_LANE: u32 = FOUND / CAST_LANES;
// Rounds of loops that a step takes beside those that sort candidates.
const STEP_ROUNDS: u32 = 2u;

const LEVEL_BITS: u32 = 28u;
const NO_LIST: u32 = 0xffffffffu;
// Candidates that are counted: more than there is ever room for.
const MOST_COUNTED: u32 = 0x80000000u;
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
var<workgroup> stack_count: atomic<u32>;
// The nearest group of the upper part of the stack: its key without the last bits, and there its place.
var<workgroup> nearest: atomic<u32>;
var<workgroup> found: array<Found, FOUND>;
var<workgroup> found_count: atomic<u32>;
// What is farther is of no use; of what is at 0, indices beyond this are not.
var<workgroup> limit: u32;
var<workgroup> limit_index: u32;
var<workgroup> is_hit: u32;
// A candidate was found that may make the limit smaller.
var<workgroup> is_nearer: u32;
var<workgroup> is_too_much: u32;
var<workgroup> list: u32;

var<private> rounds: u32;

fn first_half(at: u32) -> vec4<i32> {
    return now[2u * found[at].index];
}

fn second_half(at: u32) -> vec4<i32> {
    let index = found[at].index;
    return vec4<i32>(now[2u * index + 1u].xy, bitcast<i32>(index), 0);
}

// Puts candidates at hand, from one on, into a list behind another. Returns where its head is.
fn hand_out(lane: u32, first: u32, before: u32) -> u32 {
    let count = atomicLoad(&found_count) - first;
    if (lane == 0u) {
        // So that it never comes to 0 again, however many are found.
        list = NO_LIST;
        if (atomicLoad(&control[CANDIDATES]) < MOST_COUNTED) {
            list = atomicAdd(&control[CANDIDATES], count + 1u);
        }
    }
    workgroupBarrier();
    let head = list;
    if (head < params.room && count < params.room - head) {
        if (lane == 0u) {
            lists[2u * head] = vec4<i32>(bitcast<i32>(before), i32(count), 0, 0);
        }
        for (var at = lane; at < count; at += CAST_LANES) {
            let to = 2u * (head + 1u + at);
            lists[to] = first_half(first + at);
            lists[to + 1u] = second_half(first + at);
        }
    }
    workgroupBarrier();
    if (lane == 0u) {
        atomicStore(&found_count, 0u);
    }
    workgroupBarrier();
    return head;
}

// Answers with the candidates at hand and those of a list.
fn answer(query: u32, lane: u32, last_list: u32, ended: u32) {
    let count = select(0u, atomicLoad(&found_count), ended == ANSWERED);
    let here = min(count, params.answer_room);
    let place = query * (1u + 2u * params.answer_room);
    for (var at = lane; at < here; at += CAST_LANES) {
        answers[place + 1u + 2u * at] = first_half(at);
        answers[place + 2u + 2u * at] = second_half(at);
    }
    var last = last_list;
    if (count > here) {
        last = hand_out(lane, here, last);
    }
    if (lane == 0u) {
        answers[place] = vec4<i32>(bitcast<i32>(last), i32(here), i32(ended), 0);
    }
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
        if (rank == params.closest - 1u && own.upper <= limit) {
            limit = own.upper;
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
    rounds += FOUND_A_LANE * count;
    workgroupBarrier();
}

// Takes the nearest group from the upper part of the stack, of so many groups; MISSED and the whole part where none is
// near enough.
fn take_nearest(lane: u32, count: u32) -> vec2<u32> {
    let last = count - 1u;
    let part = select(min(count, CAST_LANES), 1u, count > STRAIGHT_DOWN);
    if (lane < part) {
        let own = stack[last - lane];
        if (own.y <= limit) {
            atomicMin(&nearest, (own.y & ~(CAST_LANES - 1u)) | lane);
        }
    }
    workgroupBarrier();
    let taken = atomicLoad(&nearest);
    let at = last - (taken & (CAST_LANES - 1u));
    var group = vec2<u32>(0u, MISSED);
    if (taken != MISSED) {
        group = stack[at];
    }
    let top = stack[last];
    workgroupBarrier();
    if (lane == 0u) {
        if (taken == MISSED) {
            atomicStore(&stack_count, count - part);
        } else {
            stack[at] = top;
            atomicStore(&stack_count, last);
        }
        atomicStore(&nearest, MISSED);
        is_nearer = 0u;
    }
    workgroupBarrier();
    return group;
}

// Looks at the items of a group.
fn look_at(lane: u32, group: u32) {
    let level = group >> LEVEL_BITS;
    let item = (group & ((1u << LEVEL_BITS) - 1u)) * FAN_OUT + lane;
    if (item < params.levels[level].count) {
        let place = 2u * (params.levels[level].first + item);
        let low = items[place];
        let high = items[place + 1u];
        let lo = bitcast<vec3<f32>>(low.xyz);
        let hi = bitcast<vec3<f32>>(high.xyz);
        let key = lower_key(lo, hi);
        if (lo.x <= hi.x && key <= limit && key != MISSED) {
            if (level > 0u) {
                stack[atomicAdd(&stack_count, 1u)] = vec2<u32>(((level - 1u) << LEVEL_BITS) | item, key);
            } else {
                var upper = MISSED;
                if (high.w != 0u) {
                    upper = upper_key(lo, hi);
                }
                found[atomicAdd(&found_count, 1u)] = Found(low.w, key, upper);
                if (upper != MISSED) {
                    is_hit = 1u;
                }
                if (upper <= limit && upper != MISSED) {
                    is_nearer = 1u;
                }
            }
        }
    }
    rounds += STEP_ROUNDS;
    workgroupBarrier();
}

fn search(query: u32, lane: u32) {
    if (lane == 0u) {
        atomicStore(&stack_count, 1u);
        stack[0] = vec2<u32>(params.top << LEVEL_BITS, 0u);
        atomicStore(&nearest, MISSED);
        atomicStore(&found_count, 0u);
        limit_index = MISSED;
        is_hit = 0u;
        is_too_much = select(0u, 1u, atomicLoad(&control[STEPS]) >= params.all_steps);
    }
    let kind = take_question(query);
    if (lane == 0u) {
        limit = most_key();
    }
    workgroupBarrier();
    var ended = select(ANSWERED, GIVEN_UP, kind == UNUSUAL || is_too_much != 0u);
    var before = NO_LIST;
    var steps = 0u;
    var count = select(1u, 0u, kind == INVALID);
    var goes_on = true;
    while (ended == ANSWERED && count > 0u && goes_on) {
        let group = take_nearest(lane, count);
        if (group.y == MISSED) {
            count = atomicLoad(&stack_count);
            rounds += STEP_ROUNDS;
            continue;
        }
        look_at(lane, group.x);
        steps++;
        count = atomicLoad(&stack_count);
        goes_on = params.any == 0u || is_hit == 0u;
        var at_hand = atomicLoad(&found_count);
        let settles = params.closest > 0u && (is_nearer != 0u || at_hand > FOUND - CAST_LANES);
        workgroupBarrier();
        if (settles) {
            settle(lane, at_hand);
            at_hand = atomicLoad(&found_count);
            workgroupBarrier();
        }
        if (at_hand > FOUND - CAST_LANES) {
            // Of the closest, all that there are so far must be at hand.
            if (params.closest > 0u) {
                ended = GIVEN_UP;
            } else {
                before = hand_out(lane, 0u, before);
            }
        }
        if (steps >= params.steps || rounds > params.thread_rounds) {
            ended = GIVEN_UP;
        }
    }
    answer(query, lane, before, ended);
    if (lane == 0u) {
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
