//! The scenes that are held to the model. What they are called stands here alone.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::time::Duration;

use pairmask::{
    EngineName, JoinOptions, Scene, SceneEdit, ServedBy, Session, SessionBuilder, SharedEdit,
    SharedScene,
};
use pairmask_core::Aabb;
use pairmask_core::filters::{FilterTable, Tag};
use pairmask_core::scene::{
    Edit, Indices, Scene as CoreCrateScene, SceneOptions, Sets, Step, Tags, Told,
};

use super::check::Subject;
use super::generate::MEMBERS;
use super::model::Heard;
use super::script::{Fate, Hears, Op, Pair, Script, Turn};

/// How long the ticks of shared scenes wait for who is late. Three commits in a row take less, but for a machine under
/// load, where some are part of the next tick then.
const TICK_DEADLINE: Duration = Duration::from_millis(8);

/// Ops of one verb that follow each other, with what they hold side by side.
#[derive(Debug, Default)]
struct Group {
    indices: Vec<u32>,
    /// The indices as bits, where they rise and are no range.
    words: Vec<u32>,
    boxes: Vec<Aabb>,
    tags: Vec<Tag>,
    pairs: Vec<Pair>,
    table: FilterTable,
}

impl Group {
    fn of(ops: &[Op]) -> Self {
        let mut group = Self::default();
        for op in ops {
            match op {
                Op::Include(pair, _) | Op::Exclude(pair, _) => group.pairs.push(*pair),
                Op::Filters(filters) => {
                    group.table = FilterTable::new(filters).expect("few filters");
                }
                _ => group.indices.extend(op.indices()),
            }
            match op {
                Op::Set(_, b) => group.boxes.push(*b),
                Op::Tag(_, tag) => group.tags.push(*tag),
                _ => {}
            }
        }
        let rises = group.indices.windows(2).all(|two| two[0] < two[1]);
        if let ([first, .., last], true) = (&group.indices[..], rises)
            && (last - first) as usize >= group.indices.len()
        {
            group.words = vec![0; (last - first) as usize / 32 + 1];
            for index in &group.indices {
                group.words[(index - first) as usize / 32] |= 1 << ((index - first) % 32);
            }
        }
        group
    }

    /// The indices, in the way to name them that fits.
    fn named(&self) -> Indices<'_> {
        let indices = &self.indices;
        match indices[..] {
            [first, ..] if !self.words.is_empty() => Indices::Mask { first, words: &self.words },
            [first, ..] if (first..).zip(indices).all(|(index, named)| index == *named) => {
                Indices::Range { first, count: indices.len() as u32 }
            }
            _ => indices.into(),
        }
    }

    fn step(&self, op: &Op) -> Step<'_> {
        match op {
            Op::Remove(_) => Step::Remove(self.named()),
            Op::Set(..) => Step::Set(Sets { indices: self.named(), boxes: &self.boxes }),
            Op::Switch(_, on) => Step::Switch(self.named(), *on),
            Op::Static(_, on) => Step::Static(self.named(), *on),
            Op::Tag(..) => Step::Tag(Tags { indices: self.named(), tags: &self.tags }),
            Op::Filters(_) => Step::Filters(&self.table),
            Op::Include(_, on) => Step::Include(&self.pairs, *on),
            Op::Exclude(_, on) => Step::Exclude(&self.pairs, *on),
        }
    }
}

/// Whether two ops can be one step.
fn are_one_step(a: &Op, b: &Op) -> bool {
    let on = |op: &Op| match op {
        Op::Switch(_, on) | Op::Static(_, on) | Op::Include(_, on) | Op::Exclude(_, on) => *on,
        _ => true,
    };
    std::mem::discriminant(a) == std::mem::discriminant(b) && on(a) == on(b)
}

