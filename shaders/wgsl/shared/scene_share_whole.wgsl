// A GPU that searches alone: entries are looked at as they lie, then all rows.

const IS_SHARE: bool = false;

fn is_of_share(cell: u32) -> bool {
    return true;
}

fn first_row_chunk(group: u32) -> u32 {
    return group;
}

fn row_chunk_step(groups: u32) -> u32 {
    return groups;
}
