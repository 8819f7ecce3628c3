// Ids in row order.
fn id_count(n: u32) -> Id {
    return pair_count(n);
}

fn id_of_pair(n: u32, a: i32, b: i32) -> Id {
    return row_order_id(n, a, b);
}
