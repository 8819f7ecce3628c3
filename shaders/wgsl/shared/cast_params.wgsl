// What the stages of casts read, and the tree that they look into. Mirror: `layouts.rs`.

// A level of the tree: the items from `first` on, so many. Those of level 0 are boxes, those of others the bounds of 32
// items of the level below.
struct CastLevel {
    first: u32,
    count: u32,
}

struct CastParams {
    // Indices that have a record.
    slots: u32,
    // Places of the tree that have their index by a list; the place of a later one is its index.
    ordered: u32,
    // 1: the tree was put in order for these boxes, and the edges of its leaves are noted; else held to those noted.
    notes_edges: u32,
    // Rays or spheres.
    queries: u32,
    // Most of the closest boxes of each; 0: all.
    closest: u32,
    // 1: one box is enough.
    any: u32,
    // Candidates that an answer has room for, and with their heads that lists have.
    answer_room: u32,
    room: u32,
    // Steps, of a group each, that all searches may take together, and that each may.
    all_steps: u32,
    steps: u32,
    // Rounds of loops that a thread may take.
    thread_rounds: u32,
    // The level of which all items are looked at.
    top: u32,
    levels: array<CastLevel, CAST_LEVELS>,
}

// Items of a group.
const FAN_OUT: u32 = CAST_LANES;

// Coordinates of items are within these. A bound at one of them is farther out.
const OUTERMOST: f32 = 1e18;
// Larger than any distance within them.
const BEYOND: f32 = 1e38;
// The smallest number that is kept by any device.
const SMALLEST: f32 = 1.17549435e-38;

// An item in memory is its min and the index of a box, its max and whether it is that box and no larger. The min of one
// with nothing in it is beyond its max.

// Words of the control block: leaves that have grown too much, candidates and heads of lists, steps.
const LOOSE: u32 = 0u;
const CANDIDATES: u32 = 1u;
const STEPS: u32 = 2u;
