// A search of a scene: entries against later entries around them, rows against all entries around them. A
// stage decides which of the candidates are reported: `may_be_reported` by the names of two boxes that overlap,
// `decide` by what else it knows; and whether entries look at entries at all (`entries_look`).
//
// One row a thread. Rows beside the grid pass the filter first, four a thread, and those that do are
// collected until there is one for each thread of the workgroup. Candidates are collected too, and decided
// together, so that the threads fetch their records side by side.
// A GPU that has a share of the search (`scene_share`) has all entries and rows, and looks for those of its
// share. One file, because entries and rows share the workgroup's lists.

#import scene_found
#import scene_filter
#import scene_share

@group(0) @binding(4) var<storage, read> now: array<vec4<i32>>;

// Most rows that a thread looks at a time.
const ROWS_TOGETHER: u32 = 4u;
// Candidates that are collected: three a thread. More are decided where they are found.
const CANDIDATES: u32 = 3u * BATCH_BOXES;

// Rows that passed the filter, or positions of entries of a share.
var<workgroup> queue: array<u32, (ROWS_TOGETHER + 1u) * BATCH_BOXES>;
var<workgroup> queued: atomic<u32>;
// Names of candidates.
var<workgroup> candidates: array<vec2<u32>, CANDIDATES>;
var<workgroup> candidate_count: atomic<u32>;
var<workgroup> ended_sum: atomic<u32>;

// The row at hand: its name, its position or the last one of no entry, its box.
var<private> row_name: u32;
var<private> row: u32;
var<private> row_lo: vec3<i32>;
var<private> row_hi: vec3<i32>;
var<private> tested: u32;

// Tests the row against the positions start .. end. It is charged those from `charged` on: an entry that looks at
// those behind it, in a cell whose entries have any order, is charged the cell.
fn test_run(start: u32, charged: u32, table_end: u32) {
    // Regardless of what the table holds, a run ends.
    let end = min(table_end, params.entry_capacity);
    tested += max(end, start) - start;
    if (!may_take_rounds(max(end, charged) - min(charged, end))) {
        return;
    }
    for (var p = start; p < end; p++) {
        let a = sorted[2u * p];
        if (all(a.xyz <= row_hi) & (row_lo.x <= a.w)) {
            let b = sorted[2u * p + 1u];
            if (all(row_lo.yz <= b.xy) && may_be_reported(row_name, bitcast<u32>(b.z))) {
                let at = atomicAdd(&candidate_count, 1u);
                if (at < CANDIDATES) {
                    candidates[at] = vec2<u32>(row_name, bitcast<u32>(b.z));
                } else {
                    decide(row_name, bitcast<u32>(b.z));
                }
            }
        }
    }
}

// As `grid_pairs` has it.
fn test_level(index: u32, is_own: bool) {
    let around = cells_around(index, row_lo, row_hi);
    let wraps_x = (grid.levels[index].wraps & 1u) != 0u;
    let width = grid.levels[index].count.x;
    let height = grid.levels[index].count.y;
    let first_cell = grid.levels[index].first_cell;
    let own = vec3<u32>(around.low & grid.levels[index].fold);
    let own_line = own.z * height + own.y;
    let reach = u32(around.last.x - around.low.x);
    for (var k = 0u; k < around.len.z; k++) {
        let z = folded(around.start.z, around.wrapped.z, k);
        for (var j = 0u; j < around.len.y; j++) {
            let line = z * height + folded(around.start.y, around.wrapped.y, j);
            let cell = first_cell + line * width;
            if (is_own & (line < own_line)) {
                continue;
            }
            // Two runs: before and behind where the axis wraps.
            var runs = vec4<u32>(0u);
            var charged = 0u;
            if (is_own & (line == own_line)) {
                runs.x = row + 1u;
                charged = table[cell + own.x];
                runs.y = table[cell + min(own.x + reach, width - 1u) + 1u];
                if (wraps_x & (own.x == 0u)) {
                    runs.z = table[cell + width - 1u];
                    runs.w = table[cell + width];
                }
            } else {
                if (around.wrapped.x > 0u) {
                    runs.x = table[cell];
                    runs.y = table[cell + around.wrapped.x];
                }
                charged = runs.x;
                runs.z = table[cell + around.start.x];
                runs.w = table[cell + around.end.x - around.wrapped.x];
            }
            for (var r = 0u; r < 2u; r++) {
                test_run(runs.x, charged, runs.y);
                runs = runs.zwzw;
                charged = runs.x;
            }
        }
    }
}

// Levels in which the box at hand may overlap an entry.
fn levels_to_look_at() -> u32 {
    var rest = atomicLoad(&used_levels);
    var passed = 0u;
    while (rest != 0u) {
        let level = countTrailingZeros(rest);
        rest &= rest - 1u;
        let low = cells_of(grid.levels[level], plain3(row_lo));
        let spans = cells_of(grid.levels[level], plain3(row_hi)) - low;
        let bit = filter_bit(level, low);
        let word = table[params.table_words + bit / 32u];
        // The filter knows boxes of two cells an axis.
        if (any(spans > vec3<i32>(1)) || ((word >> (bit % 32u)) & 1u) != 0u) {
            passed |= 1u << level;
        }
    }
    return passed;
}

