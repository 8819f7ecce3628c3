//! What the tests of all conversions share: random fields, and a check of filters against an engine's rule.

// Rules are filled as users fill them.
#![allow(clippy::field_reassign_with_default)]

use std::fmt::Debug;

use crate::filters::{Filter, FilterData, FilterId, FilterTable, Owner, Rules, World};
pub use crate::random::Random;

impl Random {
    pub fn flag(&mut self) -> bool {
        self.next().is_multiple_of(2)
    }

    /// 64 bits: none, all, the highest, the lowest, one, or few.
    pub fn long(&mut self) -> u64 {
        let few = (1 << (self.next() % 64)) | 1 << (self.next() % 64);
        let one = 1 << (self.next() % 3);
        [0, u64::MAX, 1 << 63, 1, one, one | 1 << 63, few][self.next() as usize % 7]
    }

    /// 32 bits of the same kinds.
    pub fn word(&mut self) -> u32 {
        let long = self.long();
        (long | long >> 32) as u32
    }

    /// The same with a sign.
    pub fn int(&mut self) -> i32 {
        self.word().cast_signed()
    }

    /// A number around 0, or an extreme one.
    pub fn small(&mut self) -> i32 {
        match self.next() % 8 {
            0 => i32::MIN,
            1 => i32::MAX,
            _ => (self.next() % 7) as i32 - 3,
        }
    }
}

/// Holds the filters of random fields to the rule of their engine, in both orders. The rule has to decide
/// often each way.
pub fn check<T: Debug>(
    mut field: impl FnMut(&mut Random) -> T,
    convert: impl Fn(&T) -> Filter,
    meet: impl Fn(&T, &T) -> bool,
) {
    let mut random = Random((1 << 40) + 1);
    let fields: Vec<T> = (0..300).map(|_| field(&mut random)).collect();
    let filters: Vec<Filter> = fields.iter().map(&convert).collect();
    let mut rules = Rules::default();
    rules.table = FilterTable::new(&filters).expect("few filters");
    rules.filter_data =
        (0..300).map(|at| FilterData::new(World::default(), Owner::NONE, FilterId(at))).collect();
    let mut decided = [0; 2];
    for (a, one) in (0..).zip(&fields) {
        for (b, other) in (0..).zip(&fields) {
            let expected = meet(one, other);
            assert_eq!(
                expected,
                meet(other, one),
                "the rule of {one:?} and {other:?} is symmetric"
            );
            assert_eq!(rules.meet(a, b), expected, "{one:?} and {other:?}");
            decided[usize::from(expected)] += 1;
        }
    }
    assert!(decided.iter().all(|count| *count > 5_000), "{decided:?}");
}

#[test]
#[should_panic(expected = "(1, 1) and (1, 0)")]
fn the_check_fails_where_a_rule_differs() {
    let field = |random: &mut Random| (random.word() & 1, random.word() & 1);
    let meet = |a: &(u32, u32), b: &(u32, u32)| a.0 & b.1 != 0 || b.0 & a.1 != 0;
    check(field, |&(of, with)| Filter::new(of.into(), with.into()), meet);
}
