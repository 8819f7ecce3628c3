// Whether a record has changed in the history under way, and records that do.

// Whether a record, by its second half, has changed in the history under way.
fn has_changed(b: vec4<i32>) -> bool {
    return bitcast<u32>(b.z) == params.epoch_low && (bitcast<u32>(b.w) >> 8u) == params.epoch_high;
}

// The second half of a record that changes now.
fn changed_half(hi_yz: vec2<i32>, flags: u32) -> vec4<i32> {
    return vec4<i32>(hi_yz, bitcast<vec2<i32>>(vec2<u32>(params.epoch_low, (params.epoch_high << 8u) | flags)));
}
