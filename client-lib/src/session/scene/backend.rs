//! A scene, and where its boxes are kept: by a daemon, or in this process.

use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;

use pairmask_core::aabb::Aabb;
use pairmask_core::scene::shared::{AtEnd, LeaseError};
use pairmask_core::scene::{
    Draft, Edit, Given, MarginStats, Margined, Replica, Replicas, Report, Scene as CoreScene,
    Snapshots,
};
use pairmask_wire::LeaseAction;

use super::lists::Source;
use super::options::SceneOptions;
use super::question::Question;
use super::remote::{Found, RemoteScene, edit_here, new_scene};
use super::sharing::Sharing;
use crate::session::core::Core;
use crate::session::error::Error;
use crate::session::settings::{Backend, Settings};
use crate::session::unread::Awaited;

/// Boxes that stay from answer to answer, by indices of the client's own.
///
/// [`pairmask_core::scene`] says what is reported. Made by [`Session::scene`](crate::Session::scene);
/// it lives on without the session.
///
/// Boxes may have [rules](crate::filters) of which others they meet: [`SceneEdit::set_filter`](super::SceneEdit::set_filter).
/// They may have [margins](SceneOptions::margin): then only boxes that left theirs are sent.
///
/// A daemon keeps the scene where the session has one. This process keeps boxes and flags, 25 bytes an
/// index, with filter data 12 more and with user data 8, and sends them again by itself where the daemon has lost them; where no daemon
/// answers, it answers from them itself, if the [backend](crate::Backend) allows it. Then the next changes are a
/// [resync](super::SceneAnswer::is_resync).
pub struct Scene {
    pub(super) core: Arc<Core>,
    pub(super) backend: SceneBackend,
    pub(super) margins: Option<Box<Margined>>,
    pub(super) draft: Draft,
    pub(super) snapshots: Snapshots,
    /// Indices are below this.
    pub(super) index_limit: u32,
}

/// Where the boxes are that were sent.
#[allow(clippy::large_enum_variant)] // One of each scene.
pub(super) enum SceneBackend {
    Remote(RemoteScene),
    Here(CoreScene),
}

impl SceneBackend {
    fn sent(&self) -> Replica<'_> {
        match self {
            Self::Remote(scene) => scene.copy().into(),
            Self::Here(scene) => scene.into(),
        }
    }

    /// Begins an edit, after which the pairs count as [reported](edit_here) where it is said how many there are.
    pub fn begin(
        &mut self,
        edit: Edit<'_>,
        report: Report,
        reported: Option<u64>,
    ) -> Result<Awaited, Error> {
        match self {
            Self::Remote(scene) => scene.begin(edit, report, reported),
            Self::Here(scene) => {
                edit_here(scene, edit, report, reported)?;
                Ok(Awaited::default())
            }
        }
    }

    /// Asks the scene as the last edit made it.
    pub fn ask<Q: Question>(&mut self, core: &Core, question: &Q) -> Result<Q::Answer, Error> {
        match self {
            Self::Remote(scene) => scene.ask(question),
            Self::Here(scene) => question.ask_here(core, scene),
        }
    }

    pub fn end(&mut self, awaited: Awaited) -> Result<Found, Error> {
        match self {
            Self::Remote(scene) => scene.end(awaited),
            Self::Here(_) => Ok(Found::Here),
        }
    }

    pub fn source<'a>(&'a self, found: &'a Found) -> Source<'a> {
        match (found, self) {
            (Found::Daemon(from), _) => Source::Daemon(from),
            (Found::Here, Self::Here(scene)) => Source::Here(scene.reported()),
            (Found::Here, Self::Remote(scene)) => Source::Here(scene.reported_here()),
        }
    }

    pub fn acknowledge(&mut self, report: Report) {
        match self {
            Self::Remote(scene) => scene.acknowledge(report),
            Self::Here(scene) => scene.acknowledge(),
        }
    }

    pub fn sharing(&self) -> Option<&Sharing> {
        match self {
            Self::Remote(scene) => scene.sharing(),
            Self::Here(_) => None,
        }
    }
}

impl std::fmt::Debug for Scene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scene").field("boxes", &self.len()).finish_non_exhaustive()
    }
}

