// k -> (a, b) by a binary search on the first ids of rows.
// Mirror: `pairmaskd::study::mapping::mirror::row_search`.

fn map_pair(n: u32, k: Id) -> vec2<i32> {
    return exact_pair(n, k);
}

#import each_id
#import row_order
