//! Scenes that persist, answered by the engines of this process.

use std::ops::Deref;

use pairmask_core::aabb::Aabb;
use pairmask_core::dispatch::CpuEngines;
use pairmask_core::scene::{self, Edit, Indices, SceneError, SceneOptions, Sets, Step, Told, Want};

use super::builder::Settings;

/// Boxes that persist from answer to answer, by indices of the client's own.
///
/// [`scene`](pairmask_core::scene) says what is told. Made by [`Session::scene`](super::Session::scene);
/// it lives on without the session.
#[derive(Debug)]
pub struct Scene {
    kept: scene::Scene,
    /// What an edit sets one by one; kept, so that steady edits allocate nothing.
    indices: Vec<u32>,
    boxes: Vec<Aabb>,
    removed: Vec<u32>,
}

impl Scene {
    pub(super) fn new(options: SceneOptions, settings: &Settings) -> Self {
        let (calibration, _) = settings.calibration.resolve(settings.isa);
        let threads = options.threads.or(settings.threads);
        let options = threads.map_or(options, |threads| options.with_threads(threads));
        let engines = CpuEngines::on(settings.isa, calibration);
        Self {
            kept: scene::Scene::with_engines(options, engines),
            indices: Vec::new(),
            boxes: Vec::new(),
            removed: Vec::new(),
        }
    }

    /// Begins an edit. Without [`SceneEdit::commit`], nothing happens.
    pub fn edit<'a>(&mut self) -> SceneEdit<'_, 'a> {
        self.indices.clear();
        self.boxes.clear();
        self.removed.clear();
        SceneEdit { scene: self, steps: Vec::new() }
    }

    /// Forgets what was told: the next changes are a [resync](Told::is_resync).
    pub fn lose(&mut self) {
        self.kept.lose();
    }

    /// Boxes, those that are switched off too.
    pub const fn len(&self) -> usize {
        self.kept.len()
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }

    /// The box of an index, also one that is switched off.
    pub fn get(&self, index: u32) -> Option<Aabb> {
        self.kept.get(index)
    }

    /// Bytes that the scene keeps.
    pub fn allocated_bytes(&self) -> usize {
        self.kept.allocated_bytes()
    }
}

/// An edit that is being written: see [`Edit`] for the order in which it is applied, and
/// [`EditError`](pairmask_core::scene::EditError) for what is wrong.
#[derive(Debug)]
#[must_use = "an edit does nothing until it is committed"]
pub struct SceneEdit<'s, 'a> {
    scene: &'s mut Scene,
    steps: Vec<Step<'a>>,
}

impl<'s, 'a> SceneEdit<'s, 'a> {
    /// Sets the box of an index; inserts it where there is none.
    pub fn set(self, index: u32, b: Aabb) -> Self {
        self.scene.indices.push(index);
        self.scene.boxes.push(b);
        self
    }

    /// Sets boxes where they lie: a list of indices, a range or a [bitmask](Indices::Mask), and
    /// a box for each.
    pub fn set_all(self, indices: impl Into<Indices<'a>>, boxes: &'a [Aabb]) -> Self {
        self.step(Step::Set(Sets { indices: indices.into(), boxes }))
    }

    /// Removes the box of an index.
    pub fn remove(self, index: u32) -> Self {
        self.scene.removed.push(index);
        self
    }

    /// Removes boxes.
    pub fn remove_all(self, indices: impl Into<Indices<'a>>) -> Self {
        self.step(Step::Remove(indices.into()))
    }

    /// Switches a box off (it overlaps nothing) or on.
    pub fn switch(self, index: u32, on: bool) -> Self {
        self.step(Step::Switch(one(index), on))
    }

    /// Switches boxes off or on.
    pub fn switch_all(self, indices: impl Into<Indices<'a>>, on: bool) -> Self {
        self.step(Step::Switch(indices.into(), on))
    }

    /// Makes a box static (two static boxes are no pair) or not.
    pub fn make_static(self, index: u32, is_static: bool) -> Self {
        self.step(Step::Static(one(index), is_static))
    }

    /// Makes boxes static or not.
    pub fn make_all_static(self, indices: impl Into<Indices<'a>>, is_static: bool) -> Self {
        self.step(Step::Static(indices.into(), is_static))
    }

    /// Does a step.
    pub fn step(mut self, step: Step<'a>) -> Self {
        self.steps.push(step);
        self
    }

    /// Applies the edit and answers.
    ///
    /// # Errors
    /// [`SceneError`]. After [`SceneError::Edit`] the scene is what it was.
    pub fn commit(self, want: Want) -> Result<SceneAnswer<'s>, SceneError> {
        let Self { scene: Scene { kept: scene, indices, boxes, removed }, steps } = self;
        let mut steps = steps;
        if !removed.is_empty() {
            steps.push(Step::Remove(Indices::List(removed)));
        }
        if !indices.is_empty() {
            steps.push(Step::Set(Sets { indices: Indices::List(indices), boxes }));
        }
        scene.edit(Edit { steps: &steps }, want)?;
        Ok(SceneAnswer { scene })
    }
}

/// A single index.
const fn one(index: u32) -> Indices<'static> {
    Indices::Range { first: index, count: 1 }
}

/// The answer to an edit: reads as [`Told`].
///
/// [`take`](Self::take) acknowledges it: the next changes are counted from it. An answer that is dropped
/// instead counts as never given, and the next one makes up for it.
#[derive(Debug)]
#[must_use = "an answer that is not taken is told again"]
pub struct SceneAnswer<'s> {
    scene: &'s mut scene::Scene,
}

impl<'s> SceneAnswer<'s> {
    /// Takes the answer.
    pub fn take(self) -> &'s Told {
        self.scene.take();
        self.scene.told()
    }
}

impl Deref for SceneAnswer<'_> {
    type Target = Told;

    fn deref(&self) -> &Told {
        self.scene.told()
    }
}
