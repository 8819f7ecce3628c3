//! Scenes that persist: boxes stay from answer to answer, edits go in, changes of pairs come out.

mod answer;
mod margined;
mod query;
mod remote;
mod shared;

use std::ops::Range;
use std::sync::Arc;

use pairmask_core::aabb::Aabb;
use pairmask_core::engine::EngineId;
use pairmask_core::filters::{FilterTable, Tag};
use pairmask_core::scene::{
    Edit, EditError, Indices, Scene as CoreScene, SceneOptions, SceneSkips, Sent, Sets, Step, Tags,
    Want,
};

use self::answer::Source;
pub use self::answer::{EndedIter, EndedList, PairList, PairListIter};
pub use self::margined::{
    MarginedAnswer, MarginedEdit, MarginedPairs, MarginedScene, MarginedSceneStats, PendingMargined,
};
pub(super) use self::query::Asked;
pub use self::query::{QueryAnswer, SceneQuery};
use self::remote::{Found, RemoteScene, commit_error, new_scene};
pub use self::shared::{
    JoinOptions, PendingShared, SharedAnswer, SharedEdit, SharedError, SharedScene,
};
use super::builder::Backend;
use super::core::Core;
use super::error::CommitError;
use super::pairs::ServedBy;
use super::unread::Awaited;

/// Boxes that persist from answer to answer, by indices of the client's own.
///
/// [`scene`](pairmask_core::scene) says what is told. Made by [`Session::scene`](super::Session::scene);
/// it lives on without the session.
///
/// Boxes may have [rules](crate::filters) of which others they meet: [`SceneEdit::tag`].
///
/// A daemon keeps the scene where the session has one. This process keeps boxes and flags, 25 bytes an
/// index and with tags 12 more, and sends them again by itself where the daemon has lost them; where no daemon answers, it
/// answers from them itself, if the [backend](super::Backend) allows it. Then the next changes are a
/// [resync](SceneAnswer::is_resync).
pub struct Scene {
    core: Arc<Core>,
    kept: Kept,
    draft: Draft,
    /// Indices are below this.
    index_limit: u32,
}

/// Where a scene is.
#[allow(clippy::large_enum_variant)] // One of each scene.
enum Kept {
    Remote(RemoteScene),
    Here(CoreScene),
}

/// What an edit sets one by one, or by a function; kept, so that steady edits allocate nothing.
#[derive(Debug, Default)]
struct Draft {
    indices: Vec<u32>,
    boxes: Vec<Aabb>,
    /// Boxes of [`Given::fills`].
    filled: Vec<Aabb>,
    removed: Vec<u32>,
    tagged: Vec<u32>,
    tags: Vec<Tag>,
}

/// What an edit does beside its [`Draft`].
#[derive(Debug, Default)]
struct Given<'a> {
    steps: Vec<Step<'a>>,
    /// Indices, and where their boxes lie in [`Draft::filled`].
    fills: Vec<(Indices<'a>, Range<usize>)>,
}

impl Draft {
    /// An empty one, with the memory of this.
    fn clear(&mut self) {
        self.indices.clear();
        self.boxes.clear();
        self.filled.clear();
        self.removed.clear();
        self.tagged.clear();
        self.tags.clear();
    }

    /// All steps of an edit.
    fn steps<'a>(&'a self, given: &Given<'a>) -> Vec<Step<'a>> {
        let mut steps = given.steps.clone();
        steps.extend(given.fills.iter().map(|(indices, place)| {
            Step::Set(Sets { indices: *indices, boxes: &self.filled[place.clone()] })
        }));
        if !self.removed.is_empty() {
            steps.push(Step::Remove(Indices::List(&self.removed)));
        }
        if !self.indices.is_empty() {
            let (indices, boxes) = (Indices::List(&self.indices), &self.boxes[..]);
            steps.push(Step::Set(Sets { indices, boxes }));
        }
        if !self.tagged.is_empty() {
            steps.push(Step::Tag(Tags { indices: Indices::List(&self.tagged), tags: &self.tags }));
        }
        steps
    }

