// Spheres of four f32, x y z radius, as the boxes around them. Why no pair is lost, and mirror:
// `mirror/sphere_bounds.rs`.

#import sphere_bounds

const NAN: u32 = 0x7fc00000u;
const ONE: u32 = 0x3f800000u;

fn sphere_bits(lane: u32) -> vec4<u32> {
    let at = 4u * lane;
    return vec4<u32>(raw[at], raw[at + 1u], raw[at + 2u], raw[at + 3u]);
}

fn box_bits(lane: u32) -> BoxBits {
    let sphere = sphere_bits(lane);
    let sizes = sphere & vec4<u32>(MAGNITUDE_BITS);
    if (max(sizes.x, max(sizes.y, sizes.z)) >= INFINITY_BITS || sizes.w > INFINITY_BITS) {
        return BoxBits(vec3<u32>(NAN), vec3<u32>(NAN));
    }
    if (sphere.w > SIGN_BIT) {
        return BoxBits(vec3<u32>(ONE), vec3<u32>(ONE | SIGN_BIT));
    }
    let bounds = sphere_bounds(sphere);
    return BoxBits(bounds[0], bounds[1]);
}

// The sphere as it is kept. What overlaps nothing has the radius -1.
fn kept_sphere(lane: u32, is_nothing: bool) -> vec4<i32> {
    var sphere = sphere_bits(lane);
    // -0 is a point.
    sphere.w = select(sphere.w, 0u, sphere.w == SIGN_BIT);
    return bitcast<vec4<i32>>(select(sphere, vec4<u32>(0u, 0u, 0u, ONE | SIGN_BIT), is_nothing));
}
