// What `pairs` does with boxes.

#part columns
// min.x, min.y, min.z, max.x of each column; max.y, max.z of each column.
var<workgroup> column_a: array<vec4<i32>, STRIP_COLUMNS>;
var<workgroup> column_b: array<vec2<i32>, STRIP_COLUMNS>;

#part take_column
        column_a[i] = vec4<i32>(
            keys[at],
            keys[plane + at],
            keys[2u * plane + at],
            keys[3u * plane + at],
        );
        column_b[i] = vec2<i32>(keys[4u * plane + at], keys[5u * plane + at]);

#part take_rows
    let lo_x = load_rows(own);
    let lo_y = load_rows(plane + own);
    let lo_z = load_rows(2u * plane + own);
    let hi_x = load_rows(3u * plane + own);
    let hi_y = load_rows(4u * plane + own);
    let hi_z = load_rows(5u * plane + own);

#part begin_words
#part test_column
            let a = column_a[block * 32u + bit];
            let b = column_b[block * 32u + bit];
            // `&`, not `&&`: six compares cost less than a branch.
            let hit = (lo_x <= RowsI(a.w)) & (RowsI(a.x) <= hi_x)
                & (lo_y <= RowsI(b.x)) & (RowsI(a.y) <= hi_y)
                & (lo_z <= RowsI(b.y)) & (RowsI(a.z) <= hi_z);
            words |= select(RowsU(0u), RowsU(1u << bit), hit);

#part settle_words
