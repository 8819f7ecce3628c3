//! A table of filters from a relation: which kinds meet, regardless of the reason.

use crate::filters::{Filter, FilterTable};

/// Kinds that a table of categories and masks can distinguish: a bit each.
const MOST_KINDS: usize = 64;

/// A table whose filters `0..count` meet where `meets` says so of the first two ids in either order.
///
/// Kinds that meet the same kinds share a category, so that `count` may be much larger than 64. `None` where more than
/// 64 kinds differ in what they meet.
pub fn from_relation(count: u16, meets: impl Fn(u16, u16) -> bool) -> Option<FilterTable> {
    let meet = |a: u16, b: u16| meets(a.min(b), a.max(b));
    // The first id of each kind, and the kind of each id.
    let mut kinds: Vec<u16> = Vec::new();
    let mut kind_of = Vec::with_capacity(usize::from(count));
    for id in 0..count {
        let alike = |first: &u16| (0..count).all(|other| meet(id, other) == meet(*first, other));
        let kind = match kinds.iter().position(alike) {
            Some(kind) => kind,
            None if kinds.len() == MOST_KINDS => return None,
            None => {
                kinds.push(id);
                kinds.len() - 1
            }
        };
        kind_of.push(kind);
    }
    let mask = |id: u16| {
        (0..).zip(&kinds).fold(0, |mask, (bit, first)| mask | u64::from(meet(id, *first)) << bit)
    };
    let of_kind: Vec<Filter> =
        (0..).zip(&kinds).map(|(bit, first)| Filter::new(1 << bit, mask(*first))).collect();
    let filters: Vec<Filter> = kind_of.into_iter().map(|kind| of_kind[kind]).collect();
    // A count of 16 bits is never more than there are ids.
    FilterTable::new(&filters).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filters::FilterId;
    use crate::filters::engines::testing::Random;

    fn check(count: u16, relation: impl Fn(u16, u16) -> bool) {
        let table = from_relation(count, &relation).expect("few kinds");
        assert_eq!(table.filters().len(), usize::from(count));
        for a in 0..count {
            for b in 0..count {
                let expected = relation(a.min(b), a.max(b));
                assert_eq!(table.meet(FilterId(a), FilterId(b)), expected, "{a} and {b}");
            }
        }
    }

    #[test]
    fn a_table_meets_as_its_relation_says() {
        let mut random = Random(11 << 40);
        for count in [0, 1, 2, 31, 63, 64] {
            let bits: Vec<bool> = (0..64 * 64).map(|_| random.flag()).collect();
            check(count, |a, b| bits[usize::from(a) * 64 + usize::from(b)]);
        }
        // Many kinds that meet the same ones.
        check(300, |a, b| (a % 40) * (b % 40) % 3 == 1);
    }

    #[test]
    fn more_kinds_than_categories_are_refused() {
        assert!(from_relation(65, |a, b| a == b).is_none());
        check(64, |a, b| a == b);
    }
}
