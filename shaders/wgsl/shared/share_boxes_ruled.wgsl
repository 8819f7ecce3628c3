// Boxes where one GPU has a frame with rules alone: all of them are placed, each in the cells of its
// world. The other forms are `share_boxes_whole` and `share_boxes_part`.

#import box_rules

// Of `box_rules`.
@group(0) @binding(7) var<storage, read> rules: array<u32>;

// Whether a box with this home is placed.
fn is_placed(cell: u32, level: u32) -> bool {
    return true;
}

// The first cell of the box's world.
fn world_of(index: u32) -> u32 {
    return (mark_of(index) >> RANK_SHIFT) * grid.worlds.cells;
}

// Its cell among those of boxes that lie there by their index. A world has few of them, which its boxes
// take in turns.
fn parking_of(index: u32) -> u32 {
    return index % grid.worlds.parking;
}
