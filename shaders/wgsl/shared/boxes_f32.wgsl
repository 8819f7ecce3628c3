// Boxes of six f32: min.x min.y min.z max.x max.y max.z.
fn box_bits(lane: u32) -> BoxBits {
    let at = 6u * lane;
    return BoxBits(
        vec3<u32>(raw[at], raw[at + 1u], raw[at + 2u]),
        vec3<u32>(raw[at + 3u], raw[at + 4u], raw[at + 5u]),
    );
}
