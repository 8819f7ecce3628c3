// pairs: every row of a band against every later column, 32 columns to a word.
//
// A workgroup takes a tile: PAIRS_WORKGROUP * ROWS_PER_THREAD rows by one strip of STRIP_BLOCKS
// column blocks. The columns lie in workgroup memory, the rows in registers. Each matrix word has
// one writer. The matrix is stored column block by column block, so that neighbouring threads
// write neighbouring words. Per row and strip, one mask says which of its words are not zero.
// The totals are sums of integers, so the order of the atomic additions does not show.

#import constants
#import batch
#import rows

struct PairsParams {
    // Words of one key plane.
    plane_words: u32,
    // First row of the band, a multiple of BATCH_BOXES.
    row0: u32,
    // Rows of the band's matrix, a multiple of BATCH_BOXES.
    band_rows: u32,
    // First strip of the band.
    strip0: u32,
    // Rows from here on belong to the next band, which counts them.
    counted_end: u32,
}

@group(0) @binding(0) var<storage, read> keys: array<i32>;
@group(0) @binding(1) var<storage, read_write> matrix: array<u32>;
@group(0) @binding(2) var<storage, read_write> strip_masks: array<u32>;
@group(0) @binding(3) var<storage, read_write> totals: array<SummedTotals>;
var<immediate> params: PairsParams;

// BatchTotals as this stage sees them.
struct SummedTotals {
    words: atomic<u32>,
    pairs: atomic<u32>,
}

const TILE_ROWS: u32 = PAIRS_WORKGROUP * ROWS_PER_THREAD;
const STRIP_COLUMNS: u32 = STRIP_BLOCKS * 32u;

#import columns
var<workgroup> word_sum: atomic<u32>;
var<workgroup> pair_sum: atomic<u32>;

fn store_word(at: u32, word: u32) {
    if (STORE_ZEROS || word != 0u) {
        matrix[at] = word;
    }
}

@compute @workgroup_size(PAIRS_WORKGROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let strip = params.strip0 + group.y;
    let first_column = strip * STRIP_COLUMNS;
    let tile_row = group.x * TILE_ROWS;
    let first_row = params.row0 + tile_row;
    // No column of the strip comes after any row of the tile.
    if (first_column + STRIP_COLUMNS - 1u <= first_row) {
        return;
    }

    let plane = params.plane_words;
    for (var i = lane; i < STRIP_COLUMNS; i += PAIRS_WORKGROUP) {
        let at = first_column + i;
#import take_column
    }
    if (lane == 0u) {
        atomicStore(&word_sum, 0u);
        atomicStore(&pair_sum, 0u);
    }
    let own = first_row + lane;
#import take_rows
    let rows = row_numbers(own);
    workgroupBarrier();

    var masks = RowsU(0u);
    var pairs = RowsU(0u);
    let store_at = group.y * STRIP_BLOCKS * params.band_rows + tile_row + lane;
    for (var block = 0u; block < STRIP_BLOCKS; block++) {
        var words = RowsU(0u);
#import begin_words
        for (var bit = 0u; bit < 32u; bit++) {
#import test_column
        }
        let block_column = first_column + block * 32u;
        // Only columns after the row: elsewhere than around the diagonal all or none are.
        if (block_column < first_row + TILE_ROWS) {
            let not_after = max(rows + 1u, RowsU(block_column)) - block_column;
            let keep = RowsU(0xffffffffu) << min(not_after, RowsU(31u));
            words &= select(keep, RowsU(0u), not_after > RowsU(31u));
        }
#import settle_words
        store_rows(store_at + block * params.band_rows, words);
        masks |= select(RowsU(0u), RowsU(1u << block), words != RowsU(0u));
        pairs += countOneBits(words);
    }
    store_masks(group.y * params.band_rows + tile_row + lane, masks);

    let own_words = sum_rows(countOneBits(masks));
    if (own_words != 0u) {
        atomicAdd(&word_sum, own_words);
        atomicAdd(&pair_sum, sum_rows(pairs));
    }
    workgroupBarrier();
    if (lane == 0u && first_row < params.counted_end) {
        let tile_words = atomicLoad(&word_sum);
        if (tile_words != 0u) {
            let batch = first_row / BATCH_BOXES;
            atomicAdd(&totals[batch].words, tile_words);
            atomicAdd(&totals[batch].pairs, atomicLoad(&pair_sum));
        }
    }
}
