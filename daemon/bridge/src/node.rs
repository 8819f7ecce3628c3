//! One bridge without effects. Inputs are what its own machine's boxes did in a tick, messages, and instants; outputs are
//! messages, edits of ghosts in the local scene, and reports of pairs between machines. One file, because views, contacts and
//! what is evaluated decide together which tick may be evaluated next.
//!
//! **Ticks.** Each bridge counts ticks, and jumps to the highest one that it receives. What a bridge publishes is a step
//! function of the tick: boxes stay what they are until its next batch.
//!
//! **Pairs between machines** are evaluated tick by tick, each once all members of the view have sent theirs of that tick.
//! So all members look at the same boxes, and agree without a word who owns a pair: who owns the slab of the lower corner
//! of the intersection.
//!
//! 1. The owner of a slab has every box that overlaps the slab, so it finds every pair that it owns.
//! 2. A box that comes into sight comes with what it was the tick before, one that goes out of sight with what it is now.
//!    So who owns a pair now knows whether it began now or was another's, and who owned it knows whether it ended. A pair
//!    that crosses a border is neither ended nor begun: one side gives it, the other takes it.
//! 3. By 1 and 2 the pairs of all bridges at a tick are those of one big scene of that tick, each at one bridge, each begun
//!    once and ended once. What the network does to messages changes when a tick is evaluated, and nothing else.
//!
//! **Views.** The steward, the settled bridge with the lowest machine number, proposes who takes part and how space is cut.
//! A member that accepts publishes in both views from then on, and promises a tick beyond which it evaluates nothing in the
//! old one. When all have accepted, the steward names the first tick of the new view, one after the last promise. By then
//! all are in sight of whom they concern, so 1 and 2 hold across the border between views as well.
//!
//! **Loss.** A bridge that sent nothing for a lease is in no next view. Until that starts nothing is evaluated that the lost one
//! would have to do with; then its boxes are dropped at the tick where its batches end: `lost` names it once, and ends its
//! pairs at the bridges that had reported them. Their last batches of it may differ, so between those and the
//! report of the loss its pairs are as old as what each has received. A slab whose owner is lost gets a new one in the next
//! view, which begins the pairs that it finds there: the lost one's reports ended with it. Parts of a network that is cut
//! go on as views of their own, and join as others do.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::ops::Range;
use std::time::Duration;

use pairmask_core::engine::CullError;
use pairmask_core::scene::EndReason;
use pairmask_core::scene::shared::AtEnd;

use crate::ids::{BoxId, MachineId, PairId, Peer};
use crate::protocol::{Beat, Head, Message, Proposal, Refused, Terms};
use crate::session::{ByIndex, Change, IndexNow, Link, Local, Session};
use crate::space::{Space, Spread};
use crate::state::BoxState;
use crate::view::{MOST_MEMBERS, Version, View};

/// Beats in a lease: one that is lost is no reason to worry.
const BEATS_A_LEASE: u32 = 8;
/// Ticks that are evaluated in an old view while a new one is agreed on: by then the steward has all acceptances where a
/// round trip takes less. Evaluation waits for the rest of it.
const HOLD_TICKS: u64 = 6;
/// A view gets other cuts where a slab has so many times the boxes that it would have were all equal.
const IMBALANCE: f64 = 1.25;
/// Leases after which a bridge that says nothing is forgotten: numbers that nobody has any more take no memory.
const REMEMBERED_LEASES: u32 = 16;
/// Boxes by which a bridge says how its boxes are spread.
const SPREAD_SAMPLE: usize = 4_096;
/// Ticks are below this: a jump to the last one there is would be the end of a scene. 10^5 years of ticks at 60 Hz.
const MOST_TICKS: u64 = 1 << 48;

/// The settings of a bridge.
#[derive(Clone, Debug)]
pub struct Config {
    /// Who it is.
    pub me: Peer,
    /// A hash of the scene's name.
    pub scene: u64,
    /// The axis and the lease.
    pub terms: Terms,
    /// How near to a slab a box is published to its owner. Pairs are exact without; with a margin a box is a ghost in the
    /// local scene before it matters.
    pub margin: f32,
    /// What becomes of a lost machine's ghosts in the local scene.
    pub at_end: AtEnd,
    /// How often cuts may follow the boxes; `None`: when members come or go alone.
    pub rebalance: Option<Duration>,
}

