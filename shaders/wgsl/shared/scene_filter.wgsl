// The filter: a bit for each cell, hashed, in which a box of two cells an axis can have its min corner
// if it overlaps an entry of the level. Cells are unfolded, neighbours along x are neighbouring bits.

fn filter_bit(level: u32, cell: vec3<i32>) -> u32 {
    let c = bitcast<vec3<u32>>(cell);
    let hash = c.x + c.y * 0x9e3779b1u + c.z * 0x85ebca77u + level * 0xc2b2ae3du;
    return hash & (32u * params.filter_words - 1u);
}
