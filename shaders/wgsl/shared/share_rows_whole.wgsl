// Rows and items where one GPU has a frame alone: all of them. The other form is `share_rows_part`.

// The first row.
fn first_row() -> u32 {
    return 0u;
}

// One past the last row.
fn end_row() -> u32 {
    return params.n;
}

// The place of its first item among those of all rows.
fn first_item() -> u32 {
    return 0u;
}

// Items of all rows, of which these are its own.
fn items_of_all(own: u32) -> u32 {
    return own;
}