impl Config {
    fn lease(&self) -> Duration {
        Duration::from_millis(self.terms.lease_ms.into())
    }
}

/// To whom a message goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Destination {
    /// All bridges of the scene.
    All,
    /// One.
    One(MachineId),
}

/// A box of another machine in the local scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ghost {
    /// Whose it is.
    pub machine: MachineId,
    /// Its index there.
    pub index: u32,
    /// What it is now; `None`: it is removed. Another incarnation is another box.
    pub state: Option<(u32, BoxState)>,
}

/// Pairs between machines at a tick, as far as this bridge owns them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// The tick.
    pub tick: u64,
    /// Pairs that began.
    pub begun: Vec<PairId>,
    /// Pairs that ended, and why.
    pub ended: Vec<(PairId, EndReason)>,
    /// Pairs that go on, and were another bridge's to report.
    pub taken: Vec<PairId>,
    /// Pairs that go on, and are another bridge's to report.
    pub given: Vec<PairId>,
    /// Bridges that were lost: all pairs with boxes of theirs have ended, at every bridge that reported them.
    pub lost: Vec<Peer>,
    /// Whether it is not known what others reported meanwhile: begun and taken, ended and given may be mistaken for each
    /// other, and the pairs of this bridge are right.
    pub is_resync: bool,
}

/// What a tick is answered with.
#[derive(Debug, Default)]
pub struct Output {
    /// Messages.
    pub messages: Vec<(Destination, Vec<u8>)>,
    /// Edits of the local scene.
    pub ghosts: Vec<Ghost>,
    /// Reports of ticks, in their order.
    pub reports: Vec<Report>,
}

/// What is known of another bridge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PeerStatus {
    /// Who.
    pub peer: Peer,
    /// Ticks between this bridge's and the last one that came from it.
    pub age: u64,
    /// Its ghosts here.
    pub ghosts: usize,
    /// Bytes that wait for its acknowledgement.
    pub kept_bytes: usize,
}

/// Where a bridge stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Status {
    /// Its tick.
    pub tick: u64,
    /// The last tick whose pairs it reported.
    pub evaluated: u64,
    /// Its view.
    pub version: Version,
    /// Where slabs end and begin.
    pub cuts: Vec<f32>,
    /// Members of its view but itself.
    pub peers: Vec<PeerStatus>,
    /// Machines that were lost and are not back.
    pub missing: Vec<MachineId>,
    /// Its own boxes.
    pub boxes: usize,
    /// Ghosts in the local scene.
    pub ghosts: usize,
    /// Pairs that it reports.
    pub pairs: usize,
}

#[derive(Debug)]
struct Contact {
    peer: Peer,
    at: Duration,
    beat: Option<Beat>,
    /// Until when it counts as lost though messages of it come: it acknowledges nothing.
    suspected_until: Duration,
}

/// The bridge.
#[derive(Debug)]
pub struct Node {
    config: Config,
    head: Head,
    born: Duration,
    tick: u64,
    highest: u64,
    counter: u64,
    locals: ByIndex<Local>,
    contacts: BTreeMap<MachineId, Contact>,
    /// Views in the order of their versions: the first is evaluated.
    sessions: VecDeque<Session>,
    /// Views that were evaluated, until all members have what they need of this bridge for that.
    retired: Vec<Session>,
    /// Pairs that this bridge reports.
    mine: BTreeSet<PairId>,
    missing: BTreeSet<MachineId>,
    written: BTreeMap<MachineId, ByIndex<Local>>,
    /// The view whose ghosts are in the local scene.
    shown: Version,
    next_beat: Duration,
    next_proposal: Duration,
    next_rebalance: Duration,
}

