// pack_dense: matrix words, one bit a column, -> the bit string of pair indices, one bit a pair.
//
// One thread a word of the string. Each finds the row of its first bit by an exact integer search
// (no sqrt, no rounding), then steps along the row and into the next ones. Pair indices are
// counted from the band's first pair, so they stay below 2^31 for every n. Within a band,
// row i starts at bit i(2m - i + 1)/2, m being the pairs of the first row.

#import constants
#import batch

struct PackParams {
    // Boxes.
    n: u32,
    // First row of the band, a multiple of BATCH_BOXES, and rows whose pairs the band owns.
    row0: u32,
    owned_rows: u32,
    // Rows of the band's matrix.
    band_rows: u32,
    // First column block of the matrix.
    block0: u32,
    // Words of the string that start in the band, and the bit, from the band's first pair, that
    // the first of them starts with.
    word_count: u32,
    first_bit: u32,
    // Word of the output binding that the first of them goes to.
    out_offset: u32,
    // Workgroups of a dispatch row.
    groups_x: u32,
}

@group(0) @binding(0) var<storage, read> matrix: array<u32>;
@group(0) @binding(1) var<storage, read> totals: array<BatchTotals>;
@group(0) @binding(2) var<storage, read_write> reports: array<BatchReport>;
@group(0) @binding(3) var<storage, read_write> out_words: array<u32>;
var<immediate> params: PackParams;

// First bit of row i of the band. The product stays below 2^32 because the plan keeps the pairs
// of a band below 2^31.
fn row_start(i: u32) -> u32 {
    let m = params.n - 1u - params.row0;
    return i * (2u * m - i + 1u) / 2u;
}

// The row that bit k of the band lies in: the last one that starts at or before k.
fn row_of(k: u32) -> u32 {
    var low = 0u;
    var high = min(params.owned_rows, params.n - 1u - params.row0);
    while (high - low > 1u) {
        let middle = (low + high) / 2u;
        if (row_start(middle) <= k) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return low;
}

// 32 columns of a row from `column` on; columns past the matrix are zero.
fn columns_from(band_row: u32, column: u32) -> u32 {
    let block = column / 32u - params.block0;
    let shift = column % 32u;
    let at = block * params.band_rows + band_row;
    var bits = matrix[at] >> shift;
    if (shift != 0u && column - shift + 32u < params.n) {
        bits |= matrix[at + params.band_rows] << (32u - shift);
    }
    return bits;
}

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let index = (group.y * params.groups_x + group.x) * BATCH_BOXES + lane;
    let batch0 = params.row0 / BATCH_BOXES;
    if (index < (params.owned_rows + BATCH_BOXES - 1u) / BATCH_BOXES) {
        let batch = batch0 + index;
        reports[batch].words = totals[batch].words;
        reports[batch].pairs = totals[batch].pairs;
    }
    if (index >= params.word_count) {
        return;
    }
    let k = params.first_bit + index * 32u;
    var band_row = row_of(k);
    var column = params.row0 + band_row + 1u + (k - row_start(band_row));
    var word = 0u;
    var filled = 0u;
    // Ends at the last pair: the tail bits stay zero.
    while (filled < 32u && column < params.n) {
        let take = min(32u - filled, params.n - column);
        let bits = columns_from(band_row, column) & (0xffffffffu >> (32u - take));
        word |= bits << filled;
        filled += take;
        band_row++;
        column = params.row0 + band_row + 1u;
    }
    out_words[params.out_offset + index] = word;
}
