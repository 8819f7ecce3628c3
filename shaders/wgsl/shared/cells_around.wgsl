// Cells around a box: those of a level in which the boxes lie that it may overlap. A box lies in the cell of its min
// corner and spans two cells an axis at most.

#import grid_layout

struct CellsAround {
    // The box's own cell, unfolded, and the last one of each axis.
    low: vec3<i32>,
    last: vec3<i32>,
    // In the table: the first of each axis, and how many there are.
    start: vec3<u32>,
    len: vec3<u32>,
    // One past the last, and how many of them are at the axis' beginning, where it wraps.
    end: vec3<u32>,
    wrapped: vec3<u32>,
}

fn cells_around(index: u32, lo: vec3<i32>, hi: vec3<i32>) -> CellsAround {
    let low = cells_of(grid.levels[index], plain3(lo));
    var last = cells_of(grid.levels[index], plain3(hi));
    let count = vec3<i32>(grid.levels[index].count);
    let wraps = vec3<bool>((vec3<u32>(grid.levels[index].wraps) & vec3<u32>(1u, 2u, 4u)) != vec3<u32>(0u));
    var first = low - 1;
    first = select(max(first, vec3<i32>(0)), first, wraps);
    let whole = wraps & (last - first >= count);
    first = select(first, vec3<i32>(0), whole);
    last = select(last, count - 1, whole);
    let len = vec3<u32>(clamp(last - first + 1, vec3<i32>(0), count));
    let start = vec3<u32>(first & grid.levels[index].fold);
    let end = start + len;
    let wrapped = max(end, vec3<u32>(count)) - vec3<u32>(count);
    return CellsAround(low, last, start, len, end, wrapped);
}

// Cells `first .. first + len` of an axis, folded: `wrapped` of them from 0 on, then the others.
fn folded(first: u32, wrapped: u32, i: u32) -> u32 {
    return select(first + (i - wrapped), i, i < wrapped);
}
