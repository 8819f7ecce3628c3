// `rows_4` of spheres.

alias RowsF = vec4<f32>;

fn apart_rows(rows: RowsU, first: u32, near: RowsU) -> RowsU {
    return RowsU(
        apart_bits(rows.x, first, near.x),
        apart_bits(rows.y, first, near.y),
        apart_bits(rows.z, first, near.z),
        apart_bits(rows.w, first, near.w),
    );
}
