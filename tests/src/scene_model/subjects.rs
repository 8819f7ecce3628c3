//! The scenes that are held to the model. What they are called stands here alone.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::time::Duration;

use pairmask::{
    JoinOptions, Margin, MarginedPairs, Scene, SceneAnswer, SceneEdit, ServedBy, Session,
    SessionBuilder,
};
use pairmask_core::Aabb;
use pairmask_core::engine::{EngineId, EngineName};
use pairmask_core::filters::{FilterTable, Tag};
use pairmask_core::scene::{
    Edit, Indices, QueryError, QueryTags, Report, Reported, Scene as CoreCrateScene, SceneError,
    SceneOptions, Sets, Step, Tags,
};
use pairmaskd::execute::gpu::GpuScene;

use super::check::Subject;
use super::generate::MEMBERS;
use super::model::Heard;
use super::script::{Fate, Op, Pair, Scope, Script, Turn};
use crate::heard;
use crate::queried::a_query;
use crate::stress_scenes::Rng;

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

fn are_one_step(a: &Op, b: &Op) -> bool {
    let on = |op: &Op| match op {
        Op::Switch(_, on) | Op::Static(_, on) | Op::Include(_, on) | Op::Exclude(_, on) => *on,
        _ => true,
    };
    std::mem::discriminant(a) == std::mem::discriminant(b) && on(a) == on(b)
}

pub struct Grouped<'o>(Vec<(&'o Op, Group)>);

impl<'o> Grouped<'o> {
    pub fn of(ops: &'o [Op]) -> Self {
        Self(ops.chunk_by(are_one_step).map(|ops| (&ops[0], Group::of(ops))).collect())
    }

    pub fn steps(&self) -> Vec<Step<'_>> {
        self.0.iter().map(|(op, group)| group.step(op)).collect()
    }
}

impl From<&Reported> for Heard {
    fn from(reported: &Reported) -> Self {
        heard!(reported)
    }
}

impl From<&SceneAnswer<'_>> for Heard {
    fn from(answer: &SceneAnswer<'_>) -> Self {
        heard!(answer)
    }
}

