// scene_pairs: of the boxes around each other (`scene_search`), those pairs that an edit reports.
//
// A pair is looked at where hulls overlap, and decided by what both boxes were and are. Each of the two,
// then and now, has one entry that stands for it, so no pair is reported twice.
// Mirror: none; what comes of it is what `pairmask_core::scene` reports.

#import scene_search

@group(0) @binding(5) var<storage, read> then: array<vec4<i32>>;

// Whether entries look at each other.
fn entries_look() -> bool {
    return true;
}

// Whether two entries or rows are worth a look at their records.
fn may_be_reported(one_name: u32, other_name: u32) -> bool {
    return true;
}

// A pair by its smaller index and its larger one; a change as larger index << 2 | what is reported of it.
fn report_change(index: u32, other: u32, what: u32) {
    var larger = max(index, other);
    if (params.mode == MODE_CHANGES) {
        larger = (larger << 2u) | what;
    }
    report(vec2<u32>(min(index, other), larger));
}

// Decides a candidate by its records.
fn decide(one_name: u32, other_name: u32) {
    let i = one_name & INDEX_MASK;
    let j = other_name & INDEX_MASK;
    let one_b = now[2u * i + 1u];
    let other_b = now[2u * j + 1u];
    let one = colliding(now[2u * i], one_b);
    let other = colliding(now[2u * j], other_b);
    let has = is_pair(one, other);
    let both = (one_name & other_name) >> KINDS_SHIFT;
    if (params.mode != MODE_CHANGES) {
        let is_named = ((one_name | other_name) >> KINDS_SHIFT) & THEN;
        if (has && (params.mode == MODE_ALL || is_named != 0u)) {
            report_change(i, j, REPORT_BEGUN);
        }
        return;
    }
    let one_changed = has_changed(one_b);
    let other_changed = has_changed(other_b);
    var was = one;
    var other_was = other;
    if (one_changed) {
        was = colliding(then[2u * i], then[2u * i + 1u]);
    }
    if (other_changed) {
        other_was = colliding(then[2u * j], then[2u * j + 1u]);
    }
    let had = is_pair(was, other_was);
    let one_flags = select(0u, bitcast<u32>(one_b.w), one_changed);
    let other_flags = select(0u, bitcast<u32>(other_b.w), other_changed);
    let is_replaced = ((one_flags | other_flags) & REMOVED) != 0u;
    if (had && (both & THEN) != 0u && (!has || is_replaced)) {
        let is_disabled = ((bitcast<u32>(one_b.w) | bitcast<u32>(other_b.w)) & DISABLED) != 0u;
        var reason = REPORT_SEPARATED;
        if (is_replaced) {
            reason = REPORT_REMOVED;
        } else if (is_disabled || (one.is_static && other.is_static)) {
            reason = REPORT_FILTERED;
        }
        atomicAdd(&ended_sum, 1u);
        report_change(i, j, reason);
    }
    if (has && (both & NOW) != 0u && (!had || is_replaced)) {
        report_change(i, j, REPORT_BEGUN);
    }
}
