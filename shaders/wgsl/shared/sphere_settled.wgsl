// Near pairs of one sphere with 32 others, decided in integers. The stage has `whole_sphere`.

// Those of the bits `near` whose spheres, `first` and the 31 after it, do not meet sphere `one`.
fn apart_bits(one: u32, first: u32, near: u32) -> u32 {
    var apart = 0u;
    var rest = near;
    let sphere = whole_sphere(one);
    while (rest != 0u) {
        let bit = countTrailingZeros(rest);
        rest &= rest - 1u;
        if (!do_spheres_meet(sphere, whole_sphere(first + bit))) {
            apart |= 1u << bit;
        }
    }
    return apart;
}