/// A scene without a session, of the cores or of a GPU.
pub trait BareScene {
    fn edit(&mut self, edit: Edit<'_>, report: Report) -> Result<&Reported, SceneError>;
    fn acknowledge(&mut self);
    fn resync(&mut self);
    fn box_count(&self) -> usize;
    fn query(&mut self, queries: &[Aabb], tags: QueryTags<'_>) -> Result<Vec<Pair>, QueryError>;
}

macro_rules! bare_scene {
    ($scene:ty) => {
        impl BareScene for $scene {
            fn edit(&mut self, edit: Edit<'_>, report: Report) -> Result<&Reported, SceneError> {
                <$scene>::edit(self, edit, report)
            }
            fn acknowledge(&mut self) {
                <$scene>::acknowledge(self);
            }
            fn resync(&mut self) {
                <$scene>::resync(self);
            }
            fn box_count(&self) -> usize {
                self.len()
            }
            fn query(
                &mut self,
                queries: &[Aabb],
                tags: QueryTags<'_>,
            ) -> Result<Vec<Pair>, QueryError> {
                let mut found = Vec::new();
                <$scene>::query(self, queries, tags, &mut found).map(|_| found)
            }
        }
    };
}
bare_scene!(CoreCrateScene);
bare_scene!(GpuScene);

pub struct Bare<S> {
    pub scene: S,
    /// Draws queries that are asked before an answer is taken, and after: they change nothing that is reported.
    asks: Option<Rng>,
}

pub type CoreScene = Bare<CoreCrateScene>;

impl<S: BareScene> Bare<S> {
    pub const fn of(scene: S) -> Self {
        Self { scene, asks: None }
    }

    pub fn asked(scene: S, seed: u64) -> Self {
        Self { scene, asks: Some(Rng::new(seed)) }
    }

    fn ask(&mut self) -> Result<(), String> {
        let Some(rng) = &mut self.asks else { return Ok(()) };
        let count = [0, 0, 1, 3, 70, 200][rng.below(6) as usize];
        let queries: Vec<Aabb> = (0..count).map(|_| a_query(rng, 20.0)).collect();
        let found = self.scene.query(&queries, QueryTags::None);
        found.map(drop).map_err(|error| error.to_string())
    }
}

impl CoreScene {
    pub fn new(script: &Script, threads: usize) -> Self {
        Self::of(CoreCrateScene::new(options(script).with_threads(threads)))
    }
}

pub fn options(script: &Script) -> SceneOptions {
    SceneOptions::default().with_most_boxes(script.limit.max(1))
}

impl<S: BareScene> Subject for Bare<S> {
    fn tick(&mut self, turns: &[Turn]) -> Result<Vec<(u64, Option<Heard>)>, String> {
        let mut reported = Vec::new();
        for turn in turns {
            let edit = Grouped::of(&turn.ops);
            let heard = self.scene.edit(Edit { steps: &edit.steps() }, turn.mode);
            let heard = heard.map(Heard::from).map_err(|error| error.to_string())?;
            reported.push((0, Some(heard)));
            self.ask()?;
            if turn.fate == Fate::Acknowledged {
                self.scene.acknowledge();
            }
            self.ask()?;
        }
        Ok(reported)
    }

    fn reading_acknowledges(&self) -> bool {
        false
    }

    fn invalidate(&mut self) {
        self.scene.resync();
    }

    fn box_count(&self) -> Option<usize> {
        Some(self.scene.box_count())
    }
}

/// When something may be done to a scene of a session.
#[derive(Clone, Copy, Debug)]
pub enum Moment {
    UnderWay,
    Answered(ServedBy, EngineId),
}

pub struct SessionScene<'a> {
    scene: Scene,
    expected: Option<(ServedBy, EngineName)>,
    /// Whether a resync may come at any time, as where daemons are killed.
    may_resync: bool,
    /// Draws margins, of a scene that has some.
    margins: Option<Rng>,
    disturb: Box<dyn FnMut(Moment) + 'a>,
}

impl<'a> SessionScene<'a> {
    pub fn of(session: &mut Session, script: &Script, by: ServedBy, engine: EngineName) -> Self {
        let expected = Some((by, engine));
        Self { expected, may_resync: false, ..Self::disturbed(session, script, |_| ()) }
    }

    /// One whose answers may come from anywhere, and be a resync, because of what is done during and after edits.
    pub fn disturbed(
        session: &mut Session,
        script: &Script,
        disturb: impl FnMut(Moment) + 'a,
    ) -> Self {
        let scene = session.scene(options(script));
        Self { scene, expected: None, may_resync: true, margins: None, disturb: Box::new(disturb) }
    }

    /// One whose boxes have margins of chance, and that tells exact pairs. No daemon that dies makes it resync.
    pub fn margined(
        session: &mut Session,
        script: &Script,
        disturb: impl FnMut(Moment) + 'a,
    ) -> Self {
        let mut rng = Rng::new(script.events.len() as u64);
        let options = options(script).with_margins(MarginedPairs::Exact, a_margin(&mut rng, 0));
        let scene = session.scene(options);
        let (margins, disturb) = (Some(rng), Box::new(disturb));
        Self { scene, expected: None, may_resync: false, margins, disturb }
    }

