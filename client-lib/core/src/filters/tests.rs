//! The rules against the seven lines of their order, written out one by one.

// Rules are filled as users fill them.
#![allow(clippy::field_reassign_with_default)]

use std::collections::HashMap;

use super::*;
use crate::filters::pair_lists::PairLists;
use crate::random::Random;

/// Which line of the order decided, and that they meet or do not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
enum Reason {
    OtherWorlds,
    Included,
    OneOwner,
    BothStatic,
    Excluded,
    PositiveGroup,
    NegativeGroup,
    Masks { either: bool, meet: bool },
}

/// A box to the naive rule: nothing is looked up.
#[derive(Clone, Copy, Debug)]
struct Naive {
    world: i32,
    owner: u32,
    is_static: bool,
    group: i32,
    category: u64,
    mask: u64,
    either: bool,
}

/// The order as the documentation of [`filters`](super) has it.
fn naive(a: &Naive, b: &Naive, is_included: bool, is_excluded: bool) -> Reason {
    if a.world != b.world && a.world != -1 && b.world != -1 {
        return Reason::OtherWorlds;
    }
    if is_included {
        return Reason::Included;
    }
    if a.owner != 0 && a.owner == b.owner {
        return Reason::OneOwner;
    }
    if a.is_static && b.is_static {
        return Reason::BothStatic;
    }
    if is_excluded {
        return Reason::Excluded;
    }
    if a.group != 0 && a.group == b.group {
        return if a.group > 0 { Reason::PositiveGroup } else { Reason::NegativeGroup };
    }
    let one = a.category & b.mask != 0;
    let other = b.category & a.mask != 0;
    let either = a.either && b.either;
    Reason::Masks { either, meet: if either { one || other } else { one && other } }
}

fn meets(reason: Reason) -> bool {
    match reason {
        Reason::Included | Reason::PositiveGroup => true,
        Reason::Masks { meet, .. } => meet,
        _ => false,
    }
}

/// Boxes, and the same as rules.
struct Case {
    boxes: Vec<Naive>,
    included: Vec<[u32; 2]>,
    excluded: Vec<[u32; 2]>,
    rules: Rules,
}

/// Few values of each kind, so that each line decides often.
fn case(random: &mut Random, count: u64, filter_count: u64) -> Case {
    let bits = |random: &mut Random| match random.below(4) {
        0 => 1 << 63,
        kind => kind,
    };
    let filters: Vec<Filter> = (0..filter_count)
        .map(|_| {
            Filter::new(bits(random), bits(random))
                .with_group([0, 0, 0, 1, -1, i32::MIN, i32::MAX][random.below(7) as usize])
                .with_static(random.below(5) == 0)
                .with_either(random.below(2) == 0)
        })
        .collect();
    let mut rules = Rules::default();
    rules.table = FilterTable::new(&filters).expect("few filters");
    let mut boxes = Vec::new();
    for _ in 0..count {
        // Ids beyond the table too.
        let id = random.below(filter_count + 2) as u16;
        let world = [0, 0, 0, 1, -1, i32::MIN][random.below(6) as usize];
        let owner = [0, 0, 0, 1, u32::MAX][random.below(5) as usize];
        let is_static = random.below(8) == 0;
        let filter = filters.get(usize::from(id)).copied().unwrap_or(Filter::ALL);
        let filter_data =
            FilterData::new(World(world), Owner(owner), FilterId(id)).with_static(is_static);
        rules.filter_data.push(filter_data);
        let Filter { group, category, mask, either, .. } = filter;
        let is_static = is_static || filter.is_static;
        boxes.push(Naive { world, owner, is_static, group, category, mask, either });
    }
    // A box without filter data has the default one.
    let first = filters.first().copied().unwrap_or(Filter::ALL);
    let Filter { is_static, group, category, mask, either } = first;
    boxes.push(Naive { world: 0, owner: 0, is_static, group, category, mask, either });
    let pairs = |random: &mut Random| -> Vec<[u32; 2]> {
        let of = random.below(2) * count;
        (0..of).map(|_| [0; 2].map(|_| random.below(count + 1) as u32)).collect()
    };
    let (included, excluded) = (pairs(random), pairs(random));
    for pair in &included {
        rules.lists.include(*pair, true);
    }
    for pair in &excluded {
        rules.lists.exclude(*pair, true);
    }
    Case { boxes, included, excluded, rules }
}

/// Counts the reasons, or says the first two boxes of which `decide` does not say what the order says.
fn compare(
    case: &Case,
    decide: impl Fn(u32, u32) -> bool,
    reasons: &mut HashMap<Reason, usize>,
) -> Result<(), String> {
    let has = |list: &[[u32; 2]], a, b| list.contains(&[a, b]) || list.contains(&[b, a]);
    for (a, one) in (0..).zip(&case.boxes) {
        for (b, other) in (0..).zip(&case.boxes).filter(|(b, _)| *b != a) {
            let reason = naive(one, other, has(&case.included, a, b), has(&case.excluded, a, b));
            if decide(a, b) != meets(reason) {
                return Err(format!("{a} and {b}: {reason:?}, {one:?} and {other:?}"));
            }
            *reasons.entry(reason).or_default() += 1;
        }
    }
    Ok(())
}

