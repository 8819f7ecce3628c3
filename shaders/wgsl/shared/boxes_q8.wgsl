// Boxes of six 8-bit cells: three halves of a word, two cells each. Every other box starts in the
// middle of a word.

#import cells

fn half_word(at: u32) -> u32 {
    return (raw[at / 2u] >> (16u * (at % 2u))) & 0xffffu;
}

fn box_bits(lane: u32) -> BoxBits {
    let at = 3u * lane;
    let halves = vec3<u32>(half_word(at), half_word(at + 1u), half_word(at + 2u));
    let first = halves & vec3<u32>(0xffu);
    let second = halves >> vec3<u32>(8u);
    return cell_bits(
        vec3<u32>(first.x, second.x, first.y),
        vec3<u32>(second.y, first.z, second.z),
        0xffu,
    );
}
