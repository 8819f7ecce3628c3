//! One view at work: streams to and from its members, and the replica by which pairs between machines are found.
//!
//! A member publishes to another one the boxes within the margin of its slab: a snapshot first, then edits, one batch a tick.

use std::collections::{BTreeSet, HashMap, VecDeque};
use std::hash::{BuildHasherDefault, DefaultHasher};
use std::time::Duration;

use crate::ids::{MachineId, Peer};
use crate::protocol::{Batch, Edits, Entered, Head};
use crate::replica::Replica;
use crate::state::BoxState;
use crate::stream::{Incoming, Outgoing};
use crate::view::{Version, View};

/// Boxes by index, iterated over in the same order in each run: simulations are to repeat themselves.
pub type ByIndex<T> = HashMap<u32, T, BuildHasherDefault<DefaultHasher>>;

/// A box at an index: how many boxes the index had before, and what it is.
pub type Local = (u32, BoxState);

/// An index, and what it has now.
pub type IndexNow = (u32, Option<Local>);

/// What became of the box of an index in a tick.
#[derive(Clone, Copy, Debug)]
pub struct Change {
    pub index: u32,
    pub old: Option<Local>,
    pub new: Option<Local>,
}

/// A member of the view, and the streams to and from it. Those of a bridge with itself are not used.
#[derive(Debug)]
pub struct Link {
    pub peer: Peer,
    pub out: Outgoing,
    pub incoming: Incoming,
    /// Batches that came and are not evaluated.
    pending: VecDeque<(u64, Edits)>,
    /// Its boxes, as of the last batch that came.
    pub latest: ByIndex<Local>,
    /// Indices among them that changed since a look at them.
    pub dirty: BTreeSet<u32>,
    /// The view that it comes from, once it has accepted this one.
    pub prior: Option<Version>,
    /// The last tick that it evaluates in an earlier view without knowing where this one starts.
    pub hold: u64,
    /// Whether it is a member of the next view no more: what still comes is not read.
    pub is_closed: bool,
}

/// The view, and all that belongs to it.
#[derive(Debug)]
pub struct Session {
    pub view: View,
    me: usize,
    pub prior: Version,
    /// The first tick that is evaluated in it.
    pub start: Option<u64>,
    pub hold: u64,
    margin: f32,
    pub links: Vec<Link>,
    own: VecDeque<(u64, Edits)>,
    own_last: u64,
    pub replica: Replica,
    pub applied: u64,
    /// When it had to end.
    pub ended_at: Option<Duration>,
}

/// Sorts what became of a box into the edits of somebody who had it in sight, or has it now.
fn sort_in(edits: &mut Edits, change: &Change, was_seen: bool, is_seen: bool) {
    let Change { index, old, new } = *change;
    let old = old.filter(|_| was_seen);
    let before = change.old.filter(|(of, _)| new.is_some_and(|(is, _)| is == *of));
    let before = before.map(|(_, state)| state);
    match (old, new) {
        (Some((was, old)), Some((is, new))) if was == is => match is_seen {
            true if old == new => {}
            true if old.is_like(&new) => edits.moved.push((index, new.aabb)),
            true => edits.entered.push(Entered { index, incarnation: is, state: new, before }),
            false => edits.left.push((index, new)),
        },
        (_, Some((incarnation, state))) if is_seen => {
            edits.entered.push(Entered { index, incarnation, state, before });
        }
        (Some(_), _) => edits.removed.push(index),
        (None, _) => {}
    }
}

