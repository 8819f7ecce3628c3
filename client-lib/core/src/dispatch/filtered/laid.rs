//! The filter data of a frame, laid out by the engine's position, so that a word's test reads few lines.

// `&` and `|`: a branch costs more than the second operand.
#![allow(clippy::needless_bitwise_bool)]

use super::kinds::{Kinds, MOST_KINDS};
#[cfg(target_arch = "x86_64")]
use super::sift_avx512;
#[cfg(target_arch = "x86_64")]
use crate::engine::Isa;
use crate::engine::{AvailableIsa, sift_each};
use crate::filters::{FilterData, Owner, Rules, World};
use crate::team::{for_each_in_parts, part_count};

/// Boxes of a task that lays filter data out, at least. A whole number of blocks.
const TASK_BOXES: usize = 8_192;
pub const BLOCK: usize = 32;
/// Kinds behind the last, so that the kind of each position can be read as the lowest of four bytes.
const KINDS_BEHIND: usize = 3;

/// What parts boxes beside their kinds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ByPair {
    pub owners: bool,
    /// Boxes are of several worlds.
    pub worlds: bool,
}

/// The filter data of a frame by the engine's position.
#[derive(Debug, Default)]
pub struct Laid {
    by_pair: ByPair,
    /// Owners, where they matter: whole blocks.
    pub owners: Vec<u32>,
    /// Worlds, where they matter: whole blocks.
    pub worlds: Vec<i32>,
    /// The kind of each box, by index among those that are culled.
    kind_of: Vec<u8>,
    /// The same by position, and [`KINDS_BEHIND`] more.
    pub kinds: Vec<u8>,
    pub kind_count: usize,
    /// For each block of columns and each kind, the columns that the kind meets.
    pub columns: Vec<u32>,
}

impl Laid {
    pub fn allocated_bytes(&self) -> usize {
        (self.owners.capacity() + self.worlds.capacity() + self.columns.capacity())
            * size_of::<u32>()
            + self.kind_of.capacity()
            + self.kinds.capacity()
    }

    /// Lays out the filter data of `count` boxes; `filter_data` gives that of a culled box, and `order` the culled box at
    /// each position, or is empty where they are the same. `false` where there are too many kinds.
    pub fn lay_out(
        &mut self,
        (rules, by_pair): (&Rules, ByPair),
        count: usize,
        order: &[u32],
        filter_data: impl Fn(u32) -> FilterData + Sync,
        threads: usize,
    ) -> bool {
        let kinds = Kinds::of(rules, count, &filter_data, MOST_KINDS, &mut self.kind_of, threads);
        let Some(kinds) = kinds else { return false };
        let meets = kinds.meets(rules, 1);
        let blocks = count.div_ceil(BLOCK);
        self.by_pair = by_pair;
        self.kind_count = meets.len();
        self.kinds.resize(count + KINDS_BEHIND, 0);
        self.columns.resize(blocks * meets.len(), 0);
        self.owners.resize(if by_pair.owners { blocks * BLOCK } else { 0 }, 0);
        self.worlds.resize(if by_pair.worlds { blocks * BLOCK } else { 0 }, 0);

        let parts = part_count(count, TASK_BOXES, threads);
        let step = count.div_ceil(parts.max(1)).next_multiple_of(BLOCK).max(BLOCK);
        let (mut owners, mut worlds) = (self.owners.chunks_mut(step), self.worlds.chunks_mut(step));
        let columns = self.columns.chunks_mut((step / BLOCK * meets.len()).max(1));
        let kinds = self.kinds[..count].chunks_mut(step);
        let mut work: Vec<Part<'_>> = (0..)
            .step_by(step)
            .zip(kinds.zip(columns))
            .map(|(first, (kinds, columns))| Part {
                first,
                kinds,
                columns,
                owners: owners.next().unwrap_or_default(),
                worlds: worlds.next().unwrap_or_default(),
            })
            .collect();
        let culled = |position: usize| order.get(position).map_or(position as u32, |index| *index);
        let kind_of = self.kind_of.as_slice();
        for_each_in_parts(&mut work, parts, |part| {
            part.lay_out(|at| kind_of[culled(at) as usize], &meets, |at| filter_data(culled(at)));
        });
        true
    }