impl Scene {
    pub(in crate::session) fn new(core: &Arc<Core>, options: SceneOptions) -> Result<Self, Error> {
        let own = options.without_session(core.settings().threads);
        let (usual, pairs) = (options.margin, [options.near_pairs, options.shared.is_some()]);
        let (backend, index_limit) = match (&options.shared, core.settings().backend) {
            (Some(name), _) => {
                let sharing = Sharing::new(name.parse()?, options);
                let scene = RemoteScene::join(core, own, sharing)?;
                let index_limit = scene.most_boxes();
                (SceneBackend::Remote(scene), index_limit)
            }
            (None, Backend::InProcess) => {
                (SceneBackend::Here(new_scene(own, core)), own.most_boxes)
            }
            (None, _) => (SceneBackend::Remote(RemoteScene::new(core, own, None)), own.most_boxes),
        };
        let margined = |usual| Box::new(Margined::new(usual, pairs, index_limit, own.threads));
        let (margins, draft) = (usual.map(margined), Draft::default());
        let (core, snapshots) = (Arc::clone(core), Snapshots::default());
        Ok(Self { core, backend, margins, draft, snapshots, index_limit })
    }

    /// Indices are below this.
    pub const fn most_boxes(&self) -> u32 {
        self.index_limit
    }

    /// Requests a resync: the next changes are [all pairs](super::SceneAnswer::is_resync).
    pub fn resync(&mut self) {
        self.snapshots.resync();
        if self.margins.as_mut().is_none_or(|margins| margins.resync()) {
            match &mut self.backend {
                SceneBackend::Remote(scene) => scene.resync(),
                SceneBackend::Here(scene) => scene.resync(),
            }
        }
    }

    /// Boxes, those that are disabled too; of a shared scene, this member's.
    pub const fn len(&self) -> usize {
        match (&self.margins, &self.backend) {
            (Some(margins), _) => margins.now().len(),
            (None, SceneBackend::Remote(scene)) => scene.copy().len(),
            (None, SceneBackend::Here(scene)) => scene.len(),
        }
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The box of an index as it was set, also one that is disabled.
    pub fn get(&self, index: u32) -> Option<Aabb> {
        self.replicas().now.get(index)
    }

    /// The box of an index as it was sent: inflated, where it has a margin.
    pub fn inflated(&self, index: u32) -> Option<Aabb> {
        self.backend.sent().get(index)
    }

    /// The user data of an index, which its box was [given](super::SceneEdit::set_user_data), or else 0. That of a removed
    /// box stays until another has its index, or the scene goes back to a snapshot: so pairs that ended have theirs.
    ///
    /// Of a shared scene, that of other members' boxes is known as of the last answer.
    pub fn user_data(&self, index: u32) -> u64 {
        let own = self.replicas().now;
        match self.backend.sharing() {
            // The answer of a tick says that of own boxes too.
            Some(sharing) if own.get(index).is_none() => sharing.others.of(index),
            _ => own.user_data(index),
        }
    }

    /// What margins have saved so far; `None` of a scene without.
    pub fn margin_stats(&self) -> Option<MarginStats> {
        self.margins.as_ref().map(|margins| margins.stats())
    }

    /// Bytes that this process keeps of the scene.
    pub fn allocated_bytes(&self) -> usize {
        let backend = match &self.backend {
            SceneBackend::Remote(scene) => scene.allocated_bytes().0,
            SceneBackend::Here(scene) => scene.allocated_bytes(),
        };
        backend
            + self.margins.as_ref().map_or(0, |margins| margins.allocated_bytes())
            + self.snapshots.allocated_bytes()
    }

    /// Bytes that the daemon keeps of it, by its last answer; 0 where it has none, and of a shared scene.
    pub fn daemon_bytes(&self) -> u64 {
        match &self.backend {
            SceneBackend::Remote(scene) => scene.allocated_bytes().1,
            SceneBackend::Here(_) => 0,
        }
    }

    /// Leases a range of indices of a shared scene: this member alone may set boxes there.
    ///
    /// # Errors
    /// [`Error::Lease`], among others. The indices of a writer that has died are free within about a
    /// second.
    pub fn lease(&mut self, range: Range<u32>) -> Result<(), Error> {
        let count = range.end.checked_sub(range.start).filter(|count| *count > 0);
        let take = count.map(|count| LeaseAction::Take { first: range.start, count });
        self.lease_by(take).map(drop)
    }

    /// Leases the lowest free range of so many indices. Which one that is depends on who came first.
    ///
    /// # Errors
    /// As [`lease`](Self::lease).
    pub fn lease_any(&mut self, count: u32) -> Result<Range<u32>, Error> {
        self.lease_by(Some(LeaseAction::TakeAny { count }))
    }

    /// Gives back the lease that begins at an index. Its boxes are removed, and pairs of the include and the
    /// exclude list that name one of its indices.
    ///
    /// # Errors
    /// [`Error`].
    pub fn give_back(&mut self, first: u32) -> Result<(), Error> {
        let given_back = self.lease_by(Some(LeaseAction::GiveBack { first }))?;
        if let Some(margins) = &mut self.margins {
            margins.remove(given_back)?;
        }
        Ok(())
    }

    /// `None` stands for an empty range.
    fn lease_by(&mut self, action: Option<LeaseAction>) -> Result<Range<u32>, Error> {
        self.settle();
        match &mut self.backend {
            SceneBackend::Remote(scene) if scene.sharing().is_some() => {
                scene.lease(action.ok_or(LeaseError::Empty)?)
            }
            _ => Err(Error::NotShared),
        }
    }

    /// The ranges of a shared scene that this member has leased.
    pub fn leases(&self) -> &[Range<u32>] {
        self.backend.sharing().map_or(&[], |sharing| &sharing.leases)
    }

    /// How long a tick of a shared scene is open after its first commit, at the most; `None` of another scene.
    pub fn tick_deadline(&self) -> Option<Duration> {
        self.backend.sharing()?.terms().deadline
    }

    /// What becomes of the boxes of a shared scene's writer that dies; `None` of another scene.
    pub fn at_end(&self) -> Option<AtEnd> {
        self.backend.sharing()?.terms().at_end
    }

    pub(super) fn replicas(&self) -> Replicas<'_> {
        replicas(&self.backend, self.margins.as_deref())
    }

