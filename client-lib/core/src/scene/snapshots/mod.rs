//! Snapshots of a scene, to which its client goes back: as games do that predict, and play ticks again.
//!
//! A snapshot costs nothing when it is taken, where all changes were reported; else it copies what has changed since the
//! last acknowledged answer. From then on each edit notes what it is about to change, box by box, once
//! a box and snapshot (`log`). What was noted leads from a snapshot to the next one, and from the last one to the scene
//! as it is. Going back turns these steps around, so that any snapshot can be reached from any other, at the cost of
//! what differs between them (the persistent arrays of Baker, "Shallow binding makes functional arrays fast", 1991).
//!
//! What was reported is part of a snapshot. Where boxes had changed since the last acknowledged answer, the way back
//! has two phases: to the boxes as that answer knew them, whose pairs count as reported, and from there to the
//! boxes of the snapshot (`restore`).

mod log;
mod restore;

use std::collections::BTreeMap;

pub use self::restore::{AfterPhase, RestorePhase};

use self::log::{Delta, Log, Places};
use self::restore::Incarnations;
use super::edit::{Edit, Step};
use super::replica::Replica;
use super::snapshot::HistorySnapshot;

/// A snapshot of a scene: the scene's number of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SnapshotId(u64);

impl SnapshotId {
    /// The snapshot of a number, which another language has kept.
    pub const fn from_number(number: u64) -> Self {
        Self(number)
    }

    /// Its number, which is not 0.
    pub const fn number(self) -> u64 {
        self.0
    }
}

/// The scene has no snapshot of this number, or has forgotten it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the scene has no snapshot {}", id.number())]
#[non_exhaustive]
pub struct UnknownSnapshot {
    /// The number.
    pub id: SnapshotId,
}

/// A scene as its client keeps it: boxes as they were set and as they were sent. Without margins both are the same.
#[derive(Clone, Copy, Debug)]
pub struct Replicas<'a> {
    /// Boxes as they were set.
    pub now: Replica<'a>,
    /// Boxes as they were sent, where they have margins.
    pub sent: Option<Replica<'a>>,
}

/// What was reported of the pairs.
#[derive(Clone, Debug)]
enum History {
    /// It is not known.
    Lost,
    /// Nothing, and there was no box when the history began.
    Unreported,
    /// So many pairs; and what the boxes were then that have changed since.
    Reported(u64, Delta),
}

/// A snapshot, or one that was forgotten and lies on the way between others.
#[derive(Debug)]
struct Node {
    /// `None` of one that was forgotten.
    history: Option<History>,
    /// What boxes were at this snapshot that are others at the next one.
    before: Delta,
    /// The next one on the way to the scene as it is. `None` of the last one, whose `before` is the log.
    next: Option<SnapshotId>,
    /// Those whose next one this is.
    previous: Vec<SnapshotId>,
}

/// The snapshots of a scene, and what was reported of it.
///
/// Who keeps the scene notes each edit ([`note`](Self::note)) and what was acknowledged. Without a snapshot that costs
/// nothing.
#[derive(Debug)]
pub struct Snapshots {
    nodes: BTreeMap<SnapshotId, Node>,
    last_id: u64,
    /// The last snapshot on the way to the scene as it is; `None` without snapshots.
    head: Option<SnapshotId>,
    /// What boxes were at that one which are others now.
    log: Log,
    history: HistorySnapshot,
    /// What boxes were at the last acknowledged answer that have changed since; only with snapshots.
    since: Log,
    /// Whether that is what the log says, which began with it: no box is noted twice then.
    is_since_in_log: bool,
    /// Whether an edit was made since the last acknowledged answer.
    has_changed: bool,
    incarnations: Incarnations,
    /// For deltas that are joined.
    places: Places,
}

impl Default for Snapshots {
    /// Of a scene without boxes, which has reported nothing.
    fn default() -> Self {
        Self {
            nodes: BTreeMap::new(),
            last_id: 0,
            head: None,
            log: Log::default(),
            history: HistorySnapshot::Unreported,
            since: Log::default(),
            is_since_in_log: true,
            has_changed: false,
            incarnations: Incarnations::default(),
            places: Places::default(),
        }
    }
}

impl Snapshots {
    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Whether the next [`take`](Self::take) needs the next changes to be a resync: what boxes were at the last
    /// acknowledged answer was not noted, for lack of a snapshot.
    pub fn needs_resync(&self) -> bool {
        self.is_empty() && self.has_changed && matches!(self.history, HistorySnapshot::Reported(_))
    }

