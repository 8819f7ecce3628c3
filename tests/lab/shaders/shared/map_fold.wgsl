// k -> (a, b) by folding the triangle into a rectangle (Navarro et al.): a row and the one that
// mirrors it make one row of the rectangle. The ids are not in row order.
// Mirror: `pairmaskd::study::mapping::mirror::fold`.

// Columns of the rectangle: n rounded down to an odd number.
fn fold_width(n: u32) -> u32 {
    return n - 1u + n % 2u;
}

fn map_pair(n: u32, k: Id) -> vec2<i32> {
    let width = fold_width(n);
    let y = u32(k / Id(width));
    let x = u32(k % Id(width));
    let own = n - 1u - y;
    if (x < own) {
        return vec2<i32>(i32(y), i32(y + 1u + x));
    }
    // The mirrored row holds y pairs when n is even, y + 1 when it is odd.
    let row = width - y - 2u * (n % 2u);
    return vec2<i32>(i32(row), i32(row + 1u + (x - own)));
}

#import each_id

fn id_count(n: u32) -> Id {
    return pair_count(n);
}

fn id_of_pair(n: u32, a: i32, b: i32) -> Id {
    let width = fold_width(n);
    let row = u32(a);
    if (row < n / 2u) {
        return Id(row) * Id(width) + Id(u32(b) - row - 1u);
    }
    let y = width - row - 2u * (n % 2u);
    return Id(y) * Id(width) + Id(n - 1u - y) + Id(u32(b) - row - 1u);
}
