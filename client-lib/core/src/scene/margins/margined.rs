//! Margins of a scene's boxes: which boxes of an edit are sent, and the pairs of the boxes as they were set.
//!
//! What was sent is what the scene keeps anyway, so that it is sent again, or taken over by this process,
//! with its margins. The boxes of now are in a copy beside it, to which an edit is applied exactly where the
//! scene applies its part of the edit.

use std::ops::Range;

use super::MarginedSets;
use super::exact::ExactPairs;
use super::outgoing::Outgoing;
use crate::precision::Margin;
use crate::scene::answer::{Report, Reported};
use crate::scene::copy::SceneCopy;
use crate::scene::edit::{Edit, Sets, Step, UserDataSets};
use crate::scene::error::EditError;
use crate::scene::replica::Replica;
use crate::scene::shared::remove_range;

/// Boxes that were set, and how few of them were sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct MarginStats {
    /// Edits that were applied.
    pub edits: u64,
    /// Edits for which a request was made; the others needed none.
    pub requests: u64,
    /// Boxes that edits set.
    pub set: u64,
    /// Boxes that were sent.
    pub sent: u64,
}

/// The boxes of now of a scene whose boxes have margins.
#[derive(Debug)]
pub struct Margined {
    now: SceneCopy,
    usual: Margin,
    pairs: Pairs,
    outgoing: Outgoing,
    /// Whether the edit sends anything.
    sends: bool,
    /// Threads of this process; `None` is all of its pool.
    threads: Option<usize>,
    /// Whether the scene is shared.
    is_shared: bool,
    /// The boxes before an edit with a table of filters, which a shared scene may refuse.
    before: Option<Box<SceneCopy>>,
    stats: MarginStats,
}

/// What is kept of the pairs.
#[allow(clippy::large_enum_variant)] // One of each scene.
#[derive(Debug)]
enum Pairs {
    Near(Near),
    Exact(Exact),
}

/// Near pairs are reported by the scene.
#[derive(Debug, Default)]
struct Near {
    /// Whether there may be changes that were not taken.
    is_open: bool,
    /// Pairs at the last taken answer.
    pair_count: u64,
    /// An answer that needed no request.
    reported: Reported,
}

/// Exact pairs are reported here.
#[derive(Debug, Default)]
struct Exact {
    pairs: ExactPairs,
    /// Whether there may be near pairs that are not known here.
    is_behind: bool,
}

impl Margined {
    /// Of a scene that reports near pairs or exact ones; of a shared one, near ones.
    pub fn new(
        usual: Margin,
        [near_pairs, is_shared]: [bool; 2],
        most_boxes: u32,
        threads: Option<usize>,
    ) -> Self {
        let pairs = if near_pairs || is_shared {
            Pairs::Near(Near::default())
        } else {
            Pairs::Exact(Exact::default())
        };
        Self {
            now: SceneCopy::new(most_boxes),
            usual,
            pairs,
            outgoing: Outgoing::default(),
            sends: false,
            threads,
            is_shared,
            before: None,
            stats: MarginStats::default(),
        }
    }

    /// The boxes as they were set.
    pub const fn now(&self) -> &SceneCopy {
        &self.now
    }

    /// Whether pairs are those of the boxes as they were set, and not of inflated ones.
    pub const fn is_exact(&self) -> bool {
        matches!(self.pairs, Pairs::Exact(_))
    }

    /// The margin of boxes that are set without one.
    pub const fn usual(&self) -> Margin {
        self.usual
    }

    /// What margins have saved so far.
    pub const fn stats(&self) -> MarginStats {
        self.stats
    }

    /// Bytes that are kept.
    pub fn allocated_bytes(&self) -> usize {
        let pairs = match &self.pairs {
            Pairs::Near(_) => 0,
            Pairs::Exact(exact) => exact.pairs.allocated_bytes(),
        };
        self.now.allocated_bytes() + self.outgoing.allocated_bytes() + pairs
    }

    /// Requests a resync. Whether one is to be requested of the scene of what was sent too.
    pub fn resync(&mut self) -> bool {
        match &mut self.pairs {
            Pairs::Near(near) => {
                near.is_open = true;
                true
            }
            Pairs::Exact(exact) => {
                exact.pairs.resync();
                false
            }
        }
    }

