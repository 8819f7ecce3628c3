//! One shared scene. It has two locks, so that nobody who joins, leases or commits waits for a tick that is
//! being applied: one for its [seats](Seats), held for a moment, and one for its [boxes](Boxes). A thread that takes
//! both takes that of the boxes first, and who works in the engines' pool is in it before: the pool is for one
//! at a time.

use std::ops::Range;
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

use pairmask_core::engine::{CullError, ReplyBuffer};
use pairmask_core::scene::shared::{AtEnd, LeaseError, MemberId, Ticks};
use pairmask_core::scene::{Edit, SceneOptions};
use pairmask_transport::{Memory, Share};
use pairmask_wire::{
    AgreedTerms, EditScratch, JoinRequest, LeaseAction, Observed, ResponseHeader, SceneName,
    SceneRequest,
};

use super::boxes::Boxes;
use super::seats::{Begun, Commit, Recipient, Seats};
use super::{SceneTools, locked, tick};
use crate::execute::EnginePool;
use crate::publish::{OpenRequest, Outbox, Refusal};
use crate::requests::asked::Asked;

/// Boxes that a scene may hold where nobody says so.
const MOST_BOXES: u32 = 1 << 24;
/// The deadline of its ticks where nobody says so: six frames of a game.
const DEADLINE: Duration = Duration::from_millis(100);

pub(super) struct SharedScene {
    pub(super) name: SceneName,
    pub(super) terms: AgreedTerms,
    boxes: Mutex<Boxes>,
    seats: Mutex<Seats>,
}

pub(super) type RefusedCommit = Box<(OpenRequest, Refusal)>;

impl SharedScene {
    pub fn begin(
        name: SceneName,
        request: &JoinRequest,
        tools: SceneTools,
        share: &Share,
    ) -> Result<Self, Refusal> {
        let asked = request.terms;
        let options = SceneOptions::default();
        let most_boxes = options.with_most_boxes(asked.most_boxes.unwrap_or(MOST_BOXES));
        let most_boxes = most_boxes.within_limits().most_boxes;
        let deadline = asked.deadline.unwrap_or(DEADLINE);
        Ok(Self {
            name,
            terms: AgreedTerms { most_boxes, deadline, at_end: asked.at_end.unwrap_or_default() },
            boxes: Mutex::new(Boxes::begin(most_boxes, request.engine, tools, share)?),
            seats: Mutex::new(Seats::new(Ticks::new(deadline))),
        })
    }