impl Node {
    /// A bridge without contacts: it owns all of space.
    pub fn new(config: Config, now: Duration) -> Self {
        let me = config.me;
        let version = Version { counter: 1, steward: me.machine };
        let view = View { version, members: vec![me], space: Space::whole(config.terms.axis) };
        let locals = ByIndex::default();
        let prior = Version::default();
        let mut first = Session::new((view, me, prior), (0, 0, config.margin), &locals, now);
        if let Some(first) = &mut first {
            first.start = Some(0);
        }
        Self {
            head: Head { scene: config.scene, from: me },
            born: now,
            tick: 0,
            highest: 0,
            counter: 1,
            locals,
            contacts: BTreeMap::new(),
            sessions: first.into_iter().collect(),
            retired: Vec::new(),
            mine: BTreeSet::new(),
            missing: BTreeSet::new(),
            written: BTreeMap::new(),
            shown: version,
            next_beat: now,
            next_proposal: now,
            next_rebalance: now,
            config,
        }
    }

    /// Its tick.
    pub const fn tick_number(&self) -> u64 {
        self.tick
    }

    /// The pairs that it reports, as of its last report.
    pub const fn pairs(&self) -> &BTreeSet<PairId> {
        &self.mine
    }

    /// The coordinates whose pairs it reports, in the view that is evaluated.
    pub fn owned(&self) -> Range<f32> {
        let all = f32::NEG_INFINITY..f32::INFINITY;
        self.sessions.front().map_or(all, |session| session.view.owned_by(self.config.me))
    }

    /// Takes a message in.
    ///
    /// # Errors
    /// [`Refused`]: the message has no effect then.
    pub fn receive(&mut self, bytes: &[u8], now: Duration) -> Result<(), Refused> {
        let (head, message) = Head::read(bytes)?;
        if head.scene != self.head.scene {
            return Err(Refused::Scene);
        }
        let (from, me) = (head.from, self.config.me);
        if from.machine == me.machine {
            // Its own beats come back.
            return if from == me { Ok(()) } else { Err(Refused::SameMachine(me.machine.0)) };
        }
        let (tick, terms) = match &message {
            Message::Beat(beat) => (beat.tick, Some(beat.terms)),
            Message::Batch(batch) => (batch.tick, None),
            Message::Propose(_) => (0, None),
        };
        if tick >= MOST_TICKS {
            return Err(Refused::Field("tick"));
        }
        if let Some(terms) = terms.filter(|terms| *terms != self.config.terms) {
            let ours = self.config.terms;
            let term = if terms.axis == ours.axis { "lease" } else { "axis" };
            return Err(Refused::Terms { machine: from.machine.0, term });
        }
        let known = self.contacts.get(&from.machine);
        let is_later = |known: &Contact| {
            let is_live = now < known.at + self.config.lease();
            is_live && known.peer.incarnation > from.incarnation
        };
        if known.is_some_and(is_later) {
            // From a process that is gone.
            return Ok(());
        }
        let is_room = known.is_some() || self.contacts.len() < MOST_MEMBERS;
        if known.is_none_or(|known| known.peer != from) && is_room {
            let new = Contact { peer: from, at: now, beat: None, suspected_until: Duration::ZERO };
            self.contacts.insert(from.machine, new);
        }
        let Some(contact) = self.contacts.get_mut(&from.machine) else { return Ok(()) };
        contact.at = now;
        match message {
            Message::Beat(beat) => {
                self.counter = self.counter.max(beat.counter);
                self.highest = self.highest.max(beat.tick);
                contact.beat = Some(beat);
            }
            Message::Propose(proposal) => self.accept(proposal, now),
            Message::Batch(batch) if batch.to == me => {
                self.highest = self.highest.max(batch.tick);
                let all = self.sessions.iter_mut().chain(&mut self.retired);
                let mut of = all.filter(|session| session.view.version == batch.version);
                if let Some(session) = of.next() {
                    session.receive(from, batch, now);
                }
            }
            Message::Batch(_) => {}
        }
        Ok(())
    }

    /// Accepts a view that is later than all that are known.
    fn accept(&mut self, proposal: Proposal, now: Duration) {
        let Proposal { view, base, base_start } = proposal;
        let me = self.config.me;
        if self.tick == 0 {
            return;
        }
        let is_later = self.sessions.back().is_none_or(|last| last.view.version < view.version);
        if !is_later || view.place(me).is_none() || view.space.axis != self.config.terms.axis {
            return;
        }
        if let Some(last) = self.sessions.back_mut().filter(|last| last.start.is_none()) {
            if last.view.version == base {
                last.start = Some(base_start);
            } else {
                // It will not start.
                self.sessions.pop_back();
            }
        }
        self.counter = self.counter.max(view.version.counter);
        let prior = self.sessions.back().map_or_else(Version::default, |last| last.view.version);
        // The next view starts after this one.
        let start = self.sessions.back().and_then(|last| last.start).unwrap_or(0);
        let at = (self.tick, self.tick.max(start) + HOLD_TICKS, self.config.margin);
        let session = Session::new((view, me, prior), at, &self.locals, now);
        self.sessions.extend(session);
    }

