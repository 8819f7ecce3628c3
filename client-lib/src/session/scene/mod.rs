//! Scenes that persist: boxes stay from answer to answer, edits go in, changes of pairs come out.
//!
//! ```text
//! edit      what an edit does, until it is sent
//! margins   which boxes left their margin, and the pairs of the boxes as they were set
//! remote    a scene that a daemon keeps, with the copy that this process keeps
//! options   what a session asks of a scene
//! answer    lists of pairs, in the memory of the daemon's answer or of the scene
//! query     which boxes some other boxes overlap
//! shared    a scene that several processes write
//! ```

mod answer;
mod edit;
mod margins;
mod options;
mod query;
mod remote;
mod shared;

use std::ops::Range;
use std::sync::Arc;

use pairmask_core::aabb::Aabb;
use pairmask_core::engine::{EngineId, EngineName};
use pairmask_core::scene::{Edit, Ended, Report, Scene as CoreScene, SceneSkips, Sent};
use pairmask_wire::words_in;

pub use self::answer::PairList;
use self::answer::Source;
pub use self::edit::SceneEdit;
use self::edit::{Draft, Given};
pub use self::margins::MarginStats;
use self::margins::Margined;
pub use self::options::SceneOptions;
pub use self::query::QueryAnswer;
use self::remote::{Found, RemoteScene, new_scene};
use self::shared::Member;
use super::core::Core;
use super::error::Error;
use super::pairs::ServedBy;
use super::settings::Backend;
use super::unread::Awaited;

/// Boxes that persist from answer to answer, by indices of the client's own.
///
/// [`pairmask_core::scene`] says what is reported. Made by [`Session::scene`](super::Session::scene);
/// it lives on without the session.
///
/// Boxes may have [rules](crate::filters) of which others they meet: [`SceneEdit::tag`]. They may have
/// [margins](pairmask_core::scene::SceneMargins): then only boxes that left theirs are sent.
///
/// A daemon keeps the scene where the session has one. This process keeps boxes and flags, 25 bytes an
/// index and with tags 12 more, and sends them again by itself where the daemon has lost them; where no daemon answers, it
/// answers from them itself, if the [backend](super::Backend) allows it. Then the next changes are a
/// [resync](SceneAnswer::is_resync).
pub struct Scene {
    core: Arc<Core>,
    kept: Kept,
    margins: Option<Box<Margined>>,
    draft: Draft,
    /// Indices are below this.
    index_limit: u32,
}

/// Where the boxes are that were sent.
#[allow(clippy::large_enum_variant)] // One of each scene.
enum Kept {
    Remote(RemoteScene),
    Here(CoreScene),
    /// Those of this member of a scene that several processes write.
    Shared(Box<Member>),
}

impl Kept {
    fn sent(&self) -> Sent<'_> {
        match self {
            Self::Remote(scene) => scene.copy().into(),
            Self::Here(scene) => scene.into(),
            Self::Shared(member) => member.copy().into(),
        }
    }

    fn begin<'s>(&mut self, edit: Edit<'_>, report: Report) -> Result<Awaited<'s>, Error> {
        match self {
            Self::Remote(scene) => scene.begin(edit, report),
            Self::Here(scene) => {
                scene.edit(edit, report)?;
                Ok(Awaited::default())
            }
            Self::Shared(member) => member.begin(edit, report),
        }
    }

    fn end(&mut self, awaited: Awaited<'_>, edit: Edit<'_>) -> Result<(Found, Answerer), Error> {
        let (found, tick) = match self {
            Self::Remote(scene) => (scene.end(awaited, edit)?, None),
            Self::Here(_) => (Found::Here, None),
            Self::Shared(member) => {
                let (from, marks) = member.end(awaited)?;
                let late = marks.late_in(words_in(from.answer.response.pages()));
                (Found::Daemon(from), Some(Tick { number: marks.tick, late }))
            }
        };
        let by = Answerer { tick, ..Answerer::of(&self.source(&found)) };
        Ok((found, by))
    }

    fn source<'a>(&'a self, found: &'a Found) -> Source<'a> {
        match (found, self) {
            (Found::Daemon(from), _) => Source::Daemon(from),
            (Found::Here, Self::Here(scene)) => Source::Here(scene.reported()),
            (Found::Here, Self::Remote(scene)) => Source::Here(scene.reported_here()),
            (Found::Here, Self::Shared(member)) => Source::Here(member.reported_here()),
        }
    }

    /// Takes a commit that a shared scene has refused back from the boxes with margins too.
    fn undo(&mut self, margins: Option<&mut Box<Margined>>) {
        if let (Self::Shared(member), Some(margins)) = (self, margins)
            && member.was_undone()
        {
            margins.undo();
        }
    }

    fn acknowledge(&mut self, report: Report) {
        match self {
            Self::Remote(scene) => scene.acknowledge(report),
            Self::Here(scene) => scene.acknowledge(),
            Self::Shared(member) => member.acknowledge(),
        }
    }

    fn resync(&mut self) {
        match self {
            Self::Remote(scene) => scene.resync(),
            Self::Here(scene) => scene.resync(),
            Self::Shared(member) => member.resync(),
        }
    }
}

