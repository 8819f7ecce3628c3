// Cells of boxes of a frame with rules: each box lies in those of its world. The other form is
// `box_worlds_none`.

#import box_rules

// Of `box_rules`. Bindings of rules come behind those of the stage, and are numbered when it is put
// together.
@group(0) @binding(BEHIND) var<storage, read> rules: array<u32>;

// The first cell of the box's world.
fn world_of(index: u32) -> u32 {
    return (mark_of(index) >> RANK_SHIFT) * grid.worlds.cells;
}

// Its cell among those of boxes that lie there by their index. A world has few of them, which its boxes
// take in turns.
fn parking_of(index: u32) -> u32 {
    return index % grid.worlds.parking;
}
