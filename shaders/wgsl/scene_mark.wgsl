// scene_mark: boxes that an edit removes, switches, flags or gives filter data, each once, with what becomes of
// their flags. After `scene_apply`, which may have set the same boxes anew.
// Held to `pairmask_core::scene` by the tests of scenes on GPUs.

#import constants
#import scene_params
#import scene_records
#import scene_history

@group(0) @binding(0) var<storage, read> params: SceneParams;
// Index, and the flags that it has from now on; above them MARK_NAMES, and MARK_REMOVES or MARK_TOUCHES, which both
// have pairs of the box reported as ended and as begun.
@group(0) @binding(1) var<storage, read> marks: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read_write> now: array<vec4<i32>>;
@group(0) @binding(3) var<storage, read_write> then: array<vec4<i32>>;
@group(0) @binding(4) var<storage, read_write> named: array<u32>;

@compute @workgroup_size(BATCH_BOXES)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let threads = groups.x * BATCH_BOXES;
    for (var i = group.x * BATCH_BOXES + lane; i < params.mark_count; i += threads) {
        let index = marks[i].x;
        let mark = marks[i].y;
        if (params.naming != 0u && (mark & MARK_NAMES) != 0u) {
            named[index] = params.naming;
        }
        let b = now[2u * index + 1u];
        let old = bitcast<u32>(b.w) & FLAGS;
        let removes = (mark & (MARK_REMOVES | MARK_TOUCHES)) != 0u;
        if (!removes && (old & ~REMOVED) == (mark & FLAGS)) {
            continue;
        }
        var flags = (mark & FLAGS) | (old & REMOVED);
        if (!has_changed(b)) {
            then[2u * index] = now[2u * index];
            then[2u * index + 1u] = b;
            flags &= ~REMOVED;
        }
        if (removes) {
            flags |= REMOVED;
        }
        now[2u * index + 1u] = changed_half(b.xy, flags);
    }
}