impl Session {
    /// Begins a view, with a snapshot of the boxes of a tick.
    pub fn new(
        (view, me, prior): (View, Peer, Version),
        (tick, hold, margin): (u64, u64, f32),
        locals: &ByIndex<Local>,
        now: Duration,
    ) -> Option<Self> {
        let me = view.place(me)?;
        let link = |peer: &Peer| Link {
            peer: *peer,
            out: Outgoing::default(),
            incoming: Incoming::default(),
            pending: VecDeque::new(),
            latest: ByIndex::default(),
            dirty: BTreeSet::new(),
            prior: None,
            hold: 0,
            is_closed: false,
        };
        let links = view.members.iter().map(link).collect();
        let mut session = Self {
            view,
            me,
            prior,
            start: None,
            hold,
            margin,
            links,
            own: VecDeque::new(),
            own_last: 0,
            replica: Replica::default(),
            applied: 0,
            ended_at: None,
        };
        let appeared =
            |(index, local): (&u32, &Local)| Change { index: *index, old: None, new: Some(*local) };
        session.publish(tick, &locals.iter().map(appeared).collect::<Vec<_>>(), now);
        Some(session)
    }

    /// Adds a batch of what became of boxes to each stream.
    pub fn publish(&mut self, tick: u64, changes: &[Change], now: Duration) {
        let mut edits = vec![Edits::default(); self.links.len()];
        let space = &self.view.space;
        for change in changes {
            let near = |local: Option<Local>| {
                local.and_then(|(_, state)| space.slabs_near(&state, self.margin))
            };
            let (was, is) = (near(change.old), near(change.new));
            let all = match (&was, &is) {
                (Some(a), Some(b)) => *a.start().min(b.start())..=*a.end().max(b.end()),
                (Some(one), None) | (None, Some(one)) => one.clone(),
                // Nobody sees it, but here it is.
                (None, None) => {
                    sort_in(&mut edits[self.me], change, true, true);
                    continue;
                }
            };
            sort_in(&mut edits[self.me], change, true, true);
            for slab in all {
                let member = usize::from(space.owners[slab]);
                if member != self.me {
                    let sees = |near: &Option<_>| {
                        near.as_ref().is_some_and(|slabs: &std::ops::RangeInclusive<usize>| {
                            slabs.contains(&slab)
                        })
                    };
                    sort_in(&mut edits[member], change, sees(&was), sees(&is));
                }
            }
        }
        let me = self.me;
        for (member, (link, mut edits)) in self.links.iter_mut().zip(edits).enumerate() {
            edits.sort();
            if member == me {
                self.own_last = tick;
                self.own.push_back((tick, edits));
            } else if !link.is_closed {
                link.out.push(tick, edits.to_bytes(), now);
            }
        }
    }

    /// Takes a member's batch in.
    pub fn receive(&mut self, from: Peer, mut batch: Batch, now: Duration) {
        let Some(place) = self.view.place(from) else { return };
        let link = &mut self.links[place];
        if link.is_closed {
            return;
        }
        link.out.acknowledge(batch.acknowledged, batch.seen, now);
        link.prior = Some(batch.prior);
        link.hold = batch.hold;
        // The steward's word, which each member passes on: it may reach this one though the steward has died.
        if batch.start != 0 {
            self.start.get_or_insert(batch.start);
        }
        let Link { incoming, pending, latest, dirty, .. } = link;
        // A batch of no tick of its own only acknowledges.
        if batch.since == batch.tick {
            batch.edits = Edits::default();
            if batch.tick <= incoming.received {
                return;
            }
        }
        incoming.take(batch, |batch| {
            note_latest(latest, dirty, &batch.edits);
            pending.push_back((batch.tick, batch.edits));
        });
    }

    /// Writes the batches that are due, and acknowledgements of what came where none is.
    pub fn send(
        &mut self,
        head: &Head,
        (now, slowest): (Duration, Duration),
        mut f: impl FnMut(MachineId, Vec<u8>),
    ) {
        let (version, prior) = (self.view.version, self.prior);
        let (start, hold) = (self.start.unwrap_or(0), self.hold);
        for link in self.links.iter_mut().filter(|link| link.peer != head.from && !link.is_closed) {
            let Link { peer, out, incoming, .. } = link;
            let [acknowledged, seen] = [incoming.received, incoming.seen];
            let batch = |since, tick| Batch {
                to: *peer,
                version,
                prior,
                start,
                hold,
                acknowledged,
                seen,
                since,
                tick,
                edits: Edits::default(),
            };
            let mut has_sent = false;
            out.send_due((now, slowest), |since, tick, edits| {
                has_sent = true;
                f(peer.machine, head.batch(&batch(since, tick), edits));
            });
            if std::mem::take(&mut incoming.owes) && !has_sent {
                let nothing = Edits::default().to_bytes();
                f(peer.machine, head.batch(&batch(out.last(), out.last()), &nothing));
            }
        }
    }