/// Hands an edit to `f` as steps.
fn with_steps<R>(ops: &[Op], f: impl FnOnce(&[Step<'_>]) -> R) -> R {
    let groups: Vec<(&Op, Group)> =
        ops.chunk_by(are_one_step).map(|ops| (&ops[0], Group::of(ops))).collect();
    let steps: Vec<Step<'_>> = groups.iter().map(|(op, group)| group.step(op)).collect();
    f(&steps)
}

impl From<&Told> for Heard {
    fn from(told: &Told) -> Self {
        Self {
            is_resync: told.is_resync(),
            pair_count: told.pair_count(),
            begun: told.begun().to_vec(),
            ended: told.ended().to_vec(),
            pairs: told.pairs().to_vec(),
        }
    }
}

/// A scene of the core.
#[derive(Debug)]
pub struct CoreScene(CoreCrateScene);

impl CoreScene {
    /// One that uses so many threads of the caller's pool.
    pub fn new(script: &Script, threads: usize) -> Self {
        Self(CoreCrateScene::new(options(script).with_threads(threads)))
    }
}

fn options(script: &Script) -> SceneOptions {
    SceneOptions::default().with_most_boxes(script.limit.max(1))
}

impl Subject for CoreScene {
    fn tick(&mut self, turns: &[Turn]) -> Result<Vec<(u64, Option<Heard>)>, String> {
        let edit = |turn: &Turn| {
            let edited = with_steps(&turn.ops, |steps| {
                self.0.edit(Edit { steps }, turn.mode).map(Heard::from)
            });
            if turn.fate == Fate::Acknowledged {
                self.0.take();
            }
            edited.map(|heard| (0, Some(heard))).map_err(|error| error.to_string())
        };
        turns.iter().map(edit).collect()
    }

    fn invalidate(&mut self) {
        self.0.lose();
    }

    fn box_count(&self) -> Option<usize> {
        Some(self.0.len())
    }
}

/// A scene of a session, in process or of a daemon.
pub struct SessionScene<'a> {
    scene: Scene,
    /// What has to answer.
    expected: Option<(ServedBy, EngineName)>,
    /// Whether a resync may come at any time, as where daemons are killed.
    may_resync: bool,
    /// What is done after an edit that somebody has answered.
    after: Box<dyn FnMut(ServedBy) + 'a>,
}

impl<'a> SessionScene<'a> {
    /// One that these have to answer for.
    pub fn of(session: &mut Session, script: &Script, by: ServedBy, engine: EngineName) -> Self {
        let scene = session.scene(options(script));
        let expected = Some((by, engine));
        Self { scene, expected, may_resync: false, after: Box::new(|_| ()) }
    }

    /// One whose answers may come from anywhere, and be a resync, because of what is done after edits.
    pub fn disturbed(
        session: &mut Session,
        script: &Script,
        after: impl FnMut(ServedBy) + 'a,
    ) -> Self {
        let scene = session.scene(options(script));
        Self { scene, expected: None, may_resync: true, after: Box::new(after) }
    }
}

impl Subject for SessionScene<'_> {
    fn tick(&mut self, turns: &[Turn]) -> Result<Vec<(u64, Option<Heard>)>, String> {
        let Self { scene, expected, after, .. } = self;
        let mut edit = |turn: &Turn| {
            with_steps(&turn.ops, |steps| {
                let edit = steps.iter().copied().fold(scene.edit(), SceneEdit::step);
                let pending = edit.submit(turn.mode).map_err(|error| error.to_string())?;
                if turn.fate == Fate::Abandoned {
                    return Ok((0, None));
                }
                let mut answer = pending.wait().map_err(|error| error.to_string())?;
                if turn.fate == Fate::Acknowledged {
                    answer = answer.take();
                }
                if let Some((by, engine)) = expected
                    && (answer.served_by(), answer.engine()) != (*by, (*engine).into())
                {
                    return Err(format!("{:?}, {}", answer.served_by(), answer.engine()));
                }
                after(answer.served_by());
                let heard = Heard {
                    is_resync: answer.is_resync(),
                    pair_count: answer.pair_count(),
                    begun: answer.begun().to_vec(),
                    ended: answer.ended().to_vec(),
                    pairs: answer.pairs().to_vec(),
                };
                Ok((0, Some(heard)))
            })
        };
        turns.iter().map(&mut edit).collect()
    }

    fn invalidate(&mut self) {
        self.scene.lose();
    }

    fn may_resync(&self) -> bool {
        self.may_resync
    }

    fn box_count(&self) -> Option<usize> {
        Some(self.scene.len())
    }
}

