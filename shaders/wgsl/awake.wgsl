// awake: arithmetic without a result, so that the device keeps its clocks up between frames.
//
// One workgroup; a thread's chain of dependent steps takes as long as it has rounds. The compiler
// cannot drop them, since it does not know the sum that decides what is written.

#import constants

struct AwakeParams {
    rounds: u32,
    // The sum that is written down.
    written: u32,
}

@group(0) @binding(0) var<storage, read_write> sink: array<u32>;
var<immediate> params: AwakeParams;

@compute @workgroup_size(BATCH_BOXES)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    var sum = id.x;
    for (var i = 0u; i < params.rounds; i++) {
        sum = sum * 1664525u + 1013904223u;
    }
    if (sum == params.written) {
        sink[0] = sum;
    }
}
