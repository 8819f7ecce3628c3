//! Ranges of indices, each of one member.

use std::collections::{BTreeMap, HashSet};
use std::ops::Range;

use super::MemberId;
use crate::scene::edit::{Edit, FilterDataSets, Indices, Sets, Step, UserDataSets};

/// Leases that one scene may have: a member that leases index by index would be work without end.
const MOST_LEASES: usize = 4_096;

/// Why a range is not leased, or not given back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LeaseError {
    /// The range is empty.
    #[error("a lease of no index: name at least one")]
    Empty,
    /// It ends beyond what the scene may hold.
    #[error("a lease up to index {end} is beyond the {limit} boxes that this scene may hold")]
    BeyondLimit {
        /// End of the range, in 64 bits.
        end: u64,
        /// Boxes that the scene may hold.
        limit: u32,
    },
    /// A part of it is leased.
    #[error("indices {first} to {end} are leased already")]
    Taken {
        /// First index of the lease that is there.
        first: u32,
        /// Its end.
        end: u32,
    },
    /// No free range is as long.
    #[error("no {count} free indices follow each other")]
    Full {
        /// Indices asked for.
        count: u32,
    },
    /// The scene has as many leases as it may.
    #[error("a scene has at most {limit} leases")]
    TooMany {
        /// How many it may have.
        limit: usize,
    },
    /// The member has no such lease.
    #[error("no lease of this member begins at index {first}")]
    NotHeld {
        /// First index of the range.
        first: u32,
    },
}

/// An edit of a member names what is not its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotLeased {
    /// An index of no lease of the member. Lists of pairs need both.
    #[error("index {index} is not leased by this member")]
    Index {
        /// The index, in 64 bits.
        index: u64,
    },
    /// The table of filters is given by the writer with the lowest lease alone.
    #[error("filters are given by the writer with the lowest lease")]
    Filters,
}

#[derive(Clone, Copy, Debug)]
struct Lease {
    end: u32,
    member: MemberId,
}

/// The leases of a scene, none of which overlap.
#[derive(Clone, Debug, Default)]
pub struct Leases {
    by_first: BTreeMap<u32, Lease>,
}

impl Leases {
    /// Leases a range to a member.
    ///
    /// # Errors
    /// [`LeaseError`]; nothing is leased then.
    pub fn take(
        &mut self,
        member: MemberId,
        range: Range<u32>,
        limit: u32,
    ) -> Result<(), LeaseError> {
        if range.is_empty() {
            return Err(LeaseError::Empty);
        }
        if range.end > limit {
            return Err(LeaseError::BeyondLimit { end: u64::from(range.end), limit });
        }
        if self.by_first.len() >= MOST_LEASES {
            return Err(LeaseError::TooMany { limit: MOST_LEASES });
        }
        // The last lease that begins before the end is the one that can overlap.
        let before = self.by_first.range(..range.end).next_back();
        if let Some((first, lease)) = before.filter(|(_, lease)| lease.end > range.start) {
            return Err(LeaseError::Taken { first: *first, end: lease.end });
        }
        self.by_first.insert(range.start, Lease { end: range.end, member });
        Ok(())
    }

    /// Leases the lowest free range of `count` indices.
    ///
    /// # Errors
    /// [`LeaseError`].
    pub fn take_any(
        &mut self,
        member: MemberId,
        count: u32,
        limit: u32,
    ) -> Result<Range<u32>, LeaseError> {
        let mut start = 0;
        for (first, lease) in &self.by_first {
            if first - start >= count {
                break;
            }
            start = lease.end;
        }
        let full = LeaseError::Full { count };
        let end = start.checked_add(count).filter(|end| *end <= limit).ok_or(full)?;
        self.take(member, start..end, limit)?;
        Ok(start..end)
    }

    /// Ends the lease of a member that begins at an index.
    ///
    /// # Errors
    /// [`LeaseError::NotHeld`].
    pub fn give_back(&mut self, member: MemberId, first: u32) -> Result<Range<u32>, LeaseError> {
        let held = self.by_first.get(&first).filter(|lease| lease.member == member);
        let end = held.ok_or(LeaseError::NotHeld { first })?.end;
        self.by_first.remove(&first);
        Ok(first..end)
    }

    /// Ends all leases of a member.
    pub fn end(&mut self, member: MemberId) -> Vec<Range<u32>> {
        let ended = self.of(member).0;
        self.by_first.retain(|_, lease| lease.member != member);
        ended
    }

