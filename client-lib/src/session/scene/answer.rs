//! The answer to an edit, and an edit that waits for it.

use std::ops::Range;
use std::time::{Duration, Instant};

use pairmask_core::engine::{EngineId, EngineName};
use pairmask_core::mask::PairList;
use pairmask_core::scene::{Ended, Report, SceneSkips};

use super::backend::Scene;
use super::lists::Source;
use super::remote::Found;
use crate::session::error::Error;
use crate::session::pairs::ServedBy;
use crate::session::pending::{Answered, Request};
use crate::session::unread::Awaited;

/// An edit under way. Dropped, it is applied, and its answer counts as never given.
pub struct Submitted<'s> {
    pub(super) scene: &'s mut Scene,
    pub(super) report: Report,
    /// What was asked; `None` where no request was needed.
    pub(super) asked: Option<Report>,
    pub(super) awaited: Awaited,
}

impl std::fmt::Debug for Submitted<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Submitted").field("report", &self.report).finish_non_exhaustive()
    }
}

impl<'s> Answered for SceneAnswer<'s> {
    type Request = Submitted<'s>;
}

impl<'s> Request<SceneAnswer<'s>> for Submitted<'s> {
    fn deadline(&self) -> Duration {
        self.scene.settings().deadline
    }

    fn has_come(&mut self, until: Instant) -> bool {
        self.awaited.has_come(self.scene.settings().spin, until)
    }

    fn take(self) -> Result<Result<SceneAnswer<'s>, Self>, Error> {
        let Self { scene, report, asked, awaited } = self;
        let (mut by, mut found) = (Answerer::default(), None);
        if let Some(asked) = asked {
            let ended = scene.end(awaited)?;
            by = Answerer::of(&scene.backend.source(&ended));
            found = Some((asked, ended));
        }
        let Scene { backend, margins, .. } = &mut *scene;
        if let Some(margins) = margins {
            if let Some((Report::Changes, ended)) = &found {
                let source = backend.source(ended);
                let ended = source.ended().map(|ended| ended.pair);
                margins.learn(source.is_resync(), source.pairs(), source.begun(), ended);
            }
            if margins.answer(report, found.is_some())
                && let Some((asked, _)) = found.take()
            {
                // What this process knows of near pairs is the history of what it sent.
                backend.acknowledge(asked);
            }
        }
        let found = found.map(|(_, found)| found);
        let mut answer = SceneAnswer { scene, report, found, by };
        answer.acknowledge();
        Ok(Ok(answer))
    }

    fn answer_here(self) -> Result<SceneAnswer<'s>, Error> {
        // What has no answer within the deadline ends so.
        self.take()?.map_err(|_| Error::AlreadyReceived)
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
        let tick = source.tick().map(|(number, late)| Tick { number, late });
        Self { served_by, engine, skipped: *source.skipped(), tick }
    }
}

/// The answer to an edit. All its lists are sorted: the bytes are the same whichever backend answered.
///
/// It was acknowledged by being waited for: the next changes are counted from it.
///
/// An answer of a daemon holds one of the three slots for frames until it is dropped; one of exact pairs of a
/// scene with margins holds none.
#[must_use = "what an answer reports is not reported again"]
pub struct SceneAnswer<'s> {
    scene: &'s mut Scene,
    report: Report,
    /// `None` where the answer is what the scene's margins report.
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
        let Scene { backend, margins, snapshots, .. } = &mut *self.scene;
        if let Some(margins) = margins {
            margins.acknowledge(self.report, count);
        }
        if self.found.is_some() {
            backend.acknowledge(self.report);
        }
        if matches!(self.report, Report::Changes | Report::All)
            && let Some(count) = count
        {
            snapshots.acknowledge(count);
        }
    }

    /// Which answer was asked for.
    pub const fn report(&self) -> Report {
        self.report
    }

    /// Whether changes were asked for and [`pairs`](Self::pairs) holds all pairs instead: because those
    /// are fewer than the changes, or because it is not known any more what was reported. The client drops
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

    /// Pairs of the whole scene, if the answer knows: [`Report::Moved`] and [`Report::Nothing`] do not. Of a shared
    /// scene, those of all members, regardless of the scope of this one's reports.
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

    /// The tick that the edit was part of, from 1; `None` unless several processes write the scene.
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
            (found, _) => self.scene.backend.source(found.as_ref().unwrap_or(&Found::Here)),
        }
    }
}
