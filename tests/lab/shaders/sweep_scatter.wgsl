// sweep_scatter: entries in the order of a digit; those of one digit stay in the order that they had.
//
// A thread counts its eight entries by digit, two digits a word; the counts are summed up over the workgroup.

#import constants
#import sweep_params
#import sweep_digits

@group(0) @binding(2) var<storage, read> starts: array<u32>;
@group(0) @binding(3) var<storage, read> values: array<u32>;
@group(0) @binding(4) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(5) var<storage, read_write> values_out: array<u32>;

// Words of two digits' counts, 16 bits each.
const WORDS: u32 = DIGITS / 2u;

// Counts of a word, lane by lane.
var<workgroup> sums: array<u32, WORDS * BATCH_BOXES>;
var<workgroup> tile_starts: array<u32, DIGITS>;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let count = entries_in_all();
    let first = group.x * TILE + lane * THREAD_ENTRIES;
    var own: array<u32, WORDS>;
    var own_keys: array<u32, THREAD_ENTRIES>;
    for (var i = 0u; i < THREAD_ENTRIES; i++) {
        if (first + i < count) {
            let key = keys[first + i];
            own_keys[i] = key;
            let digit = digit_of(key);
            own[digit / 2u] += 1u << (16u * (digit % 2u));
        }
    }
    for (var word = 0u; word < WORDS; word++) {
        sums[word * BATCH_BOXES + lane] = own[word];
    }
    if (lane < DIGITS) {
        tile_starts[lane] = starts[lane * params.tiles + group.x];
    }
    workgroupBarrier();
    for (var reach = 1u; reach < BATCH_BOXES; reach <<= 1u) {
        var before: array<u32, WORDS>;
        if (lane >= reach) {
            for (var word = 0u; word < WORDS; word++) {
                before[word] = sums[word * BATCH_BOXES + lane - reach];
            }
        }
        workgroupBarrier();
        for (var word = 0u; word < WORDS; word++) {
            sums[word * BATCH_BOXES + lane] += before[word];
        }
        workgroupBarrier();
    }
    for (var word = 0u; word < WORDS; word++) {
        own[word] = sums[word * BATCH_BOXES + lane] - own[word];
    }
    for (var i = 0u; i < THREAD_ENTRIES; i++) {
        if (first + i < count) {
            let key = own_keys[i];
            let digit = digit_of(key);
            let shift = 16u * (digit % 2u);
            let at = tile_starts[digit] + ((own[digit / 2u] >> shift) & 0xffffu);
            own[digit / 2u] += 1u << shift;
            keys_out[at] = key;
            values_out[at] = values[first + i];
        }
    }
}
