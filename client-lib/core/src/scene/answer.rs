//! What a scene reports: pairs that began and ended, or pairs that there are.

use std::sync::Arc;

use super::pair_list::Pair;
use crate::engine::PairSkips;

/// Changes that are reported as such even where all pairs are fewer: 32 KiB.
const RESYNC_LEAST: u64 = 4_096;

/// Whether so many changes are reported as a resync: the `pair_count` pairs of now are fewer.
pub const fn is_resync_due(changes: u64, pair_count: u64) -> bool {
    changes > if pair_count > RESYNC_LEAST { pair_count } else { RESYNC_LEAST }
}

/// Which answer a client asks of an edit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Report {
    /// Pairs that began and ended since the last answer that was acknowledged: by a session, waited for.
    #[default]
    Changes,
    /// Pairs of now with at least one box that this edit named: that it set, enabled or disabled, made static or not,
    /// or gave filter data, or that is in a pair which it listed, whether that changed anything or not; and those whose
    /// filter is another one by the edit's new table. In a [shared scene](super::shared), boxes that the edit of any
    /// member named at a tick since the last answer that this member received, regardless of what that reported; all boxes
    /// where it has received none.
    Moved,
    /// All pairs of now.
    All,
    /// Nothing: the edit is applied.
    Nothing,
}

/// Why a pair ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum EndReason {
    /// A box of the pair was removed, also where its index has a new box.
    Removed,
    /// A box of the pair is disabled now, both are static now, or [rules](crate::filters) keep them apart.
    Filtered,
    /// The boxes overlap no more.
    Separated,
}

/// A pair that ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Ended {
    /// The indices, smaller one first.
    pub pair: [u32; 2],
    /// Why.
    pub reason: EndReason,
}

/// Work that an answer left out. Pairs are those of boxes that are present and enabled: n(n − 1)/2
/// of n boxes. Each is counted once: as tested or by the first reason that holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct SceneSkips {
    /// Boxes that were not looked at, besides as neighbours of others.
    pub boxes: u64,
    /// Pairs of two static boxes.
    pub static_pairs: u64,
    /// Pairs of two boxes that have not changed since the last answer that was acknowledged: by a session, waited for.
    pub unmoved_pairs: u64,
    /// Pairs of boxes in cells too far apart, and those that an engine left out.
    pub cell_pairs: u64,
    /// Boxes in cells that were compared with another.
    pub tested: u64,
}

impl SceneSkips {
    /// The numbers, in the order of the fields.
    pub const fn to_array(self) -> [u64; 5] {
        let Self { boxes, static_pairs, unmoved_pairs, cell_pairs, tested } = self;
        [boxes, static_pairs, unmoved_pairs, cell_pairs, tested]
    }

    /// What [`to_array`](Self::to_array) gave.
    pub const fn from_array(numbers: [u64; 5]) -> Self {
        let [boxes, static_pairs, unmoved_pairs, cell_pairs, tested] = numbers;
        Self { boxes, static_pairs, unmoved_pairs, cell_pairs, tested }
    }

    /// Pairs that were not tested.
    pub const fn pairs(&self) -> u64 {
        self.static_pairs.saturating_add(self.unmoved_pairs).saturating_add(self.cell_pairs)
    }

    /// Pairs that were not tested, by reason, as whole frames count them.
    pub const fn why(&self) -> PairSkips {
        PairSkips::of_scene(self.static_pairs, self.unmoved_pairs, self.cell_pairs)
    }

    /// The meter of an answer. Of the boxes that are `active`, so many are static; of these numbers, those that were looked
    /// at are `moved`. So many pairs were `tested`.
    pub const fn of(
        [active, statics]: [u64; 2],
        [moved, moved_statics]: [u64; 2],
        tested: u64,
    ) -> Self {
        const fn pairs(n: u64) -> u64 {
            n * n.saturating_sub(1) / 2
        }
        let static_pairs = pairs(statics);
        let unmoved = pairs(active - moved).saturating_sub(pairs(statics - moved_statics));
        let rest = pairs(active).saturating_sub(static_pairs + unmoved);
        Self {
            boxes: active - moved,
            static_pairs,
            unmoved_pairs: unmoved,
            cell_pairs: rest.saturating_sub(tested),
            tested,
        }
    }
}