// One level of the filter for four boxes: whether each may overlap an entry of it.
fn passes(level: u32, lo: array<vec3<i32>, ROWS_TOGETHER>, hi: array<vec3<i32>, ROWS_TOGETHER>) -> vec4<bool> {
    let cell_0 = cells_of(grid.levels[level], plain3(lo[0]));
    let cell_1 = cells_of(grid.levels[level], plain3(lo[1]));
    let cell_2 = cells_of(grid.levels[level], plain3(lo[2]));
    let cell_3 = cells_of(grid.levels[level], plain3(lo[3]));
    let bits = vec4<u32>(
        filter_bit(level, cell_0),
        filter_bit(level, cell_1),
        filter_bit(level, cell_2),
        filter_bit(level, cell_3),
    );
    let at = vec4<u32>(params.table_words) + bits / 32u;
    let words = vec4<u32>(table[at.x], table[at.y], table[at.z], table[at.w]);
    // The filter knows boxes of two cells an axis.
    let is_large = vec4<bool>(
        any(cells_of(grid.levels[level], plain3(hi[0])) - cell_0 > vec3<i32>(1)),
        any(cells_of(grid.levels[level], plain3(hi[1])) - cell_1 > vec3<i32>(1)),
        any(cells_of(grid.levels[level], plain3(hi[2])) - cell_2 > vec3<i32>(1)),
        any(cells_of(grid.levels[level], plain3(hi[3])) - cell_3 > vec3<i32>(1)),
    );
    return is_large | (((words >> (bits % 32u)) & vec4<u32>(1u)) != vec4<u32>(0u));
}

// Looks at up to four rows a thread from `first` on, and queues those that may overlap an entry.
fn queue_rows(first: u32, lane: u32, has_giants: bool) {
    let slots = vec4<u32>(first + lane) + BATCH_BOXES * vec4<u32>(0u, 1u, 2u, 3u);
    // All four are fetched at once, also those that are no rows.
    let at = min(slots, vec4<u32>(params.slots - 1u));
    let rows = vec4<u32>(params.table_words + params.filter_words) + at / 32u;
    let words = vec4<u32>(table[rows.x], table[rows.y], table[rows.z], table[rows.w]);
    let a_0 = now[2u * at.x];
    let a_1 = now[2u * at.y];
    let a_2 = now[2u * at.z];
    let a_3 = now[2u * at.w];
    let b_0 = now[2u * at.x + 1u];
    let b_1 = now[2u * at.y + 1u];
    let b_2 = now[2u * at.z + 1u];
    let b_3 = now[2u * at.w + 1u];
    let are_here = (slots < vec4<u32>(params.slots)) & (vec4<u32>(0u, 1u, 2u, 3u) < vec4<u32>(params.rows_together));
    let are_rows = are_here & (((words >> (at % 32u)) & vec4<u32>(1u)) != vec4<u32>(0u));
    if (!any(are_rows)) {
        return;
    }
    let lo = array<vec3<i32>, ROWS_TOGETHER>(a_0.xyz, a_1.xyz, a_2.xyz, a_3.xyz);
    let hi = array<vec3<i32>, ROWS_TOGETHER>(
        vec3<i32>(a_0.w, b_0.xy),
        vec3<i32>(a_1.w, b_1.xy),
        vec3<i32>(a_2.w, b_2.xy),
        vec3<i32>(a_3.w, b_3.xy),
    );
    var passed = vec4<bool>(has_giants);
    var rest = atomicLoad(&used_levels);
    while (rest != 0u) {
        let level = countTrailingZeros(rest);
        rest &= rest - 1u;
        passed = passed | passes(level, lo, hi);
    }
    passed = passed & are_rows;
    if (passed.x) {
        queue[atomicAdd(&queued, 1u)] = slots.x;
    }
    if (passed.y) {
        queue[atomicAdd(&queued, 1u)] = slots.y;
    }
    if (passed.z) {
        queue[atomicAdd(&queued, 1u)] = slots.z;
    }
    if (passed.w) {
        queue[atomicAdd(&queued, 1u)] = slots.w;
    }
}

// Queues the entries of this share among those of a batch.
fn queue_entries(first: u32, lane: u32, entry_count: u32) {
    let at = first + lane;
    if (at >= entry_count) {
        return;
    }
    let a = sorted[2u * at];
    let b = sorted[2u * at + 1u];
    let level = bitcast<u32>(b.w);
    // As `scene_cells` has it.
    var cell = grid.first_giant + (bitcast<u32>(b.z) & INDEX_MASK) / UNPLACED_A_CELL;
    if (level < grid.level_count) {
        cell = cell_at(grid.levels[level], cells_of(grid.levels[level], plain3(a.xyz)));
    }
    if (is_of_share(cell)) {
        queue[atomicAdd(&queued, 1u)] = at;
    }
}

