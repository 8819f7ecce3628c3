// Cells of boxes of a frame without rules: all boxes are of one world. The other form is
// `box_worlds_ruled`.

// The first cell of the box's world.
fn world_of(index: u32) -> u32 {
    return 0u;
}

// Its cell among those of boxes that lie there by their index.
fn parking_of(index: u32) -> u32 {
    return index / UNPLACED_A_CELL;
}
