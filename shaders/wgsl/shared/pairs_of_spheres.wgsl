// What `pairs` does with spheres: each test in f32 first; those that are near are decided in integers
// when the word is whole.

#part columns
#import sphere_filter
#import sphere_exact
#import sphere_settled

// Each column's sphere, as it is compared.
var<workgroup> columns: array<vec4<f32>, STRIP_COLUMNS>;

// The sphere of a row or a column, to the bit.
fn whole_sphere(index: u32) -> vec4<u32> {
    let plane = params.plane_words;
    return bitcast<vec4<u32>>(vec4<i32>(
        keys[index],
        keys[plane + index],
        keys[2u * plane + index],
        keys[3u * plane + index],
    ));
}

#part take_column
        columns[i] = compared_column(whole_sphere(at));

#part take_rows
    let bits_x = bitcast<RowsU>(load_rows(own));
    let bits_y = bitcast<RowsU>(load_rows(plane + own));
    let bits_z = bitcast<RowsU>(load_rows(2u * plane + own));
    let bits_r = bitcast<RowsU>(load_rows(3u * plane + own));
    // `compared_row`, for all rows at once.
    let sizes = RowsU(MAGNITUDE_BITS);
    let largest = max(max(bits_x & sizes, bits_y & sizes), max(bits_z & sizes, bits_r & sizes));
    let is_far = largest > RowsU(SAFE_BITS);
    let is_nothing = (bits_r & RowsU(SIGN_BIT)) != RowsU(0u);
    let is_other = is_far | is_nothing;
    let other_x = select(RowsU(FAR_BITS | SIGN_BIT), RowsU(0u), is_nothing);
    let other_r = select(RowsU(FAR_BITS), RowsU(NOTHING_RADIUS_BITS), is_nothing);
    let row_x = bitcast<RowsF>(select(bits_x, other_x, is_other));
    let row_y = bitcast<RowsF>(select(bits_y, RowsU(0u), is_other));
    let row_z = bitcast<RowsF>(select(bits_z, RowsU(0u), is_other));
    let row_r = bitcast<RowsF>(select(bits_r, other_r, is_other));

#part begin_words
        // Bits of `words` that f32 does not decide.
        var near = RowsU(0u);

#part test_column
            let column = columns[block * 32u + bit];
            let x = row_x - RowsF(column.x);
            let y = row_y - RowsF(column.y);
            let z = row_z - RowsF(column.z);
            let reach = row_r + RowsF(column.w);
            let distance = x * x + y * y + z * z;
            // Below 0 with what overlaps nothing.
            let square = reach * abs(reach);
            let is_apart = distance * RowsF(LESS) - RowsF(LEAST) > square;
            let is_together = square * RowsF(LESS) - RowsF(LEAST) > distance;
            words |= select(RowsU(1u << bit), RowsU(0u), is_apart);
            near |= select(RowsU(1u << bit), RowsU(0u), is_apart | is_together);

#part settle_words
        near &= words;
        if (sum_rows(countOneBits(near)) != 0u) {
            words &= ~apart_rows(rows, block_column, near);
        }

