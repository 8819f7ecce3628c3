// Order-preserving integer keys. WGSL promises neither subnormals nor NaN nor infinity, so floats
// are never compared: only their bits are looked at. Mirror: `pairmask::aabb::order_key`.

const SIGN_BIT: u32 = 0x80000000u;
const MAGNITUDE_BITS: u32 = 0x7fffffffu;
const INFINITY_BITS: u32 = 0x7f800000u;

// Keys of a box that overlaps nothing: no key of a number reaches either.
const NOTHING_MIN: i32 = 0x7fffffff;
const NOTHING_MAX: i32 = i32(-0x7fffffff - 1);

fn is_nan(bits: u32) -> bool {
    return (bits & MAGNITUDE_BITS) > INFINITY_BITS;
}

// The key orders as the numbers do; -0 and +0 have one key.
fn order_key(bits: u32) -> i32 {
    let key = bitcast<i32>(select(bits, 0u, bits == SIGN_BIT));
    // Negative numbers grow in magnitude with their bits: flip all but the sign.
    return key ^ bitcast<i32>(bitcast<u32>(key >> 31u) >> 1u);
}