    /// The ranges of a member, rising.
    pub fn of(&self, member: MemberId) -> Ranges {
        let own = self.by_first.iter().filter(|(_, lease)| lease.member == member);
        Ranges(own.map(|(first, lease)| *first..lease.end).collect())
    }

    /// The members that have leases, in the order of their lowest indices.
    pub fn writers(&self) -> Vec<MemberId> {
        let mut seen = HashSet::new();
        let members = self.by_first.values().map(|lease| lease.member);
        members.filter(|member| seen.insert(*member)).collect()
    }

    /// The writer with the lowest lease.
    pub fn first_writer(&self) -> Option<MemberId> {
        self.by_first.values().next().map(|lease| lease.member)
    }
}

/// Rising ranges of indices that do not overlap.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Ranges(Vec<Range<u32>>);

impl Ranges {
    /// The ranges.
    pub fn as_slice(&self) -> &[Range<u32>] {
        &self.0
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether an index is in one of them.
    #[inline]
    pub fn has(&self, index: u32) -> bool {
        match self.0.as_slice() {
            [only] => only.contains(&index),
            ranges => {
                let at = ranges.partition_point(|range| range.end <= index);
                ranges.get(at).is_some_and(|range| range.start <= index)
            }
        }
    }

    /// The first of the indices from one to another that is in none of them. Without a look at each: a few bytes name
    /// 2^32.
    fn first_outside(&self, first: u32, last: u32) -> Option<u32> {
        let behind = self.0.partition_point(|range| range.end <= first);
        let mut next = first;
        for range in &self.0[behind..] {
            if next > last || next < range.start {
                break;
            }
            next = range.end;
        }
        (next <= last).then_some(next)
    }

    /// Whether all of an edit is about indices of these ranges. `is_first` says whether they are those of
    /// the writer with the lowest lease, who may give the table of filters.
    ///
    /// # Errors
    /// [`NotLeased`] with the first index that is not.
    pub fn allow(&self, edit: Edit<'_>, is_first: bool) -> Result<(), NotLeased> {
        let check = |indices: &Indices<'_>| {
            let beyond = indices.last().filter(|last| *last > u64::from(u32::MAX));
            if let Some(index) = beyond {
                return Err(NotLeased::Index { index });
            }
            let wrong = match *indices {
                Indices::Range { count: 0, .. } => None,
                Indices::Range { first, count } => self.first_outside(first, first + (count - 1)),
                _ => {
                    let mut wrong = None;
                    indices.for_each(|_, index| {
                        if !self.has(index) {
                            wrong = wrong.or(Some(index));
                        }
                    });
                    wrong
                }
            };
            wrong.map_or(Ok(()), |index| Err(NotLeased::Index { index: u64::from(index) }))
        };
        for step in edit.steps {
            match step {
                Step::Remove(indices)
                | Step::Enable(indices, _)
                | Step::Static(indices, _)
                | Step::Set(Sets { indices, .. })
                | Step::FilterData(FilterDataSets { indices, .. })
                | Step::UserData(UserDataSets { indices, .. }) => check(indices)?,
                Step::Include(pairs, _) | Step::Exclude(pairs, _) => {
                    check(&Indices::List(pairs.as_flattened()))?;
                }
                Step::Filters(_) if !is_first => return Err(NotLeased::Filters),
                Step::Filters(_) => {}
            }
        }
        Ok(())
    }
}

impl FromIterator<Range<u32>> for Ranges {
    /// From ranges that do not overlap, in any order. Those that follow each other become one.
    fn from_iter<I: IntoIterator<Item = Range<u32>>>(ranges: I) -> Self {
        let mut all: Vec<_> = ranges.into_iter().filter(|range| !range.is_empty()).collect();
        all.sort_unstable_by_key(|range| range.start);
        all.dedup_by(|next, last| {
            let follows = last.end == next.start;
            if follows {
                last.end = next.end;
            }
            follows
        });
        Self(all)
    }
}

#[cfg(test)]
#[allow(clippy::single_range_in_vec_init)] // Lists of ranges are meant.
mod tests {
    use super::*;
    use crate::aabb::Aabb;
    use crate::filters::FilterTable;

    const A: MemberId = MemberId(1);
    const B: MemberId = MemberId(2);