#[test]
fn rules_decide_as_their_order_says() {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let mut reasons = HashMap::new();
    for round in 0..60 {
        // Some tables are too large to be computed once.
        let filter_count = if round % 20 == 19 { 1_100 } else { 1 + random.below(20) };
        let count = 1 + random.below(60);
        let case = case(&mut random, count, filter_count);
        compare(&case, |a, b| case.rules.meet(a, b), &mut reasons).expect("as the order says");
    }
    let masks =
        [false, true].map(|either| [false, true].map(|meet| Reason::Masks { either, meet }));
    let named = [
        Reason::OtherWorlds,
        Reason::Included,
        Reason::OneOwner,
        Reason::BothStatic,
        Reason::Excluded,
        Reason::PositiveGroup,
        Reason::NegativeGroup,
    ];
    for reason in named.iter().chain(masks.iter().flatten()) {
        let count = reasons.get(reason).copied().unwrap_or_default();
        assert!(count >= 100, "{reason:?} decided {count} times");
    }
}

#[test]
fn the_comparison_notices_each_rule_that_is_left_out() {
    type Mutation = fn(&mut Rules);
    let mutations: [(&str, Mutation); 7] = [
        ("worlds", |rules| {
            rules.filter_data.iter_mut().for_each(|filter_data| filter_data.world = World(0));
        }),
        ("owners", |rules| {
            rules.filter_data.iter_mut().for_each(|filter_data| filter_data.owner = Owner::NONE);
        }),
        ("static boxes", |rules| {
            rules
                .filter_data
                .iter_mut()
                .for_each(|filter_data| *filter_data = filter_data.with_static(false));
        }),
        ("filters", |rules| rules.table = FilterTable::default()),
        ("include list", |rules| {
            let pairs: Vec<[u32; 2]> = rules.lists.included().collect();
            for pair in pairs {
                rules.lists.include(pair, false);
            }
        }),
        ("exclude list", |rules| {
            let pairs: Vec<[u32; 2]> = rules.lists.excluded().collect();
            for pair in pairs {
                rules.lists.exclude(pair, false);
            }
        }),
        ("either", |rules| {
            let both = rules.table.filters().iter().map(|filter| filter.with_either(false));
            rules.table = FilterTable::new(&both.collect::<Vec<_>>()).expect("few filters");
        }),
    ];
    for (what, mutate) in mutations {
        let mut random = Random(77);
        let noticed = (0..30).any(|_| {
            let case = case(&mut random, 60, 12);
            let mut wrong = case.rules.clone();
            mutate(&mut wrong);
            compare(&case, |a, b| wrong.meet(a, b), &mut HashMap::new()).is_err()
        });
        assert!(noticed, "{what}");
    }
}

#[test]
fn lists_decide_of_indices_that_have_no_filter_data() {
    let mut lists = PairLists::new();
    lists.exclude([5, u32::MAX >> 8], true);
    let mut rules = Rules::default();
    rules.lists = lists;
    assert!(!rules.meet(u32::MAX >> 8, 5));
    assert!(rules.meet(4, 5));
}

#[test]
fn rules_of_which_a_look_says_that_all_meet_let_all_meet() {
    let mut random = Random(0xA11);
    let (mut all, mut some) = (0, 0);
    for _ in 0..3_000 {
        let n = random.below(6) as u32;
        let mut rules = Rules::default();
        let kinds = [Filter::ALL, Filter::new(1, 2), Filter::ALL.with_static(true)];
        if random.below(3) == 0 {
            rules.table =
                FilterTable::new(&kinds[random.below(3) as usize..]).expect("few filters");
        }
        let rare = |random: &mut Random| u32::from(random.below(9) == 0);
        for _ in 0..random.below(8) {
            let world = World([0, 0, 0, -1, 5][random.below(5) as usize]);
            let filter = FilterId(rare(&mut random) as u16);
            let filter_data = FilterData::new(world, Owner(rare(&mut random)), filter);
            rules.filter_data.push(filter_data.with_static(rare(&mut random) == 1));
        }
        if random.below(9) == 0 {
            rules.lists.exclude([0, 1], true);
        }
        let meet = (0..n).all(|a| (0..a).all(|b| rules.meet(a, b)));
        if rules.let_all_meet(n as usize) {
            assert!(meet, "{rules:?}");
            all += 1;
        } else {
            some += u32::from(!meet);
        }
    }
    assert!(all > 300 && some > 300, "{all} and {some}");
}
