// One of several GPUs that search the same scene: each looks for what is around its entries and its rows.
//
// Entries are shared out by their cells and never by their positions: the entries of a cell lie in any order,
// another one on each GPU, and find each other by it. Rows are shared out by index.

const IS_SHARE: bool = true;

// Neighbouring cells that are of one share: as many as a batch has about five of.
const SHARE_CELLS: u32 = 64u;

fn is_of_share(cell: u32) -> bool {
    return (cell / SHARE_CELLS) % params.share_count == params.share;
}

fn first_row_chunk(group: u32) -> u32 {
    return group * params.share_count + params.share;
}

fn row_chunk_step(groups: u32) -> u32 {
    return groups * params.share_count;
}
