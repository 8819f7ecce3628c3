// Rays: where one enters and leaves a box, rounded outward, and inward for those that it hits for certain. Axes on which
// it goes backward are mirrored.

// Ten f32 each: origin, direction, most, half extents.
@group(0) @binding(4) var<storage, read> questions: array<u32>;

// What faces that the ray enters and leaves by are counted from: farther out than exact, and farther in.
var<private> outer_near: vec3<f32>;
var<private> outer_far: vec3<f32>;
var<private> inner_near: vec3<f32>;
var<private> inner_far: vec3<f32>;
var<private> one_over: vec3<f32>;
var<private> is_mirrored: vec3<bool>;
// It does not move on these axes.
var<private> is_level: vec3<bool>;
var<private> ray_most: f32;

// Directions are taken from 1e-19 on: what is far over this is still a number.
const LEAST_DIRECTION: u32 = 0x1fec1e4au;

fn take_question(query: u32) -> u32 {
    let at = 10u * query;
    let origin_bits = vec3<u32>(questions[at], questions[at + 1u], questions[at + 2u]);
    let direction_bits = vec3<u32>(questions[at + 3u], questions[at + 4u], questions[at + 5u]);
    let most_bits = questions[at + 6u];
    let half_bits = vec3<u32>(questions[at + 7u], questions[at + 8u], questions[at + 9u]);
    let are_numbers = are_finite(origin_bits) && are_finite(direction_bits) && are_finite(half_bits);
    let are_lengths = all(half_bits <= vec3<u32>(SIGN_BIT)) && most_bits <= SIGN_BIT && !is_nan(most_bits);
    if (!are_numbers || !are_lengths) {
        return INVALID;
    }
    if (!(are_usual(origin_bits, LEAST_USUAL) && are_usual(direction_bits, LEAST_DIRECTION) && are_usual(half_bits, LEAST_USUAL))) {
        return UNUSUAL;
    }
    is_level = (direction_bits & vec3<u32>(MAGNITUDE_BITS)) == vec3<u32>(0u);
    is_mirrored = direction_bits > vec3<u32>(SIGN_BIT);
    let direction = bitcast<vec3<f32>>(direction_bits & vec3<u32>(MAGNITUDE_BITS));
    one_over = vec3<f32>(1.0) / select(direction, vec3<f32>(1.0), is_level);
    let plain_origin = bitcast<vec3<f32>>(origin_bits);
    let origin = select(plain_origin, -plain_origin, is_mirrored);
    let half = bitcast<vec3<f32>>(half_bits & vec3<u32>(MAGNITUDE_BITS));
    // The sums are rounded: by how much at most, and not at all where the ray is thin.
    let zero = vec3<f32>(0.0);
    let slack = select((abs(origin) + half) * ROUNDING, zero, half == zero);
    outer_near = origin + half + slack;
    outer_far = origin - half - slack;
    inner_near = origin + half - slack;
    inner_far = origin - half + slack;
    ray_most = select(min(bitcast<f32>(most_bits & MAGNITUDE_BITS), BEYOND), 0.0, all(is_level));
    return USUAL;
}

fn most_key() -> u32 {
    return key_of(max(ray_most, SMALLEST));
}

fn is_beside(before: vec3<f32>, behind: vec3<f32>) -> bool {
    let zero = vec3<f32>(0.0);
    return any(is_level & ((before > zero) | (behind < zero)));
}

// When faces so far away are met: the last of those that it enters by, and the first of those that it leaves by.
fn enters_at(before: vec3<f32>) -> f32 {
    let at = select(before * one_over, vec3<f32>(0.0), is_level);
    return max(max(at.x, at.y), max(at.z, 0.0));
}

fn leaves_at(behind: vec3<f32>, is_endless: vec3<bool>) -> f32 {
    let at = select(behind * one_over, vec3<f32>(BEYOND), is_level | is_endless);
    return min(min(at.x, at.y), min(at.z, ray_most));
}

fn near_face(lo: vec3<f32>, hi: vec3<f32>) -> vec3<f32> {
    return select(lo, -hi, is_mirrored);
}

fn far_face(lo: vec3<f32>, hi: vec3<f32>) -> vec3<f32> {
    return select(hi, -lo, is_mirrored);
}

// Below which distance the ray hits nothing in these bounds, as a key; MISSED where it hits nothing there at all.
fn lower_key(lo: vec3<f32>, hi: vec3<f32>) -> u32 {
    let far = far_face(lo, hi);
    let before = near_face(lo, hi) - outer_near;
    let behind = far - outer_far;
    let enter = enters_at(before - vec3<f32>(SMALLEST)) * (1.0 - ROUNDING);
    let leave = leaves_at(behind + vec3<f32>(SMALLEST), far >= vec3<f32>(OUTERMOST));
    let is_met = enter <= leave * (1.0 + ROUNDING) + SMALLEST && !is_beside(before, behind);
    return select(MISSED, key_of(enter), is_met);
}

// The distance of a box is no larger, as a key; 0 where it is 0, and MISSED where the ray may miss it.
fn upper_key(lo: vec3<f32>, hi: vec3<f32>) -> u32 {
    let before = near_face(lo, hi) - inner_near;
    let behind = far_face(lo, hi) - inner_far;
    if (is_beside(before, behind)) {
        return MISSED;
    }
    // Inside at once.
    if (all(before <= vec3<f32>(0.0)) && all(behind >= vec3<f32>(0.0))) {
        return 0u;
    }
    let enter = enters_at(before + vec3<f32>(SMALLEST)) * (1.0 + ROUNDING) + SMALLEST;
    let leave = leaves_at(behind - vec3<f32>(SMALLEST), vec3<bool>(false)) * (1.0 - ROUNDING) - SMALLEST;
    return select(MISSED, key_of(enter), enter <= leave);
}
