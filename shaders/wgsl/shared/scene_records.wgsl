// Records of a scene, two words of four an index: min.x, min.y, min.z, max.x; max.y, max.z, and the
// history in which the box last changed in 56 bits, flags in the low eight of the last word.

#import order_keys

// The index has a box.
const PRESENT: u32 = 1u;
// It is disabled.
const DISABLED: u32 = 2u;
// It is still: static, and no rule makes an exception of it.
const STATIC: u32 = 4u;
// A box of this index was removed in the history of the record, or its filter data have changed.
const REMOVED: u32 = 8u;
const FLAGS: u32 = 0xffu;

// Bits of an entry's name above its index: which boxes of the index it stands for. Where moved pairs are
// looked for, the first says that the edit named the box.
const THEN: u32 = 1u;
const NOW: u32 = 2u;
const KINDS_SHIFT: u32 = 30u;
const INDEX_MASK: u32 = 0x3fffffffu;

struct SceneBox {
    lo: vec3<i32>,
    hi: vec3<i32>,
    is_static: bool,
}

// What collides of a record.
fn colliding(a: vec4<i32>, b: vec4<i32>) -> SceneBox {
    let flags = bitcast<u32>(b.w);
    var found = SceneBox(a.xyz, vec3<i32>(a.w, b.xy), (flags & STATIC) != 0u);
    if ((flags & (PRESENT | DISABLED)) != PRESENT) {
        found.lo = vec3<i32>(NOTHING_MIN);
        found.hi = vec3<i32>(NOTHING_MAX);
    }
    return found;
}

fn is_nothing(one: SceneBox) -> bool {
    return one.lo.x == NOTHING_MIN;
}

fn overlap(one: SceneBox, other: SceneBox) -> bool {
    return all(one.lo <= other.hi) & all(other.lo <= one.hi);
}

// Whether two boxes are a pair: they overlap, and are not both static.
fn is_pair(one: SceneBox, other: SceneBox) -> bool {
    return overlap(one, other) & !(one.is_static & other.is_static);
}

fn hull(one: SceneBox, other: SceneBox) -> SceneBox {
    return SceneBox(min(one.lo, other.lo), max(one.hi, other.hi), false);
}
