// Boxes that are placed where one GPU has a frame alone: all of them. The other forms are
// `share_boxes_part` and `share_boxes_ruled`.

// Whether a box with this home is placed.
fn is_placed(cell: u32, level: u32) -> bool {
    return true;
}

// The first cell of the box's world.
fn world_of(index: u32) -> u32 {
    return 0u;
}

// Its cell among those of boxes that lie there by their index.
fn parking_of(index: u32) -> u32 {
    return index / PARKED;
}
