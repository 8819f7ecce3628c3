// scene_finish: what the host learns of a search, with some entries to choose the next grid by.
// Mirror: none; it copies.

#import constants
#import scene_params
#import scene_records

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
@group(0) @binding(1) var<storage, read> control: array<u32>;
@group(0) @binding(2) var<storage, read> sorted: array<vec4<i32>>;
@group(0) @binding(3) var<storage, read_write> summary: SceneSummary;

// The bits of a key's number: the map to keys is its own inverse, but for -0.
fn number_bits(key: i32) -> u32 {
    return bitcast<u32>(order_key(bitcast<u32>(key)));
}

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(local_invocation_index) lane: u32) {
    let count = control[ENTRIES];
    let sampled = select(min(count, SCENE_SAMPLES), 0u, count > params.entry_capacity);
    if (lane < sampled) {
        let step = count / sampled;
        let a = sorted[2u * lane * step];
        let b = sorted[2u * lane * step + 1u];
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
        summary.found = vec2<u32>(control[FOUND], control[FOUND + 1u]);
        summary.ended = vec2<u32>(control[ENDED], control[ENDED + 1u]);
        summary.tested = vec2<u32>(control[TESTED], control[TESTED + 1u]);
        summary.entries = count;
        summary.rows = control[ROWS];
        summary.moved = control[MOVED];
        summary.moved_static = control[MOVED_STATIC];
        summary.sampled = sampled;
    }
}
