// k -> (k / n, k % n): the lazy way of section 3.2.2. Half of the ids are no pair (a >= b).
// Mirror: `pairmaskd::study::mapping::mirror::lazy`.

fn map_pair(n: u32, k: Id) -> vec2<i32> {
    return vec2<i32>(i32(k / Id(n)), i32(k % Id(n)));
}

#import each_id

fn id_count(n: u32) -> Id {
    return Id(n) * Id(n) - Id(n);
}

fn id_of_pair(n: u32, a: i32, b: i32) -> Id {
    return Id(a) * Id(n) + Id(b);
}
