//! Who has a seat in a shared scene: members, their leases, and the open tick. No boxes: nothing here waits
//! for a tick that is being applied.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use pairmask_core::scene::shared::{
    Leases, MemberId, NotLeased, Ranges, Scope, TickChanges, Ticks, Unreported,
};
use pairmask_wire::{EditScratch, JoinRequest, Reject, SceneRequest};

use super::locked;
use crate::publish::{OpenRequest, Refusal};

const MOST_MEMBERS: usize = 1_024;

pub(super) struct Seats {
    pub leases: Leases,
    ticks: Ticks,
    members: BTreeMap<MemberId, Member>,
    last_member: u64,
    /// Whether the scene is no longer to be found: its last member has left.
    pub has_ended: bool,
    /// Of the open tick.
    work: TickWork,
}

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TickWork {
    boxes: u64,
    needs_whole: bool,
    /// Threads that clients let it have, where they say so.
    threads: Option<usize>,
}

/// A commit whose edit is being read.
pub(super) struct Begun {
    pub own: Arc<Ranges>,
    /// Whether its member may give the table of filters.
    pub is_first: bool,
    /// Memory of the last one.
    pub scratch: EditScratch,
}

pub(super) struct ClosedTick {
    pub number: u64,
    /// Leases of writers that had not committed, rising, each as it was leased.
    pub late: Vec<Range<u32>>,
    /// Commits in the order of their writers' indices, then those of listeners.
    pub commits: Vec<(Recipient, Commit)>,
    /// All others, who learn of it later.
    pub others: Vec<Recipient>,
    /// Bytes that members keep for reading their next edits.
    pub scratch_bytes: u64,
}

/// Boxes of a tick up to which one thread is as soon done as all are that have to be woken.
const FEW_BOXES: u64 = 512;

fn wrong(field: &'static str) -> Refusal {
    Reject::Edit(field).into()
}

impl Seats {
    pub fn new(ticks: Ticks) -> Self {
        let (leases, members) = (Leases::default(), BTreeMap::new());
        Self { leases, ticks, members, last_member: 0, has_ended: false, work: TickWork::default() }
    }

    /// Ends the scene where it has no members. Whether it has ended.
    pub fn end_without_members(&mut self) -> bool {
        self.has_ended |= self.members.is_empty();
        self.has_ended
    }

    /// When the open tick closes at the latest.
    pub const fn closes_at(&self) -> Option<Instant> {
        self.ticks.closes_at()
    }

    /// By how many threads of so many the open tick is to be ended, if it is to be closed.
    pub fn threads_if_due(&self, now: Instant, threads: usize) -> Option<usize> {
        let TickWork { boxes, needs_whole, threads: asked } = self.work;
        let most = asked.map_or(threads, |most| most.min(threads)).max(1);
        let are_many = boxes > FEW_BOXES || needs_whole;
        self.ticks.is_due(now).then_some(if are_many { most } else { 1 })
    }

    pub fn join(&mut self, request: &JoinRequest) -> Result<MemberId, Refusal> {
        if self.members.len() >= MOST_MEMBERS {
            return Err(wrong("number of members"));
        }
        self.last_member += 1;
        let id = MemberId(self.last_member);
        let (own, unreported) = Default::default();
        let recipient = Recipient { id, scope: request.scope, own, unreported };
        let scratch = EditScratch::default();
        let member = Member { recipient, revision: 0, is_reading: false, commit: None, scratch };
        self.members.insert(id, member);
        Ok(id)
    }

    pub fn note_leases(&mut self, id: MemberId) {
        self.ticks.wait_for(self.leases.writers());
        if let Some(Member { recipient, .. }) = self.members.get_mut(&id) {
            recipient.own = Arc::new(self.leases.of(id));
            // Other pairs are reported to it from now on.
            if recipient.scope == Scope::Own {
                locked(&recipient.unreported).resync();
            }
        }
    }

    pub fn give_back(&mut self, id: MemberId, first: u32) -> Result<Range<u32>, Refusal> {
        // What waits for the end of the tick, or is being read, may name them.
        if self.members.get(&id).is_none_or(Member::commits) {
            return Err(wrong("lease of a commit under way"));
        }
        let range = self.leases.give_back(id, first)?;
        self.note_leases(id);
        Ok(range)
    }

    /// Until the edit is [taken in](Self::commit) or [given up](Self::give_up), its leases stay.
    pub fn begin(&mut self, id: MemberId, request: &SceneRequest) -> Result<Begun, Refusal> {
        let is_first = self.leases.first_writer() == Some(id);
        let member = self.members.get_mut(&id).ok_or_else(|| Refusal::stale_scene(0))?;
        if member.revision != request.base {
            return Err(Refusal::stale_scene(member.revision));
        }
        if member.commits() {
            return Err(wrong("second commit of a tick"));
        }
        member.is_reading = true;
        let scratch = std::mem::take(&mut member.scratch);
        Ok(Begun { own: Arc::clone(&member.recipient.own), is_first, scratch })
    }

    pub fn give_up(&mut self, id: MemberId) {
        if let Some(member) = self.members.get_mut(&id) {
            member.is_reading = false;
        }
    }