    #[test]
    fn ranges_belong_to_one_member_each() {
        let mut leases = Leases::default();
        assert_eq!(leases.take(A, 10..20, 100), Ok(()));
        for (range, error) in [
            (5..5, LeaseError::Empty),
            (90..101, LeaseError::BeyondLimit { end: 101, limit: 100 }),
            (0..11, LeaseError::Taken { first: 10, end: 20 }),
            (19..30, LeaseError::Taken { first: 10, end: 20 }),
            (0..100, LeaseError::Taken { first: 10, end: 20 }),
            (12..13, LeaseError::Taken { first: 10, end: 20 }),
        ] {
            assert_eq!(leases.take(B, range, 100), Err(error));
        }
        assert_eq!(leases.take(B, 20..30, 100), Ok(()));
        assert_eq!(leases.take_any(B, 10, 100), Ok(0..10));
        assert_eq!(leases.take_any(A, 70, 100), Ok(30..100));
        assert_eq!(leases.take_any(A, 1, 100), Err(LeaseError::Full { count: 1 }));
        assert_eq!(leases.writers(), [B, A]);
        assert_eq!(leases.first_writer(), Some(B));
        assert_eq!(leases.give_back(B, 10), Err(LeaseError::NotHeld { first: 10 }));
        assert_eq!(leases.give_back(A, 10), Ok(10..20));
        assert_eq!(leases.end(B), [0..10, 20..30]);
        assert_eq!(leases.writers(), [A]);
        assert_eq!(leases.of(A).as_slice(), &[30..100][..]);
    }

    #[test]
    fn leases_are_not_without_end() {
        let mut leases = Leases::default();
        for first in 0..MOST_LEASES as u32 {
            assert!(leases.take(A, first..first + 1, u32::MAX).is_ok());
        }
        let refused = leases.take(A, 1 << 20..1 << 21, u32::MAX);
        assert_eq!(refused, Err(LeaseError::TooMany { limit: MOST_LEASES }));
    }

    #[test]
    fn a_range_is_not_looked_at_index_by_index() {
        let mut leases = Leases::default();
        for range in [0..1 << 31, 1 << 31..u32::MAX] {
            leases.take(A, range, u32::MAX).expect("free");
        }
        let all = Step::Remove((0..u32::MAX).into());
        let steps = vec![all; 100_000];
        assert_eq!(leases.of(A).allow(Edit { steps: &steps }, false), Ok(()));
    }

    #[test]
    fn an_edit_names_its_own_indices_alone() {
        let own: Ranges = [20..30, 5..10, 10..12].into_iter().collect();
        assert_eq!(own.as_slice(), &[5..12, 20..30][..]);
        let all: Vec<u32> = (0..40).filter(|index| own.has(*index)).collect();
        assert_eq!(all, (5..12).chain(20..30).collect::<Vec<_>>());
        let allow = |step: Step<'_>| own.allow(Edit { steps: &[step] }, false);
        let wrong = |index| Err(NotLeased::Index { index });
        assert_eq!(allow(Step::Remove((5..12).into())), Ok(()));
        assert_eq!(allow(Step::Remove((5..13).into())), wrong(12));
        assert_eq!(allow(Step::Remove((9..25).into())), wrong(12));
        assert_eq!(allow(Step::Remove((15..25).into())), wrong(15));
        assert_eq!(allow(Step::Remove((29..40).into())), wrong(30));
        assert_eq!(allow(Step::Remove(Indices::Range { first: 99, count: 0 })), Ok(()));
        assert_eq!(allow(Step::Enable((&[29, 5]).into(), true)), Ok(()));
        assert_eq!(allow(Step::Static((&[29, 30]).into(), true)), wrong(30));
        let far = Indices::Range { first: u32::MAX, count: 2 };
        assert_eq!(allow(Step::Remove(far)), wrong(1 << 32));
        let far = Indices::Mask { first: 20, words: &[0b11, 1 << 31] };
        assert_eq!(allow(Step::Remove(far)), wrong(83));
        let boxes = [Aabb::EMPTY];
        assert_eq!(allow(Step::Set(Sets { indices: (&[4]).into(), boxes: &boxes })), wrong(4));
        assert_eq!(allow(Step::Include(&[[5, 29]], true)), Ok(()));
        assert_eq!(allow(Step::Exclude(&[[5, 19]], true)), wrong(19));
        let table = FilterTable::default();
        assert_eq!(allow(Step::Filters(&table)), Err(NotLeased::Filters));
        assert_eq!(own.allow(Edit { steps: &[Step::Filters(&table)] }, true), Ok(()));
    }
}
