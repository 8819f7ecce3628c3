// Boxes of six IEEE halves, two a word, the first in the low half.
//
// Each half becomes the bits of the f32 of its value, by integers alone: WGSL promises neither
// subnormals nor NaN nor infinity. Mirror: `expand` in `pairmask::precision::f16`.

// f32 exponents are biased by 127, those of halves by 15.
const BIAS_GAP: u32 = 112u << 23u;
// Fraction bits that a half does not have.
const DROPPED: u32 = 13u;
// Exponent of 2^-24, of which subnormal halves are multiples, less the leading one's own.
const SUBNORMAL_EXPONENT: u32 = 127u - 24u - 1u;

fn half_bits(half: u32) -> u32 {
    let magnitude = half & 0x7fffu;
    let exponent = magnitude >> 10u;
    // Infinity and NaN keep the largest exponent; a NaN keeps a fraction bit.
    let gap = select(BIAS_GAP, 2u * BIAS_GAP, exponent == 31u);
    let normal = (magnitude << DROPPED) + gap;
    // The leading one goes to the lowest bit of the exponent and raises it by one.
    let leading = firstLeadingBit(magnitude);
    let scaled = ((SUBNORMAL_EXPONENT + leading) << 23u) + (magnitude << (23u - leading));
    let subnormal = select(scaled, 0u, magnitude == 0u);
    return ((half & 0x8000u) << 16u) | select(normal, subnormal, exponent == 0u);
}

fn half_bits3(halves: vec3<u32>) -> vec3<u32> {
    return vec3<u32>(half_bits(halves.x), half_bits(halves.y), half_bits(halves.z));
}

fn box_bits(lane: u32) -> BoxBits {
    let at = 3u * lane;
    let words = vec3<u32>(raw[at], raw[at + 1u], raw[at + 2u]);
    let first = words & vec3<u32>(0xffffu);
    let second = words >> vec3<u32>(16u);
    return BoxBits(
        half_bits3(vec3<u32>(first.x, second.x, first.y)),
        half_bits3(vec3<u32>(second.y, first.z, second.z)),
    );
}