    /// What is wrong with a box that the scene keeps after an edit.
    fn check_boxes(&self, ops: &[Op]) -> Result<(), String> {
        let last: BTreeMap<u32, Option<Aabb>> = ops
            .iter()
            .filter_map(|op| match op {
                Op::Set(index, b) => Some((*index, Some(*b))),
                Op::Remove(index) => Some((*index, None)),
                _ => None,
            })
            .fold(BTreeMap::new(), |mut last, (index, b)| {
                // What is removed and set is there.
                let entry = last.entry(index).or_insert(b);
                *entry = b.or(*entry);
                last
            });
        let bits = |b: Aabb| <[f32; 6]>::from(b).map(f32::to_bits);
        match last.iter().find(|(i, b)| self.scene.get(**i).map(bits) != b.map(bits)) {
            Some((index, b)) => Err(format!("{index} is {:?}, not {b:?}", self.scene.get(*index))),
            None => Ok(()),
        }
    }
}

/// A margin, of a scene with so many boxes: few huge ones in large scenes, where each such box is near all others.
pub fn a_margin(rng: &mut Rng, boxes: usize) -> Margin {
    let units = match rng.below(12 + boxes as u32) {
        0..3 => 0.0,
        3 => 1e-45,
        4 => 1e30,
        5 => 20.0,
        6 => f32::MAX,
        at => [0.05, 0.3, 0.3, 1.0][at as usize % 4],
    };
    Margin::new(units).expect("finite, and not negative")
}

/// Margins for the groups of an edit that set boxes: none, one for all, or one for each.
pub fn margins_for(grouped: &Grouped<'_>, rng: &mut Rng, boxes: usize) -> Vec<Vec<Margin>> {
    let of = |(op, group): &(&Op, Group)| {
        let (Op::Set(..), count) = (op, [0, 1, group.boxes.len()][rng.below(3) as usize]) else {
            return Vec::new();
        };
        (0..count).map(|_| a_margin(rng, boxes)).collect()
    };
    grouped.0.iter().map(of).collect()
}

impl Grouped<'_> {
    /// The margin of each box that is set, where `margins` names none the usual one.
    pub fn margins_of_boxes(&self, margins: &[Vec<Margin>], usual: Margin) -> Vec<(u32, Margin)> {
        let mut all = Vec::new();
        for ((op, group), margins) in self.0.iter().zip(margins) {
            if let Op::Set(..) = op {
                let of = |at| *margins.get(at).or(margins.last()).unwrap_or(&usual);
                all.extend((0..).zip(&group.indices).map(|(at, index)| (*index, of(at))));
            }
        }
        all
    }

    pub fn with_margins<'s, 'a>(
        &'a self,
        edit: SceneEdit<'s, 'a>,
        margins: &'a [Vec<Margin>],
    ) -> SceneEdit<'s, 'a> {
        let groups = self.0.iter().zip(margins);
        groups.fold(edit, |edit, ((op, group), margins)| {
            let (boxes, singly) = (&group.boxes[..], group.boxes.len() % 3 == 1);
            let mut each = group.indices.iter().copied().zip(boxes.iter().copied());
            match &margins[..] {
                [] if boxes.is_empty() || boxes.len() % 3 == 0 => edit.step(group.step(op)),
                [] if singly => each.fold(edit, |edit, (index, b)| edit.set(index, b)),
                [] => edit.set_with(group.named(), |_| each.next().map_or(Aabb::EMPTY, |(_, b)| b)),
                [margin] if singly => {
                    each.fold(edit, |edit, (index, b)| edit.set_margined(index, b, *margin))
                }
                [margin] => edit.set_all_margined(group.named(), boxes, *margin),
                margins if singly => {
                    let mut margins = margins.iter();
                    each.fold(edit, |edit, (index, b)| {
                        edit.set_margined(index, b, *margins.next().expect("one for each"))
                    })
                }
                margins => edit.set_all_margined(group.named(), boxes, margins),
            }
        })
    }
}

