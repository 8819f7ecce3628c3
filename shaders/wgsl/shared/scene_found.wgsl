// What the searches of a scene's grid have in common: pairs that are reported, tests that are counted, and what the
// host learns, which the last workgroup to end writes down.

#import constants
#import scene_params
#import scene_records
#import scene_history
#import grid_layout
#import cells_around

struct SceneSummary {
    // 64 bits each, low word first.
    found: vec2<u32>,
    ended: vec2<u32>,
    tested: vec2<u32>,
    entries: u32,
    rows: u32,
    // Boxes that collide and have changed, and how many of them are static.
    moved: u32,
    moved_static: u32,
    // Entries below.
    sampled: u32,
    padding: u32,
    // Bits of min and max.
    samples: array<array<u32, 6>, SCENE_SAMPLES>,
}

@group(0) @binding(0) var<storage, read> params: SceneParams;
@group(0) @binding(1) var<storage, read> grid: GridLayout;
@group(0) @binding(2) var<storage, read> table: array<u32>;
@group(0) @binding(3) var<storage, read> sorted: array<vec4<i32>>;
// Bindings 4 and 5 are others in each stage.
@group(0) @binding(6) var<storage, read_write> control: array<atomic<u32>>;
// Pairs as the stage reports them.
@group(0) @binding(7) var<storage, read_write> found: array<vec2<u32>>;
@group(0) @binding(8) var<storage, read_write> summary: SceneSummary;

// Levels that have entries.
var<workgroup> used_levels: atomic<u32>;
// Pairs to be reported.
var<workgroup> window: array<vec2<u32>, 2u * BATCH_BOXES>;
var<workgroup> reported: atomic<u32>;
var<workgroup> window_base: u32;
var<workgroup> tested_low: atomic<u32>;
var<workgroup> tested_high: atomic<u32>;
// Whether the search stops: there are more entries than there is room for, or more tests than are allowed.
var<workgroup> is_too_much: u32;
var<workgroup> is_last: u32;

// Rounds of loops that the row at hand is charged. They follow from the scene and its grid alone, whichever thread
// takes the row, and in any order of the entries of a cell.
var<private> rounds: u32;

// What all lanes do first. It ends with a barrier.
fn begin_search(lane: u32) {
    if (lane == 0u) {
        atomicStore(&used_levels, 0u);
        atomicStore(&reported, 0u);
        atomicStore(&tested_low, 0u);
        atomicStore(&tested_high, 0u);
        is_too_much = select(0u, 1u, atomicLoad(&control[ENTRIES]) > params.entry_capacity);
    }
    workgroupBarrier();
    if (lane < grid.level_count) {
        let first = grid.levels[lane].first_cell;
        if (table[first] != table[first + grid.levels[lane].cell_count]) {
            atomicOr(&used_levels, 1u << lane);
        }
    }
    workgroupBarrier();
}

// Adds to a number of 64 bits of the control block; what its low word was.
fn add_wide(word: u32, more: u32) -> u32 {
    let before = atomicAdd(&control[word], more);
    if (before + more < before) {
        atomicAdd(&control[word + 1u], 1u);
    }
    return before;
}

// Takes a pair down that the host reads.
fn report(pair: vec2<u32>) {
    let at = atomicAdd(&reported, 1u);
    if (at < 2u * BATCH_BOXES) {
        window[at] = pair;
        return;
    }
    let slot = add_wide(FOUND, 1u);
    if (slot < params.pair_capacity) {
        found[slot] = pair;
    }
}

fn count_tests(tested: u32) {
    if (tested != 0u) {
        let before = atomicAdd(&tested_low, tested);
        if (before + tested < before) {
            atomicAdd(&tested_high, 1u);
        }
    }
}

// Whether the row may go through a loop so many times. A software adapter ends loops early, silently.
fn may_take_rounds(more: u32) -> bool {
    // Of the loops around it, too: over runs, lines and levels.
    rounds += more + 4u;
    return rounds <= params.thread_rounds;
}

// Rounds that were not taken count as more tests than are allowed.
fn note_rounds() {
    if (rounds > params.thread_rounds) {
        atomicMax(&control[TESTED + 1u], params.budget);
    }
}

// What was reported goes out, and tests are counted for the budget. All lanes call it, after a barrier.
fn hand_out(lane: u32) {
    let all = min(atomicLoad(&reported), 2u * BATCH_BOXES);
    if (lane == 0u) {
        let low = atomicLoad(&tested_low);
        if (low != 0u) {
            add_wide(TESTED, low);
        }
        let high = atomicLoad(&tested_high);
        if (high != 0u) {
            atomicAdd(&control[TESTED + 1u], high);
        }
        atomicStore(&tested_low, 0u);
        atomicStore(&tested_high, 0u);
        if (all != 0u) {
            window_base = add_wide(FOUND, all);
        }
    }
    workgroupBarrier();
    for (var i = lane; i < all; i += BATCH_BOXES) {
        let slot = window_base + i;
        if (slot >= window_base && slot < params.pair_capacity) {
            found[slot] = window[i];
        }
    }
    workgroupBarrier();
    if (lane == 0u) {
        atomicStore(&reported, 0u);
    }
}

// The bits of a key's number: the map to keys is its own inverse, but for -0.
fn number_bits(key: i32) -> u32 {
    return bitcast<u32>(order_key(bitcast<u32>(key)));
}

// What the host learns, with some entries to choose the next grid by.
fn summarize(lane: u32) {
    let count = atomicLoad(&control[ENTRIES]);
    let sampled = select(min(count, SCENE_SAMPLES), 0u, count > params.entry_capacity);
    if (lane < sampled) {
        let at = 2u * lane * (count / sampled);
        let a = sorted[at];
        let b = sorted[at + 1u];
        summary.samples[lane] = array<u32, 6>(
            number_bits(a.x),
            number_bits(a.y),
            number_bits(a.z),
            number_bits(a.w),
            number_bits(b.x),
            number_bits(b.y),
        );
    }
    if (lane == 0u) {
        summary.found = vec2<u32>(atomicLoad(&control[FOUND]), atomicLoad(&control[FOUND + 1u]));
        summary.ended = vec2<u32>(atomicLoad(&control[ENDED]), atomicLoad(&control[ENDED + 1u]));
        summary.tested = vec2<u32>(atomicLoad(&control[TESTED]), atomicLoad(&control[TESTED + 1u]));
        summary.entries = count;
        summary.rows = atomicLoad(&control[ROWS]);
        summary.moved = atomicLoad(&control[MOVED]);
        summary.moved_static = atomicLoad(&control[MOVED_STATIC]);
        summary.sampled = sampled;
    }
}

// What all lanes do last.
fn end_search(groups: u32, lane: u32) {
    // What this workgroup counted is there for all before it says that it has ended.
    storageBarrier();
    if (lane == 0u) {
        is_last = select(0u, 1u, atomicAdd(&control[DONE], 1u) == groups - 1u);
    }
    workgroupBarrier();
    if (is_last != 0u) {
        storageBarrier();
        summarize(lane);
    }
}
