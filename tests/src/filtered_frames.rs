//! Whole frames with random rules, and the pairs that they have by the oracle and by the seven rules in
//! their order.

use std::collections::BTreeSet;

use pairmask_core::Aabb;
use pairmask_core::filters::{Filter, FilterId, FilterTable, Owner, Rules, Tag, World};
use pairmask_core::oracle::{Pair, truth};

/// Numbers of chance.
#[derive(Debug)]
pub struct Chance(u64);

impl Chance {
    /// Another sequence for each seed.
    pub const fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    /// A number below another.
    pub const fn below(&mut self, end: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) % end
    }
}

/// What kinds of rules a frame has.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    worlds: &'static [i32],
    filters: u64,
    lists: bool,
}

/// All kinds: worlds, filters and lists, alone and together.
pub const KINDS: [Kind; 9] = [
    Kind { worlds: &[0], filters: 70, lists: false },
    Kind { worlds: &[0], filters: 15, lists: false },
    Kind { worlds: &[7, -1], filters: 12, lists: true },
    Kind { worlds: &[0, 1, 2], filters: 0, lists: false },
    Kind { worlds: &[3, -1, 9, 9, 9, -4], filters: 0, lists: false },
    Kind { worlds: &[3, 3, -1, 9, i32::MIN, i32::MAX], filters: 9, lists: true },
    Kind { worlds: &[0, 1, 1, 1, 1, 1, 1, 1, 1, 1], filters: 70, lists: false },
    Kind { worlds: &[-1], filters: 0, lists: true },
    Kind { worlds: &[5], filters: 3, lists: false },
];

/// A frame, and what a client hears of it.
#[derive(Clone, Debug)]
pub struct FilteredFrame {
    /// Its boxes.
    pub boxes: Vec<Aabb>,
    /// Its rules.
    pub rules: Rules,
    /// Its pairs, sorted.
    pub pairs: Vec<Pair>,
}

impl FilteredFrame {
    /// A frame of `n` boxes, some empty or invalid, with rules of a kind.
    ///
    /// # Panics
    /// Never: tables of so many filters can be made.
    pub fn drawn(n: usize, kind: Kind, seed: u64) -> Self {
        let mut chance = Chance::new(seed);
        let boxes = drawn_boxes(n, &mut chance);
        let filters: Vec<Filter> = (0..kind.filters)
            .map(|_| {
                Filter::new(chance.below(8), chance.below(8) | 1)
                    .with_group(chance.below(3) as i32 - 1)
                    .with_static(chance.below(6) == 0)
                    .with_either(chance.below(2) == 0)
            })
            .collect();
        let mut rules = Rules::default();
        rules.table = FilterTable::new(&filters).expect("few filters");
        // The last boxes have no tag, and some tags name a filter that is not in the table.
        for _ in 0..n - n / 9 {
            let world = World(kind.worlds[chance.below(kind.worlds.len() as u64) as usize]);
            let mut tag = Tag::default().with_world(world);
            if kind.filters > 0 {
                let owner = Owner(chance.below(5) as u32);
                tag = Tag::new(world, owner, FilterId(chance.below(kind.filters + 1) as u16));
                tag = tag.with_static(chance.below(7) == 0);
            }
            rules.tags.push(tag);
        }
        let (mut included, mut excluded) = (BTreeSet::new(), BTreeSet::new());
        for _ in 0..if kind.lists && n > 1 { n } else { 0 } {
            let [a, b] = [0; 2].map(|_| chance.below(n as u64) as u32);
            let list = if chance.below(2) == 0 { &mut included } else { &mut excluded };
            list.insert([a.min(b), a.max(b)]);
        }
        for pair in &included {
            rules.lists.include(*pair, true);
        }
        for pair in &excluded {
            rules.lists.exclude(*pair, true);
        }
        let mut pairs = truth(&boxes).pairs;
        pairs.retain(|(a, b)| {
            let listed = [included.contains(&[*a, *b]), excluded.contains(&[*a, *b])];
            may_meet([rules.tag(*a), rules.tag(*b)], &filters, listed)
        });
        pairs.sort_unstable();
        Self { boxes, rules, pairs }
    }
}

fn drawn_boxes(n: usize, chance: &mut Chance) -> Vec<Aabb> {
    let side = (n as f64).cbrt().ceil() as u64 * 2 + 4;
    let mut corner = || [0; 3].map(|_| chance.below(side * 16) as f32 / 16.0);
    let mut boxes: Vec<Aabb> =
        (0..n).map(|_| corner()).map(|low| Aabb::new(low, low.map(|x| x + 2.5))).collect();
    for (at, b) in boxes.iter_mut().enumerate() {
        match at % 37 {
            11 => *b = Aabb::EMPTY,
            23 => b.min[1] = f32::NAN,
            _ => {}
        }
    }
    boxes
}

/// The seven rules, in their order.
fn may_meet([a, b]: [Tag; 2], filters: &[Filter], [included, excluded]: [bool; 2]) -> bool {
    let of = |tag: Tag| filters.get(usize::from(tag.filter.0)).copied().unwrap_or(Filter::ALL);
    let (f, g) = (of(a), of(b));
    if a.world != b.world && a.world.0 != -1 && b.world.0 != -1 {
        return false;
    }
    if included {
        return true;
    }
    if a.owner == b.owner && a.owner.0 != 0 {
        return false;
    }
    if (a.is_static() || f.is_static) && (b.is_static() || g.is_static) || excluded {
        return false;
    }
    if f.group == g.group && f.group != 0 {
        return f.group > 0;
    }
    let (one, other) = (f.category & g.mask != 0, g.category & f.mask != 0);
    if f.either && g.either { one || other } else { one && other }
}
