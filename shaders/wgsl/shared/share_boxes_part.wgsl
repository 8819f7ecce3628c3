// Boxes that are placed where several GPUs share a frame: those of its rows, and those that its rows look
// at. The other form is `share_boxes_whole`.

// Whether a box with this home is placed.
fn is_placed(cell: u32, level: u32) -> bool {
    if (level == grid.level_count) {
        // Every row looks at giants.
        return true;
    }
    if (level == NO_LEVEL) {
        return cell >= grid.share.first_cell && cell < grid.share.end_cell;
    }
    let at = grid.share.looked_at[level];
    return cell >= at.x && cell < at.y || cell >= at.z && cell < at.w;
}
