// sweep_scan: counts of digits and tiles -> where the first entry of each goes. A workgroup a digit.

#import constants
#import sweep_params
#import scan

@group(0) @binding(0) var<storage, read> control: array<u32>;
@group(0) @binding(1) var<storage, read_write> counts: array<u32>;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let digit = group.x;
    var before = 0u;
    for (var lower = 0u; lower < digit; lower++) {
        before += control[DIGITS_AT + params.pass_number * DIGITS + lower];
    }
    for (var first = 0u; first < params.tiles; first += BATCH_BOXES) {
        let tile = first + lane;
        let at = digit * params.tiles + tile;
        var own = 0u;
        if (tile < params.tiles) {
            own = counts[at];
        }
        scan[lane] = own;
        workgroupBarrier();
        sum_up(lane);
        if (tile < params.tiles) {
            counts[at] = before + scan[lane] - own;
        }
        before += scan[BATCH_BOXES - 1u];
        workgroupBarrier();
    }
}
