// What every stage of the sweep is told, and the words of its control block. Mirror: `sweep/layouts.rs`.

struct SweepParams {
    // Boxes.
    n: u32,
    // Entries, and pairs, that there is room for.
    entry_capacity: u32,
    pair_capacity: u32,
    // Axis of the sort, and the two that tubes divide.
    axes: u32,
    // Bits of a place along the axis of the sort, and of a tube's number along the other two.
    place_bits: u32,
    tube_bits_0: u32,
    tube_bits_1: u32,
    // Digit of the sort at hand: its number, and its first bit.
    pass_number: u32,
    shift: u32,
    // Tiles of the sort that there is room for.
    tiles: u32,
    // Rounds of loops that a thread may take.
    thread_rounds: u32,
    // Where place and tubes begin, and how many there are a unit.
    origin_0: f32,
    origin_1: f32,
    origin_2: f32,
    scale_0: f32,
    scale_1: f32,
    scale_2: f32,
}

var<immediate> params: SweepParams;

// Words of the control block.
const ENTRIES: u32 = 0u;
const FOUND: u32 = 1u;
// 64 bits.
const TESTED: u32 = 2u;
// Whether a thread would have taken more rounds than it may.
const TOO_MUCH: u32 = 4u;
// Entries of each digit, pass by pass.
const DIGITS_AT: u32 = 16u;

// Digits are four bits.
const DIGITS: u32 = 16u;
// Entries of a thread, and of a workgroup, of the sort.
const THREAD_ENTRIES: u32 = 8u;
const TILE: u32 = THREAD_ENTRIES * BATCH_BOXES;

fn axis(number: u32) -> u32 {
    return (params.axes >> (8u * number)) & 3u;
}