    /// Keeps a box for each index, all of which are below a limit.
    fn fill(
        &mut self,
        indices: Indices<'_>,
        limit: u32,
        mut f: impl FnMut(u32) -> Aabb,
    ) -> Result<Range<usize>, EditError> {
        if let Some(index) = indices.last().filter(|last| *last >= u64::from(limit)) {
            return Err(EditError::BeyondLimit { index, limit });
        }
        let (start, count) = (self.filled.len(), indices.len());
        let no_memory = |_| EditError::NoMemory { boxes: count as u64 };
        self.filled.try_reserve(count).map_err(no_memory)?;
        indices.for_each(|_, index| self.filled.push(f(index)));
        Ok(start..self.filled.len())
    }
}

impl std::fmt::Debug for Scene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scene").field("boxes", &self.len()).finish_non_exhaustive()
    }
}

impl Scene {
    pub(super) fn new(options: SceneOptions, core: &Arc<Core>) -> Self {
        let kept = match core.settings().backend {
            Backend::InProcess => Kept::Here(new_scene(options, core)),
            Backend::Auto | Backend::Daemon => {
                Kept::Remote(RemoteScene::new(Arc::clone(core), options))
            }
        };
        let draft = Draft::default();
        Self { core: Arc::clone(core), kept, draft, index_limit: options.most_boxes }
    }

    /// Begins an edit. Without [`SceneEdit::commit`], nothing happens.
    pub fn edit<'a>(&mut self) -> SceneEdit<'_, 'a> {
        self.draft.clear();
        SceneEdit { scene: self, given: Given::default(), refused: None }
    }

    /// Forgets what was told: the next changes are a [resync](SceneAnswer::is_resync).
    pub fn lose(&mut self) {
        match &mut self.kept {
            Kept::Remote(scene) => scene.lose(),
            Kept::Here(scene) => scene.lose(),
        }
    }

    /// Boxes, those that are switched off too.
    pub const fn len(&self) -> usize {
        match &self.kept {
            Kept::Remote(scene) => scene.copy().len(),
            Kept::Here(scene) => scene.len(),
        }
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The box of an index, also one that is switched off.
    pub fn get(&self, index: u32) -> Option<Aabb> {
        match &self.kept {
            Kept::Remote(scene) => scene.copy().get(index),
            Kept::Here(scene) => scene.get(index),
        }
    }

    /// The boxes that this process keeps.
    fn sent(&self) -> Sent<'_> {
        match &self.kept {
            Kept::Remote(scene) => scene.copy().into(),
            Kept::Here(scene) => scene.into(),
        }
    }

    /// Bytes that this process keeps of the scene.
    pub fn allocated_bytes(&self) -> usize {
        match &self.kept {
            Kept::Remote(scene) => scene.allocated_bytes().0,
            Kept::Here(scene) => scene.allocated_bytes(),
        }
    }

    /// Bytes that the daemon keeps of it, by its last answer; 0 where it has none.
    pub fn daemon_bytes(&self) -> u64 {
        match &self.kept {
            Kept::Remote(scene) => scene.allocated_bytes().1,
            Kept::Here(_) => 0,
        }
    }
}

/// An edit that is being written: see [`Edit`] for the order in which it is applied, and
/// [`EditError`](pairmask_core::scene::EditError) for what is wrong.
#[derive(Debug)]
#[must_use = "an edit does nothing until it is committed"]
pub struct SceneEdit<'s, 'a> {
    scene: &'s mut Scene,
    given: Given<'a>,
    /// What is wrong with a fill.
    refused: Option<EditError>,
}

impl<'s, 'a> SceneEdit<'s, 'a> {
    /// Sets the box of an index; inserts it where there is none.
    pub fn set(self, index: u32, b: Aabb) -> Self {
        self.scene.draft.indices.push(index);
        self.scene.draft.boxes.push(b);
        self
    }

    /// Sets boxes where they lie: a list of indices, a range or a [bitmask](Indices::Mask), and
    /// a box for each.
    pub fn set_all(self, indices: impl Into<Indices<'a>>, boxes: &'a [Aabb]) -> Self {
        self.step(Step::Set(Sets { indices: indices.into(), boxes }))
    }

