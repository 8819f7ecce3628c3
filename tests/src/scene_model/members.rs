//! The members of a shared scene, held to the model.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::time::Duration;

use pairmask::{Scene, SceneEdit, SceneOptions, Session, SessionBuilder};
use pairmask_core::Aabb;
use pairmask_core::engine::EngineName;
use pairmask_core::scene::QueryFilterData;

use super::check::Subject;
use super::generate::MEMBERS;
use super::grouped::Grouped;
use super::model::Received;
use super::script::{Fate, Pair, Scope, Script, Turn};
use crate::received;

/// How long the ticks of shared scenes wait for who is late. Three commits in a row take less, but for a machine under
/// load, where some are part of the next tick then.
const TICK_DEADLINE: Duration = Duration::from_millis(8);

#[derive(Debug)]
pub struct Sessions {
    of_members: RefCell<Vec<Session>>,
    scenes: Cell<u32>,
}

impl Sessions {
    pub fn new(builder: &SessionBuilder) -> Self {
        let connect = |_| builder.clone().connect().expect("a daemon");
        let of_members = RefCell::new((0..MEMBERS).map(connect).collect());
        Self { of_members, scenes: Cell::new(0) }
    }
}

#[derive(Debug)]
pub struct SharedMembers<'s> {
    sessions: &'s Sessions,
    name: String,
    options: SceneOptions,
    members: BTreeMap<u32, (Scene, Range<u32>)>,
    engine: Option<EngineName>,
    ticks: usize,
    asked: usize,
    /// Members that received the answer of the last tick.
    received: BTreeSet<u32>,
}

impl<'s> SharedMembers<'s> {
    /// A scene of its own, which an engine has to answer for where one is named.
    pub fn new(sessions: &'s Sessions, script: &Script, engine: Option<EngineName>) -> Self {
        sessions.scenes.set(sessions.scenes.get() + 1);
        let options = SceneOptions::default()
            .with_most_boxes(script.own(MEMBERS).end)
            .with_tick_deadline(TICK_DEADLINE)
            .with_at_end(script.shared.unwrap_or_default());
        let name = format!("model-{}", sessions.scenes.get());
        let (members, received) = Default::default();
        Self { sessions, name, options, members, engine, ticks: 0, asked: 0, received }
    }
}

impl Subject for SharedMembers<'_> {
    fn tick(&mut self, turns: &[Turn]) -> Result<Vec<(u64, Option<Received>)>, String> {
        let owns: BTreeMap<u32, Range<u32>> =
            self.members.iter().map(|(member, (_, own))| (*member, own.clone())).collect();
        let mut free: BTreeMap<u32, &mut Scene> =
            self.members.iter_mut().map(|(member, (scene, _))| (*member, scene)).collect();
        // In any order of commits, all receive the same.
        let mut order: Vec<&Turn> = turns.iter().collect();
        self.ticks += 1;
        order.rotate_left(self.ticks % turns.len());
        let mut pending = BTreeMap::new();
        let edits: Vec<Grouped<'_>> = order.iter().map(|turn| Grouped::of(&turn.ops)).collect();
        for (turn, grouped) in order.iter().zip(&edits) {
            let scene = free.remove(&turn.member).ok_or("a member that has not joined")?;
            let edit = grouped.steps().into_iter().fold(scene.edit(), SceneEdit::step);
            let submitted = edit.submit(turn.mode).map_err(|error| error.to_string())?;
            pending.insert(turn.member, submitted);
        }
        let mut reported = BTreeMap::new();
        let mut committed: BTreeMap<u64, BTreeSet<u32>> = BTreeMap::new();
        let mut late: Vec<(u64, Vec<Range<u32>>)> = Vec::new();
        let is_unread = |turn: &&Turn| turn.fate == Fate::Unread;
        for turn in turns.iter().filter(|t| !is_unread(t)).chain(turns.iter().filter(is_unread)) {
            let (own, pending) = (&owns[&turn.member], pending.remove(&turn.member));
            let pending = pending.ok_or("a second turn")?;
            // The others' answers say in which tick a writer's commit was that nobody waits for. Where none of them
            // does, it is waited for.
            let others = late.iter().find(|(_, late)| !late.contains(own));
            if let Some((tick, _)) = others.filter(|_| is_unread(&turn) && !own.is_empty()) {
                committed.entry(*tick).or_default().insert(turn.member);
                reported.insert(turn.member, (*tick, None));
                continue;
            }
            let answer = pending.wait().map_err(|error| error.to_string())?;
            if self.engine.is_some_and(|engine| answer.engine() != engine) {
                return Err(answer.engine().to_string());
            }
            let tick = answer.tick().ok_or("an answer of no tick")?;
            committed.entry(tick).or_default().insert(turn.member);
            late.push((tick, answer.late().to_vec()));
            reported.insert(turn.member, (tick, Some(received!(answer))));
        }
        let reported =
            turns.iter().map(|turn| reported.remove(&turn.member).ok_or("a second turn"));
        let reported = reported.collect::<Result<Vec<_>, _>>()?;
        let last = reported.iter().map(|(tick, _)| *tick).max();
        let are_last = turns.iter().zip(&reported);
        let are_last =
            are_last.filter(|(_, (tick, received))| Some(*tick) == last && received.is_some());
        self.received = are_last.map(|(turn, _)| turn.member).collect();
        for (tick, late) in late {
            let is_late = |member: &u32| !committed[&tick].contains(member);
            let expected: Vec<Range<u32>> =
                owns.iter().filter(|(m, _)| is_late(m)).map(|(_, own)| own.clone()).collect();
            if late != expected {
                return Err(format!("late: {late:?} for {expected:?}"));
            }
        }
        Ok(reported)
    }

    fn join(&mut self, member: u32, scope: Scope, own: Range<u32>) -> Result<(), String> {
        let session = &mut self.sessions.of_members.borrow_mut()[member as usize];
        let joined = session.scene(self.options.clone().with_scope(scope).with_shared(&self.name));
        let mut scene = joined.map_err(|error| error.to_string())?;
        if !own.is_empty() {
            scene.lease(own.clone()).map_err(|error| error.to_string())?;
        }
        self.members.insert(member, (scene, own));
        Ok(())
    }

    fn reading_acknowledges(&self) -> bool {
        true
    }

    /// Asks as one member and then as another.
    fn query(
        &mut self,
        queries: &[Aabb],
        filter_data: QueryFilterData<'_>,
    ) -> Option<Result<Vec<Pair>, String>> {
        self.asked += 1;
        let asks = self.asked % self.members.len().max(1);
        let (scene, _) = self.members.values_mut().nth(asks)?;
        let found = scene.query_filtered(queries, filter_data);
        Some(found.map(|found| found.to_vec()).map_err(|error| error.to_string()))
    }

    fn user_data(&self, member: u32, index: u32) -> Option<u64> {
        let (scene, own) = self.members.get(&member)?;
        // Of others it knows what the last answer knew, which it may not have received.
        (self.received.contains(&member) || own.contains(&index)).then(|| scene.user_data(index))
    }

    fn leave(&mut self, member: u32) {
        self.members.remove(&member);
        // Requests of one session are served in their order: it has left when this is answered.
        let session = &mut self.sessions.of_members.borrow_mut()[member as usize];
        drop(session.daemon_status());
    }
}
