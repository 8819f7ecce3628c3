// Bounds of items, one a lane, of each group of 32 lanes.

var<workgroup> group_min: array<vec3<f32>, BATCH_BOXES>;
var<workgroup> group_max: array<vec3<f32>, BATCH_BOXES>;

// Those of a lane's group are in its first lane from now on.
fn bound_groups(lane: u32, lo: vec3<f32>, hi: vec3<f32>) {
    group_min[lane] = lo;
    group_max[lane] = hi;
    for (var half = FAN_OUT / 2u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if (lane % FAN_OUT < half) {
            group_min[lane] = min(group_min[lane], group_min[lane + half]);
            group_max[lane] = max(group_max[lane], group_max[lane + half]);
        }
    }
}

// The item of the group of a lane that is the first of one.
fn put_group(item: u32, lane: u32) {
    items[2u * item] = vec4<u32>(bitcast<vec3<u32>>(group_min[lane]), 0u);
    items[2u * item + 1u] = vec4<u32>(bitcast<vec3<u32>>(group_max[lane]), 0u);
}
