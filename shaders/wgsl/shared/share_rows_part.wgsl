// Rows and items where several GPUs share a frame: rows whose home cells are in a range. Each GPU counts
// the boxes of all cells, so a row has the same number everywhere. The other form is `share_rows_whole`.

// The first row.
fn first_row() -> u32 {
    return table[grid.share.first_cell];
}

// One past the last row.
fn end_row() -> u32 {
    return table[grid.share.end_cell];
}

// The place of its first item among those of all rows.
fn first_item() -> u32 {
    return grid.share.first_item;
}

// Items of all rows, of which these are its own.
fn items_of_all(own: u32) -> u32 {
    return grid.share.all_items;
}