    /// Sets boxes to what a function gives for each index, in the order in which they are named.
    ///
    /// It is the better way where the boxes lie in no array: where they are computed from bodies, or gathered
    /// from several places. They are written once, to memory that the scene keeps for the next such edit (24
    /// bytes for each box of the largest one), and are copied from there as those of
    /// [`set_all`](Self::set_all) are from the caller's array. Boxes that lie in an array already are one copy
    /// cheaper with `set_all`.
    ///
    /// With an index that the scene cannot have, the function is not called, and the edit is refused when it
    /// is committed.
    ///
    /// ```
    /// use pairmask::scene::{SceneOptions, Want};
    /// use pairmask::{Aabb, Backend, Session};
    ///
    /// let bodies: Vec<([f32; 3], f32)> = vec![([0.0; 3], 1.0), ([1.5; 3], 1.0), ([9.0; 3], 1.0)];
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut scene = session.scene(SceneOptions::default());
    /// let edit = scene.edit().set_with(0..3, |index| {
    ///     let (centre, half) = bodies[index as usize];
    ///     Aabb::new(centre.map(|x| x - half), centre.map(|x| x + half))
    /// });
    /// assert_eq!(edit.commit(Want::Changes)?.take().begun(), [[0, 1]]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn set_with(mut self, indices: impl Into<Indices<'a>>, f: impl FnMut(u32) -> Aabb) -> Self {
        let (indices, limit) = (indices.into(), self.scene.index_limit);
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

    /// Gives a box its [tag](pairmask_core::filters): its world, its owner and its filter. A box that is
    /// inserted has [`Tag::default`]. Whether a box itself is static, [`make_static`](Self::make_static) says, and
    /// not its tag.
    pub fn tag(self, index: u32, tag: Tag) -> Self {
        self.scene.draft.tagged.push(index);
        self.scene.draft.tags.push(tag);
        self
    }

    /// Gives boxes their tags, as [`tag`](Self::tag) does.
    pub fn tag_all(self, indices: impl Into<Indices<'a>>, tags: &'a [Tag]) -> Self {
        self.step(Step::Tag(Tags { indices: indices.into(), tags }))
    }

    /// The filters that tags name, in place of all before.
    pub fn filters(self, table: &'a FilterTable) -> Self {
        self.step(Step::Filters(table))
    }

    /// Puts pairs on the include list, or takes them off.
    pub fn include(self, pairs: &'a [[u32; 2]], on: bool) -> Self {
        self.step(Step::Include(pairs, on))
    }

    /// Puts pairs on the exclude list, or takes them off.
    pub fn exclude(self, pairs: &'a [[u32; 2]], on: bool) -> Self {
        self.step(Step::Exclude(pairs, on))
    }

    /// Does a step.
    pub fn step(mut self, step: Step<'a>) -> Self {
        self.given.steps.push(step);
        self
    }

    /// Applies the edit and answers.
    ///
    /// # Errors
    /// [`CommitError`]. After [`CommitError::Edit`] and [`CommitError::Frame`] the scene is what it was.
    pub fn commit(self, want: Want) -> Result<SceneAnswer<'s>, CommitError> {
        self.submit(want)?.wait()
    }

    /// Sends the edit. The daemon works on it while this thread does something else; in process it is
    /// answered before this returns.
    ///
    /// # Errors
    /// [`CommitError`]. The scene is then what it was, but for [`CommitError::Wait`].
    pub fn submit(self, want: Want) -> Result<PendingAnswer<'s, 'a>, CommitError> {
        let Self { scene, given, refused } = self;
        if let Some(error) = refused {
            return Err(error.into());
        }
        let Scene { kept, draft, .. } = &mut *scene;
        let all = draft.steps(&given);
        let edit = Edit { steps: &all };
        let awaited = match kept {
            Kept::Here(here) => {
                here.edit(edit, want).map_err(commit_error)?;
                Awaited::default()
            }
            Kept::Remote(remote) => remote.begin(edit, want)?,
        };
        Ok(PendingAnswer { scene, given, want, awaited })
    }
}

/// An edit under way. Dropped, it is applied, and its answer counts as never given.
///
/// It holds one of the session's three places for frames. Dropped, it leaves that to whatever wants one next,
/// which waits for the daemon's answer first where no other is free.
#[must_use = "an edit is answered when it is waited for"]
pub struct PendingAnswer<'s, 'a> {
    scene: &'s mut Scene,
    given: Given<'a>,
    want: Want,
    awaited: Awaited<'s>,
}