impl Subject for SessionScene<'_> {
    fn tick(&mut self, turns: &[Turn]) -> Result<Vec<(u64, Option<Heard>)>, String> {
        let mut reported = Vec::new();
        for turn in turns {
            let Self { scene, expected, margins, disturb, .. } = self;
            let requests = |scene: &Scene| scene.margin_stats().map(|stats| stats.requests);
            let (grouped, before, len) = (Grouped::of(&turn.ops), requests(scene), scene.len());
            let margins = margins.as_mut().map(|rng| margins_for(&grouped, rng, len));
            let edit = match &margins {
                Some(margins) => grouped.with_margins(scene.edit(), margins),
                None => grouped.steps().into_iter().fold(scene.edit(), SceneEdit::step),
            };
            let pending = edit.submit(turn.mode).map_err(|error| error.to_string())?;
            disturb(Moment::UnderWay);
            if turn.fate == Fate::Unread {
                reported.push((0, None));
                continue;
            }
            let answer = pending.wait().map_err(|error| error.to_string())?;
            if let Some((by, engine)) = expected
                && (answer.served_by(), answer.engine()) != (*by, (*engine).into())
            {
                return Err(format!("{:?}, {}", answer.served_by(), answer.engine()));
            }
            let (by, engine) = (answer.served_by(), answer.engine());
            reported.push((0, Some(Heard::from(&answer))));
            drop(answer);
            if before.is_none() || before != requests(scene) {
                disturb(Moment::Answered(by, engine));
            }
            let is_kept = scene.is_empty() || scene.daemon_bytes() > 0;
            if expected.is_some() && by == ServedBy::Daemon && !is_kept {
                return Err("the daemon keeps the scene in no memory".into());
            }
            self.check_boxes(&turn.ops)?;
        }
        Ok(reported)
    }

    fn invalidate(&mut self) {
        self.scene.resync();
    }

    fn may_resync(&self) -> bool {
        self.may_resync
    }

    fn box_count(&self) -> Option<usize> {
        Some(self.scene.len())
    }
}

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
    options: JoinOptions,
    members: BTreeMap<u32, (Scene, Range<u32>)>,
    engine: Option<EngineName>,
    ticks: usize,
    asked: usize,
}

impl<'s> SharedMembers<'s> {
    /// A scene of its own, which an engine has to answer for where one is named.
    pub fn new(sessions: &'s Sessions, script: &Script, engine: Option<EngineName>) -> Self {
        sessions.scenes.set(sessions.scenes.get() + 1);
        let options = JoinOptions::default()
            .with_most_boxes(script.own(MEMBERS).end)
            .with_tick_deadline(TICK_DEADLINE)
            .with_at_end(script.shared.unwrap_or_default());
        let name = format!("model-{}", sessions.scenes.get());
        Self { sessions, name, options, members: BTreeMap::new(), engine, ticks: 0, asked: 0 }
    }
}

impl Subject for SharedMembers<'_> {
    fn tick(&mut self, turns: &[Turn]) -> Result<Vec<(u64, Option<Heard>)>, String> {
        let owns: BTreeMap<u32, Range<u32>> =
            self.members.iter().map(|(member, (_, own))| (*member, own.clone())).collect();
        let mut free: BTreeMap<u32, &mut Scene> =
            self.members.iter_mut().map(|(member, (scene, _))| (*member, scene)).collect();
        // Whoever commits first, all are told the same.
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
            reported.insert(turn.member, (tick, Some(heard!(answer))));
        }
        let reported =
            turns.iter().map(|turn| reported.remove(&turn.member).ok_or("a second turn"));
        let reported = reported.collect::<Result<Vec<_>, _>>()?;
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
        let joined = session.join_scene(&self.name, self.options.with_scope(scope));
        let mut scene = joined.map_err(|error| error.to_string())?;
        if !own.is_empty() {
            scene.lease(own.clone()).map_err(|error| error.to_string())?;
        }
        self.members.insert(member, (scene, own));
        Ok(())
    }

    /// Asks as one member and then as another.
    fn query(
        &mut self,
        queries: &[Aabb],
        tags: QueryTags<'_>,
    ) -> Option<Result<Vec<Pair>, String>> {
        self.asked += 1;
        let asks = self.asked % self.members.len().max(1);
        let (scene, _) = self.members.values_mut().nth(asks)?;
        let asked = scene.query(queries);
        let asked = match tags {
            QueryTags::None => asked,
            QueryTags::One(tag) => asked.tag(tag),
            QueryTags::Each(tags) => asked.tags(tags),
        };
        Some(asked.find().map(|found| found.to_vec()).map_err(|error| error.to_string()))
    }

    fn leave(&mut self, member: u32) {
        self.members.remove(&member);
        // Requests of one session are served in their order: it has left when this is answered.
        let session = &mut self.sessions.of_members.borrow_mut()[member as usize];
        drop(session.daemon_status());
    }
}
