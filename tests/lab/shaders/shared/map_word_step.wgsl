// k -> (a, b) by one inverse a word of 32 ids, then steps.
// Mirror: `pairmaskd::study::mapping::mirror::word_step`.

fn next_pair(n: u32, k: Id, pair: vec2<i32>) -> vec2<i32> {
    if (pair.y + 1 < i32(n)) {
        return vec2<i32>(pair.x, pair.y + 1);
    }
    return vec2<i32>(pair.x + 1, pair.x + 2);
}

fn map_pair(n: u32, k: Id) -> vec2<i32> {
    let within = u32(k) % 32u;
    var pair = exact_pair(n, k - Id(within));
    for (var t = 0u; t < within; t++) {
        pair = next_pair(n, k, pair);
    }
    return pair;
}

#import row_order
