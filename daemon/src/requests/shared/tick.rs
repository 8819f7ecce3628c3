//! The end of a tick: all edits are applied, and every member that has committed is answered.

use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use pairmask_core::dispatch::StageTimes;
use pairmask_core::scene::shared::{MemberId, Scope};
use pairmask_core::scene::{Edit, Report, Reported, SceneError};
use pairmask_wire::{EditScratch, TickNotes};
use rayon::prelude::*;

use super::boxes::{Boxes, Changed};
use super::locked;
use super::seats::{ClosedTick, Commit, Recipient};
use crate::publish::{Outbox, Refusal};
use crate::requests::scene::EditAnswer;

/// Pairs of now that members need.
struct Pairs {
    count: u64,
    /// All of them; empty where nobody needs them.
    whole: Arc<Vec<[u32; 2]>>,
    /// Those that moved after the first of the ticks whose answers members received last.
    moved: Arc<Vec<[u32; 2]>>,
}

/// A tick whose edits are applied: what members are answered with.
pub(super) struct AppliedTick {
    number: u64,
    late: Vec<Range<u32>>,
    answer: EditAnswer,
    answers: Vec<Answer>,
}

struct Answer {
    recipient: Recipient,
    commit: Commit,
    reported: Result<Reported, Refusal>,
    /// User data that have changed since the last answer that the member received.
    user_data: Vec<(u32, u64)>,
}

/// Does something for each of a list, side by side where there are threads for it.
fn for_each<T: Send>(list: Vec<T>, threads: usize, f: impl Fn(T) + Send + Sync) {
    if threads == 1 || list.len() == 1 {
        list.into_iter().for_each(f);
    } else {
        list.into_par_iter().for_each(f);
    }
}

/// Applies an edit that was checked, and notes what these are to learn of it.
pub(super) fn apply(
    boxes: &mut Boxes,
    recipients: &[&Recipient],
    edit: Edit<'_>,
    threads: usize,
) -> Result<(), SceneError> {
    match boxes.apply(edit, threads) {
        Ok(Changed::Reported) => {
            let changes = boxes.changes();
            if boxes.has_room(recipients.len() as u64 * changes.bytes()) {
                for_each(recipients.to_vec(), threads, |recipient| recipient.note(&changes));
            } else {
                // They are sent all pairs next, which nobody keeps for them.
                lose(recipients);
            }
        }
        Ok(Changed::Lost) => lose(recipients),
        Err(error) => {
            lose(recipients);
            return Err(error);
        }
    }
    boxes.scene.acknowledge();
    Ok(())
}

/// What was reported to these is not known any more.
fn lose(recipients: &[&Recipient]) {
    for recipient in recipients {
        recipient.resync();
    }
}

impl ClosedTick {
    /// Applies its edits in the order of their writers' indices.
    pub fn apply(self, boxes: &mut Boxes, threads: usize) -> AppliedTick {
        let start = Instant::now();
        let Self { number, late, commits, others, scratch_bytes } = self;
        let recipients: Vec<&Recipient> =
            commits.iter().map(|(recipient, _)| recipient).chain(&others).collect();
        let mut steps = Vec::new();
        for (_, commit) in &commits {
            // They were right when they were read, and are the same now.
            steps.extend(commit.edit.steps().unwrap_or_default());
        }
        if let Some((_, commit)) = commits.first() {
            // As for a scene of one session.
            boxes.limit_pairs(commit.open.limit_pairs());
        }
        let edit = Edit { steps: &steps };
        boxes.note_moved(number, edit);
        let moved = edit.boxes() as u64;
        let applied = apply(boxes, &recipients, edit, threads);
        drop(steps);
        let pairs = applied.and_then(|()| Pairs::needed(boxes, &commits));
        if pairs.is_err() {
            lose(&recipients);
        }
        let answers = reported_to(commits, boxes, &pairs, number, threads);
        let recipients = answers.iter().map(|answer| &answer.recipient).chain(&others);
        // Members keep the memory of their edits for the next.
        let edits = answers.iter().map(|answer| answer.commit.edit.allocated_bytes() as u64);
        let edit_bytes = edits.sum::<u64>() + scratch_bytes;
        boxes.note_room(recipients.map(Recipient::bytes).sum::<u64>() + edit_bytes);
        let pair_count = pairs.as_ref().ok().map(|pairs| pairs.count);
        let scene = &boxes.scene;
        let execute_ns = start.elapsed().as_nanos() as u64;
        let times = StageTimes { execute_ns, ..StageTimes::default() };
        boxes.count_tick(moved, pair_count, &times);
        let (engine, bytes, boxes) = (scene.engine(), scene.bytes(), scene.len() as u64);
        let answer = EditAnswer { engine, bytes, boxes, threads, times };
        AppliedTick { number, late, answer, answers }
    }
}

