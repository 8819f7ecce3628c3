//! PhysX: the words of `PxFilterData`, for the default filter shader and for the one that most hosts write.

use super::filter_of_32;
use crate::filters::Filter;

/// Category of triggers, beside the 32 of the groups.
const TRIGGER: u64 = 1 << 32;

/// The filter of a PhysX shape under `PxDefaultSimulationFilterShader`, with its operations as they are by
/// default: the groups' table alone decides.
///
/// `group` is `word0`, below 32. `meets` has a bit for each group that it may meet, as `PxGetGroupCollisionFlag`
/// says. Two bodies of which none is dynamic never meet, as the scene's filtering modes say unless they are
/// `eKEEP`. A trigger meets shapes of all bodies, whatever the groups and the modes say, and no other trigger. So
/// one of a static actor meets static shapes too, of which PhysX says nothing: two that never move. `None` where
/// the group is none of the 32.
pub const fn from_physx_group(
    group: u32,
    meets: u32,
    is_trigger: bool,
    is_dynamic: bool,
) -> Option<Filter> {
    if group >= 32 {
        return None;
    }
    Some(if is_trigger {
        Filter::new(TRIGGER, !TRIGGER)
    } else {
        Filter::new(1 << group, TRIGGER | meets as u64).with_static(!is_dynamic)
    })
}

/// The filter of a PhysX shape under `PxDefaultSimulationFilterShader` with the operations `OR`, `OR`,
/// `SWAP_AND`, constants 0 and the filter bool true: two shapes meet where one's `word2` has a bit of the
/// other's `word3`. All groups have to meet each other in the table.
pub const fn from_physx_groups_mask(word2: u32, word3: u32, is_dynamic: bool) -> Filter {
    filter_of_32(word2, word3).with_either(true).with_static(!is_dynamic)
}

/// The filter of a PhysX shape under the shader that most hosts write: `word0` says what it is, `word1` what it
/// meets, and both have to agree.
pub const fn from_physx_words(word0: u32, word1: u32, is_dynamic: bool) -> Filter {
    filter_of_32(word0, word1).with_static(!is_dynamic)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filters::engines::testing::{Random, check};

    #[test]
    fn physx_groups_meet_as_the_table_says() {
        let mut random = Random(3 << 40);
        let mut table = [[true; 32]; 32];
        for _ in 0..300 {
            let [a, b] = [random.next(), random.next()].map(|word| (word % 32) as usize);
            let on = random.flag();
            table[a][b] = on;
            table[b][a] = on;
        }
        let row =
            |group: u32| (0..32).fold(0, |row, b| row | u32::from(table[group as usize][b]) << b);
        let field = |random: &mut Random| {
            (random.next() as u32 % 32, random.flag() && random.flag(), random.flag())
        };
        let meet = |a: &(u32, bool, bool), b: &(u32, bool, bool)| match (a.1, b.1) {
            (true, true) => false,
            (false, false) => (a.2 || b.2) && table[a.0 as usize][b.0 as usize],
            _ => true,
        };
        check(
            field,
            |&(group, is_trigger, is_dynamic)| {
                from_physx_group(group, row(group), is_trigger, is_dynamic).expect("below 32")
            },
            meet,
        );
        assert_eq!(from_physx_group(32, 0, false, true), None);
    }

    #[test]
    fn physx_groups_masks_meet_as_swap_and_says() {
        let halves = |word: u32| [word as u16, (word >> 16) as u16];
        let meet = |a: &(u32, u32, bool), b: &(u32, u32, bool)| {
            let ([a0, a1], [a2, a3]) = (halves(a.0), halves(a.1));
            let ([b0, b1], [b2, b3]) = (halves(b.0), halves(b.1));
            let results = [a0 & b2, a1 & b3, a2 & b0, a3 & b1];
            (a.2 || b.2) && results.iter().any(|bits| *bits != 0)
        };
        let field = |random: &mut Random| (random.word(), random.word(), random.flag());
        check(
            field,
            |&(word2, word3, is_dynamic)| from_physx_groups_mask(word2, word3, is_dynamic),
            meet,
        );
    }

    #[test]
    fn physx_words_meet_where_both_agree() {
        let meet = |a: &(u32, u32, bool), b: &(u32, u32, bool)| {
            (a.2 || b.2) && a.0 & b.1 != 0 && b.0 & a.1 != 0
        };
        let field = |random: &mut Random| (random.word(), random.word(), random.flag());
        check(
            field,
            |&(word0, word1, is_dynamic)| from_physx_words(word0, word1, is_dynamic),
            meet,
        );
    }
}
