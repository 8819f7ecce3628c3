// scene_apply: boxes that an edit sets, as they lie in (shared) memory -> keys in their records.
//
// A record that changes for the first time in a history is kept as it was. What the next stages count
// in is zeroed here.
// Held to `pairmask_core::scene` by the tests of scenes on GPUs.

#import constants
#import box_batch
#import scene_params
#import scene_records
#import scene_history

// Binding 0: the boxes, of `box_batch`.
@group(0) @binding(1) var<storage, read> params: SceneParams;
@group(0) @binding(2) var<storage, read> indices: array<u32>;
@group(0) @binding(3) var<storage, read_write> now: array<vec4<i32>>;
@group(0) @binding(4) var<storage, read_write> then: array<vec4<i32>>;
// The naming in which each box was last named.
@group(0) @binding(5) var<storage, read_write> named: array<u32>;
@group(0) @binding(6) var<storage, read_write> table: array<vec4<u32>>;
@group(0) @binding(7) var<storage, read_write> control: array<u32>;

fn set_box(at: u32, keys: KeyBox) {
    var index = params.set_first + at;
    if (params.set_is_range == 0u) {
        index = indices[at];
    }
    // The host has checked it. Were the list another one by now, no other memory would be written to.
    if (index >= params.slots) {
        return;
    }
    if (params.naming != 0u) {
        named[index] = params.naming;
    }
    let a = now[2u * index];
    let b = now[2u * index + 1u];
    let first = vec4<i32>(keys.lo, keys.hi.x);
    var flags = bitcast<u32>(b.w) & FLAGS;
    if ((flags & PRESENT) != 0u && all(a == first) && all(b.xy == keys.hi.yz)) {
        return;
    }
    if (!has_changed(b)) {
        then[2u * index] = a;
        then[2u * index + 1u] = b;
        flags &= ~REMOVED;
    }
    now[2u * index] = first;
    now[2u * index + 1u] = changed_half(keys.hi.yz, flags | PRESENT);
}

@compute @workgroup_size(BATCH_BOXES)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let thread = group.x * BATCH_BOXES + lane;
    let threads = groups.x * BATCH_BOXES;
    // Table and filter are whole words of four.
    let zeroed = (params.table_words + params.filter_words) / 4u;
    for (var i = thread; i < zeroed; i += threads) {
        table[i] = vec4<u32>(0u);
    }
    for (var i = thread; i < params.control_words; i += threads) {
        control[i] = 0u;
    }
    let batches = (params.set_count + BATCH_BOXES - 1u) / BATCH_BOXES;
    for (var batch = group.x; batch < batches; batch += groups.x) {
        load_batch(batch, lane, params.set_count);
        let at = batch * BATCH_BOXES + lane;
        if (at < params.set_count) {
            set_box(at, take_keys(lane));
        }
        // Before the next batch comes to workgroup memory.
        workgroupBarrier();
    }
}
