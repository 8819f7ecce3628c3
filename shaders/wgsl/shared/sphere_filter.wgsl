// Spheres as they are compared in f32: a test says apart, together or near. Proof, and mirror:
// `mirror/sphere_filter.rs`.

#import order_keys

// 2^36: up to here numbers are compared as they are.
const SAFE_BITS: u32 = 0x51800000u;
// 2^60: centre and radius of what has a larger one, so that it is near to all that is valid. Columns
// have the centre at +2^60, rows at -2^60.
const FAR_BITS: u32 = 0x5d800000u;
// -2^61: the radius of what overlaps nothing.
const NOTHING_RADIUS_BITS: u32 = 0xde000000u;
// 1 - 2^-19.
const LESS: f32 = 0.99999809265136718750;
// 2^-80.
const LEAST: f32 = 0x1p-80f;

fn as_compared(sphere: vec4<u32>, far_x: u32) -> vec4<f32> {
    let sizes = sphere & vec4<u32>(MAGNITUDE_BITS);
    let is_far = max(max(sizes.x, sizes.y), max(sizes.z, sizes.w)) > SAFE_BITS;
    let is_nothing = (sphere.w & SIGN_BIT) != 0u;
    let held = select(sphere, vec4<u32>(far_x, 0u, 0u, FAR_BITS), is_far);
    return bitcast<vec4<f32>>(select(held, vec4<u32>(0u, 0u, 0u, NOTHING_RADIUS_BITS), is_nothing));
}

fn compared_column(sphere: vec4<u32>) -> vec4<f32> {
    return as_compared(sphere, FAR_BITS);
}

fn compared_row(sphere: vec4<u32>) -> vec4<f32> {
    return as_compared(sphere, FAR_BITS | SIGN_BIT);
}
