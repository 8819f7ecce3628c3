// The box around a sphere, rounded outward. Why no pair is lost, and mirror: `mirror/sphere_bounds.rs`.

#import order_keys

// 2^126: beyond, a sum might not be finite. The box is all of space.
const BOUNDED_BITS: u32 = 0x7e800000u;
// Steps of f32 outward: for the rounding of the sum, and for inputs that are taken as 0.
const OUTWARD: i32 = 2;

fn stepped(bits: vec3<u32>, steps: i32) -> vec3<u32> {
    let keys = vec3<i32>(order_key(bits.x), order_key(bits.y), order_key(bits.z)) + vec3<i32>(steps);
    // The map to keys is its own inverse.
    return bitcast<vec3<u32>>(vec3<i32>(
        order_key(bitcast<u32>(keys.x)),
        order_key(bitcast<u32>(keys.y)),
        order_key(bitcast<u32>(keys.z)),
    ));
}

// Bits of the min and the max corner of a valid sphere's box.
fn sphere_bounds(sphere: vec4<u32>) -> array<vec3<u32>, 2> {
    let sizes = sphere & vec4<u32>(MAGNITUDE_BITS);
    if (max(max(sizes.x, sizes.y), max(sizes.z, sizes.w)) >= BOUNDED_BITS) {
        return array<vec3<u32>, 2>(vec3<u32>(INFINITY_BITS | SIGN_BIT), vec3<u32>(INFINITY_BITS));
    }
    let center = bitcast<vec3<f32>>(sphere.xyz);
    let radius = vec3<f32>(bitcast<f32>(sizes.w));
    return array<vec3<u32>, 2>(
        stepped(bitcast<vec3<u32>>(center - radius), -OUTWARD),
        stepped(bitcast<vec3<u32>>(center + radius), OUTWARD),
    );
}