    /// Checks an edit, and chooses what is sent of its sets. What is asked of the scene; `None` where no request is
    /// needed. [`apply`](Self::apply) or [`cancel`](Self::cancel) is to follow.
    ///
    /// # Errors
    /// [`EditError`]; the edit is dropped then.
    pub fn choose(
        &mut self,
        edit: Edit<'_>,
        sets: &[MarginedSets<'_>],
        report: Report,
        sent: Replica<'_>,
    ) -> Result<Option<Report>, EditError> {
        let Self { now, pairs, outgoing, threads, .. } = self;
        sets.iter().try_for_each(MarginedSets::check)?;
        now.check(edit)?;
        // A daemon reports pairs of the boxes that it is sent, also where they did not leave their margin.
        let needs_all = matches!(pairs, Pairs::Near(_)) && report == Report::Moved;
        outgoing.clear();
        for sets in sets {
            outgoing.choose(sets, now, sent, needs_all, *threads);
        }
        self.sends = !outgoing.is_empty() || edit.steps.iter().any(is_sent);
        Ok(match &self.pairs {
            Pairs::Near(near) => {
                let reports = report == Report::All || (report == Report::Changes && near.is_open);
                // A tick waits for the commits of all members.
                (self.sends || reports || self.is_shared).then_some(report)
            }
            Pairs::Exact(_) if report == Report::Nothing => self.sends.then_some(report),
            Pairs::Exact(exact) => (self.sends || exact.is_behind).then_some(Report::Changes),
        })
    }

    /// Checks an edit of the boxes as they were set, which goes back to a snapshot together with what was sent.
    /// [`apply`](Self::apply) or [`cancel`](Self::cancel) is to follow.
    ///
    /// # Errors
    /// [`EditError`]; the edit is dropped then.
    pub fn begin_restore(&mut self, edit: Edit<'_>) -> Result<(), EditError> {
        self.now.check(edit)?;
        self.outgoing.clear();
        self.sends = true;
        Ok(())
    }

    /// The steps of an edit that are sent.
    pub fn request<'a>(&'a self, all: &[Step<'a>]) -> Vec<Step<'a>> {
        let mut steps: Vec<Step<'a>> = all.iter().copied().filter(is_sent).collect();
        if !self.outgoing.is_empty() {
            let (indices, boxes) = (self.outgoing.indices(), self.outgoing.boxes());
            steps.push(Step::Set(Sets { indices, boxes }));
        }
        steps
    }

    /// Drops an edit that the scene has refused.
    pub fn cancel(&mut self, edit: Edit<'_>) {
        self.now.cancel(edit);
    }

    /// Takes back the last edit, which a shared scene has refused.
    pub fn undo(&mut self) {
        if let Some(before) = self.before.take() {
            self.now = *before;
        }
    }

    /// Removes boxes of indices that are no longer this member's.
    ///
    /// # Errors
    /// As [`SceneCopy::check`].
    pub fn remove(&mut self, range: Range<u32>) -> Result<(), EditError> {
        remove_range(&mut self.now, range)
    }

    /// Applies an edit.
    pub fn apply(&mut self, edit: Edit<'_>, report: Report, is_request: bool) {
        match &mut self.pairs {
            Pairs::Near(near) => near.is_open |= self.sends,
            Pairs::Exact(exact) => {
                exact.is_behind |= self.sends;
                exact.pairs.note(edit, &self.now, report);
            }
        }
        self.before = (self.is_shared && edit.has_table()).then(|| {
            let mut before = Box::new(self.now.clone());
            before.cancel(edit);
            before
        });
        self.now.apply(edit);
        self.stats.edits += 1;
        self.stats.requests += u64::from(is_request);
        self.stats.set += edit.boxes() as u64;
        self.stats.sent += self.outgoing.len() as u64;
    }

    /// Moves all boxes together: an edit of the boxes as they were set, which changes no pair of them. Those that were
    /// sent have been moved too.
    pub fn shift(&mut self, edit: Edit<'_>) {
        match &mut self.pairs {
            Pairs::Near(near) => near.is_open = true,
            Pairs::Exact(exact) => exact.is_behind = true,
        }
        self.now.apply(edit);
    }

    /// Takes the changes of near pairs that the scene reports, or all of them in a resync.
    pub fn learn(
        &mut self,
        is_resync: bool,
        pairs: impl IntoIterator<Item = [u32; 2]>,
        begun: impl IntoIterator<Item = [u32; 2]>,
        ended: impl IntoIterator<Item = [u32; 2]>,
    ) {
        let Pairs::Exact(exact) = &mut self.pairs else { return };
        if is_resync {
            exact.pairs.resync_near(pairs, &self.now);
        } else {
            exact.pairs.change_near(begun, ended, &self.now);
        }
        exact.is_behind = false;
    }

    /// Answers an edit, after the scene's answer if one was asked for. Whether the answer is [here](Self::reported), and
    /// not the scene's.
    pub fn answer(&mut self, report: Report, was_asked: bool) -> bool {
        match &mut self.pairs {
            Pairs::Near(_) if was_asked => false,
            Pairs::Near(near) => {
                near.reported = Reported::of_none(report, near.pair_count);
                true
            }
            Pairs::Exact(exact) => {
                exact.pairs.report(report, &self.now, self.threads);
                true
            }
        }
    }

    /// The last answer, where it is here.
    pub const fn reported(&self) -> &Reported {
        match &self.pairs {
            Pairs::Near(near) => &near.reported,
            Pairs::Exact(exact) => exact.pairs.reported(),
        }
    }

    /// Notes that the last answer is taken, which knew so many pairs.
    pub fn acknowledge(&mut self, report: Report, pair_count: Option<u64>) {
        match (&mut self.pairs, report, pair_count) {
            (Pairs::Exact(exact), ..) => exact.pairs.acknowledge(),
            (Pairs::Near(near), Report::Changes | Report::All, Some(count)) => {
                (near.is_open, near.pair_count) = (false, count);
            }
            _ => {}
        }
    }
}

/// Whether a step is sent as it is: it sets no boxes, and names any.
fn is_sent(step: &Step<'_>) -> bool {
    match step {
        Step::Set(_) => false,
        Step::Remove(indices)
        | Step::Enable(indices, _)
        | Step::Static(indices, _)
        | Step::UserData(UserDataSets { indices, .. }) => indices.last().is_some(),
        _ => true,
    }
}
