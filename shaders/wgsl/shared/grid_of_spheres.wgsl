// What the grid's stages do with spheres: their boxes have cells, and they themselves are tested. Each
// test is made in f32 first; those that are near are decided in integers when the word is whole.

#part key_planes
    let sphere = kept_sphere(lane, box.lo.x == NOTHING_MIN);
    keys[index] = sphere.x;
    keys[plane + index] = sphere.y;
    keys[2u * plane + index] = sphere.z;
    keys[3u * plane + index] = sphere.w;

#part record
        records[index] = kept_sphere(lane, level == NO_LEVEL);
        let home = bitcast<vec2<i32>>(vec2<u32>(cell, (level << LEVEL_SHIFT) | slot));
        records[params.plane + index] = vec4<i32>(vec2<i32>(0), home);

#part row_object
#import sphere_bounds
#import sphere_filter
#import sphere_exact
#import sphere_settled

// The row as it is compared; bits of the word at hand that f32 does not decide.
var<private> row_sphere: vec4<f32>;
var<private> near: u32;

// The sphere of a position, to the bit.
fn whole_sphere(position: u32) -> vec4<u32> {
    return bitcast<vec4<u32>>(sorted[2u * position]);
}

#part settle_word
    if (near != 0u) {
        bits &= ~apart_bits(row, block * 32u, near);
        near = 0u;
    }

#part test_position
        let column = compared_column(whole_sphere(p));
        let apart = row_sphere.xyz - column.xyz;
        let reach = row_sphere.w + column.w;
        let distance = apart.x * apart.x + apart.y * apart.y + apart.z * apart.z;
        // Below 0 with what overlaps nothing.
        let square = reach * abs(reach);
        if (!(distance * LESS - LEAST > square)) {
            if (p / 32u != block) {
                finish_word();
                block = p / 32u;
            }
            let bit = 1u << (p % 32u);
            bits |= bit;
            near |= select(bit, 0u, square * LESS - LEAST > distance);
        }

#part take_row
        let bounds = sphere_bounds(bitcast<vec4<u32>>(a));
        row_lo = vec3<i32>(order_key(bounds[0].x), order_key(bounds[0].y), order_key(bounds[0].z));
        row_hi = vec3<i32>(order_key(bounds[1].x), order_key(bounds[1].y), order_key(bounds[1].z));
        row_sphere = compared_row(bitcast<vec4<u32>>(a));
        near = 0u;
