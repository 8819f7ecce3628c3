// `rows_2` of spheres.

alias RowsF = vec2<f32>;

fn apart_rows(rows: RowsU, first: u32, near: RowsU) -> RowsU {
    return RowsU(apart_bits(rows.x, first, near.x), apart_bits(rows.y, first, near.y));
}
