// Boxes of six 16-bit cells, two a word, the first in the low half.

#import cells

fn box_bits(lane: u32) -> BoxBits {
    let at = 3u * lane;
    let words = vec3<u32>(raw[at], raw[at + 1u], raw[at + 2u]);
    let first = words & vec3<u32>(0xffffu);
    let second = words >> vec3<u32>(16u);
    return cell_bits(
        vec3<u32>(first.x, second.x, first.y),
        vec3<u32>(second.y, first.z, second.z),
        0xffffu,
    );
}