    /// The bits of a word whose pairs pass, of boxes that are on no list.
    #[inline]
    pub fn passing(&self, row: u32, block: u32, bits: u32) -> u32 {
        let kind = usize::from(self.kinds[row as usize]);
        let bits = bits & self.columns[block as usize * self.kind_count + kind];
        if bits == 0 || self.by_pair == ByPair::default() {
            return bits;
        }
        let first = BLOCK * block as usize;
        let (owners, worlds) = (self.owners.get(first..), self.worlds.get(first..));
        let of_row = |of: &[u32]| of.get(row as usize).copied().unwrap_or_default();
        let owner = of_row(&self.owners);
        let world = self.worlds.get(row as usize).copied().unwrap_or_default();
        let (mut passing, mut rest) = (bits, bits);
        while rest != 0 {
            let column = rest.trailing_zeros() as usize;
            let other = owners.and_then(|owners| owners.get(column)).copied().unwrap_or_default();
            let its = worlds.and_then(|worlds| worlds.get(column)).copied().unwrap_or(world);
            // No branch: which pairs pass is as good as random.
            let is_of_one = (owner == other) & (owner != Owner::NONE.0);
            let worlds_meet = (world == its) | (world == World::ALL.0) | (its == World::ALL.0);
            passing ^= u32::from(is_of_one | !worlds_meet) << column;
            rest &= rest - 1;
        }
        passing
    }

    /// Keeps what passes of some words, of boxes that are on no list; see
    /// [`PairTest::sift`](crate::engine::PairTest::sift).
    pub fn sift(&self, words: [&mut [u32]; 3], isa: AvailableIsa) -> (usize, u64) {
        #[cfg(target_arch = "x86_64")]
        if isa.get() == Isa::Avx512 && sift_avx512::takes(self) {
            return sift_avx512::sift(self, words, isa);
        }
        let _ = isa;
        sift_each(words, |row, block, bits| self.passing(row, block, bits), |_| ())
    }
}

/// Some positions of an order, and what is laid out for them.
struct Part<'a> {
    first: usize,
    kinds: &'a mut [u8],
    columns: &'a mut [u32],
    owners: &'a mut [u32],
    worlds: &'a mut [i32],
}

impl Part<'_> {
    /// `meets` has the kinds that each kind meets.
    fn lay_out(
        &mut self,
        kind: impl Fn(usize) -> u8,
        meets: &[u32],
        filter_data: impl Fn(usize) -> FilterData,
    ) {
        for (at, laid) in (self.first..).zip(&mut *self.kinds) {
            *laid = kind(at);
        }
        // The last block's boxes that are none have no bits.
        let end = self.first + self.kinds.len();
        for (at, laid) in (self.first..end).zip(&mut *self.owners) {
            *laid = filter_data(at).owner.0;
        }
        for (at, laid) in (self.first..end).zip(&mut *self.worlds) {
            *laid = filter_data(at).world.0;
        }
        let blocks = self.columns.chunks_exact_mut(meets.len());
        for (columns, kinds) in blocks.zip(self.kinds.chunks(BLOCK)) {
            let mut of_kind = [0; MOST_KINDS];
            for (column, kind) in kinds.iter().enumerate() {
                of_kind[usize::from(*kind)] |= 1 << column;
            }
            for (columns, meets) in columns.iter_mut().zip(meets) {
                let bits = (0..).zip(&of_kind[..meets_len(*meets)]);
                *columns = bits.fold(0, |sum, (bit, of_kind): (u32, &u32)| {
                    sum | (of_kind & 0u32.wrapping_sub(meets >> bit & 1))
                });
            }
        }
    }
}

/// Kinds up to the last that is met.
const fn meets_len(meets: u32) -> usize {
    (u32::BITS - meets.leading_zeros()) as usize
}

#[cfg(test)]
mod tests {
    // Rules are filled as users fill them.
    #![allow(clippy::field_reassign_with_default)]

    use super::super::tests::Random;
    use super::*;
    use crate::engine::Isa;
    use crate::filters::{Filter, FilterId, FilterTable};