    /// Ends a tick: `changes` are indices of the own machine's boxes, and what they are now, each index once.
    ///
    /// # Errors
    /// [`CullError`] where there are more pairs between machines than one bridge can look at.
    pub fn tick(&mut self, changes: &[IndexNow], now: Duration) -> Result<Output, CullError> {
        self.tick = (self.tick + 1).max(self.highest).max(1);
        let changes = self.note(changes);
        for at in 0..self.sessions.len() {
            let start = self.sessions.get(at + 1).and_then(|next| next.start);
            let session = &mut self.sessions[at];
            if start.is_none_or(|start| !session.is_published_until(start)) {
                session.publish(self.tick, &changes, now);
            }
        }
        let mut output = Output::default();
        self.keep_views(now, &mut output);
        self.evaluate(now, &mut output)?;
        self.send(now, &mut output);
        self.show(&mut output);
        Ok(output)
    }

    fn note(&mut self, changes: &[IndexNow]) -> Vec<Change> {
        let locals = &mut self.locals;
        let note = |(index, new): &IndexNow| {
            let old = match new {
                Some(local) => locals.insert(*index, *local),
                None => locals.remove(index),
            };
            Change { index: *index, old, new: *new }
        };
        changes.iter().map(note).collect()
    }

    fn is_settled(&self, now: Duration) -> bool {
        now >= self.born + self.config.lease() / 2
    }

    /// Contacts that sent something within a lease.
    fn live(&self, now: Duration) -> impl Iterator<Item = &Contact> {
        let lease = self.config.lease();
        let is_live =
            move |contact: &&Contact| now < contact.at + lease && now >= contact.suspected_until;
        self.contacts.values().filter(is_live)
    }

    fn keep_views(&mut self, now: Duration, output: &mut Output) {
        let lease = self.config.lease();
        self.contacts.retain(|_, contact| now < contact.at + lease * REMEMBERED_LEASES);
        // Who acknowledges nothing is as good as lost, and counts so for a while. Who has not accepted a view cannot: that
        // is its steward's business, which may be lost itself. Who is in a later view acknowledges there alone, also where
        // this bridge was left out of it; the steward, whom all wait for, is in no later one than its own.
        let leads = self.is_steward(now);
        let Self { config, contacts, sessions, .. } = self;
        let may_answer = |session: &Session, link: &Link, latest: u64| {
            let Version { counter, steward } = session.view.version;
            let has_accepted = session.start.is_some() || link.prior.is_some();
            steward == config.me.machine || has_accepted && (leads || latest <= counter)
        };
        for contact in contacts.values_mut() {
            let latest = contact.beat.as_ref().map_or(0, |beat| beat.counter);
            let links = sessions.iter().flat_map(|session| {
                let open = session.others().filter(|link| !link.is_closed);
                open.filter(move |link| may_answer(session, link, latest))
            });
            let of = links.filter(|link| link.peer == contact.peer);
            if of.map(|link| link.out.waits(now)).min().is_some_and(|least| least > lease) {
                contact.suspected_until = now + lease;
            }
        }
        if now >= self.next_beat {
            self.next_beat = now + lease / BEATS_A_LEASE;
            let beat = self.beat(now);
            output.messages.push((Destination::All, self.head.message(&Message::Beat(beat))));
        }
        if self.is_steward(now) {
            self.propose_if_due(now);
        }
        self.drive(now, output);
    }

