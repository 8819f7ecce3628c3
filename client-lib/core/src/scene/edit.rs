//! Edits: what changes in a scene from one answer to the next, in place.
//!
//! An edit names boxes by the client's own indices. It borrows the client's arrays and is read where
//! they lie, up to three times: once to check it, once to apply it, once for the answer.

use bytemuck::{Pod, Zeroable};

pub use super::indices::Indices;
use crate::aabb::Aabb;
use crate::filters::{FilterData, FilterTable};

/// Indices of a list that are looked at before it is known whether they rise.
const CHECKED_TOGETHER: usize = 1 << 12;

/// Boxes and where they belong: the box at a place belongs to the index at the same place.
#[derive(Clone, Copy, Debug)]
pub struct Sets<'a> {
    /// The indices.
    pub indices: Indices<'a>,
    /// A box for each.
    pub boxes: &'a [Aabb],
}

/// Filter data and where they belong: the entry at a position belongs to the index at the same place.
#[derive(Clone, Copy, Debug)]
pub struct FilterDataSets<'a> {
    /// The indices.
    pub indices: Indices<'a>,
    /// Filter data for each.
    pub filter_data: &'a [FilterData],
}

/// A number of the client's own that a box carries: the index of a body, or an address. The bytes of a u64, as two words, so
/// that it may lie where words do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Pod, Zeroable)]
#[repr(transparent)]
pub struct UserData([u32; 2]);

impl From<u64> for UserData {
    fn from(number: u64) -> Self {
        bytemuck::cast(number)
    }
}

impl From<UserData> for u64 {
    fn from(user_data: UserData) -> Self {
        bytemuck::cast(user_data)
    }
}

/// User data and where they belong: the entry at a position belongs to the index at the same place.
#[derive(Clone, Copy, Debug)]
pub struct UserDataSets<'a> {
    /// The indices.
    pub indices: Indices<'a>,
    /// User data for each.
    pub user_data: &'a [UserData],
}

