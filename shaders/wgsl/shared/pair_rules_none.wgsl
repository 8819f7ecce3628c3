// Rows of a frame without rules: all pairs count, and all rows are of one world. The other form is
// `pair_rules_ruled`.

// The row at hand is that of a box.
fn take_rules(index: u32) {}

// Whether the row's box may meet another.
fn may_meet(index: u32) -> bool {
    return true;
}

// The first cell of the row's world.
fn world_cell() -> u32 {
    return 0u;
}

// Whether any row has to look at a level.
fn has_boxes(first_cell: u32, cell_end: u32) -> bool {
    return table[first_cell] != table[cell_end];
}

// Whether the row need not look at a level that some row has to look at.
fn is_empty_here(level: u32) -> bool {
    return false;
}

// Whether the row does not take too much for a grid. All rows together were asked for before.
fn is_row_within_budget() -> bool {
    return true;
}

// What the host learns of the row, which has so many items of its batch before it.
fn note_row(entries_before: u32) {}