impl std::fmt::Debug for Scene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scene").field("boxes", &self.len()).finish_non_exhaustive()
    }
}

impl Scene {
    pub(super) fn new(core: &Arc<Core>, options: SceneOptions) -> Result<Self, Error> {
        let own = options.without_session(core.settings().threads);
        let (usual, pairs) = (options.margin, [options.near_pairs, options.shared.is_some()]);
        let kept = match (&options.shared, core.settings().backend) {
            (Some(name), _) => Kept::Shared(Box::new(Member::join(core, name.parse()?, options)?)),
            (None, Backend::InProcess) => Kept::Here(new_scene(own, core)),
            (None, _) => Kept::Remote(RemoteScene::new(Arc::clone(core), own)),
        };
        let index_limit = match &kept {
            Kept::Shared(member) => member.most_boxes(),
            _ => own.most_boxes,
        };
        let margined = |usual| Box::new(Margined::new(usual, pairs, index_limit, own.threads));
        let (margins, draft) = (usual.map(margined), Draft::default());
        Ok(Self { core: Arc::clone(core), kept, margins, draft, index_limit })
    }

    /// Begins an edit. Without [`SceneEdit::commit`], nothing happens.
    pub fn edit<'a>(&mut self) -> SceneEdit<'_, 'a> {
        self.draft.clear();
        SceneEdit::new(self)
    }

    /// Indices are below this.
    pub const fn most_boxes(&self) -> u32 {
        self.index_limit
    }

    /// Forgets what was told: the next changes are a [resync](SceneAnswer::is_resync).
    pub fn resync(&mut self) {
        if self.margins.as_mut().is_none_or(|margins| margins.resync()) {
            self.kept.resync();
        }
    }

    /// Boxes, those that are switched off too; of a shared scene, this member's.
    pub const fn len(&self) -> usize {
        match (&self.margins, &self.kept) {
            (Some(margins), _) => margins.now().len(),
            (None, Kept::Remote(scene)) => scene.copy().len(),
            (None, Kept::Here(scene)) => scene.len(),
            (None, Kept::Shared(member)) => member.copy().len(),
        }
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The box of an index as it was set, also one that is switched off.
    pub fn get(&self, index: u32) -> Option<Aabb> {
        match &self.margins {
            Some(margins) => margins.now().get(index),
            None => self.inflated(index),
        }
    }

    /// The box of an index as it was sent: inflated, where it has a margin.
    pub fn inflated(&self, index: u32) -> Option<Aabb> {
        match &self.kept {
            Kept::Remote(scene) => scene.copy().get(index),
            Kept::Here(scene) => scene.get(index),
            Kept::Shared(member) => member.copy().get(index),
        }
    }

    /// What margins have saved so far; `None` of a scene without.
    pub fn margin_stats(&self) -> Option<MarginStats> {
        self.margins.as_ref().map(|margins| margins.stats())
    }

    /// Bytes that this process keeps of the scene.
    pub fn allocated_bytes(&self) -> usize {
        let kept = match &self.kept {
            Kept::Remote(scene) => scene.allocated_bytes().0,
            Kept::Here(scene) => scene.allocated_bytes(),
            Kept::Shared(member) => member.copy().allocated_bytes(),
        };
        kept + self.margins.as_ref().map_or(0, |margins| margins.allocated_bytes())
    }

    /// Bytes that the daemon keeps of it, by its last answer; 0 where it has none.
    pub fn daemon_bytes(&self) -> u64 {
        match &self.kept {
            Kept::Remote(scene) => scene.allocated_bytes().1,
            Kept::Here(_) | Kept::Shared(_) => 0,
        }
    }

    /// Receives the answer to a commit of a shared scene that nobody waited for: a refused one is taken back before
    /// another edit is checked.
    fn settle(&mut self) {
        if let Kept::Shared(member) = &mut self.kept {
            member.settle();
        }
        self.kept.undo(self.margins.as_mut());
    }

    /// Sends an edit, as far as anything of it is to be sent. Returns what it asks for; `None` where no request is
    /// needed.
    fn begin<'s>(
        &mut self,
        given: &Given<'_>,
        report: Report,
    ) -> Result<(Option<Report>, Awaited<'s>), Error> {
        self.settle();
        let Self { kept, margins, draft, .. } = self;
        let all = draft.steps(given);
        let edit = Edit { steps: &all };
        let Some(margins) = margins else {
            return Ok((Some(report), kept.begin(edit, report)?));
        };
        let sets = draft.margined(given, margins.usual());
        let ask = margins.choose(edit, &sets, report, kept.sent())?;
        let sent = ask.map(|report| kept.begin(Edit { steps: &margins.request(&all) }, report));
        if matches!(&sent, Some(Err(error)) if !error.is_applied()) {
            margins.cancel(edit);
        } else {
            margins.apply(edit, report, ask.is_some());
        }
        Ok((ask, sent.transpose()?.unwrap_or_default()))
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
    report: Report,
    /// What was asked; `None` where no request was needed.
    asked: Option<Report>,
    awaited: Awaited<'s>,
}

