// write_list: the pairs of a band, in order of (row, column).
//
// One workgroup a batch of rows, a window of its words at a time (`band_words`). A second scan gives
// each word of the window the number of its first pair, so that each thread takes a place in the reply
// and looks for its pair: neighbouring lanes write neighbouring pairs over the link, regardless of what words they
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

fn entries_of(batch: BatchTotals) -> u32 {
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

// The searches are straight code, as many steps for each lane: no subgroup diverges, and lavapipe ends
// all loops of a thread after 65,535 rounds together.

// `word`, or the word `reach` further if that starts at or before pair `number` of the window.
fn nearer_word(word: u32, reach: u32, number: u32, used: u32) -> u32 {
    let other = word + reach;
    if (other < used && window_starts[other] <= number) {
        return other;
    }
    return word;
}

// The word that pair `number` of the window is of: the last that starts at or before it.
fn word_of(number: u32, used: u32) -> u32 {
    var word = nearer_word(0u, 512u, number, used);
    word = nearer_word(word, 256u, number, used);
    word = nearer_word(word, 128u, number, used);
    word = nearer_word(word, 64u, number, used);
    word = nearer_word(word, 32u, number, used);
    word = nearer_word(word, 16u, number, used);
    word = nearer_word(word, 8u, number, used);
    word = nearer_word(word, 4u, number, used);
    word = nearer_word(word, 2u, number, used);
    return nearer_word(word, 1u, number, used);
}

// What is left of a search for a set bit.
struct BitSearch {
    // The bits from `slot` on.
    bits: u32,
    // Set bits among them before the one that is looked for.
    before: u32,
    // Bits passed over.
    slot: u32,
}

// Passes over the next `width` bits if the one that is looked for is not among them.
fn nearer_bit(search: BitSearch, width: u32) -> BitSearch {
    let below = countOneBits(search.bits & ((1u << width) - 1u));
    if (search.before < below) {
        return search;
    }
    return BitSearch(search.bits >> width, search.before - below, search.slot + width);
}

// Place of the set bit of `bits` that `before` set bits come before.
fn bit_of(bits: u32, before: u32) -> u32 {
    var search = nearer_bit(BitSearch(bits, before, 0u), 16u);
    search = nearer_bit(search, 8u);
    search = nearer_bit(search, 4u);
    search = nearer_bit(search, 2u);
    return nearer_bit(search, 1u).slot;
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
            let slot = base - skew + i;
            if (i >= skew && slot < params.capacity) {
                let word = word_of(i - skew, used);
                let address = address_of(group.x, word);
                let bit = bit_of(window_bits[word], i - skew - window_starts[word]);
                out_pairs[slot] = vec2<u32>(address.x, 32u * address.y + bit);
            }
        }
        base += pairs;
        workgroupBarrier();
    }
}
