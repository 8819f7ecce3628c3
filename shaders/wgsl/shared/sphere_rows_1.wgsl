// `rows_1` of spheres.

alias RowsF = f32;

fn apart_rows(rows: RowsU, first: u32, near: RowsU) -> RowsU {
    return apart_bits(rows, first, near);
}