/// Sessions of the members of shared scenes, one scene after the other.
#[derive(Debug)]
pub struct Sessions {
    of_members: RefCell<Vec<Session>>,
    scenes: Cell<u32>,
}

impl Sessions {
    /// Sessions of a daemon.
    ///
    /// # Panics
    /// When it does not answer.
    pub fn new(builder: &SessionBuilder) -> Self {
        let connect = |_| builder.clone().connect().expect("a daemon");
        let of_members = RefCell::new((0..MEMBERS).map(connect).collect());
        Self { of_members, scenes: Cell::new(0) }
    }
}

/// The members of a shared scene.
#[derive(Debug)]
pub struct SharedMembers<'s> {
    sessions: &'s Sessions,
    name: String,
    options: JoinOptions,
    members: BTreeMap<u32, (SharedScene, Range<u32>)>,
}

impl<'s> SharedMembers<'s> {
    /// A scene of its own.
    pub fn new(sessions: &'s Sessions, script: &Script) -> Self {
        sessions.scenes.set(sessions.scenes.get() + 1);
        let options = JoinOptions::default()
            .with_most_boxes(script.own(MEMBERS).end)
            .with_tick_deadline(TICK_DEADLINE)
            .with_at_end(script.shared.unwrap_or_default());
        let name = format!("model-{}", sessions.scenes.get());
        Self { sessions, name, options, members: BTreeMap::new() }
    }
}

impl Subject for SharedMembers<'_> {
    fn tick(&mut self, turns: &[Turn]) -> Result<Vec<(u64, Option<Heard>)>, String> {
        let owns: BTreeMap<u32, Range<u32>> =
            self.members.iter().map(|(member, (_, own))| (*member, own.clone())).collect();
        let mut free: BTreeMap<u32, &mut SharedScene> =
            self.members.iter_mut().map(|(member, (scene, _))| (*member, scene)).collect();
        let mut pending = Vec::new();
        for turn in turns {
            let scene = free.remove(&turn.member).ok_or("a member that has not joined")?;
            let submitted = with_steps(&turn.ops, |steps| {
                let edit = steps.iter().copied().fold(scene.edit(), SharedEdit::step);
                edit.submit(turn.mode)
            });
            pending.push(submitted.map_err(|error| error.to_string())?);
        }
        let mut told = Vec::new();
        let mut committed: BTreeMap<u64, BTreeSet<u32>> = BTreeMap::new();
        let mut late = Vec::new();
        for (turn, pending) in turns.iter().zip(pending) {
            let mut answer = pending.wait().map_err(|error| error.to_string())?;
            if turn.fate == Fate::Acknowledged {
                answer = answer.take();
            }
            let heard = Heard {
                is_resync: answer.is_resync(),
                pair_count: answer.pair_count(),
                begun: answer.begun().to_vec(),
                ended: answer.ended().to_vec(),
                pairs: answer.pairs().to_vec(),
            };
            committed.entry(answer.tick()).or_default().insert(turn.member);
            late.push((answer.tick(), answer.late()));
            told.push((answer.tick(), Some(heard)));
        }
        for (tick, late) in late {
            let is_late = |member: &u32| !committed[&tick].contains(member);
            let expected: Vec<Range<u32>> =
                owns.iter().filter(|(m, _)| is_late(m)).map(|(_, own)| own.clone()).collect();
            if late != expected {
                return Err(format!("late: {late:?} for {expected:?}"));
            }
        }
        Ok(told)
    }

    fn join(&mut self, member: u32, hears: Hears, own: Range<u32>) -> Result<(), String> {
        let session = &mut self.sessions.of_members.borrow_mut()[member as usize];
        let joined = session.join_scene(&self.name, self.options.hearing(hears));
        let mut scene = joined.map_err(|error| error.to_string())?;
        if !own.is_empty() {
            scene.lease(own.clone()).map_err(|error| error.to_string())?;
        }
        self.members.insert(member, (scene, own));
        Ok(())
    }

    fn leave(&mut self, member: u32) {
        self.members.remove(&member);
        // Requests of one session are served in their order: it has left when this is answered.
        let session = &mut self.sessions.of_members.borrow_mut()[member as usize];
        drop(session.daemon_status());
    }
}