impl std::fmt::Debug for PendingAnswer<'_, '_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PendingAnswer").field("want", &self.want).finish_non_exhaustive()
    }
}

impl<'s> PendingAnswer<'s, '_> {
    /// Waits for the answer, as long as the session's deadline allows.
    ///
    /// # Errors
    /// [`CommitError`]. The edit is applied; the next answer makes up for this one.
    pub fn wait(self) -> Result<SceneAnswer<'s>, CommitError> {
        let Self { scene, given, want, awaited } = self;
        let Scene { kept, draft, .. } = &mut *scene;
        let found = match kept {
            Kept::Remote(remote) => remote.end(awaited, Edit { steps: &draft.steps(&given) })?,
            Kept::Here(_) => Found::Here,
        };
        Ok(SceneAnswer { scene, want, found })
    }
}

/// A single index.
const fn one(index: u32) -> Indices<'static> {
    Indices::Range { first: index, count: 1 }
}

/// The answer to an edit. All its lists are sorted: the bytes are the same whoever answered.
///
/// [`take`](Self::take) acknowledges it: the next changes are counted from it. An answer that is dropped
/// instead counts as never given, and the next one makes up for it.
///
/// An answer of a daemon holds one of the three places for frames until it is dropped.
#[must_use = "an answer that is not taken is told again"]
pub struct SceneAnswer<'s> {
    scene: &'s mut Scene,
    want: Want,
    found: Found,
}

impl std::fmt::Debug for SceneAnswer<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SceneAnswer")
            .field("want", &self.want)
            .field("begun", &self.begun().len())
            .field("ended", &self.ended().len())
            .field("pairs", &self.pairs().len())
            .finish_non_exhaustive()
    }
}

impl SceneAnswer<'_> {
    /// Takes the answer: what it tells is known from now on.
    pub fn take(self) -> Self {
        match &mut self.scene.kept {
            Kept::Remote(remote) => remote.take(self.want),
            Kept::Here(scene) => scene.take(),
        }
        self
    }

    /// Which answer was asked for.
    pub const fn want(&self) -> Want {
        self.want
    }

    /// Whether changes were asked for and [`pairs`](Self::pairs) holds all pairs instead: because those
    /// are fewer than the changes, or because it is not known any more what was told. The client forgets
    /// the pairs that it knows.
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

    /// Pairs of now, for [`Want::All`], [`Want::Moved`] and a [resync](Self::is_resync).
    pub fn pairs(&self) -> PairList<'_> {
        self.source().pairs()
    }

    /// Pairs of the whole scene, if the answer knows: [`Want::Moved`] and [`Want::Nothing`] do not.
    pub fn pair_count(&self) -> Option<u64> {
        self.source().pair_count()
    }

    /// Work left out.
    pub fn skipped(&self) -> &SceneSkips {
        self.source().skipped()
    }

    /// What answered.
    pub fn served_by(&self) -> ServedBy {
        self.source().served_by()
    }

    /// The engine that answered. It may be one of a later daemon that this build does not know.
    pub fn engine(&self) -> EngineId {
        self.source().engine()
    }

    fn source(&self) -> Source<'_> {
        match (&self.found, &self.scene.kept) {
            (Found::Daemon(from), _) => Source::Daemon(from),
            (Found::Here, Kept::Here(scene)) => Source::Here(scene.told()),
            (Found::Here, Kept::Remote(remote)) => Source::Here(remote.told_here()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Session;
    use super::*;

    #[test]
    fn steady_fills_allocate_no_boxes() {
        let session = Session::builder().backend(Backend::InProcess).connect();
        let mut session = session.expect("no daemon is needed");
        let mut scene = session.scene(SceneOptions::default());
        let mut fill = |step: usize| {
            let at = |index: u32| Aabb::new([index as f32; 3], [index as f32 + step as f32; 3]);
            let edit = scene.edit().set_with(0..600, at).set_with(600..1_000, at);
            drop(edit.commit(Want::Nothing).expect("an answer"));
            assert_eq!(scene.get(999), Some(at(999)));
            (scene.draft.filled.as_ptr(), scene.draft.filled.capacity())
        };
        let first = fill(0);
        assert!((1..20).all(|step| fill(step) == first));
    }
}