impl std::fmt::Debug for PendingAnswer<'_, '_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PendingAnswer").field("report", &self.report).finish_non_exhaustive()
    }
}

impl<'s> PendingAnswer<'s, '_> {
    /// Waits for the answer, as long as the session's deadline allows. It is acknowledged by that: what it reports is
    /// not reported again. What the answer to a dropped edit would have reported, the next answer does.
    ///
    /// # Errors
    /// [`Error`]. The edit is applied; the next answer makes up for this one.
    pub fn wait(self) -> Result<SceneAnswer<'s>, Error> {
        let Self { scene, given, report, asked, awaited } = self;
        let Scene { kept, draft, margins, .. } = &mut *scene;
        let (mut by, mut found) = (Answerer::default(), None);
        if let Some(asked) = asked {
            let mut steps = draft.steps(&given);
            if let Some(margins) = margins {
                steps = margins.request(&steps);
            }
            let answered;
            let ended = kept.end(awaited, Edit { steps: &steps });
            kept.undo(margins.as_mut());
            (answered, by) = ended?;
            found = Some((asked, answered));
        }
        if let Some(margins) = margins
            && margins.answer(report, found.as_ref().map(|(of, found)| (*of, kept.source(found))))
            && let Some((asked, _)) = found.take()
        {
            // What this process knows of near pairs is the history of what it sent.
            kept.acknowledge(asked);
        }
        let found = found.map(|(_, found)| found);
        let mut answer = SceneAnswer { scene, report, found, by };
        answer.acknowledge();
        Ok(answer)
    }
}

/// What answered a request. Where none was needed, this process has.
struct Answerer {
    served_by: ServedBy,
    engine: EngineId,
    skipped: SceneSkips,
    tick: Option<Tick>,
}

/// The tick of a scene that several processes write.
struct Tick {
    number: u64,
    late: Vec<Range<u32>>,
}

impl Default for Answerer {
    fn default() -> Self {
        let engine = EngineName::CpuGrid.into();
        let skipped = SceneSkips::default();
        Self { served_by: ServedBy::InProcess, engine, skipped, tick: None }
    }
}

impl Answerer {
    fn of(source: &Source<'_>) -> Self {
        let (served_by, engine) = (source.served_by(), source.engine());
        Self { served_by, engine, skipped: *source.skipped(), tick: None }
    }
}