    /// Who has a seat, locked: for a moment.
    pub fn seats(&self) -> MutexGuard<'_, Seats> {
        locked(&self.seats)
    }

    /// A member joins; `None` where the scene has ended.
    pub fn join(&self, request: &JoinRequest) -> Option<Result<MemberId, Refusal>> {
        let mut seats = self.seats();
        let agreed = self.terms.agree(&request.terms).map_err(Refusal::from);
        (!seats.has_ended).then(|| agreed.and_then(|()| seats.join(request)))
    }

    pub fn lease(&self, id: MemberId, action: LeaseAction) -> Result<Range<u32>, Refusal> {
        let limit = self.terms.most_boxes;
        let mut seats = self.seats();
        let range = match action {
            LeaseAction::Take { first, count } => {
                let end = first.checked_add(count).filter(|end| *end <= limit);
                let beyond =
                    LeaseError::BeyondLimit { end: u64::from(first) + u64::from(count), limit };
                let range = first..end.ok_or(beyond)?;
                seats.leases.take(id, range.clone(), limit)?;
                range
            }
            LeaseAction::TakeAny { count } => seats.leases.take_any(id, count, limit)?,
            LeaseAction::GiveBack { first } => {
                drop(seats);
                return self.give_back(id, first);
            }
        };
        seats.note_leases(id);
        Ok(range)
    }

    /// A member gives indices back. Their boxes are removed, and listed pairs that name them: who leases them
    /// next finds none there.
    fn give_back(&self, id: MemberId, first: u32) -> Result<Range<u32>, Refusal> {
        let mut boxes = locked(&self.boxes);
        let mut seats = self.seats();
        let range = seats.give_back(id, first)?;
        let recipients = seats.recipients();
        drop(seats);
        self.remove(&mut boxes, std::slice::from_ref(&range), &recipients);
        Ok(range)
    }

    /// A member commits. Its edit is read here, beside those of others; its request is kept until the tick
    /// ends, or comes back with why not.
    pub fn commit(
        &self,
        id: MemberId,
        open: OpenRequest,
        request: &SceneRequest,
    ) -> Result<(), RefusedCommit> {
        // Its work is bounded by what the scene may hold, regardless of what the member says of that.
        let request = &SceneRequest { most_boxes: self.terms.most_boxes, ..*request };
        let begun = self.seats().begin(id, request);
        let Begun { own, is_first, scratch } = match begun {
            Ok(begun) => begun,
            Err(refusal) => return Err(Box::new((open, refusal))),
        };
        let mut commit = Commit { open, request: *request, edit: scratch };
        let copy = commit.open.charge_copy();
        let read = copy
            .as_ref()
            .map_err(|over| Refusal::from(*over))
            .and_then(|_| commit.edit.copy(request, commit.open.pages()).map_err(Refusal::from));
        let allowed = read.and_then(|()| {
            let steps = commit.edit.steps()?;
            own.allow(Edit { steps: &steps }, is_first).map_err(Refusal::from)
        });
        let taken = match allowed {
            Ok(()) => self.take_in(id, commit),
            Err(refusal) => Err((commit, refusal)),
        };
        // The memory of an edit that was refused ends with it: nothing was charged for that.
        taken.map_err(|(Commit { open, .. }, refusal)| {
            self.seats().give_up(id);
            Box::new((open, refusal))
        })
    }

    /// Checks the edit of a commit by the boxes that there are, and makes it part of the open tick.
    #[allow(clippy::result_large_err)] // Its caller takes it apart at once.
    fn take_in(&self, id: MemberId, commit: Commit) -> Result<(), (Commit, Refusal)> {
        if commit.edit.is_empty() {
            // One that says nothing need not wait for a tick that is being applied.
            return self.seats().commit(id, commit, Instant::now());
        }
        let mut boxes = locked(&self.boxes);
        let bytes = commit.edit.allocated_bytes() as u64;
        let steps = commit.edit.steps();
        let checked = steps.map_err(Refusal::from);
        let checked = checked.and_then(|steps| boxes.check(Edit { steps: &steps }, bytes));
        if let Err(refusal) = checked {
            return Err((commit, refusal));
        }
        self.seats().commit(id, commit, Instant::now()).inspect_err(|(commit, _)| {
            cancel(&mut boxes, &commit.edit);
        })
    }

    /// Answers a query or a cast. Whether a GPU did.
    pub fn ask(
        &self,
        open: &mut OpenRequest,
        asked: Asked<'_>,
        threads: usize,
        outbox: &Outbox,
    ) -> Result<bool, Refusal> {
        let mut boxes = locked(&self.boxes);
        boxes.ask(open, asked, threads, outbox)?;
        Ok(boxes.scene.engine().is_gpu())
    }

    /// Answers which boxes changed after a tick, into the request's reply.
    pub fn observe(&self, open: &mut OpenRequest, after: u64) -> Result<ResponseHeader, Refusal> {
        let boxes = locked(&self.boxes);
        let bytes = Observed::payload_bytes(boxes.index_end(), boxes.filters());
        let _charge = open.share().charge(Memory::Own, bytes as u64)?;
        let observed = boxes.observed_after(after);
        drop(boxes);
        let fields = open.fields;
        let (_, mut reply) = open.payload_and_reply();
        let words = reply.reserve(observed.payload_words() as u64).map_err(CullError::from)?;
        Ok(observed.write(&fields, words))
    }

    /// Ends the open tick if that is due. How many threads took part.
    pub fn end_tick(&self, pool: &EnginePool, outbox: &Outbox) -> usize {
        let due = self.seats().threads_if_due(Instant::now(), pool.threads());
        match due {
            None => 1,
            Some(1) => {
                self.end_tick_by(1, outbox);
                1
            }
            // Its members do not wait for the end of another client's frame.
            Some(threads) => pool.work_here_if_taken(|in_pool| {
                let threads = if in_pool { threads } else { 1 };
                self.end_tick_by(threads, outbox);
                threads
            }),
        }
    }

    fn end_tick_by(&self, threads: usize, outbox: &Outbox) {
        let mut boxes = locked(&self.boxes);
        // Another thread may have ended it meanwhile.
        let Some(closed) = self.seats().close(Instant::now()) else { return };
        let mut applied = closed.apply(&mut boxes, threads);
        drop(boxes);
        let mut seats = self.seats();
        applied.scratches().for_each(|(id, scratch)| seats.keep_scratch(id, scratch));
        drop(seats);
        applied.answer(outbox);
    }

    /// A member has left or joins again, or its session has ended. With its boxes go, or stay, listed pairs that
    /// name them. Returns the request of a commit that has no answer.
    pub fn end_member(&self, id: MemberId, at_end: AtEnd) -> Option<OpenRequest> {
        let mut boxes = locked(&self.boxes);
        let mut seats = self.seats();
        let (member, ended) = seats.end(id)?;
        // Nobody may join a scene whose last boxes stay because nobody is there.
        let has_ended = seats.end_without_members();
        let recipients = seats.recipients();
        drop(seats);
        if let Some(commit) = &member.commit {
            cancel(&mut boxes, &commit.edit);
        }
        match at_end {
            _ if has_ended => {}
            AtEnd::Remove => self.remove(&mut boxes, &ended, &recipients),
            AtEnd::Keep => boxes.keep(&ended),
        }
        member.commit.map(|commit| commit.open)
    }

    /// Removes the boxes of ranges that are nobody's any more, and takes pairs that name them off the lists.
    fn remove(&self, boxes: &mut Boxes, ranges: &[Range<u32>], recipients: &[Recipient]) {
        let remains = boxes.remains(ranges);
        let steps = remains.steps();
        if steps.is_empty() {
            return;
        }
        let recipients: Vec<&Recipient> = recipients.iter().collect();
        boxes.note_removed(Edit { steps: &steps });
        if let Err(error) = tick::apply(boxes, &recipients, Edit { steps: &steps }, 1) {
            log::warn!("scene '{}': removing boxes of a member that has left: {error}", self.name);
        }
    }
}

fn cancel(boxes: &mut Boxes, edit: &EditScratch) {
    let steps = edit.steps().unwrap_or_default();
    boxes.cancel(Edit { steps: &steps }, edit.allocated_bytes() as u64);
}
