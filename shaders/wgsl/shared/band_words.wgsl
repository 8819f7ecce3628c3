// The non-zero words of a batch of rows of a band, in order of (row, column block), a window at a time.
//
// One workgroup a batch, one row a thread. A scan gives each row's words their numbers in the batch;
// the words of a window of numbers are collected in workgroup memory. What earlier batches had is added
// up from the totals, so the place in the reply of all that is written is known beforehand.

struct WriteParams {
    // First row of the band, a multiple of BATCH_BOXES.
    row0: u32,
    // Rows of the band's matrix.
    band_rows: u32,
    // First strip of the band, and the one past the last.
    strip0: u32,
    strip_end: u32,
    // Column blocks of a strip.
    strip_blocks: u32,
    // Words, or pairs of a list, that the reply has room for.
    capacity: u32,
}

@group(0) @binding(0) var<storage, read> matrix: array<u32>;
@group(0) @binding(1) var<storage, read> strip_masks: array<u32>;
@group(0) @binding(2) var<storage, read> totals: array<BatchTotals>;
@group(0) @binding(3) var<storage, read_write> reports: array<BatchReport>;
var<immediate> params: WriteParams;

var<workgroup> earlier_sum: atomic<u32>;
// Row in the batch << 24 | column block; bits.
var<workgroup> window_slots: array<u32, WINDOW_WORDS>;
var<workgroup> window_bits: array<u32, WINDOW_WORDS>;

// The row at hand, its first strip, its words, and how many of the batch come before them.
var<private> band_row: u32;
var<private> first_strip: u32;
var<private> own: u32;
var<private> own_start: u32;

// Numbers the words of the batch, and returns how many there are. All lanes call it. `earlier_sum` has
// the items (`entries_of`) of earlier batches afterwards, and the batch's report its totals.
fn number_words(batch_in_band: u32, lane: u32) -> u32 {
    band_row = batch_in_band * BATCH_BOXES + lane;
    let row = params.row0 + band_row;
    let batch = row / BATCH_BOXES;
    if (lane == 0u) {
        atomicStore(&earlier_sum, 0u);
    }

    // A strip counts for a row if its last column comes after the row; earlier ones may not even
    // have been written.
    let strip_columns = params.strip_blocks * 32u;
    first_strip = max((row + 1u) / strip_columns, params.strip0);
    own = 0u;
    for (var strip = first_strip; strip < params.strip_end; strip++) {
        own += countOneBits(strip_masks[(strip - params.strip0) * params.band_rows + band_row]);
    }
    var earlier = 0u;
    for (var i = lane; i < batch; i += BATCH_BOXES) {
        earlier += entries_of(totals[i]);
    }

    scan[lane] = own;
    workgroupBarrier();
    if (earlier != 0u) {
        atomicAdd(&earlier_sum, earlier);
    }
    sum_up(lane);
    own_start = scan[lane] - own;
    if (lane == 0u) {
        reports[batch].words = totals[batch].words;
        reports[batch].pairs = totals[batch].pairs;
    }
    return scan[BATCH_BOXES - 1u];
}

// Collects the words of the row with numbers from `window` on, as far as the window goes. A barrier
// follows.
fn fill_window(lane: u32, window: u32) {
    // Rows whose words lie outside this window have nothing to add to it.
    if (own == 0u || own_start >= window + WINDOW_WORDS || own_start + own <= window) {
        return;
    }
    var at = own_start;
    for (var strip = first_strip; strip < params.strip_end; strip++) {
        let band_strip = strip - params.strip0;
        var mask = strip_masks[band_strip * params.band_rows + band_row];
        while (mask != 0u) {
            let bit = countTrailingZeros(mask);
            mask &= mask - 1u;
            if (at >= window && at < window + WINDOW_WORDS) {
                let band_block = band_strip * params.strip_blocks + bit;
                window_slots[at - window] = (lane << 24u) | (strip * params.strip_blocks + bit);
                window_bits[at - window] = matrix[band_block * params.band_rows + band_row];
            }
            at++;
        }
    }
}

// Row and column block of word `i` of the window.
fn address_of(batch_in_band: u32, i: u32) -> vec2<u32> {
    let first_row = params.row0 + batch_in_band * BATCH_BOXES;
    let slot = window_slots[i];
    return vec2<u32>(first_row + (slot >> 24u), slot & 0xffffffu);
}
