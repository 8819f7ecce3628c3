// Pair ids in integers, of 32 or 64 bits (`Id`), and the exact inverse. Boxes count from 0.
// Mirror: `pairmask::pair_index`.

// Pairs of n boxes. Halving the even factor first keeps the product within the id.
fn pair_count(n: u32) -> Id {
    if (n % 2u == 0u) {
        return Id(n / 2u) * Id(n - 1u);
    }
    return Id(n) * Id((n - 1u) / 2u);
}

// First id of row a: a(2n - a - 1)/2, right for negative rows too. With 32 bits it is taken modulo
// 2^32, and so is all that is subtracted from it.
fn row_first(n: u32, a: i32) -> SignedId {
    let p = SignedId(a);
    let q = SignedId(n) + SignedId(n) - p - SignedId(1);
    // One of p and q is even.
    if ((a & 1) == 0) {
        return (p >> 1u) * q;
    }
    return p * (q >> 1u);
}

// Column of id k if it lies in row a; outside a + 1 .. n - 1 when it does not.
fn column_in(n: u32, a: i32, k: Id) -> i32 {
    return a + 1 + i32(SignedId(k) - row_first(n, a));
}

// Id of the pair a < b.
fn row_order_id(n: u32, a: i32, b: i32) -> Id {
    return Id(row_first(n, a)) + Id(b - a - 1);
}

// The pair of id k, by a binary search for the last row that starts at or before k.
fn exact_pair(n: u32, k: Id) -> vec2<i32> {
    var low = 0u;
    var high = n - 1u;
    while (high - low > 1u) {
        let middle = (low + high) / 2u;
        if (Id(row_first(n, i32(middle))) <= k) {
            low = middle;
        } else {
            high = middle;
        }
    }
    let a = i32(low);
    return vec2<i32>(a, column_in(n, a, k));
}
