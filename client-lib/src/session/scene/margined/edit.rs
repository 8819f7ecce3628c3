//! An edit of boxes with margins, and which part of it is sent.

use pairmask_core::aabb::Aabb;
use pairmask_core::precision::Margin;
use pairmask_core::scene::{Edit, Indices, MarginedSets, Margins, SceneCopy, Step, Want};

use super::super::PendingAnswer;
use super::answer::{MarginedAnswer, PendingMargined};
use super::{Draft, MarginedScene};
use crate::session::error::CommitError;

/// An edit that is being written: see [`Edit`] for the order in which it is applied, and
/// [`EditError`](pairmask_core::scene::EditError) for what is wrong.
#[derive(Debug)]
#[must_use = "an edit does nothing until it is committed"]
pub struct MarginedEdit<'s, 'a> {
    scene: &'s mut MarginedScene,
    sets: Vec<MarginedSets<'a>>,
    /// All steps but sets.
    steps: Vec<Step<'a>>,
}

impl<'s, 'a> MarginedEdit<'s, 'a> {
    pub(super) const fn new(scene: &'s mut MarginedScene) -> Self {
        Self { scene, sets: Vec::new(), steps: Vec::new() }
    }

    /// Sets the box of an index and its margin; inserts it where there is none.
    pub fn set(self, index: u32, b: Aabb, margin: Margin) -> Self {
        let draft = &mut self.scene.draft;
        draft.indices.push(index);
        draft.boxes.push(b);
        draft.margins.push(margin);
        self
    }

    /// Sets boxes where they lie: a list of indices, a range or a [bitmask](Indices::Mask), a box for each,
    /// and a margin for each or one for all.
    pub fn set_all(
        mut self,
        indices: impl Into<Indices<'a>>,
        boxes: &'a [Aabb],
        margins: impl Into<Margins<'a>>,
    ) -> Self {
        self.sets.push(MarginedSets { indices: indices.into(), boxes, margins: margins.into() });
        self
    }

    /// Removes the box of an index.
    pub fn remove(self, index: u32) -> Self {
        self.scene.draft.removed.push(index);
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

    fn step(mut self, step: Step<'a>) -> Self {
        self.steps.push(step);
        self
    }

    /// Applies the edit and answers.
    ///
    /// # Errors
    /// [`CommitError`]. After [`CommitError::Edit`] and [`CommitError::Frame`] the scene is what it was.
    pub fn commit(self, want: Want) -> Result<MarginedAnswer<'s>, CommitError>
    where
        'a: 's,
    {
        self.submit(want)?.wait()
    }

    /// Applies the edit, and sends what is to be sent of it. The daemon works on it while this thread does
    /// something else.
    ///
    /// # Errors
    /// [`CommitError`]. The scene is then what it was, but for [`CommitError::Wait`].
    pub fn submit(self, want: Want) -> Result<PendingMargined<'s>, CommitError>
    where
        'a: 's,
    {
        let Self { scene, sets, steps } = self;
        let (mut sets, mut steps): (Vec<MarginedSets<'s>>, Vec<Step<'s>>) = (sets, steps);
        let MarginedScene { scene, now, pairs, draft, outgoing, threads, stats } = scene;
        let draft = &*draft;
        draft.add_to(&mut sets, &mut steps);
        for sets in &sets {
            sets.check()?;
        }
        let all: Vec<Step<'_>> =
            steps.iter().copied().chain(sets.iter().map(MarginedSets::step)).collect();
        let edit = Edit { steps: &all };
        now.check(edit)?;

        let threads = *threads;
        outgoing.clear();
        for sets in &sets {
            outgoing.choose(sets, now, scene.sent(), pairs.needs_all(want), threads);
        }
        let outgoing = &*outgoing;
        steps.retain(names_any);
        let sends = !outgoing.is_empty() || !steps.is_empty();
        let ask = pairs.ask(want, sends);
        let sent = ask.map(|want| {
            let edit = steps.into_iter().fold(scene.edit(), super::super::SceneEdit::step);
            let edit = if outgoing.is_empty() {
                edit
            } else {
                edit.set_all(outgoing.indices(), outgoing.boxes())
            };
            edit.submit(want)
        });
        if let Some(Err(CommitError::Edit(_) | CommitError::Frame(_))) = &sent {
            now.cancel(edit);
        } else {
            pairs.note(edit, now, want, sends);
            now.apply(edit);
            stats.edits += 1;
            stats.requests += u64::from(ask.is_some());
            stats.set += edit.boxes() as u64;
            stats.sent += outgoing.len() as u64;
        }
        let pending: Option<PendingAnswer<'s, 's>> = sent.transpose()?;
        let now: &'s SceneCopy = now;
        Ok(PendingMargined::new(pending, pairs, now, want, threads))
    }
}

impl Draft {
    /// Adds what was set and removed one by one.
    fn add_to<'a>(&'a self, sets: &mut Vec<MarginedSets<'a>>, steps: &mut Vec<Step<'a>>) {
        if !self.removed.is_empty() {
            steps.push(Step::Remove(Indices::List(&self.removed)));
        }
        if !self.indices.is_empty() {
            let (indices, boxes) = (Indices::List(&self.indices), &self.boxes[..]);
            sets.push(MarginedSets { indices, boxes, margins: (&self.margins).into() });
        }
    }
}

/// Whether a step that is no set names any box.
fn names_any(step: &Step<'_>) -> bool {
    match step {
        Step::Remove(indices) | Step::Switch(indices, _) | Step::Static(indices, _) => {
            indices.last().is_some()
        }
        _ => true,
    }
}

/// A single index.
const fn one(index: u32) -> Indices<'static> {
    Indices::Range { first: index, count: 1 }
}
