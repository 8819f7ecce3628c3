// scene_query_rows: of the boxes around each other (`scene_search`), each query and the boxes that it overlaps.
//
// Queries lie behind the scene's records and are the entries, so that the scene's boxes look for them: each
// looks at one bit and few have more to do. Boxes so large that they would look at many cells are entries
// too. An entry is its box and no hull, so boxes that overlap are a pair.
// Held to every box against every query by the tests of scenes on GPUs.

#import scene_search

// Pairs of each query.
@group(0) @binding(5) var<storage, read_write> counts: array<atomic<u32>>;

fn is_query(name: u32) -> bool {
    return ((name >> KINDS_SHIFT) & THEN) != 0u;
}

// Queries do not look for queries: entries look where boxes are among them.
fn entries_look() -> bool {
    return atomicLoad(&control[MOVED]) != 0u;
}

fn may_be_reported(one_name: u32, other_name: u32) -> bool {
    return is_query(one_name) != is_query(other_name);
}

// Reports a pair: the number of the query, the index of the box. Counts it for the query.
fn decide(one_name: u32, other_name: u32) {
    let is_first = is_query(one_name);
    let query = select(other_name, one_name, is_first) & INDEX_MASK;
    let index = select(one_name, other_name, is_first) & INDEX_MASK;
    let number = query - params.set_first;
    atomicAdd(&counts[number], 1u);
    report(vec2<u32>(number, index));
}