    fn beat(&self, now: Duration) -> Beat {
        let suspects = self.contacts.iter().filter(|(_, contact)| now < contact.suspected_until);
        let step = self.locals.len() / SPREAD_SAMPLE + 1;
        let axis = usize::from(self.config.terms.axis);
        let sample = self.locals.values().step_by(step).filter(|(_, state)| state.is_there());
        let mut spread = Spread::of(sample.map(|(_, state)| state.aabb.min[axis]).collect());
        spread.count = spread.count.saturating_mul(step as u32);
        Beat {
            terms: self.config.terms,
            tick: self.tick,
            is_settled: self.is_settled(now),
            counter: self.counter,
            suspects: suspects.map(|(machine, _)| *machine).collect(),
            spread,
        }
    }

    fn is_steward(&self, now: Duration) -> bool {
        let is_settled =
            |contact: &&Contact| contact.beat.as_ref().is_some_and(|beat| beat.is_settled);
        let lowest = self.live(now).filter(is_settled).map(|contact| contact.peer.machine).min();
        self.is_settled(now) && lowest.is_none_or(|lowest| self.config.me.machine < lowest)
    }

    fn propose_if_due(&mut self, now: Duration) {
        let me = self.config.me;
        // A link that is cut between two others parts the higher one from the scene.
        let is_suspected = |of: &Contact| {
            let mut lower = self.live(now).filter(|contact| contact.peer.machine < of.peer.machine);
            lower.any(|contact| {
                contact.beat.as_ref().is_some_and(|beat| beat.suspects.contains(&of.peer.machine))
            })
        };
        let there =
            self.live(now).filter(|contact| contact.beat.is_some() && !is_suspected(contact));
        let mut members: Vec<Peer> = there.map(|contact| contact.peer).chain([me]).collect();
        members.sort_unstable();
        let Some(last) = self.sessions.back() else { return };
        let own = self.beat(now).spread;
        let spread = |peer: &Peer| {
            let beat = self.contacts.get(&peer.machine).and_then(|contact| contact.beat.as_ref());
            if *peer == me { own } else { beat.map(|beat| beat.spread).unwrap_or_default() }
        };
        let spreads: Vec<Spread> = members.iter().map(spread).collect();
        let is_balanced = || match self.config.rebalance {
            Some(_) if self.sessions.len() == 1 && now >= self.next_rebalance => {
                last.view.space.imbalance(&spreads) < IMBALANCE
            }
            _ => true,
        };
        if last.view.members == members && is_balanced() {
            return;
        }
        self.next_rebalance = now + self.config.rebalance.unwrap_or_default();
        let version = Version { counter: self.counter + 1, steward: me.machine };
        let space = Space::balanced(self.config.terms.axis, &spreads);
        self.next_proposal = now;
        let (base, base_start) = self.base();
        let view = View { version, members, space };
        self.accept(Proposal { view, base, base_start }, now);
    }

    /// The last view that has a first tick, and that tick.
    fn base(&self) -> (Version, u64) {
        let started = |session: &Session| Some((session.view.version, session.start?));
        self.sessions.iter().rev().find_map(started).unwrap_or_default()
    }

    /// Brings the last view forward, where it is this bridge's proposal.
    fn drive(&mut self, now: Duration, output: &mut Output) {
        let (me, head) = (self.config.me, self.head);
        let beat = self.config.lease() / BEATS_A_LEASE / 2;
        let (base, base_start) = self.base();
        let Some(last) = self.sessions.back_mut() else { return };
        if last.view.version.steward != me.machine {
            return;
        }
        if last.start.is_none() {
            last.start = last.latest_hold().map(|hold| hold + 1);
        }
        if now >= self.next_proposal && last.others().any(|link| link.prior.is_none()) {
            self.next_proposal = now + beat;
            let proposal = Proposal { view: last.view.clone(), base, base_start };
            let bytes = head.message(&Message::Propose(proposal));
            for link in last.others().filter(|link| link.prior.is_none()) {
                output.messages.push((Destination::One(link.peer.machine), bytes.clone()));
            }
        }
    }

    fn send(&mut self, now: Duration, output: &mut Output) {
        let lease = self.config.lease();
        let head = self.head;
        for session in self.sessions.iter_mut().chain(&mut self.retired) {
            session.send(&head, (now, lease / BEATS_A_LEASE), |to, bytes| {
                output.messages.push((Destination::One(to), bytes));
            });
        }
        let has_all = |session: &Session| {
            session.others().all(|link| link.is_closed || link.out.acknowledged == link.out.last())
        };
        self.retired.retain(|session| {
            !has_all(session) && session.ended_at.is_none_or(|at| now < at + lease)
        });
    }

