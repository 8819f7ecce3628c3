// k -> (a, b) by the closed form of Avril et al. 2012, formulas 1 and 2, with the corrections of
// section 3.3 if CORRECTED. Inside, boxes count from 1 as in the paper.
// Mirror: `pairmaskd::study::mapping::mirror::closed`.

#import root

// 4n^2 - 4n - 8k + 1: in f32 as the paper writes it, or with the subtraction in integers.
fn discriminant(n: u32, k: Id) -> f32 {
    if (INTEGER_DISCRIMINANT) {
        return 8.0 * f32(pair_count(n) - k) + 1.0;
    }
    let m = f32(n);
    // Rounding can make it negative near the last pair: that counts as 0 on every device.
    return max(4.0 * m * m - 4.0 * m - 8.0 * f32(k) + 1.0, 0.0);
}

fn map_pair(n: u32, k: Id) -> vec2<i32> {
    let last = i32(n);
    var a = i32((f32(2u * n + 1u) - root(discriminant(n, k))) * 0.5);
    var b = column_in(n, a - 1, k) + 1;
    if (CORRECTED) {
        if (b > last) {
            a++;
            b = a + (b - last);
        } else if (a >= b) {
            b = last - (a - b);
            a--;
        }
    }
    return vec2<i32>(a - 1, b - 1);
}

#import each_id
#import row_order