impl Pairs {
    fn needed(boxes: &mut Boxes, commits: &[(Recipient, Commit)]) -> Result<Self, SceneError> {
        let count = boxes.scene.reported().pair_count().unwrap_or(0);
        let (mut needs_whole, mut moved_after) = (false, None);
        for (recipient, commit) in commits {
            let unreported = locked(&recipient.unreported);
            needs_whole |= unreported.needs_whole(commit.request.report);
            if commit.request.report == Report::Moved {
                let received_at = unreported.received_at();
                moved_after = Some(moved_after.map_or(received_at, |at: u64| at.min(received_at)));
            }
        }
        let whole = if needs_whole { boxes.whole()? } else { Arc::default() };
        let moved =
            moved_after.map_or_else(|| Ok(Arc::default()), |tick| boxes.moved_after(tick))?;
        Ok(Self { count, whole, moved })
    }
}

fn reported_to(
    commits: Vec<(Recipient, Commit)>,
    boxes: &Boxes,
    pairs: &Result<Pairs, SceneError>,
    tick: u64,
    threads: usize,
) -> Vec<Answer> {
    let (reasons, moved, user_data) = (boxes.reasons(), &boxes.moved, boxes.user_data());
    let report = |(recipient, commit): (Recipient, Commit)| {
        let user_data = user_data.changed_after(locked(&recipient.unreported).received_at());
        let reported = pairs.as_ref().map_err(|error| Refusal::from(error.clone())).map(|pairs| {
            let report = commit.request.report;
            let mut unreported = locked(&recipient.unreported);
            let moved_after = (report == Report::Moved).then(|| unreported.received_at());
            let all = if moved_after.is_some() { &pairs.moved } else { &pairs.whole };
            let is_its = |pair: &[u32; 2]| {
                recipient.has_pair(*pair)
                    && moved_after.is_none_or(|tick| moved.has_moved(*pair, tick))
            };
            let its = match recipient.scope {
                _ if moved_after.is_none() && !unreported.needs_whole(report) => Arc::default(),
                Scope::All if moved_after.is_none() => Arc::clone(all),
                _ => Arc::new(all.iter().copied().filter(is_its).collect()),
            };
            unreported.answer(report, tick, its, pairs.count, |named| reasons.of(named))
        });
        Answer { recipient, commit, reported, user_data }
    };
    if threads == 1 {
        commits.into_iter().map(report).collect()
    } else {
        commits.into_par_iter().map(report).collect()
    }
}

impl AppliedTick {
    /// The members that have committed, and the memory of their edits.
    pub fn scratches(&mut self) -> impl Iterator<Item = (MemberId, EditScratch)> {
        let answers = self.answers.iter_mut();
        answers.map(|answer| (answer.recipient.id, std::mem::take(&mut answer.commit.edit)))
    }

    pub fn answer(self, outbox: &Outbox) {
        let Self { number, late, answer, answers } = self;
        for_each(
            answers,
            answer.threads,
            |Answer { recipient, mut commit, reported, user_data }| {
                let tick = Some(TickNotes { tick: number, late: &late, user_data: &user_data });
                let sent = reported
                    .and_then(|reported| answer.send(&mut commit.open, &reported, tick, outbox));
                if let Err(refusal) = sent {
                    recipient.resync();
                    outbox.refuse(&mut commit.open, &refusal);
                }
                drop(commit.open);
            },
        );
    }
}