fn take_row(index: u32) {
    let a = now[2u * index];
    let b = now[2u * index + 1u];
    row_lo = a.xyz;
    row_hi = vec3<i32>(a.w, b.xy);
}

fn search(group: u32, groups: u32, lane: u32) {
    if (lane == 0u) {
        atomicStore(&queued, 0u);
        atomicStore(&candidate_count, 0u);
        atomicStore(&ended_sum, 0u);
    }
    begin_search(lane);
    if (is_too_much != 0u) {
        return;
    }
    let entry_count = table[grid.first_nothing];
    let giants = table[grid.first_giant];
    let entry_chunks = select(0u, (entry_count + BATCH_BOXES - 1u) / BATCH_BOXES, entries_look());
    var chunks = entry_chunks;
    if (entry_count != 0u && atomicLoad(&control[ROWS]) != 0u) {
        let round = params.rows_together * BATCH_BOXES;
        chunks += (params.slots + round - 1u) / round;
    }
    var chunk = group;
    var step = groups;
    var has_entries = IS_SHARE;
    loop {
        if (lane == 0u) {
            is_too_much = select(0u, 1u, atomicLoad(&control[TESTED + 1u]) >= params.budget);
        }
        workgroupBarrier();
        if (is_too_much != 0u) {
            break;
        }
        // Uniform: an entry a thread, as they lie or queued, or a queued row a thread.
        var is_entry = chunk < entry_chunks;
        var count = 0u;
        if (is_entry && !IS_SHARE) {
            count = min(BATCH_BOXES, entry_count - chunk * BATCH_BOXES);
        } else {
            count = atomicLoad(&queued);
            workgroupBarrier();
            if (has_entries) {
                while (chunk < entry_chunks && count < BATCH_BOXES) {
                    queue_entries(chunk * BATCH_BOXES, lane, entry_count);
                    workgroupBarrier();
                    count = atomicLoad(&queued);
                    workgroupBarrier();
                    chunk += groups;
                }
                has_entries = count != 0u;
                if (!has_entries) {
                    chunk = entry_chunks + first_row_chunk(group);
                    step = row_chunk_step(groups);
                }
            }
            is_entry = has_entries;
            while (!is_entry && chunk < chunks && count < BATCH_BOXES) {
                queue_rows((chunk - entry_chunks) * params.rows_together * BATCH_BOXES, lane, giants != entry_count);
                workgroupBarrier();
                count = atomicLoad(&queued);
                workgroupBarrier();
                chunk += step;
            }
            if (count == 0u) {
                break;
            }
        }
        let taken = min(count, BATCH_BOXES);
        var levels = 0u;
        var own_level = grid.level_count + 1u;
        var giant_start = entry_count;
        tested = 0u;
        // To queue it, and to look at its levels.
        rounds = 2u * GRID_LEVELS + 1u;
        if (is_entry) {
            row = chunk * BATCH_BOXES + lane;
            if (lane < taken) {
                if (IS_SHARE) {
                    row = queue[count - taken + lane];
                }
                let a = sorted[2u * row];
                let b = sorted[2u * row + 1u];
                row_lo = a.xyz;
                row_hi = vec3<i32>(a.w, b.xy);
                row_name = bitcast<u32>(b.z);
                own_level = bitcast<u32>(b.w);
                levels = atomicLoad(&used_levels) & (0xffffffffu << own_level);
                giant_start = max(giants, row + 1u);
            }
            if (!IS_SHARE) {
                chunk += groups;
            }
        } else {
            if (lane < taken) {
                let slot = queue[count - taken + lane];
                row_name = (select(NOW, THEN | NOW, params.mode == MODE_CHANGES) << KINDS_SHIFT) | slot;
                take_row(slot);
                levels = levels_to_look_at();
                giant_start = giants;
            }
        }
        if (IS_SHARE || !is_entry) {
            workgroupBarrier();
            if (lane == 0u) {
                atomicStore(&queued, count - taken);
            }
        }
        while (levels != 0u) {
            let level = countTrailingZeros(levels);
            levels &= levels - 1u;
            test_level(level, level == own_level);
        }
        test_run(giant_start, giants, entry_count);
        count_tests(tested);
        note_rounds();
        workgroupBarrier();
        let decided = min(atomicLoad(&candidate_count), CANDIDATES);
        for (var i = lane; i < decided; i += BATCH_BOXES) {
            decide(candidates[i].x, candidates[i].y);
        }
        workgroupBarrier();
        hand_out(lane);
        if (lane == 0u) {
            atomicStore(&candidate_count, 0u);
            let ended = atomicLoad(&ended_sum);
            if (ended != 0u) {
                add_wide(ENDED, ended);
                atomicStore(&ended_sum, 0u);
            }
        }
    }
}

@compute @workgroup_size(BATCH_BOXES)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    search(group.x, groups.x, lane);
    end_search(groups.x, lane);
}
