//! Edits of a member, and what a tick answers.

use std::ops::Range;
use std::time::Instant;

use pairmask_core::aabb::Aabb;
use pairmask_core::engine::EngineId;
use pairmask_core::filters::Tag;
use pairmask_core::scene::{Edit, EditError, Indices, SceneSkips, Sets, Step, Tags, Want};
use pairmask_wire::{TickMarks, words_in};

use super::super::answer::{EndedList, FromDaemon, PairList, Source};
use super::super::{Given, one};
use super::SharedScene;
use super::options::SharedError;
use crate::session::unread::Awaited;

/// An edit of a member's own boxes that is being written. Steps are applied as those of an [`Edit`].
#[derive(Debug)]
#[must_use = "an edit does nothing until it is committed"]
pub struct SharedEdit<'s, 'a> {
    scene: &'s mut SharedScene,
    given: Given<'a>,
    /// What is wrong with a fill.
    refused: Option<EditError>,
}

impl<'s> SharedEdit<'s, '_> {
    /// An edit without steps; the scene's draft is empty.
    pub(super) fn new(scene: &'s mut SharedScene) -> Self {
        Self { scene, given: Given::default(), refused: None }
    }
}

impl<'s, 'a> SharedEdit<'s, 'a> {
    /// Sets the box of an index; inserts it where there is none.
    pub fn set(self, index: u32, b: Aabb) -> Self {
        self.scene.draft.indices.push(index);
        self.scene.draft.boxes.push(b);
        self
    }

    /// Sets boxes where they lie: indices, and a box for each.
    pub fn set_all(self, indices: impl Into<Indices<'a>>, boxes: &'a [Aabb]) -> Self {
        self.step(Step::Set(Sets { indices: indices.into(), boxes }))
    }

    /// Sets boxes that a function gives, index by index.
    pub fn set_with(mut self, indices: impl Into<Indices<'a>>, f: impl FnMut(u32) -> Aabb) -> Self {
        let (indices, limit) = (indices.into(), self.scene.terms.most_boxes);
        match self.scene.draft.fill(indices, limit, f) {
            Ok(place) => self.given.fills.push((indices, place)),
            Err(error) => self.refused = self.refused.or(Some(error)),
        }
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

    /// Makes a box static (two static boxes are no pair) or not.
    pub fn make_static(self, index: u32, is_static: bool) -> Self {
        self.step(Step::Static(one(index), is_static))
    }

    /// Gives boxes their [tags](pairmask_core::filters). Whether a box itself is static,
    /// [`make_static`](Self::make_static) says, and not its tag.
    pub fn tag_all(self, indices: impl Into<Indices<'a>>, tags: &'a [Tag]) -> Self {
        self.step(Step::Tag(Tags { indices: indices.into(), tags }))
    }

    /// Does a step.
    pub fn step(mut self, step: Step<'a>) -> Self {
        self.given.steps.push(step);
        self
    }

    /// Commits the edit, and waits for the end of the tick.
    ///
    /// # Errors
    /// [`SharedError`].
    pub fn commit(self, want: Want) -> Result<SharedAnswer<'s>, SharedError> {
        self.submit(want)?.wait()
    }

    /// Commits the edit. This thread can do something else until the tick ends.
    ///
    /// # Errors
    /// [`SharedError`].
    pub fn submit(self, want: Want) -> Result<PendingShared<'s>, SharedError> {
        let Self { scene, given, refused } = self;
        if want == Want::Moved {
            return Err(SharedError::Moved);
        }
        if let Some(error) = refused {
            return Err(error.into());
        }
        let draft = std::mem::take(&mut scene.draft);
        let begun = scene.begin(Edit { steps: &draft.steps(&given) }, want);
        scene.draft = draft;
        Ok(PendingShared { awaited: begun?, scene, want })
    }
}

/// A commit under way. Dropped, it is applied with its tick, and its answer counts as never given.
#[must_use = "a commit is answered when it is waited for"]
pub struct PendingShared<'s> {
    scene: &'s mut SharedScene,
    want: Want,
    awaited: Awaited<'s>,
}

impl std::fmt::Debug for PendingShared<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PendingShared").field("want", &self.want).finish_non_exhaustive()
    }
}

impl<'s> PendingShared<'s> {
    /// Waits for the end of the tick: as long as its deadline and the session's allow together.
    ///
    /// # Errors
    /// [`SharedError`]. The next answer makes up for this one.
    pub fn wait(self) -> Result<SharedAnswer<'s>, SharedError> {
        let Self { scene, want, awaited } = self;
        let sent_at = Instant::now();
        let (from, marks) = scene.end(awaited)?;
        log::trace!("tick {} after {:?}", marks.tick, sent_at.elapsed());
        Ok(SharedAnswer { scene, want, from, marks })
    }
}

/// What a tick tells a member. Its lists are sorted, and lie in the daemon's memory: it holds one of the
/// three places for frames until it is dropped.
///
/// [`take`](Self::take) acknowledges it: the next changes are counted from it. An answer that is dropped
/// instead counts as never given, and the next one makes up for it.
#[must_use = "an answer that is not taken is told again"]
pub struct SharedAnswer<'s> {
    scene: &'s mut SharedScene,
    want: Want,
    from: Box<FromDaemon>,
    marks: TickMarks,
}

impl std::fmt::Debug for SharedAnswer<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SharedAnswer")
            .field("tick", &self.tick())
            .field("begun", &self.begun().len())
            .field("ended", &self.ended().len())
            .field("pairs", &self.pairs().len())
            .finish_non_exhaustive()
    }
}

impl SharedAnswer<'_> {
    /// Takes the answer: what it tells is known from now on.
    pub fn take(self) -> Self {
        if matches!(self.want, Want::Changes | Want::All)
            && let Some(there) = &mut self.scene.there
        {
            there.is_taken = true;
        }
        self
    }

    /// The tick that the commit was part of, from 1.
    pub const fn tick(&self) -> u64 {
        self.marks.tick
    }

    /// Leases of writers that had not committed when the tick ended: they kept their last boxes.
    pub fn late(&self) -> Vec<Range<u32>> {
        self.marks.late_in(words_in(self.from.answer.response.pages()))
    }

    /// Whether changes were asked for and [`pairs`](Self::pairs) holds all pairs instead, because it is not
    /// known what this member knows: at first, after it has leased indices, after a long time without a
    /// commit, and where the daemon was restarted.
    pub fn is_resync(&self) -> bool {
        self.source().is_resync()
    }

    /// Pairs that began, for [`Want::Changes`].
    pub fn begun(&self) -> PairList<'_> {
        self.source().begun()
    }

    /// Pairs that ended, for [`Want::Changes`].
    pub fn ended(&self) -> EndedList<'_> {
        self.source().ended()
    }

    /// Pairs of now, for [`Want::All`] and a [resync](Self::is_resync): those that this member hears of.
    pub fn pairs(&self) -> PairList<'_> {
        self.source().pairs()
    }

    /// Pairs of the whole scene, whatever this member hears of; `None` for [`Want::Nothing`].
    pub fn pair_count(&self) -> Option<u64> {
        self.source().pair_count()
    }

    /// Work left out.
    pub fn skipped(&self) -> &SceneSkips {
        self.source().skipped()
    }

    /// The engine that answered.
    pub fn engine(&self) -> EngineId {
        self.source().engine()
    }

    fn source(&self) -> Source<'_> {
        Source::Daemon(&self.from)
    }
}