    /// Takes a snapshot of the scene as it is.
    pub fn take(&mut self) -> SnapshotId {
        self.last_id += 1;
        let id = SnapshotId(self.last_id);
        let history = match self.history {
            HistorySnapshot::Lost => History::Lost,
            HistorySnapshot::Unreported => History::Unreported,
            HistorySnapshot::Reported(count) => {
                let since = if self.is_since_in_log { &self.log } else { &self.since };
                History::Reported(count, since.delta().clone())
            }
        };
        if !self.log.delta().is_empty() {
            self.part_since();
        }
        let mut previous = Vec::new();
        if let Some(head) = self.head.replace(id) {
            let before = self.log.take();
            if let Some(node) = self.nodes.get_mut(&head) {
                (node.before, node.next) = (before, Some(id));
            }
            previous.push(head);
        }
        self.is_since_in_log |= self.since.delta().is_empty();
        let before = Delta::default();
        self.nodes.insert(id, Node { history: Some(history), before, next: None, previous });
        id
    }

    /// Has what changed since the last acknowledged answer in a log of its own.
    fn part_since(&mut self) {
        if std::mem::take(&mut self.is_since_in_log) {
            self.since.put(self.log.delta().clone());
        }
    }

    /// Forgets a snapshot. With the last one, edits cost nothing again.
    ///
    /// # Errors
    /// [`UnknownSnapshot`].
    pub fn forget(&mut self, id: SnapshotId) -> Result<(), UnknownSnapshot> {
        let node = self.nodes.get_mut(&id).filter(|node| node.history.is_some());
        node.ok_or(UnknownSnapshot { id })?.history = None;
        if self.nodes.values().all(|node| node.history.is_none()) {
            self.nodes.clear();
            self.head = None;
            (self.log, self.since) = (Log::default(), Log::default());
            self.is_since_in_log = true;
            (self.incarnations, self.places) = Default::default();
        } else {
            self.let_go(id);
        }
        Ok(())
    }

    /// Takes out a forgotten snapshot, unless several ways meet there.
    fn let_go(&mut self, id: SnapshotId) {
        let is_needless = |node: &&Node| node.history.is_none() && node.previous.len() < 2;
        let Some(Node { next, previous, .. }) = self.nodes.get(&id).filter(is_needless) else {
            return;
        };
        let (next, previous) = (*next, previous.first().copied());
        // The last one on the way, whose changes are in the log, stays until another is.
        if next.is_none() && previous.is_none() {
            return;
        }
        let Some(gone) = self.nodes.remove(&id) else { return };
        if let Some(next) = next.and_then(|next| self.nodes.get_mut(&next)) {
            next.previous.retain(|other| *other != id);
            next.previous.extend(previous);
        }
        if let Some(node) = previous.and_then(|previous| self.nodes.get_mut(&previous)) {
            node.next = next;
            let own = std::mem::take(&mut node.before);
            if next.is_some() {
                node.before = own.then(gone.before, &mut self.places);
            } else {
                self.head = previous;
                self.part_since();
                let later = self.log.take();
                self.log.put(own.then(later, &mut self.places));
            }
        } else if let Some(next) = next {
            self.log.recycle(gone.before);
            self.let_go(next);
        }
    }

    /// Notes an edit that is about to be applied. One that turns out to be wrong does no harm.
    pub fn note(&mut self, edit: Edit<'_>, replicas: &Replicas<'_>, limit: u32) {
        if self.is_empty() || !edit.names_below(limit) {
            return;
        }
        self.log.note(edit, replicas, &self.incarnations);
        if !self.is_since_in_log && matches!(self.history, HistorySnapshot::Reported(_)) {
            self.since.note(edit, replicas, &self.incarnations);
        }
    }

    /// Notes that an edit was applied.
    pub fn note_applied(&mut self, edit: Edit<'_>) {
        self.has_changed |= edit.steps.iter().any(|step| !matches!(step, Step::UserData(_)));
        if !self.is_empty() {
            edit.for_each_removed(|index| self.incarnations.renew(index));
        }
    }

    /// Notes that an answer was acknowledged, which knew so many pairs: of all changes, or of all pairs.
    pub fn acknowledge(&mut self, pair_count: u64) {
        self.history = HistorySnapshot::Reported(pair_count);
        self.has_changed = false;
        self.begin_since();
    }

    fn begin_since(&mut self) {
        self.since.clear();
        self.is_since_in_log = self.log.delta().is_empty();
    }

    /// Notes that it is not known any more what was reported.
    pub fn resync(&mut self) {
        self.history = HistorySnapshot::Lost;
        self.begin_since();
    }

    /// Bytes that are allocated, but for those of listed pairs and tables of filters.
    pub fn allocated_bytes(&self) -> usize {
        let of = |node: &Node| {
            let since = match &node.history {
                Some(History::Reported(_, since)) => since.allocated_bytes(),
                _ => 0,
            };
            size_of::<Node>() + node.before.allocated_bytes() + since
        };
        self.nodes.values().map(of).sum::<usize>()
            + self.log.allocated_bytes()
            + self.since.allocated_bytes()
            + self.incarnations.allocated_bytes()
            + self.places.allocated_bytes()
    }
}

#[cfg(test)]
mod tests;
