// write_list: the pairs of a band, in order of (row, column).
//
// One workgroup a batch of rows, a window of its words at a time (`band_words`). A second scan gives
// each word of the window the number of its first pair, so that each thread takes a place in the reply
// and looks for its pair: neighbouring lanes write neighbouring pairs over the link, whatever words they
// are of. Pairs past the capacity are not written, only counted, and the host comes back with room for
// all.

#import constants
#import batch
#import scan
#import band_words

// Bindings 0 to 3: of `band_words`.
@group(0) @binding(4) var<storage, read_write> out_pairs: array<vec2<u32>>;

const LANE_WORDS: u32 = WINDOW_WORDS / BATCH_BOXES;

// Pairs of the window before each of its words.
var<workgroup> window_starts: array<u32, WINDOW_WORDS>;

fn items_of(batch: BatchTotals) -> u32 {
    return batch.pairs;
}

// Numbers the pairs of the window's first `used` words, and returns how many there are. All lanes call
// it, after a barrier.
fn number_pairs(lane: u32, used: u32) -> u32 {
    var pairs = 0u;
    for (var k = 0u; k < LANE_WORDS; k++) {
        let i = lane * LANE_WORDS + k;
        window_starts[i] = pairs;
        if (i < used) {
            pairs += countOneBits(window_bits[i]);
        }
    }
    scan[lane] = pairs;
    workgroupBarrier();
    sum_up(lane);
    let earlier = scan[lane] - pairs;
    for (var k = 0u; k < LANE_WORDS; k++) {
        window_starts[lane * LANE_WORDS + k] += earlier;
    }
    workgroupBarrier();
    return scan[BATCH_BOXES - 1u];
}

// The word that pair `number` of the window is of: the last that starts at or before it. As many steps
// for each lane.
fn word_of(number: u32, used: u32) -> u32 {
    var word = 0u;
    for (var reach = WINDOW_WORDS / 2u; reach > 0u; reach /= 2u) {
        if (word + reach < used && window_starts[word + reach] <= number) {
            word += reach;
        }
    }
    return word;
}

// Place of the set bit of `bits` that `number` set bits come before.
fn bit_of(bits: u32, number: u32) -> u32 {
    var rest = bits;
    var left = number;
    var place = 0u;
    for (var width = 16u; width > 0u; width /= 2u) {
        let below = countOneBits(rest & ((1u << width) - 1u));
        if (left >= below) {
            left -= below;
            rest >>= width;
            place += width;
        }
    }
    return place;
}

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let batch_words = number_words(group.x, lane);
    var base = atomicLoad(&earlier_sum);
    for (var window = 0u; window < batch_words; window += WINDOW_WORDS) {
        fill_window(lane, window);
        workgroupBarrier();
        let used = min(batch_words - window, WINDOW_WORDS);
        let pairs = number_pairs(lane, used);
        // The first lane starts at a line of the reply.
        let skew = base % LINE_PAIRS;
        for (var i = lane; i < skew + pairs; i += BATCH_BOXES) {
            let place = base - skew + i;
            if (i >= skew && place < params.capacity) {
                let word = word_of(i - skew, used);
                let address = address_of(group.x, word);
                let bit = bit_of(window_bits[word], i - skew - window_starts[word]);
                out_pairs[place] = vec2<u32>(address.x, 32u * address.y + bit);
            }
        }
        base += pairs;
        workgroupBarrier();
    }
}