    /// Whether all has come up to a tick from each member that is to be waited for.
    pub fn has_received(&self, tick: u64) -> bool {
        self.own_last >= tick
            && self.others().all(|link| link.is_closed || link.incoming.received >= tick)
    }

    /// Whether all is published that it takes to end it, where the next view starts at a tick: what leaves the sight of a
    /// member with the view has gone out of it by this one's last batch, of that tick.
    pub const fn is_published_until(&self, start: u64) -> bool {
        self.own_last >= start
    }

    /// Members but this bridge.
    pub fn others(&self) -> impl Iterator<Item = &Link> {
        let me = self.me;
        self.links.iter().enumerate().filter(move |(place, _)| *place != me).map(|(_, link)| link)
    }

    /// Whether every member has accepted the view, and how far they evaluate earlier ones.
    pub fn latest_hold(&self) -> Option<u64> {
        let mut latest = self.hold;
        for link in self.others() {
            link.prior?;
            latest = latest.max(link.hold);
        }
        Some(latest)
    }

    /// The next tick of which there are edits.
    pub fn next_tick(&self) -> Option<u64> {
        let next = |queue: &VecDeque<(u64, Edits)>| queue.front().map(|(tick, _)| *tick);
        self.links.iter().filter_map(|link| next(&link.pending)).chain(next(&self.own)).min()
    }

    /// Evaluates up to a tick.
    pub fn advance(&mut self, tick: u64) {
        while let Some(next) = self.next_tick().filter(|next| *next <= tick) {
            self.begin(next);
            let me = self.view.members[self.me].machine;
            while let Some((_, edits)) = self.own.pop_front_if(|(at, _)| *at == next) {
                self.replica.apply(me, &edits);
            }
            for link in &mut self.links {
                while let Some((_, edits)) = link.pending.pop_front_if(|(at, _)| *at == next) {
                    self.replica.apply(link.peer.machine, &edits);
                }
            }
        }
        if self.applied < tick {
            self.begin(tick);
        }
    }

    fn begin(&mut self, tick: u64) {
        self.applied = tick;
        self.replica.begin(tick);
    }

    /// Members whose last batch is before a tick, and that are not waited for: their boxes are dropped.
    pub fn drop_lost(&mut self, tick: u64) -> Vec<Peer> {
        let mut lost = Vec::new();
        for link in &mut self.links {
            if link.is_closed && link.incoming.received < tick && link.prior.take().is_some() {
                self.replica.drop_machine(link.peer.machine);
                link.pending.clear();
                lost.push(link.peer);
            }
        }
        lost
    }

    /// The view that a member comes from.
    pub fn prior_of(&self, peer: Peer) -> Option<Version> {
        let place = self.view.place(peer)?;
        if place == self.me { Some(self.prior) } else { self.links[place].prior }
    }

    /// The member of a machine.
    pub fn member(&self, machine: MachineId) -> Option<Peer> {
        let place = self.view.members.binary_search_by_key(&machine, |peer| peer.machine);
        place.ok().map(|place| self.view.members[place])
    }
}

fn note_latest(latest: &mut ByIndex<Local>, dirty: &mut BTreeSet<u32>, edits: &Edits) {
    for (index, aabb) in &edits.moved {
        if let Some((_, state)) = latest.get_mut(index) {
            state.aabb = *aabb;
        }
        dirty.insert(*index);
    }
    for entered in &edits.entered {
        latest.insert(entered.index, (entered.incarnation, entered.state));
        dirty.insert(entered.index);
    }
    for index in edits.left.iter().map(|(index, _)| index).chain(&edits.removed) {
        latest.remove(index);
        dirty.insert(*index);
    }
}