/// The answer to an edit. All its lists are sorted: the bytes are the same whoever answered.
///
/// It was acknowledged by being waited for: the next changes are counted from it.
///
/// An answer of a daemon holds one of the three places for frames until it is dropped; one of exact pairs of a
/// scene with margins holds none.
#[must_use = "what an answer reports is not reported again"]
pub struct SceneAnswer<'s> {
    scene: &'s mut Scene,
    report: Report,
    /// `None` where the answer is what the scene's margins tell.
    found: Option<Found>,
    by: Answerer,
}

impl std::fmt::Debug for SceneAnswer<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SceneAnswer")
            .field("report", &self.report)
            .field("begun", &self.begun())
            .field("ended", &self.ended().collect::<Vec<_>>())
            .field("pairs", &self.pairs())
            .finish_non_exhaustive()
    }
}

impl SceneAnswer<'_> {
    /// What the answer reports is known from now on, and not reported again.
    fn acknowledge(&mut self) {
        let count = self.pair_count();
        let Scene { kept, margins, .. } = &mut *self.scene;
        if let Some(margins) = margins {
            margins.acknowledge(self.report, count);
        }
        if self.found.is_some() {
            kept.acknowledge(self.report);
        }
    }

    /// Which answer was asked for.
    pub const fn report(&self) -> Report {
        self.report
    }

    /// Whether changes were asked for and [`pairs`](Self::pairs) holds all pairs instead: because those
    /// are fewer than the changes, or because it is not known any more what was reported. The client forgets
    /// the pairs that it knows.
    pub fn is_resync(&self) -> bool {
        self.source().is_resync()
    }

    /// Pairs that began, for [`Report::Changes`].
    pub fn begun(&self) -> PairList<'_> {
        self.source().begun()
    }

    /// Pairs that ended, and why, for [`Report::Changes`]. They are checked as those of a [`PairList`].
    pub fn ended(&self) -> impl Iterator<Item = Ended> + Clone + std::fmt::Debug + '_ {
        self.source().ended()
    }

    /// Pairs of now, for [`Report::All`], [`Report::Moved`] and a [resync](Self::is_resync).
    pub fn pairs(&self) -> PairList<'_> {
        self.source().pairs()
    }

    /// Pairs of the whole scene, if the answer knows: [`Report::Moved`] and [`Report::Nothing`] do not. Of a shared scene,
    /// whatever the scope of this member's reports.
    pub fn pair_count(&self) -> Option<u64> {
        self.source().pair_count()
    }

    /// Work left out.
    pub const fn skipped(&self) -> &SceneSkips {
        &self.by.skipped
    }

    /// What answered. Edits of a scene with margins that need no request are answered in process.
    pub const fn served_by(&self) -> ServedBy {
        self.by.served_by
    }

    /// The engine that answered. It may be one of a later daemon that this build does not know.
    pub const fn engine(&self) -> EngineId {
        self.by.engine
    }

    /// The tick that the edit was part of, from 1; `None` but of a scene that several processes write.
    pub fn tick(&self) -> Option<u64> {
        self.by.tick.as_ref().map(|tick| tick.number)
    }

    /// Leases of writers that had not committed when the tick ended: they kept their last boxes.
    pub fn late(&self) -> &[Range<u32>] {
        self.by.tick.as_ref().map_or(&[], |tick| &tick.late)
    }

    /// The scene, to look at its boxes beside the answer.
    pub const fn scene(&self) -> &Scene {
        self.scene
    }

    fn source(&self) -> Source<'_> {
        match (&self.found, &self.scene.margins) {
            (None, Some(margins)) => Source::Here(margins.reported()),
            (found, _) => self.scene.kept.source(found.as_ref().unwrap_or(&Found::Here)),
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
        let mut scene = session.scene(SceneOptions::default()).expect("a scene");
        let mut fill = |step: usize| {
            let at = |index: u32| Aabb::new([index as f32; 3], [index as f32 + step as f32; 3]);
            let edit = scene.edit().set_with(0..600, at).set_with(600..1_000, at);
            drop(edit.commit(Report::Nothing).expect("an answer"));
            assert_eq!(scene.get(999), Some(at(999)));
            (scene.draft.filled.as_ptr(), scene.draft.filled.capacity())
        };
        let first = fill(0);
        assert!((1..20).all(|step| fill(step) == first));
    }
}
