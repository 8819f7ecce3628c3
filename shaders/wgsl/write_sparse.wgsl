// write_sparse: the non-zero words of a band, in order of (row, column block), with their addresses.
//
// One workgroup a batch of rows. Each word's place is known before it is written (`band_words`), so no
// capacity can overflow: words past the capacity are not written, only counted, and the host comes
// back with room for all. Words are collected in workgroup memory first, so that neighbouring lanes
// write neighbouring words over the link.

#import constants
#import batch
#import scan
#import band_words

// Bindings 0 to 3: of `band_words`.
@group(0) @binding(4) var<storage, read_write> out_rows: array<u32>;
@group(0) @binding(5) var<storage, read_write> out_blocks: array<u32>;
@group(0) @binding(6) var<storage, read_write> out_bits: array<u32>;

fn entries_of(batch: BatchTotals) -> u32 {
    return batch.words;
}

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let batch_words = number_words(group.x, lane);
    let base = atomicLoad(&earlier_sum);
    for (var window = 0u; window < batch_words; window += WINDOW_WORDS) {
        fill_window(lane, window);
        workgroupBarrier();
        let used = min(batch_words - window, WINDOW_WORDS);
        for (var i = lane; i < used; i += BATCH_BOXES) {
            let slot = base + window + i;
            if (slot < params.capacity) {
                let address = address_of(group.x, i);
                out_rows[slot] = address.x;
                out_blocks[slot] = address.y;
                out_bits[slot] = window_bits[i];
            }
        }
        workgroupBarrier();
    }
}
