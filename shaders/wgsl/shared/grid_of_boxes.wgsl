// What the grid's stages do with boxes.

#part key_planes
    keys[index] = box.lo.x;
    keys[plane + index] = box.lo.y;
    keys[2u * plane + index] = box.lo.z;
    keys[3u * plane + index] = box.hi.x;
    keys[4u * plane + index] = box.hi.y;
    keys[5u * plane + index] = box.hi.z;

#part record
        records[index] = vec4<i32>(box.lo, box.hi.x);
        let home = bitcast<vec2<i32>>(vec2<u32>(cell, (level << LEVEL_SHIFT) | slot));
        records[params.plane + index] = vec4<i32>(box.hi.yz, home);

#part row_object
#part settle_word
#part test_position
        let a = sorted[2u * p];
        if (all(a.xyz <= row_hi) & (row_lo.x <= a.w)) {
            let b = sorted[2u * p + 1u];
            if (all(row_lo.yz <= b.xy) && may_meet(bitcast<u32>(b.z))) {
                if (p / 32u != block) {
                    finish_word();
                    block = p / 32u;
                }
                bits |= 1u << (p % 32u);
            }
        }

#part take_row
        row_lo = a.xyz;
        row_hi = vec3<i32>(a.w, b.xy);