    /// How long an answer is waited for, and how.
    pub(super) fn settings(&self) -> &Settings {
        match &self.backend {
            SceneBackend::Remote(scene) => scene.settings(),
            SceneBackend::Here(_) => self.core.settings(),
        }
    }

    /// Receives the answer to an edit that nobody waited for: a commit of a shared scene that was refused is taken back
    /// before another edit is checked.
    pub(super) fn settle(&mut self) {
        if let SceneBackend::Remote(scene) = &mut self.backend
            && scene.settle()
            && let Some(margins) = &mut self.margins
        {
            margins.undo();
        }
    }

    /// Sends an edit, as far as anything of it is to be sent. Returns what it asks for; `None` where no request is
    /// needed.
    pub(super) fn begin(
        &mut self,
        given: &Given<'_>,
        report: Report,
    ) -> Result<(Option<Report>, Awaited), Error> {
        self.settle();
        let Self { backend, margins, draft, snapshots, index_limit, .. } = self;
        let all = draft.steps(given);
        let edit = Edit { steps: &all };
        snapshots.note(edit, &replicas(backend, margins.as_deref()), *index_limit);
        let Some(margins) = margins else {
            let begun = backend.begin(edit, report, None);
            if is_applied(&begun) {
                snapshots.note_applied(edit);
            }
            return Ok((Some(report), begun?));
        };
        let sets = draft.margined(given, margins.usual());
        let ask = margins.choose(edit, &sets, report, backend.sent())?;
        let sent =
            ask.map(|report| backend.begin(Edit { steps: &margins.request(&all) }, report, None));
        if sent.as_ref().is_none_or(is_applied) {
            margins.apply(edit, report, ask.is_some());
            snapshots.note_applied(edit);
        } else {
            margins.cancel(edit);
        }
        Ok((ask, sent.transpose()?.unwrap_or_default()))
    }

    /// Waits for the answer to an edit that asked for something. What was refused is taken back.
    pub(super) fn end(&mut self, awaited: Awaited) -> Result<Found, Error> {
        let ended = self.backend.end(awaited);
        if let SceneBackend::Remote(scene) = &mut self.backend
            && scene.was_undone()
            && let Some(margins) = &mut self.margins
        {
            margins.undo();
        }
        ended
    }
}

/// The boxes of a scene as they were set, and as they were sent.
pub(super) fn replicas<'a>(
    backend: &'a SceneBackend,
    margins: Option<&'a Margined>,
) -> Replicas<'a> {
    match margins {
        None => Replicas { now: backend.sent(), sent: None },
        Some(margins) => Replicas { now: margins.now().into(), sent: Some(backend.sent()) },
    }
}

/// Whether the scene has an edit that was begun.
pub(super) fn is_applied<T>(begun: &Result<T, Error>) -> bool {
    !matches!(begun, Err(error) if !error.is_applied())
}