/// An answer. All its lists are sorted by (a, b), a < b: the bytes are the same regardless of the number of
/// threads, and however the pairs were found.
#[derive(Clone, Debug, Default)]
pub struct Reported {
    pub(super) report: Report,
    pub(super) resync: bool,
    pub(super) begun: Vec<Pair>,
    pub(super) ended: Vec<Ended>,
    pub(super) pairs: Arc<Vec<Pair>>,
    pub(super) pair_count: u64,
    pub(super) skipped: SceneSkips,
}

/// Answers of a scene that is kept elsewhere, as on a GPU: for who keeps it. Lists are sorted.
impl Reported {
    /// Pairs that began and ended, for [`Report::Changes`].
    pub fn of_changes(begun: Vec<[u32; 2]>, ended: Vec<Ended>, pair_count: u64) -> Self {
        Self { report: Report::Changes, begun, ended, pair_count, ..Self::default() }
    }

    /// Pairs of now, for [`Report::All`], [`Report::Moved`], and [`Report::Changes`] where it is a resync.
    /// `pair_count` are those of the whole scene, where the answer reports them.
    pub fn of_pairs(report: Report, pairs: Arc<Vec<[u32; 2]>>, pair_count: u64) -> Self {
        Self { report, resync: report == Report::Changes, pairs, pair_count, ..Self::default() }
    }

    /// An answer without pairs.
    pub fn of_none(report: Report, pair_count: u64) -> Self {
        Self { report, pair_count, ..Self::default() }
    }

    /// The same with a skip meter.
    #[must_use]
    pub fn with_skips(self, skipped: SceneSkips) -> Self {
        Self { skipped, ..self }
    }

    /// The lists of what began and ended, for their memory.
    pub fn into_changes(self) -> (Vec<[u32; 2]>, Vec<Ended>) {
        (self.begun, self.ended)
    }
}

impl Reported {
    /// Which answer was asked for.
    pub const fn report(&self) -> Report {
        self.report
    }

    /// Whether changes were asked for and [`pairs`](Self::pairs) holds all pairs instead: because those
    /// are fewer than the changes, or the scene has lost track of what it reported. The client drops the
    /// pairs that it knows.
    pub const fn is_resync(&self) -> bool {
        self.resync
    }

    /// Pairs that began, for [`Report::Changes`].
    pub fn begun(&self) -> &[[u32; 2]] {
        &self.begun
    }

    /// Pairs that ended, for [`Report::Changes`].
    pub fn ended(&self) -> &[Ended] {
        &self.ended
    }

    /// Pairs of now, for [`Report::All`], [`Report::Moved`] and a [resync](Self::is_resync).
    pub fn pairs(&self) -> &[[u32; 2]] {
        &self.pairs
    }

    /// Pairs of the whole scene, if the answer knows: [`Report::Moved`] and [`Report::Nothing`] do not.
    pub fn pair_count(&self) -> Option<u64> {
        matches!(self.report, Report::Changes | Report::All).then_some(self.pair_count)
    }

    /// Work left out.
    pub const fn skipped(&self) -> &SceneSkips {
        &self.skipped
    }

    /// Bytes that are allocated, beside `pairs`, which a scene may keep as well.
    pub(super) fn allocated_bytes(&self) -> usize {
        self.begun.capacity() * size_of::<Pair>() + self.ended.capacity() * size_of::<Ended>()
    }

    /// An empty answer.
    pub(super) fn begin(&mut self, report: Report) {
        (self.report, self.resync, self.pair_count) = (report, false, 0);
        self.skipped = SceneSkips::default();
        self.begun.clear();
        self.ended.clear();
        self.pairs = Arc::default();
    }
}
