// k -> (a, b) counted from the far end, where nothing cancels, and one integer fix-up.
// Mirror: `pairmaskd::study::mapping::mirror::far_end`.

// 0 + 1 + ... + (j - 1).
fn triangle(j: u32) -> Id {
    return pair_count(j);
}

fn map_pair(n: u32, k: Id) -> vec2<i32> {
    // Pairs after k. The j pairs of a row counted from the end follow triangle(j) others.
    let after = pair_count(n) - Id(1) - k;
    var j = u32((1.0 + sqrt(8.0 * f32(after) + 1.0)) * 0.5);
    if (triangle(j) > after) {
        j--;
    } else if (after - triangle(j) >= Id(j)) {
        j++;
    }
    return vec2<i32>(i32(n - 1u - j), i32(n - 1u - u32(after - triangle(j))));
}

#import each_id
#import row_order
