// write_sparse: the non-zero words of a band, in order of (row, column block), with their addresses.
//
// One workgroup a batch of rows, one row a thread. The words of earlier batches are added up from
// the totals, the batch's own rows by a scan, so each word's place is known before it is written
// and no capacity can overflow: words past the capacity are not written, only counted, and the
// host comes back with room for all. Words are collected in workgroup memory first, so that
// neighbouring lanes write neighbouring words over the link.

#import constants
#import batch
#import scan

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
    // Words that the reply has room for.
    capacity: u32,
}

@group(0) @binding(0) var<storage, read> matrix: array<u32>;
@group(0) @binding(1) var<storage, read> strip_masks: array<u32>;
@group(0) @binding(2) var<storage, read> totals: array<BatchTotals>;
@group(0) @binding(3) var<storage, read_write> reports: array<BatchReport>;
@group(0) @binding(4) var<storage, read_write> out_rows: array<u32>;
@group(0) @binding(5) var<storage, read_write> out_blocks: array<u32>;
@group(0) @binding(6) var<storage, read_write> out_bits: array<u32>;
var<immediate> params: WriteParams;

var<workgroup> earlier_sum: atomic<u32>;
var<workgroup> window_rows: array<u32, WINDOW_WORDS>;
var<workgroup> window_blocks: array<u32, WINDOW_WORDS>;
var<workgroup> window_bits: array<u32, WINDOW_WORDS>;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let band_row = group.x * BATCH_BOXES + lane;
    let row = params.row0 + band_row;
    let batch = row / BATCH_BOXES;
    if (lane == 0u) {
        atomicStore(&earlier_sum, 0u);
    }

    // A strip counts for a row if its last column comes after the row; earlier ones may not even
    // have been written.
    let strip_columns = params.strip_blocks * 32u;
    let first_strip = max((row + 1u) / strip_columns, params.strip0);
    var own = 0u;
    for (var strip = first_strip; strip < params.strip_end; strip++) {
        own += countOneBits(strip_masks[(strip - params.strip0) * params.band_rows + band_row]);
    }
    var earlier = 0u;
    for (var i = lane; i < batch; i += BATCH_BOXES) {
        earlier += totals[i].words;
    }

    scan[lane] = own;
    workgroupBarrier();
    if (earlier != 0u) {
        atomicAdd(&earlier_sum, earlier);
    }
    sum_up(lane);
    let batch_words = scan[BATCH_BOXES - 1u];
    let own_start = scan[lane] - own;
    let base = atomicLoad(&earlier_sum);

    for (var window = 0u; window < batch_words; window += WINDOW_WORDS) {
        // Rows whose words lie outside this window have nothing to add to it.
        if (own != 0u && own_start < window + WINDOW_WORDS && own_start + own > window) {
            var at = own_start;
            for (var strip = first_strip; strip < params.strip_end; strip++) {
                let band_strip = strip - params.strip0;
                var mask = strip_masks[band_strip * params.band_rows + band_row];
                while (mask != 0u) {
                    let bit = countTrailingZeros(mask);
                    mask &= mask - 1u;
                    if (at >= window && at < window + WINDOW_WORDS) {
                        let band_block = band_strip * params.strip_blocks + bit;
                        window_rows[at - window] = row;
                        window_blocks[at - window] = strip * params.strip_blocks + bit;
                        window_bits[at - window] = matrix[band_block * params.band_rows + band_row];
                    }
                    at++;
                }
            }
        }
        workgroupBarrier();
        let used = min(batch_words - window, WINDOW_WORDS);
        for (var i = lane; i < used; i += BATCH_BOXES) {
            let place = base + window + i;
            if (place < params.capacity) {
                out_rows[place] = window_rows[i];
                out_blocks[place] = window_blocks[i];
                out_bits[place] = window_bits[i];
            }
        }
        workgroupBarrier();
    }
    if (lane == 0u) {
        reports[batch].words = totals[batch].words;
        reports[batch].pairs = totals[batch].pairs;
    }
}
