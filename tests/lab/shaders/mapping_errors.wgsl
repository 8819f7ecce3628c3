// mapping_errors: counts the ids that a variant maps wrongly, and the pairs that it names. One
// thread a word of 32 ids.
// Mirror: `pairmask_lab::study::mapping::errors`.

#import constants
#import pair_ids
#import map

struct MappingErrorsParams {
    n: u32,
    word_count: u32,
    // Workgroups of a dispatch row.
    groups_x: u32,
    // 0: words from `first` on, `stride` ids apart. 1: one word around the start of each row.
    around_rows: u32,
    first_low: u32,
    first_high: u32,
    stride_low: u32,
    stride_high: u32,
    // Whether pairs are marked in `named`, which has a bit for each.
    mark: u32,
}

struct MappingTally {
    // Ids looked at, and those of them that the variant leaves out (a >= b, the lazy way).
    ids: atomic<u32>,
    skipped: atomic<u32>,
    // Ids mapped to another pair or to none; those that still name two different boxes.
    wrong: atomic<u32>,
    wrong_named: atomic<u32>,
    row_error: atomic<u32>,
    // Pairs named for the first time, when marked.
    distinct: atomic<u32>,
}

@group(0) @binding(0) var<storage, read_write> tally: MappingTally;
@group(0) @binding(1) var<storage, read_write> named: array<atomic<u32>>;
var<immediate> params: MappingErrorsParams;

var<workgroup> shared_counts: array<atomic<u32>, 5>;
var<workgroup> shared_row_error: atomic<u32>;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    if (lane < 5u) {
        atomicStore(&shared_counts[lane], 0u);
    }
    if (lane == 5u) {
        atomicStore(&shared_row_error, 0u);
    }
    workgroupBarrier();

    let n = params.n;
    let word = (group.y * params.groups_x + group.x) * BATCH_BOXES + lane;
    let total = id_count(n);
    var k = total;
    if (word < params.word_count) {
        if (params.around_rows == 1u) {
            let start = Id(row_first(n, i32(word)));
            k = start - min(start, Id(16));
        } else {
            let stride = id_of(params.stride_low, params.stride_high);
            k = id_of(params.first_low, params.first_high) + Id(word) * stride;
        }
    }
    var ids = 0u;
    var skipped = 0u;
    var wrong = 0u;
    var wrong_named = 0u;
    var row_error = 0u;
    var distinct = 0u;
    for (; ids < 32u && k < total; ids++) {
        let pair = map_pair(n, k);
        let a = min(pair.x, pair.y);
        let b = max(pair.x, pair.y);
        let names = a >= 0 && a < b && b < i32(n);
        if (MAY_SKIP && pair.x >= pair.y) {
            skipped++;
        } else {
            let right = names && pair.x < pair.y && id_of_pair(n, pair.x, pair.y) == k;
            if (!right) {
                wrong++;
                wrong_named += u32(names);
                row_error = max(row_error, u32(abs(pair.x - exact_pair(n, k).x)));
            }
            if (names && params.mark == 1u) {
                let index = row_order_id(n, a, b);
                let bit = 1u << (u32(index) % 32u);
                let before = atomicOr(&named[u32(index / Id(32))], bit);
                distinct += u32((before & bit) == 0u);
            }
        }
        k += Id(1);
    }
    atomicAdd(&shared_counts[0], ids);
    atomicAdd(&shared_counts[1], skipped);
    atomicAdd(&shared_counts[2], wrong);
    atomicAdd(&shared_counts[3], wrong_named);
    atomicAdd(&shared_counts[4], distinct);
    atomicMax(&shared_row_error, row_error);
    workgroupBarrier();
    if (lane == 0u) {
        atomicAdd(&tally.ids, atomicLoad(&shared_counts[0]));
        atomicAdd(&tally.skipped, atomicLoad(&shared_counts[1]));
        atomicAdd(&tally.wrong, atomicLoad(&shared_counts[2]));
        atomicAdd(&tally.wrong_named, atomicLoad(&shared_counts[3]));
        atomicAdd(&tally.distinct, atomicLoad(&shared_counts[4]));
        atomicMax(&tally.row_error, atomicLoad(&shared_row_error));
    }
}
