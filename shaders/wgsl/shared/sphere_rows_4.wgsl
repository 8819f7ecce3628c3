// `rows_4` of spheres.

alias RowsF = vec4<f32>;

fn apart_rows(rows: RowsU, first: u32, near: RowsU) -> RowsU {
    // A loop: the integers are there once, not four times.
    var apart = RowsU(0u);
    for (var i = 0u; i < 4u; i++) {
        apart[i] = apart_bits(rows[i], first, near[i]);
    }
    return apart;
}
