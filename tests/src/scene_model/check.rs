//! A script, played on a scene and on the model.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use pairmask_core::Aabb;
use pairmask_core::filters::{FilterId, Owner, Tag, World};
use pairmask_core::scene::QueryTags;

use super::model::{Heard, Listener, Model};
use super::script::{AtEnd, Event, Fate, Pair, Scope, Script, Turn};
use crate::queried::a_query;
use crate::stress_scenes::Rng;

/// A scene that is held to the model. Scripts are right: whatever it refuses is a failure.
pub trait Subject {
    /// Applies edits: of one member, or one of each. Returns for each the number of its tick and what was told,
    /// if it was waited for.
    fn tick(&mut self, turns: &[Turn]) -> Result<Vec<(u64, Option<Heard>)>, String>;

    fn invalidate(&mut self) {}

    fn join(&mut self, _member: u32, _scope: Scope, _own: Range<u32>) -> Result<(), String> {
        Err("not shared".into())
    }

    fn leave(&mut self, _member: u32) {}

    /// Whether any changes may come as a resync, as where daemons are killed.
    fn may_resync(&self) -> bool {
        false
    }

    /// Whether an answer is acknowledged by being read, whatever its fate was to be; else by its fate alone.
    fn reading_acknowledges(&self) -> bool {
        false
    }

    fn box_count(&self) -> Option<usize> {
        None
    }

    /// The boxes that some others overlap, where the subject is asked that.
    fn query(&mut self, _: &[Aabb], _: QueryTags<'_>) -> Option<Result<Vec<Pair>, String>> {
        None
    }
}

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

    fn note(&mut self, heard: &Heard) {
        self.resyncs += usize::from(heard.is_resync);
        self.pairs += heard.begun.len() + heard.pairs.len();
        heard.ended.iter().for_each(|ended| self.ended[ended.reason as usize] += 1);
    }
}

fn difference(heard: &Heard, expected: &Heard) -> Option<(&'static str, String)> {
    fn first<T: PartialEq + std::fmt::Debug>(heard: &[T], expected: &[T]) -> Option<String> {
        let longest = heard.len().max(expected.len());
        let at = (0..longest).find(|at| heard.get(*at) != expected.get(*at))?;
        let [h, e] = [heard.get(at), expected.get(at)];
        Some(format!("{h:?} for {e:?} at {at} of {} for {}", heard.len(), expected.len()))
    }
    if heard.is_resync != expected.is_resync {
        return Some(("resync", format!("{} for {}", heard.is_resync, expected.is_resync)));
    }
    let lists = [
        ("pairs", first(&heard.pairs, &expected.pairs)),
        ("begun", first(&heard.begun, &expected.begun)),
        ("ended", first(&heard.ended, &expected.ended)),
    ];
    let list = lists.into_iter().find_map(|(kind, text)| Some((kind, text?)));
    let counts = (heard.pair_count, expected.pair_count);
    list.or_else(|| {
        (counts.0 != counts.1).then(|| ("count", format!("{:?} for {:?}", counts.0, counts.1)))
    })
}

#[derive(Default)]
struct Play {
    model: Model,
    listeners: BTreeMap<u32, Listener>,
    memberships: u64,
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
            Event::Tick(turns) => {
                let reported = subject.tick(turns).map_err(|error| ("refused", error))?;
                // One that came too late under load is part of the next tick.
                let mut by_tick: BTreeMap<u64, Vec<(&Turn, Option<Heard>)>> = BTreeMap::new();
                for (turn, (tick, heard)) in turns.iter().zip(reported) {
                    by_tick.entry(tick).or_default().push((turn, heard));
                }
                let (may_resync, by_reading) =
                    (subject.may_resync(), subject.reading_acknowledges());
                let mut ticks = by_tick.into_values();
                let is_shared = script.shared.is_some();
                ticks.try_for_each(|turns| self.tick(turns, is_shared, may_resync, by_reading))?;
                match subject.box_count() {
                    Some(len) if len != self.model.len() => {
                        Err(("boxes", format!("{len} for {}", self.model.len())))
                    }
                    _ => Ok(()),
                }
            }
        }
    }

    /// Asks who is near some boxes, all of them among those.
    fn query(&self, event: usize, subject: &mut dyn Subject) -> Result<(), (&'static str, String)> {
        let mut rng = Rng::new(event as u64);
        let all = Aabb::new([f32::NEG_INFINITY; 3], [f32::INFINITY; 3]);
        let queries = [all, a_query(&mut rng, 3.0), a_query(&mut rng, 20.0)];
        let tag = Tag::new(World(0), Owner(1), FilterId(rng.below(4) as u16));
        let tags = [QueryTags::None, QueryTags::One(tag)][event % 2];
        let Some(found) = subject.query(&queries, tags) else { return Ok(()) };
        let (found, expected) =
            (found.map_err(|error| ("refused", error))?, self.model.query(&queries, tags));
        if found == expected {
            return Ok(());
        }
        Err(("query", format!("{found:?} for {expected:?}, {tags:?}")))
    }

    fn tick(
        &mut self,
        reported: Vec<(&Turn, Option<Heard>)>,
        is_shared: bool,
        may_resync: bool,
        reading_acknowledges: bool,
    ) -> Result<(), (&'static str, String)> {
        let named: BTreeSet<u32> = reported
            .iter()
            .flat_map(|(turn, _)| self.model.apply(self.listeners[&turn.member].id, &turn.ops))
            .collect();
        self.listeners.values_mut().for_each(|listener| listener.note_named(&named, is_shared));
        let now = self.model.pairs();
        for (turn, heard) in reported {
            self.seen.edits += 1;
            let listener = self.listeners.get_mut(&turn.member).expect("it has joined");
            if let Some(heard) = heard {
                listener.is_lost |= may_resync && heard.is_resync;
                let expected = listener.expects(&self.model, &now, turn.mode);
                if let Some((kind, text)) = difference(&heard, &expected) {
                    return Err((
                        kind,
                        format!("{text}, {:?} of member {}", turn.mode, turn.member),
                    ));
                }
                self.seen.note(&heard);
                if reading_acknowledges || turn.fate == Fate::Acknowledged {
                    listener.acknowledge(&now, turn.mode);
                }
            }
        }
        Ok(())
    }
}
