//! Filters as words.

use pairmask_core::filters::{Filter, FilterData};

/// Words of filter data, a filter and a pair.
pub(crate) const FILTER_DATA_WORDS: usize = 3;
pub(crate) const FILTER_WORDS: usize = 6;
pub(crate) const PAIR_WORDS: usize = 2;
const _: () = assert!(size_of::<FilterData>() == 4 * FILTER_DATA_WORDS);

/// Indices that one request may name, for each box that it is about: those of an edit, in all its steps
/// together, removed, set, enabled or disabled, flagged, given filter data and renewed, and more than as much again. Without a
/// limit, one request could be work without end.
pub(crate) const NAMED_PER_BOX: u64 = 16;

const FILTER_STATIC: u32 = 1;
const FILTER_EITHER: u32 = 1 << 1;

pub(crate) fn words_of(filter: &Filter) -> [u32; FILTER_WORDS] {
    let flag = |on: bool, flag: u32| if on { flag } else { 0 };
    let flags = flag(filter.is_static, FILTER_STATIC) | flag(filter.either, FILTER_EITHER);
    let halves = |bits: u64| [bits as u32, (bits >> 32) as u32];
    let ([c, d], [m, n]) = (halves(filter.category), halves(filter.mask));
    [flags, filter.group.cast_unsigned(), c, d, m, n]
}

/// What [`words_of`] wrote, or any words.
pub(crate) fn filter_of(&[flags, group, c, d, m, n]: &[u32; FILTER_WORDS]) -> Filter {
    let whole = |low: u32, high: u32| u64::from(low) | u64::from(high) << 32;
    let filter = Filter::new(whole(c, d), whole(m, n)).with_group(group.cast_signed());
    filter.with_static(flags & FILTER_STATIC != 0).with_either(flags & FILTER_EITHER != 0)
}
