// Boxes of cell numbers, as f32. Mirror: `expand` of the cells in `pairmask::precision`.

// What f32::NAN is in Rust.
const NAN_BITS: u32 = 0x7fc00000u;

// Cells are integers up to 65,535, which are f32 exactly. Of boxes with min > max, those with the
// largest number as min.x and 0 as max.x had a NaN.
fn cell_bits(lo: vec3<u32>, hi: vec3<u32>, largest: u32) -> BoxBits {
    var bits = BoxBits(bitcast<vec3<u32>>(vec3<f32>(lo)), bitcast<vec3<u32>>(vec3<f32>(hi)));
    bits.lo.x = select(bits.lo.x, NAN_BITS, (lo.x == largest) & (hi.x == 0u));
    return bits;
}