    fn rules(random: &mut Random, n: usize, filters: u64) -> Rules {
        let mut rules = Rules::default();
        let table: Vec<Filter> =
            (0..filters).map(|_| Filter::new(random.below(16), random.below(16))).collect();
        rules.table = FilterTable::new(&table).expect("few filters");
        let worlds = [World(3), World(4), World::ALL];
        rules.filter_data = (0..n)
            .map(|_| {
                let owner = Owner(random.below(4) as u32);
                let filter = FilterId(random.below(filters + 1) as u16);
                let filter_data = FilterData::new(worlds[random.below(3) as usize], owner, filter);
                filter_data.with_static(random.below(5) == 0)
            })
            .collect();
        rules
    }

    #[test]
    fn words_are_sifted_alike_by_all_instruction_sets_and_by_the_rules() {
        let mut random = Random(61);
        for (n, filters) in [(65, 3), (96, 15), (1_000, 9), (9_001, 15)] {
            let rules = rules(&mut random, n, filters);
            let mut order: Vec<u32> = (0..n as u32).collect();
            for at in (1..n).rev() {
                order.swap(at, random.below(at as u64 + 1) as usize);
            }
            let blocks = n.div_ceil(BLOCK) as u64;
            let word = |random: &mut Random| {
                let block = random.below(blocks) as u32;
                let within = (n as u32 - 32 * block).min(32);
                let bits = random.below(1 << 32) as u32 & (u64::MAX >> (64 - within)) as u32;
                [random.below(n as u64) as u32, block, bits & random.below(1 << 32) as u32]
            };
            let words: Vec<[u32; 3]> = (0..777).map(|_| word(&mut random)).collect();
            let of = |at: usize| words.iter().map(|word| word[at]).collect::<Vec<u32>>();
            for by_pair in [(false, false), (true, false), (false, true), (true, true)] {
                let by_pair = ByPair { owners: by_pair.0, worlds: by_pair.1 };
                let meets = |a: u32, b: u32| {
                    let filter_data = |at: u32| {
                        let filter_data = rules.filter_data(order[at as usize]);
                        let filter_data = if by_pair.owners {
                            filter_data
                        } else {
                            filter_data.with_owner(Owner::NONE)
                        };
                        if by_pair.worlds { filter_data } else { filter_data.with_world(World(0)) }
                    };
                    crate::filters::decide(
                        &filter_data(a),
                        &filter_data(b),
                        &rules.table,
                        Default::default,
                    )
                };
                let kept = |[row, block, bits]: &[u32; 3]| {
                    let columns = (0..32).filter(|column| bits >> column & 1 == 1);
                    let pass = columns.filter(|column| meets(*row, 32 * block + column));
                    let bits = pass.fold(0, |bits, column| bits | 1 << column);
                    (bits != 0).then_some([*row, *block, bits])
                };
                let expected: Vec<[u32; 3]> = words.iter().filter_map(kept).collect();
                assert!(!expected.is_empty() && expected.len() < words.len());
                let ones = |words: &[[u32; 3]]| {
                    words.iter().map(|word| u64::from(word[2].count_ones())).sum::<u64>()
                };
                let went = ones(&words) - ones(&expected);
                for isa in Isa::ALL.into_iter().filter_map(AvailableIsa::new) {
                    let mut laid = Laid::default();
                    let filter_data = |culled| rules.filter_data(culled);
                    assert!(laid.lay_out((&rules, by_pair), n, &order, filter_data, 1));
                    let (mut rows, mut blocks, mut bits) = (of(0), of(1), of(2));
                    let (kept, ended) = laid.sift([&mut rows, &mut blocks, &mut bits], isa);
                    let kept: Vec<[u32; 3]> =
                        (0..kept).map(|at| [rows[at], blocks[at], bits[at]]).collect();
                    assert!(kept == expected, "{n} boxes, {by_pair:?}, {}", isa.get());
                    assert_eq!(ended, went);
                }
            }
        }
    }

    #[test]
    fn too_many_kinds_are_not_laid_out() {
        let mut rules = Rules::default();
        rules.table = FilterTable::new(&[Filter::ALL; 40]).expect("few filters");
        rules.filter_data =
            (0..100).map(|at| FilterData::default().with_filter(FilterId(at % 33))).collect();
        let lay_out = |rules: &Rules| {
            let filter_data = |index| rules.filter_data(index);
            Laid::default().lay_out((rules, ByPair::default()), 100, &[], filter_data, 1)
        };
        assert!(!lay_out(&rules));
        rules.filter_data.truncate(32);
        rules.filter_data.resize(100, FilterData::default());
        assert!(lay_out(&rules));
    }
}
