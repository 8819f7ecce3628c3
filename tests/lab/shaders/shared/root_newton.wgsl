// sqrt as x times the inverse root: a first guess from the bits, then Newton's steps.
// Mirror: `pairmaskd::study::mapping::roots::newton`.
fn root(x: f32) -> f32 {
    let half = 0.5 * x;
    var y = bitcast<f32>(ROOT_MAGIC - (bitcast<u32>(x) >> 1u));
    for (var step = 0u; step < NEWTON_STEPS; step++) {
        y = y * (1.5 - half * y * y);
    }
    return x * y;
}
