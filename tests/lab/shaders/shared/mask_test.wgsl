// Boxes as keys (order_key of min.xyz, max.xyz) and the test of a pair, for the output study.

struct MaskParams {
    n: u32,
    pair_count: u32,
    thread_count: u32,
    groups_x: u32,
}

@group(0) @binding(0) var<storage, read> keys: array<i32>;

// The mapping may name no pair (from 5,794 boxes on): then nothing is read.
fn overlaps(n: u32, pair: vec2<i32>) -> bool {
    if (pair.x < 0 || pair.x >= pair.y || pair.y >= i32(n)) {
        return false;
    }
    let a = u32(pair.x) * BOX_WORDS;
    let b = u32(pair.y) * BOX_WORDS;
    return keys[a] <= keys[b + 3u] && keys[b] <= keys[a + 3u]
        && keys[a + 1u] <= keys[b + 4u] && keys[b + 1u] <= keys[a + 4u]
        && keys[a + 2u] <= keys[b + 5u] && keys[b + 2u] <= keys[a + 5u];
}