    /// Evaluates all ticks that can be.
    fn evaluate(&mut self, now: Duration, output: &mut Output) -> Result<(), CullError> {
        loop {
            self.close_left(now);
            let start = self.sessions.get(1).and_then(|next| next.start);
            // What later views hold back; without one, nothing.
            let latest = self.sessions.back().filter(|_| self.sessions.len() > 1);
            let limit = match (start, latest) {
                (Some(start), _) => start.saturating_sub(1),
                (None, Some(latest)) => latest.hold,
                (None, None) => u64::MAX,
            };
            let Some(first) = self.sessions.front_mut() else { return Ok(()) };
            let next = first.next_tick().filter(|tick| *tick <= limit);
            if let Some(tick) = next.filter(|tick| first.has_received(*tick)) {
                let lost = first.drop_lost(tick);
                first.advance(tick);
                let report = self.report(None, lost)?;
                output.reports.push(report);
                continue;
            }
            let Some(start) = start else { return Ok(()) };
            let overdue_after = self.config.lease() / 2;
            let is_over = next.is_none() && first.has_received(start);
            let is_overdue = first.ended_at.is_some_and(|at| now > at + overdue_after);
            let has_next = self.sessions[1].has_received(start);
            if !(is_over || is_overdue) || !has_next {
                return Ok(());
            }
            let Some(mut before) = self.sessions.pop_front() else { return Ok(()) };
            let lost = before.drop_lost(u64::MAX);
            // What becomes of pairs that are another one's from now on, both boxes may be out of sight in the next view.
            before.advance(start);
            let first = &mut self.sessions[0];
            first.advance(start.saturating_sub(1));
            first.advance(start);
            let mut report = self.report(Some(&before), lost)?;
            report.is_resync = !is_over;
            output.reports.push(report);
            before.ended_at = Some(now);
            self.retired.push(before);
        }
    }

    /// Waits no more, in each view that ends, for members that do not go on to the next.
    fn close_left(&mut self, now: Duration) {
        for at in 1..self.sessions.len() {
            if self.sessions[at].start.is_none() {
                break;
            }
            let ending = self.sessions[at - 1].view.version;
            let links = self.sessions[at - 1].others();
            // Who comes from another view publishes nothing in this one any more.
            let goes_on = |peer: Peer| {
                let next = &self.sessions[at];
                let is_open = next.others().any(|link| link.peer == peer && !link.is_closed);
                is_open && next.prior_of(peer).is_none_or(|prior| prior == ending)
            };
            let gone: Vec<Peer> =
                links.map(|link| link.peer).filter(|peer| !goes_on(*peer)).collect();
            let session = &mut self.sessions[at - 1];
            session.ended_at.get_or_insert(now);
            for link in session.links.iter_mut().filter(|link| gone.contains(&link.peer)) {
                link.is_closed = true;
            }
        }
    }

    /// Reports the tick up to which the first view was advanced; `ended` is the view before, where this is its first tick.
    fn report(&mut self, ended: Option<&Session>, lost: Vec<Peer>) -> Result<Report, CullError> {
        let Some(session) = self.sessions.front() else { return Ok(Report::default()) };
        let me = self.config.me;
        let axis = usize::from(session.view.space.axis);
        let mut report = Report { tick: session.applied, lost, ..Report::default() };
        for peer in &report.lost {
            self.missing.insert(peer.machine);
            self.mine.retain(|pair| pair.iter().all(|id| id.machine != peer.machine));
        }
        if ended.is_some() {
            self.missing.retain(|machine| session.member(*machine).is_none());
        }
        let all = session.replica.pairs(axis)?;
        let own = all.into_iter().filter(|(_, corner)| session.view.owner(*corner) == me);
        let now: BTreeSet<PairId> = own.map(|(pair, _)| pair).collect();
        for pair in now.difference(&self.mine) {
            let was = was_reported(session, ended, *pair);
            if was { &mut report.taken } else { &mut report.begun }.push(*pair);
        }
        for pair in self.mine.difference(&now) {
            let before = |id| ended.and_then(|ended| ended.replica.now(id));
            let [a, b] = pair.map(|id| session.replica.now(id).or_else(|| before(id)));
            match (a, b) {
                (Some(a), Some(b)) if a.meets(&b) => report.given.push(*pair),
                (Some(a), Some(b)) if a.aabb.overlaps(&b.aabb) => {
                    report.ended.push((*pair, EndReason::Filtered));
                }
                (Some(_), Some(_)) => report.ended.push((*pair, EndReason::Separated)),
                _ => report.ended.push((*pair, EndReason::Removed)),
            }
        }
        self.mine = now;
        Ok(report)
    }

