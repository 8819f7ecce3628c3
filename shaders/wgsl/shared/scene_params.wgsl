// What every stage of a scene reads, and the words of its control block. Mirror: `layouts.rs`.

struct SceneParams {
    // Indices that have a record.
    slots: u32,
    // What is looked for: MODE_*.
    mode: u32,
    // 1: every box that collides is an entry of the grid; else those that changed, and wide ones.
    dense: u32,
    // The history under way: records with this number have changed since it began. 56 bits.
    epoch_low: u32,
    epoch_high: u32,
    // Boxes that the edit sets.
    set_count: u32,
    // Where they belong: from this index on (`set_is_range` is 1), or by a list.
    set_first: u32,
    set_is_range: u32,
    // Boxes that the edit removes or flags.
    mark_count: u32,
    // The number that named boxes get; 0: none is named.
    naming: u32,
    // Entries, and found pairs, that there is room for.
    entry_capacity: u32,
    pair_capacity: u32,
    // Words of the table of cells. Behind it lie the words of the filter, a power of two, and those of
    // the rows, a bit an index.
    table_words: u32,
    filter_words: u32,
    // Words of the control block from its start that are zero when cells are counted.
    control_words: u32,
    // More tests than this many 2^32 are left to another engine.
    budget: u32,
    // Queries.
    query_count: u32,
    // Rounds of loops that a row or an entry of a search may take.
    thread_rounds: u32,
    // Rows beside the grid that a thread looks at a time: 1 to 4.
    rows_together: u32,
    // GPUs that share the search, and which of them this one is.
    share_count: u32,
    share: u32,
}

// Pairs that began or ended since the history began.
const MODE_CHANGES: u32 = 0u;
// Pairs of now with a box that the edit named.
const MODE_MOVED: u32 = 1u;
// All pairs of now, or queries against all boxes.
const MODE_ALL: u32 = 2u;
// Pairs of a query and a box; what is set from `set_first` on are the queries.
const MODE_QUERY: u32 = 3u;

// Words of the control block. WORK and SUMS are where `grid_scan` has them.
const ENTRIES: u32 = CONTROL_HEADER_WORDS;
const ROWS: u32 = ENTRIES + 1u;
// Boxes that have changed; of queries that are entries, boxes that are entries too.
const MOVED: u32 = ENTRIES + 2u;
const MOVED_STATIC: u32 = ENTRIES + 3u;
// 64 bits each, low word first.
const FOUND: u32 = ENTRIES + 4u;
const ENDED: u32 = ENTRIES + 6u;
const TESTED: u32 = ENTRIES + 8u;
// Workgroups of the search that have ended.
const DONE: u32 = ENTRIES + 10u;
const SUMS: u32 = CONTROL_HEADER_WORDS + SUPERS_MOST;
