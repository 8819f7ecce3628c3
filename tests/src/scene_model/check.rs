//! A script, played on a scene and on the model.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use pairmask_core::Aabb;
use pairmask_core::filters::{FilterData, FilterId, Owner, World};
use pairmask_core::scene::QueryFilterData;

use super::generate::MEMBERS;
use super::model::{Listener, Model, Received};
use super::script::{AtEnd, Event, Fate, HOST, Op, Pair, Scope, Script, Turn};
use crate::queried::a_query;
use crate::stress_scenes::Rng;

/// A scene that is held to the model. Scripts are right: a refusal is a failure.
pub trait Subject {
    /// Applies edits: of one member, or one of each. Returns for each the number of its tick and what was reported,
    /// if it was waited for.
    fn tick(&mut self, turns: &[Turn]) -> Result<Vec<(u64, Option<Received>)>, String>;

    fn invalidate(&mut self) {}

    fn snapshot(&mut self, _number: u32) -> Result<(), String> {
        Err("no snapshots".into())
    }

    fn restore(&mut self, _number: u32) -> Result<(), String> {
        Err("no snapshots".into())
    }

    fn forget(&mut self, _number: u32) -> Result<(), String> {
        Err("no snapshots".into())
    }

    fn join(&mut self, _member: u32, _scope: Scope, _own: Range<u32>) -> Result<(), String> {
        Err("not shared".into())
    }

    fn leave(&mut self, _member: u32) {}

    /// The user data of an index, as a member knows it, where the subject is asked that.
    fn user_data(&self, _member: u32, _index: u32) -> Option<u64> {
        None
    }

    /// Whether any changes may come as a resync, as where daemons are killed.
    fn may_resync(&self) -> bool {
        false
    }

    /// Whether an answer is acknowledged by being read, regardless of what its fate was to be; else by its fate alone.
    fn reading_acknowledges(&self) -> bool {
        false
    }

    fn box_count(&self) -> Option<usize> {
        None
    }

    /// The boxes that some others overlap, where the subject is asked that.
    fn query(&mut self, _: &[Aabb], _: QueryFilterData<'_>) -> Option<Result<Vec<Pair>, String>> {
        None
    }
}

/// Indices whose user data are compared.
const MOST_MARKED: u32 = 200;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    pub event: usize,
    pub kind: &'static str,
    pub text: String,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Seen {
    pub edits: usize,
    pub ended: [usize; 3],
    pub resyncs: usize,
    /// Pairs that began, and pairs of now.
    pub pairs: usize,
}

impl Seen {
    pub fn add(&mut self, other: Self) {
        self.edits += other.edits;
        self.resyncs += other.resyncs;
        self.pairs += other.pairs;
        self.ended.iter_mut().zip(other.ended).for_each(|(sum, count)| *sum += count);
    }

    fn note(&mut self, received: &Received) {
        self.resyncs += usize::from(received.is_resync);
        self.pairs += received.begun.len() + received.pairs.len();
        received.ended.iter().for_each(|ended| self.ended[ended.reason as usize] += 1);
    }
}

fn difference(received: &Received, expected: &Received) -> Option<(&'static str, String)> {
    fn first<T: PartialEq + std::fmt::Debug>(received: &[T], expected: &[T]) -> Option<String> {
        let longest = received.len().max(expected.len());
        let at = (0..longest).find(|at| received.get(*at) != expected.get(*at))?;
        let [h, e] = [received.get(at), expected.get(at)];
        Some(format!("{h:?} for {e:?} at {at} of {} for {}", received.len(), expected.len()))
    }
    if received.is_resync != expected.is_resync {
        return Some(("resync", format!("{} for {}", received.is_resync, expected.is_resync)));
    }
    let lists = [
        ("pairs", first(&received.pairs, &expected.pairs)),
        ("begun", first(&received.begun, &expected.begun)),
        ("ended", first(&received.ended, &expected.ended)),
    ];
    let list = lists.into_iter().find_map(|(kind, text)| Some((kind, text?)));
    let counts = (received.pair_count, expected.pair_count);
    list.or_else(|| {
        (counts.0 != counts.1).then(|| ("count", format!("{:?} for {:?}", counts.0, counts.1)))
    })
}

#[derive(Default)]
struct Play {
    model: Model,
    listeners: BTreeMap<u32, Listener>,
    memberships: u64,
    snapshots: BTreeMap<u32, (Model, Listener)>,
    went_back: bool,
    seen: Seen,
}

pub fn check(script: &Script, subject: &mut dyn Subject) -> Result<Seen, Failure> {
    let mut play = Play::default();
    if script.shared.is_none() {
        play.listeners.insert(0, Listener::new(0, false, None));
    }
    for (event, happens) in script.events.iter().enumerate() {
        let done = play.event(script, happens, subject);
        let done = done.and_then(|()| play.query(event, subject));
        done.map_err(|(kind, text)| Failure {
            event,
            kind,
            text: format!("event {event}: {kind}: {text}"),
        })?;
    }
    Ok(play.seen)
}