/// What a step of an edit does.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Step<'a> {
    /// Removes boxes.
    Remove(Indices<'a>),
    /// Sets boxes; inserts those that are absent, enabled and not static.
    Set(Sets<'a>),
    /// Disables boxes (`false`: they overlap nothing and stay what they are) or enables them.
    Enable(Indices<'a>, bool),
    /// Makes boxes static (`true`: two static boxes are no pair) or not.
    Static(Indices<'a>, bool),
    /// Gives boxes their [filter data](crate::filters). A box that is inserted has [`FilterData::default`].
    /// [`Static`](Self::Static) says whether a box itself is static, and not its filter data.
    FilterData(FilterDataSets<'a>),
    /// Gives boxes user data, which change nothing that is reported. A box that is inserted has 0.
    UserData(UserDataSets<'a>),
    /// The filters that filter data names, in place of all before.
    Filters(&'a FilterTable),
    /// Puts pairs of indices on the include list, or takes them off.
    Include(&'a [[u32; 2]], bool),
    /// Puts pairs of indices on the exclude list, or takes them off.
    Exclude(&'a [[u32; 2]], bool),
}

impl Step<'_> {
    /// The indices of boxes that it names, but for those of listed pairs.
    pub(super) const fn indices(&self) -> Option<Indices<'_>> {
        match self {
            Self::Remove(indices)
            | Self::Set(Sets { indices, .. })
            | Self::Enable(indices, _)
            | Self::Static(indices, _)
            | Self::FilterData(FilterDataSets { indices, .. })
            | Self::UserData(UserDataSets { indices, .. }) => Some(*indices),
            Self::Filters(_) | Self::Include(..) | Self::Exclude(..) => None,
        }
    }

    /// Whether it is about collision filters.
    pub const fn is_rule(&self) -> bool {
        matches!(
            self,
            Self::FilterData(_) | Self::Filters(_) | Self::Include(..) | Self::Exclude(..)
        )
    }
}

/// An edit: steps, which are done in the order of their kinds, regardless of the order in the slice: all
/// removals, all sets, then enabled and static flags in the order given, then what is about rules, then user data.
///
/// An index may be removed and set in one edit: it is another box then, whose pairs all begin.
///
/// ```
/// use pairmask_core::Aabb;
/// use pairmask_core::scene::{Edit, Scene, SceneOptions, Sets, Step, Report};
///
/// let boxes = [[0.0, 1.0], [0.5, 2.0]].map(|[a, b]| Aabb::new([a; 3], [b; 3]));
/// let mut scene = Scene::new(SceneOptions::default());
/// let steps = [Step::Set(Sets { indices: (7..9).into(), boxes: &boxes })];
/// let reported = scene.edit(Edit { steps: &steps }, Report::Changes)?;
/// assert_eq!(reported.begun(), [[7, 8]]);
/// # Ok::<(), pairmask_core::scene::SceneError>(())
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct Edit<'a> {
    /// The steps.
    pub steps: &'a [Step<'a>],
}

impl<'a> Edit<'a> {
    /// Nothing changes.
    pub const NONE: Edit<'static> = Edit { steps: &[] };

    /// Boxes that it sets.
    pub fn boxes(&self) -> usize {
        self.sets().map(|sets| sets.boxes.len()).sum()
    }

    /// What it sets, step by step.
    pub fn sets(&self) -> impl Iterator<Item = &'a Sets<'a>> + use<'a> {
        self.steps.iter().filter_map(|step| match step {
            Step::Set(sets) => Some(sets),
            _ => None,
        })
    }

    /// Whether it sets boxes of rising indices and does nothing else: no index is named twice then.
    pub(super) fn is_plainly_right(&self) -> bool {
        let mut end = 0;
        self.steps.iter().all(|step| {
            let Step::Set(Sets { indices, .. }) = step else { return false };
            let (first, last) = match *indices {
                Indices::List([]) => return true,
                Indices::List(list) if !rises(list) => return false,
                Indices::List(list) => (list[0], list.last().map(|last| u64::from(*last))),
                Indices::Range { first, .. } | Indices::Mask { first, .. } => {
                    (first, indices.last())
                }
            };
            let begins_behind = u64::from(first) >= end;
            end = last.map_or(end, |last| last + 1);
            begins_behind || last.is_none()
        })
    }

    /// Indices that it sets are below this.
    pub fn index_end(&self) -> u64 {
        self.last_set().map_or(0, |last| last + 1)
    }

    /// The largest index that is set, in 64 bits.
    pub(super) fn last_set(&self) -> Option<u64> {
        self.sets().filter_map(|sets| sets.indices.last()).max()
    }

    /// Whether all indices of boxes that it names are below this.
    pub(super) fn names_below(&self, limit: u32) -> bool {
        let last = self.last_set().max(self.last_named());
        last.is_none_or(|last| last < u64::from(limit))
    }

    /// The largest index that a step names without setting it, in 64 bits.
    pub(super) fn last_named(&self) -> Option<u64> {
        let last = |step: &Step<'_>| match step {
            Step::Remove(indices)
            | Step::Enable(indices, _)
            | Step::Static(indices, _)
            | Step::FilterData(FilterDataSets { indices, .. })
            | Step::UserData(UserDataSets { indices, .. }) => indices.last(),
            _ => None,
        };
        self.steps.iter().filter_map(last).max()
    }

    /// The largest index that an edit puts on a list of pairs, or takes off.
    pub fn last_listed(&self) -> Option<u32> {
        let last = |step: &Step<'_>| match step {
            Step::Include(pairs, _) | Step::Exclude(pairs, _) => {
                pairs.as_flattened().iter().copied().max()
            }
            _ => None,
        };
        self.steps.iter().filter_map(last).max()
    }

    /// The first step whose boxes or filter data are not as many as its indices: indices and those.
    pub fn uneven(&self) -> Option<(usize, usize)> {
        let mut lengths = self.steps.iter().filter_map(|step| match step {
            Step::Set(Sets { indices, boxes }) => Some((indices.len(), boxes.len())),
            Step::FilterData(FilterDataSets { indices, filter_data }) => {
                Some((indices.len(), filter_data.len()))
            }
            Step::UserData(UserDataSets { indices, user_data }) => {
                Some((indices.len(), user_data.len()))
            }
            _ => None,
        });
        lengths.find(|(indices, entries)| indices != entries)
    }

    /// The indices that it removes.
    #[inline]
    pub fn for_each_removed(&self, mut f: impl FnMut(u32)) {
        for step in self.steps {
            if let Step::Remove(indices) = step {
                indices.for_each(|_, i| f(i));
            }
        }
    }

    #[inline]
    pub(super) fn for_each_set(&self, mut f: impl FnMut(u32, &'a Aabb)) {
        for step in self.steps {
            if let Step::Set(Sets { indices, boxes }) = step {
                indices.for_each(|at, i| f(i, &boxes[at]));
            }
        }
    }

    /// Enabled and static flags, in the order given.
    #[inline]
    pub(super) fn for_each_flag(&self, mut f: impl FnMut(u32, Flag)) {
        for step in self.steps {
            match *step {
                Step::Enable(indices, on) => indices.for_each(|_, i| f(i, Flag::On(on))),
                Step::Static(indices, on) => indices.for_each(|_, i| f(i, Flag::Static(on))),
                _ => {}
            }
        }
    }

    /// Filter data, in the order given.
    pub(super) fn for_each_filter_data(&self, mut f: impl FnMut(u32, FilterData)) {
        for step in self.steps {
            if let Step::FilterData(FilterDataSets { indices, filter_data }) = step {
                indices.for_each(|at, i| f(i, filter_data[at]));
            }
        }
    }

    /// User data, in the order given.
    pub fn for_each_user_data(&self, mut f: impl FnMut(u32, u64)) {
        for step in self.steps {
            if let Step::UserData(UserDataSets { indices, user_data }) = step {
                indices.for_each(|at, index| f(index, user_data[at].into()));
            }
        }
    }

    /// Whether it gives user data.
    pub(super) fn gives_user_data(&self) -> bool {
        self.steps.iter().any(|step| matches!(step, Step::UserData(_)))
    }

    /// The indices that it [names](super::Report::Moved), some of them twice, but for those that its table of filters
    /// names alone.
    pub(super) fn for_each_named(&self, mut f: impl FnMut(u32)) {
        self.for_each_set(|index, _| f(index));
        self.for_each_flag(|index, _| f(index));
        self.for_each_filter_data(|index, _| f(index));
        for step in self.steps {
            if let Step::Include(pairs, _) | Step::Exclude(pairs, _) = step {
                pairs.as_flattened().iter().for_each(|index| f(*index));
            }
        }
    }

    /// Bytes that its rules may take where they are kept, beside filter data.
    pub fn rule_bytes(&self) -> usize {
        /// A pair in the tables of now and of then, half of whose places are free.
        const PAIR_BYTES: usize = 64;
        let bytes = |step: &Step<'_>| match step {
            Step::Filters(table) => 2 * table.allocated_bytes(),
            Step::Include(pairs, _) | Step::Exclude(pairs, _) => PAIR_BYTES * pairs.len(),
            Step::FilterData(FilterDataSets { filter_data, .. }) => PAIR_BYTES * filter_data.len(),
            _ => 0,
        };
        self.steps.iter().map(bytes).sum()
    }

    /// Bytes that its user data may take where they are kept: up to the last index that has any.
    pub fn user_data_bytes(&self) -> u64 {
        let last = |step: &Step<'_>| match step {
            Step::UserData(UserDataSets { indices, .. }) => indices.last(),
            _ => None,
        };
        let end = self.steps.iter().filter_map(last).max().map_or(0, |last| last + 1);
        end * size_of::<u64>() as u64
    }

    /// Whether it gives filter data other than those that boxes have without any.
    pub(super) fn gives_filter_data(&self) -> bool {
        self.steps.iter().any(|step| match step {
            Step::FilterData(FilterDataSets { filter_data, .. }) => filter_data
                .iter()
                .any(|filter_data| filter_data.with_static(false) != FilterData::default()),
            Step::Filters(table) => !table.filters().is_empty(),
            Step::Include(pairs, on) | Step::Exclude(pairs, on) => *on && !pairs.is_empty(),
            _ => false,
        })
    }

    /// Whether it gives a table of filters.
    pub fn has_table(&self) -> bool {
        self.steps.iter().any(|step| matches!(step, Step::Filters(_)))
    }

    /// Whether a step of it is about rules.
    pub fn has_rules(&self) -> bool {
        self.steps.iter().any(Step::is_rule)
    }
}