    /// Brings the ghosts in the local scene up to date.
    fn show(&mut self, output: &mut Output) {
        let tick = self.tick;
        let is_shown = |session: &Session| {
            let is_there =
                session.others().all(|link| link.is_closed || link.incoming.received > 0);
            is_there && session.start.is_some_and(|start| start <= tick)
        };
        let at = self.sessions.iter().rposition(is_shown).unwrap_or(0);
        let keeps = self.config.at_end == AtEnd::Keep;
        let Some(session) = self.sessions.get_mut(at) else { return };
        let is_new = self.shown != session.view.version;
        self.shown = session.view.version;
        if is_new {
            let gone: Vec<MachineId> = self.written.keys().copied().collect();
            for machine in gone.into_iter().filter(|machine| session.member(*machine).is_none()) {
                if !keeps {
                    let ghosts = self.written.remove(&machine).unwrap_or_default();
                    let ended = |index| Ghost { machine, index, state: None };
                    output.ghosts.extend(ghosts.into_keys().map(ended));
                }
            }
        }
        for link in &mut session.links {
            let machine = link.peer.machine;
            let written = self.written.entry(machine).or_default();
            let mut touched: BTreeSet<u32> = std::mem::take(&mut link.dirty);
            if is_new {
                touched.extend(written.keys().chain(link.latest.keys()));
            }
            for index in touched {
                let state = link.latest.get(&index).copied();
                let was = match state {
                    Some(state) => written.insert(index, state),
                    None => written.remove(&index),
                };
                if was != state {
                    output.ghosts.push(Ghost { machine, index, state });
                }
            }
        }
        self.written.retain(|_, ghosts| !ghosts.is_empty());
    }

    /// Where it stands.
    pub fn status(&self) -> Status {
        let session = self.sessions.front();
        let peer = |link: &Link| PeerStatus {
            peer: link.peer,
            age: self.tick.saturating_sub(link.incoming.received),
            ghosts: link.latest.len(),
            kept_bytes: link.out.kept_bytes(),
        };
        Status {
            tick: self.tick,
            evaluated: session.map_or(0, |session| session.applied),
            version: session.map(|session| session.view.version).unwrap_or_default(),
            cuts: session.map(|session| session.view.space.cuts.clone()).unwrap_or_default(),
            peers: session.map(|s| s.others().map(peer).collect()).unwrap_or_default(),
            missing: self.missing.iter().copied().collect(),
            boxes: self.locals.len(),
            ghosts: self.written.values().map(ByIndex::len).sum(),
            pairs: self.mine.len(),
        }
    }
}

/// Whether a pair that a bridge comes to own was there the tick before, and somebody's to report who goes on to this view.
fn was_reported(session: &Session, ended: Option<&Session>, pair: PairId) -> bool {
    let [a, b] = pair.map(|id: BoxId| session.replica.before(id));
    let (Some(a), Some(b)) = (a, b) else { return false };
    if !a.meets(&b) {
        return false;
    }
    let Some(ended) = ended else { return true };
    let prior = |machine| session.member(machine).and_then(|peer| session.prior_of(peer));
    let [a_prior, b_prior] = pair.map(|id| prior(id.machine));
    if a_prior != b_prior {
        return false;
    }
    if a_prior != Some(ended.view.version) {
        // They come from another view than this bridge, where the pair was somebody's.
        return true;
    }
    let axis = usize::from(ended.view.space.axis);
    let owner = ended.view.owner(a.corner_with(&b, axis));
    session.prior_of(owner) == a_prior
}