    /// Whether a commit of the open tick gives the table of filters.
    fn has_table(&self) -> bool {
        let mut commits = self.members.values().filter_map(|member| member.commit.as_ref());
        commits.any(|commit| commit.edit.has_table())
    }

    /// Takes the commit of a member in, whose edit is right. `Err` where the member has ended meanwhile, or
    /// gives a second table of filters: another writer was the first one when it gave the first table.
    #[allow(clippy::result_large_err)] // Its caller answers it at once.
    pub fn commit(
        &mut self,
        id: MemberId,
        commit: Commit,
        now: Instant,
    ) -> Result<(), (Commit, Refusal)> {
        if commit.edit.has_table() && self.has_table() {
            return Err((commit, NotLeased::Filters.into()));
        }
        let left = |commit| Err((commit, Refusal::stale_scene(0)));
        let Some(member) = self.members.get_mut(&id) else { return left(commit) };
        if !self.ticks.commit(id, now) {
            return left(commit);
        }
        let request = &commit.request;
        let mut unreported = locked(&member.recipient.unreported);
        unreported.acknowledge(request.is_acknowledged);
        if request.is_lost {
            unreported.resync();
        }
        let work = &mut self.work;
        work.boxes += u64::from(commit.open.fields.box_count.get());
        work.needs_whole |= unreported.needs_whole(request.report);
        work.threads = work.threads.max(request.threads);
        drop(unreported);
        member.revision = request.revision;
        member.is_reading = false;
        member.commit = Some(commit);
        Ok(())
    }

    pub fn close(&mut self, now: Instant) -> Option<ClosedTick> {
        let closed = self.ticks.close(now)?;
        self.work = TickWork::default();
        let late = closed.late.iter().filter_map(|id| self.members.get(id));
        let late = late.flat_map(|member| member.recipient.own.as_slice().to_vec());
        let mut late: Vec<Range<u32>> = late.collect();
        late.sort_unstable_by_key(|range| range.start);
        let (mut commits, mut others) = (Vec::new(), Vec::new());
        let mut take = |member: &mut Member| match member.commit.take() {
            Some(commit) => commits.push((member.recipient.clone(), commit)),
            None => others.push(member.recipient.clone()),
        };
        for id in self.leases.writers() {
            self.members.get_mut(&id).into_iter().for_each(&mut take);
        }
        let listeners = self.members.values_mut().filter(|member| member.recipient.own.is_empty());
        listeners.for_each(take);
        // That of those who have committed went into their commits.
        let scratches = self.members.values().map(|member| &member.scratch);
        let scratch_bytes = scratches.map(|scratch| scratch.allocated_bytes() as u64).sum();
        Some(ClosedTick { number: closed.number, late, commits, others, scratch_bytes })
    }

    pub fn keep_scratch(&mut self, id: MemberId, scratch: EditScratch) {
        if let Some(member) = self.members.get_mut(&id) {
            member.scratch = scratch;
        }
    }

    pub fn recipients(&self) -> Vec<Recipient> {
        self.members.values().map(|member| member.recipient.clone()).collect()
    }

    /// A member has left, or its session has ended. Returns it, and what it had leased.
    pub fn end(&mut self, id: MemberId) -> Option<(Member, Vec<Range<u32>>)> {
        let member = self.members.remove(&id)?;
        self.ticks.discard(id);
        let ended = self.leases.end(id);
        self.ticks.wait_for(self.leases.writers());
        Some((member, ended))
    }
}

pub(super) struct Member {
    pub recipient: Recipient,
    /// The number of its last commit.
    pub revision: u64,
    pub is_reading: bool,
    pub commit: Option<Commit>,
    pub scratch: EditScratch,
}

/// What is to be reported to a member. The worker thread that ends a tick has it without its seat.
#[derive(Clone)]
pub(super) struct Recipient {
    pub id: MemberId,
    pub scope: Scope,
    pub own: Arc<Ranges>,
    /// Locked for a moment, and nothing is locked meanwhile.
    pub unreported: Arc<Mutex<Unreported>>,
}

/// A commit that waits for the end of its tick. What it says is copied, once: the client may change or end
/// its own memory meanwhile.
pub(super) struct Commit {
    pub open: OpenRequest,
    pub request: SceneRequest,
    pub edit: EditScratch,
}

impl Member {
    /// Whether it has a commit in the open tick, or one that is being read.
    pub const fn commits(&self) -> bool {
        self.is_reading || self.commit.is_some()
    }
}

impl Recipient {
    pub fn has_pair(&self, [a, b]: [u32; 2]) -> bool {
        self.scope == Scope::All || self.own.has(a) || self.own.has(b)
    }

    pub fn note(&self, changes: &TickChanges) {
        let mut unreported = locked(&self.unreported);
        match self.scope {
            Scope::All => unreported.note(changes, |_| true),
            Scope::Own => unreported.note(changes, |pair| self.has_pair(pair)),
        }
    }

    pub fn resync(&self) {
        locked(&self.unreported).resync();
    }

    pub fn bytes(&self) -> u64 {
        locked(&self.unreported).allocated_bytes() as u64
    }
}