/// Whether each index is larger than the one before: counted without a branch an index, which takes a tenth of a
/// nanosecond.
fn rises(list: &[u32]) -> bool {
    let falls = |at: usize| {
        let some = &list[at..list.len().min(at + CHECKED_TOGETHER + 1)];
        some.windows(2).map(|pair| u32::from(pair[0] >= pair[1])).sum::<u32>()
    };
    (0..list.len()).step_by(CHECKED_TOGETHER).all(|at| falls(at) == 0)
}

/// A flag of a box and its new value.
#[derive(Clone, Copy, Debug)]
pub(super) enum Flag {
    On(bool),
    Static(bool),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_edits_that_set_rising_indices_are_plainly_right() {
        let boxes = vec![Aabb::EMPTY; 5_000];
        let is_right = |all: &[Indices<'_>]| {
            let boxes = &boxes;
            let sets = all.iter().map(|indices| Sets { indices: *indices, boxes });
            let steps: Vec<Step<'_>> = sets.map(Step::Set).collect();
            Edit { steps: &steps }.is_plainly_right()
        };
        let mut list: Vec<u32> = (0..5_000).collect();
        let range = |first, count| Indices::Range { first, count };
        let mask = Indices::Mask { first: 40, words: &[0, 1 << 7] };
        let (empty, seven) = (Indices::List(&[]), Indices::List(&[7_000]));
        assert!(is_right(&[]) && is_right(&[empty]) && is_right(&[(&list).into()]));
        assert!(is_right(&[(&list).into(), range(5_000, 1), range(2, 0), empty, seven]));
        assert!(!is_right(&[(&list).into(), range(4_999, 2)]) && !is_right(&[seven, seven]));
        assert!(is_right(&[range(3, 37), mask, range(80, 9)]) && !is_right(&[range(3, 38), mask]));
        assert!(!is_right(&[mask, range(79, 9)]) && !is_right(&[range(9, 3), range(3, 2)]));
        for at in [0, 1, 4_095, 4_096, 4_998] {
            list[at] = at as u32 + 1;
            assert!(!is_right(&[(&list).into()]), "{at}");
            list[at] = at as u32;
        }
        assert!(!Edit { steps: &[Step::Remove(mask)] }.is_plainly_right());
    }
}
