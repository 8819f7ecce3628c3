//! The scenes that are held to the model: without a session, and of one.

use std::collections::BTreeMap;

use pairmask::{Scene, SceneAnswer, SceneEdit, ServedBy, Session, SnapshotId};
use pairmask_core::Aabb;
use pairmask_core::cast::{Hit, Hits, Ray, Shapes};
use pairmask_core::engine::{EngineId, EngineName};
use pairmask_core::scene::{
    Cast, Edit, QueryError, QueryFilterData, Report, Reported, Scene as CoreCrateScene, SceneError,
    SceneOptions,
};
use pairmaskd::execute::gpu::GpuScene;

use super::check::Subject;
use super::grouped::{Grouped, a_margin, margins_for};
use super::model::Received;
use super::script::{Fate, Op, Pair, Script, Turn};
use crate::casts::a_ray;
use crate::queried::a_query;
use crate::received;
use crate::stress_scenes::Rng;

impl From<&Reported> for Received {
    fn from(reported: &Reported) -> Self {
        received!(reported)
    }
}

impl From<&SceneAnswer<'_>> for Received {
    fn from(answer: &SceneAnswer<'_>) -> Self {
        received!(answer)
    }
}

/// A scene without a session, of the cores or of a GPU.
pub trait BareScene {
    fn edit(&mut self, edit: Edit<'_>, report: Report) -> Result<&Reported, SceneError>;
    fn acknowledge(&mut self);
    fn resync(&mut self);
    fn box_count(&self) -> usize;
    fn query(
        &mut self,
        queries: &[Aabb],
        filter_data: QueryFilterData<'_>,
    ) -> Result<Vec<Pair>, QueryError>;
    fn cast(&mut self, cast: &Cast<'_>) -> Result<Vec<Hit>, QueryError>;
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
                filter_data: QueryFilterData<'_>,
            ) -> Result<Vec<Pair>, QueryError> {
                let mut found = Vec::new();
                <$scene>::query(self, queries, filter_data, &mut found).map(|_| found)
            }
            fn cast(&mut self, cast: &Cast<'_>) -> Result<Vec<Hit>, QueryError> {
                let mut found = Vec::new();
                <$scene>::cast(self, cast, &mut found).map(|_| found)
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
        let found = self.scene.query(&queries, QueryFilterData::None);
        found.map_err(|error| error.to_string())?;
        let rays: Vec<Ray> = (0..count).map(|_| a_ray(rng, 20.0)).collect();
        let (shapes, filter_data) = (Shapes::Rays(&rays), QueryFilterData::None);
        let cast = Cast { shapes, hits: Hits::Closest(2), filter_data, most_hits: 1 << 20 };
        self.scene.cast(&cast).map(drop).map_err(|error| error.to_string())
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

fn session_options(script: &Script) -> pairmask::SceneOptions {
    pairmask::SceneOptions::default().with_most_boxes(script.limit.max(1))
}

impl<S: BareScene> Subject for Bare<S> {
    fn tick(&mut self, turns: &[Turn]) -> Result<Vec<(u64, Option<Received>)>, String> {
        let mut reported = Vec::new();
        for turn in turns {
            let edit = Grouped::of(&turn.ops);
            let received = self.scene.edit(Edit { steps: &edit.steps() }, turn.mode);
            let received = received.map(Received::from).map_err(|error| error.to_string())?;
            reported.push((0, Some(received)));
            self.ask()?;
            if turn.fate == Fate::Acknowledged {
                self.scene.acknowledge();
            }
            self.ask()?;
        }
        Ok(reported)
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
    snapshots: BTreeMap<u32, SnapshotId>,
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
        let scene = session.scene(session_options(script)).expect("no scene that is shared");
        let disturb = Box::new(disturb);
        let snapshots = BTreeMap::new();
        Self { scene, expected: None, may_resync: true, margins: None, disturb, snapshots }
    }

    /// One whose boxes have margins of chance, and that reports exact pairs. No daemon that dies makes it resync.
    pub fn margined(
        session: &mut Session,
        script: &Script,
        disturb: impl FnMut(Moment) + 'a,
    ) -> Self {
        let mut rng = Rng::new(script.events.len() as u64);
        let options = session_options(script).with_margin(a_margin(&mut rng, 0));
        let scene = session.scene(options).expect("no scene that is shared");
        let (margins, disturb, snapshots) = (Some(rng), Box::new(disturb), BTreeMap::new());
        Self { scene, expected: None, may_resync: false, margins, disturb, snapshots }
    }

    fn forget_id(&mut self, id: SnapshotId) -> Result<(), String> {
        self.scene.forget_snapshot(id).map_err(|error| error.to_string())
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

impl Subject for SessionScene<'_> {
    fn tick(&mut self, turns: &[Turn]) -> Result<Vec<(u64, Option<Received>)>, String> {
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
            reported.push((0, Some(Received::from(&answer))));
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

    fn snapshot(&mut self, number: u32) -> Result<(), String> {
        let taken = self.scene.snapshot().map_err(|error| error.to_string())?;
        self.snapshots.insert(number, taken).map_or(Ok(()), |before| self.forget_id(before))
    }

    fn restore(&mut self, number: u32) -> Result<(), String> {
        (self.disturb)(Moment::UnderWay);
        self.scene.restore(self.snapshots[&number]).map_err(|error| error.to_string())
    }

    fn forget(&mut self, number: u32) -> Result<(), String> {
        let taken = self.snapshots.remove(&number);
        taken.map_or(Ok(()), |before| self.forget_id(before))
    }

    fn user_data(&self, _: u32, index: u32) -> Option<u64> {
        Some(self.scene.user_data(index))
    }

    fn may_resync(&self) -> bool {
        self.may_resync
    }

    fn reading_acknowledges(&self) -> bool {
        true
    }

    fn box_count(&self) -> Option<usize> {
        Some(self.scene.len())
    }
}
