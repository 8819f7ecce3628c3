// Rows of a frame with rules: each looks at the cells of its world, and pairs of boxes that may not meet
// do not count. The other form is `pair_rules_none`.

#import box_rules

// Of `box_rules`. Bindings of rules come behind those of the stage, and are numbered when it is put
// together.
@group(0) @binding(BEHIND) var<storage, read> rules: array<u32>;
// For the first row of each world the world's rank and 1, and its batch's items before it; for other rows
// 0. `grid_write` informs the host where each world's items begin.
@group(0) @binding(BEHIND_THAT) var<storage, read_write> row_worlds: array<vec2<u32>>;

var<private> row_owner: u32;
var<private> row_mark: u32;
var<private> row_world: u32;

// The row at hand is that of a box.
fn take_rules(index: u32) {
    row_owner = owner_of(index);
    row_mark = mark_of(index);
    row_world = (row_mark >> RANK_SHIFT) * grid.worlds.cells;
}

// Whether the row's box may meet another. Where lists name both, the host decides.
fn may_meet(index: u32) -> bool {
    let mark = mark_of(index);
    if ((mark & row_mark & LISTED) != 0u) {
        return true;
    }
    if (row_owner != 0u && owner_of(index) == row_owner) {
        return false;
    }
    let kind = mark & KIND_MASK;
    let meets = rules[(row_mark & KIND_MASK) * KIND_WORDS + kind / 32u];
    return (meets >> (kind % 32u) & 1u) != 0u;
}

// The first cell of the row's world.
fn world_cell() -> u32 {
    return row_world;
}

// Whether any row has to look at a level: that is asked for each.
fn has_boxes(first_cell: u32, cell_end: u32) -> bool {
    return true;
}

// Whether the row need not look at a level that some row has to look at.
fn is_empty_here(level: u32) -> bool {
    let first = world_cell() + grid.levels[level].first_cell;
    return table[first] == table[first + grid.levels[level].cell_count];
}

// Whether the row does not take too much for a grid: the giants of its world. The host sees it as work.
fn is_row_within_budget() -> bool {
    let giants = table[world_cell() + grid.first_nothing] - table[world_cell() + grid.first_giant];
    let rows = table[world_cell() + grid.worlds.cells] - table[world_cell()];
    if ((giants >> 10u) * (rows >> 10u) <= params.budget) {
        return true;
    }
    atomicMax(&control[WORK], params.budget + 1u);
    return false;
}

// What the host learns of the row, which has so many items of its batch before it.
fn note_row(entries_before: u32) {
    if (grid.worlds.count > 1u && row < params.n) {
        let is_first = row == table[row_world];
        let world = select(0u, (row_mark >> RANK_SHIFT) + 1u, is_first);
        row_worlds[row] = vec2<u32>(world, entries_before);
    }
}