impl Play {
    fn event(
        &mut self,
        script: &Script,
        event: &Event,
        subject: &mut dyn Subject,
    ) -> Result<(), (&'static str, String)> {
        match event {
            Event::Join(member, scope) => {
                let own = script.own(*member);
                let reported_of = (*scope == Scope::Own).then(|| own.clone());
                self.memberships += 1;
                self.listeners.insert(*member, Listener::new(self.memberships, true, reported_of));
                subject.join(*member, *scope, own).map_err(|error| ("refused", error))
            }
            Event::Leave(member) => {
                self.listeners.remove(member);
                if script.shared == Some(AtEnd::Remove) {
                    self.model.clear(script.own(*member));
                }
                subject.leave(*member);
                Ok(())
            }
            Event::Invalidate => {
                subject.invalidate();
                self.listeners.values_mut().for_each(|listener| listener.is_lost = true);
                Ok(())
            }
            Event::Snapshot(number) => {
                let listener = self.listeners.get_mut(&HOST).expect("not shared");
                // What boxes were when pairs were last reported is known with snapshots alone.
                listener.is_lost |= self.snapshots.is_empty() && listener.is_behind();
                self.snapshots.insert(*number, (self.model.clone(), listener.clone()));
                subject.snapshot(*number).map_err(|error| ("refused", error))
            }
            Event::Restore(number) => {
                let (model, listener) = self.snapshots[number].clone();
                self.model = model;
                self.listeners.insert(HOST, listener);
                self.went_back = true;
                subject.restore(*number).map_err(|error| ("refused", error))?;
                self.check_user_data(script, subject)?;
                self.check_count(subject)
            }
            Event::Forget(number) => {
                self.snapshots.remove(number);
                subject.forget(*number).map_err(|error| ("refused", error))
            }
            Event::Tick(turns) => {
                let reported = subject.tick(turns).map_err(|error| ("refused", error))?;
                // One that came too late under load is part of the next tick.
                let mut by_tick: BTreeMap<u64, Vec<(&Turn, Option<Received>)>> = BTreeMap::new();
                for (turn, (tick, received)) in turns.iter().zip(reported) {
                    by_tick.entry(tick).or_default().push((turn, received));
                }
                let (may_resync, by_reading) =
                    (subject.may_resync(), subject.reading_acknowledges());
                let mut ticks = by_tick.into_values();
                let is_shared = script.shared.is_some();
                ticks.try_for_each(|turns| self.tick(turns, is_shared, may_resync, by_reading))?;
                self.check_user_data(script, subject)?;
                self.check_count(subject)
            }
        }
    }

    /// What the host knows, which receives the answer of each tick.
    fn check_user_data(
        &self,
        script: &Script,
        subject: &dyn Subject,
    ) -> Result<(), (&'static str, String)> {
        let end = script.own(MEMBERS).start.max(script.limit).min(MOST_MARKED);
        for index in 0..end {
            // Snapshots have the user data of boxes alone.
            if self.went_back && !self.model.has(index) {
                continue;
            }
            let expected = self.model.user_data(index);
            if let Some(found) = subject.user_data(HOST, index).filter(|found| *found != expected) {
                return Err(("user data", format!("{found} for {expected} of {index}")));
            }
        }
        Ok(())
    }

    fn check_count(&self, subject: &dyn Subject) -> Result<(), (&'static str, String)> {
        match subject.box_count() {
            Some(len) if len != self.model.len() => {
                Err(("boxes", format!("{len} for {}", self.model.len())))
            }
            _ => Ok(()),
        }
    }

    /// Asks who is near some boxes, all of them among those.
    fn query(&self, event: usize, subject: &mut dyn Subject) -> Result<(), (&'static str, String)> {
        let mut rng = Rng::new(event as u64);
        let all = Aabb::new([f32::NEG_INFINITY; 3], [f32::INFINITY; 3]);
        let queries = [all, a_query(&mut rng, 3.0), a_query(&mut rng, 20.0)];
        let filter_data = FilterData::new(World(0), Owner(1), FilterId(rng.below(4) as u16));
        let filter_data = [QueryFilterData::None, QueryFilterData::One(filter_data)][event % 2];
        let Some(found) = subject.query(&queries, filter_data) else { return Ok(()) };
        let (found, expected) =
            (found.map_err(|error| ("refused", error))?, self.model.query(&queries, filter_data));
        if found == expected {
            return Ok(());
        }
        Err(("query", format!("{found:?} for {expected:?}, {filter_data:?}")))
    }

    fn tick(
        &mut self,
        reported: Vec<(&Turn, Option<Received>)>,
        is_shared: bool,
        may_resync: bool,
        reading_acknowledges: bool,
    ) -> Result<(), (&'static str, String)> {
        let named: BTreeSet<u32> = reported
            .iter()
            .flat_map(|(turn, _)| self.model.apply(self.listeners[&turn.member].id, &turn.ops))
            .collect();
        let changes = |op: &Op| !matches!(op, Op::UserData(..));
        if reported.iter().any(|(turn, _)| turn.ops.iter().any(changes)) {
            self.listeners.values_mut().for_each(Listener::note_edit);
        }
        self.listeners.values_mut().for_each(|listener| listener.note_named(&named, is_shared));
        let now = self.model.pairs();
        for (turn, received) in reported {
            self.seen.edits += 1;
            let listener = self.listeners.get_mut(&turn.member).expect("it has joined");
            if let Some(received) = received {
                listener.is_lost |= may_resync && received.is_resync;
                let expected = listener.expects(&self.model, &now, turn.mode);
                if let Some((kind, text)) = difference(&received, &expected) {
                    return Err((
                        kind,
                        format!("{text}, {:?} of member {}", turn.mode, turn.member),
                    ));
                }
                self.seen.note(&received);
                if reading_acknowledges || turn.fate == Fate::Acknowledged {
                    listener.acknowledge(&now, turn.mode);
                }
            }
        }
        Ok(())
    }
}
