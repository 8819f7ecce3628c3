// cast_groups: items of a level of a tree -> bounds of 32 together, the items of the next.

#import constants
#import cast_params
#import cast_bounds

struct CastGroupsParams {
    // The level that is read.
    level: u32,
}

@group(0) @binding(0) var<storage, read> params: CastParams;
@group(0) @binding(1) var<storage, read_write> items: array<vec4<u32>>;
var<immediate> own: CastGroupsParams;

@compute @workgroup_size(BATCH_BOXES)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let read = params.levels[own.level];
    let written = params.levels[own.level + 1u];
    for (var first = group.x * BATCH_BOXES; first < read.count; first += groups.x * BATCH_BOXES) {
        let at = first + lane;
        var lo = vec3<f32>(BEYOND);
        var hi = vec3<f32>(-BEYOND);
        if (at < read.count) {
            lo = bitcast<vec3<f32>>(items[2u * (read.first + at)].xyz);
            hi = bitcast<vec3<f32>>(items[2u * (read.first + at) + 1u].xyz);
        }
        bound_groups(lane, lo, hi);
        if (lane % FAN_OUT == 0u && at < read.count) {
            put_group(written.first + at / FAN_OUT, lane);
        }
        workgroupBarrier();
    }
}
