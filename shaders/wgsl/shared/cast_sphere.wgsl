// Spheres: the square of a box's distance from the center, rounded down, and up.

// Four f32 each: center, radius.
@group(0) @binding(4) var<storage, read> questions: array<vec4<u32>>;

// Larger radii than this are without an end: all that lies within the outermost coordinates is nearer.
const FARTHEST: f32 = 4e18;

var<private> center: vec3<f32>;
var<private> radius: f32;

fn take_question(query: u32) -> u32 {
    let sphere = questions[query];
    center = bitcast<vec3<f32>>(sphere.xyz);
    radius = bitcast<f32>(sphere.w & MAGNITUDE_BITS);
    if (!are_finite(sphere.xyz) || sphere.w > SIGN_BIT || is_nan(sphere.w)) {
        return INVALID;
    }
    return select(UNUSUAL, USUAL, are_usual(sphere.xyz, LEAST_USUAL));
}

fn most_key() -> u32 {
    if (radius > FARTHEST) {
        return key_of(BEYOND);
    }
    return key_of(radius * radius * (1.0 + ROUNDING) + SMALLEST);
}

fn square(lo: vec3<f32>, hi: vec3<f32>) -> f32 {
    let gap = max(max(lo - center, center - hi), vec3<f32>(0.0));
    return gap.x * gap.x + gap.y * gap.y + gap.z * gap.z;
}

// Below which square nothing in these bounds is, as a key.
fn lower_key(lo: vec3<f32>, hi: vec3<f32>) -> u32 {
    return key_of(square(lo, hi) * (1.0 - ROUNDING));
}

// The square of a box is no larger, as a key; 0 where it is 0, and MISSED where the sphere may not touch it.
fn upper_key(lo: vec3<f32>, hi: vec3<f32>) -> u32 {
    if (all(lo <= center) && all(center <= hi)) {
        return 0u;
    }
    let upper = square(lo, hi) * (1.0 + ROUNDING) + 4.0 * SMALLEST;
    let most = select(radius * radius * (1.0 - ROUNDING) - 4.0 * SMALLEST, BEYOND, radius > FARTHEST);
    return select(MISSED, key_of(upper), upper <= most);
}
