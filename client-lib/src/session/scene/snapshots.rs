//! Snapshots of a scene, to which it goes back.

use pairmask_core::scene::{AfterPhase, Edit, Report, RestorePhase, SnapshotId};

use super::answer::{SceneAnswer, Submitted};
use super::backend::{Scene, is_applied, replicas};
use crate::session::error::Error;
use crate::session::pending::Pending;

impl Scene {
    /// Takes a snapshot of the scene as the last edit made it: boxes, flags, filters, pair lists, margins, and what was
    /// reported. Games that predict go back to one and play ticks again: the same edits have the same answers, to the
    /// byte, unless a daemon died meanwhile, after which the next changes are a [resync](super::SceneAnswer::is_resync).
    ///
    /// This process keeps it. It costs nothing when it is taken, where all changes were reported: else it copies what has
    /// changed since. From then on, each edit copies what it changes, once a snapshot: 64 bytes a box, with margins 88, and
    /// 8 for each index. A snapshot is kept until it is [forgotten](Self::forget_snapshot), or the scene
    /// ends. To keep one in a file, [`save`](Self::save) the scene.
    ///
    /// Where changes are yet to be reported when the only snapshot is taken, the next changes are a resync: what the boxes
    /// were when pairs were last reported is kept with snapshots alone.
    ///
    /// ```
    /// use pairmask::{Aabb, Backend, Report, SceneOptions, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut scene = session.scene(SceneOptions::default())?;
    /// let at = |x: f32| Aabb::new([x; 3], [x + 1.0; 3]);
    /// drop(scene.edit().set(0, at(0.0)).set(1, at(9.0)).commit(Report::Changes)?);
    ///
    /// let tick = scene.snapshot()?;
    /// assert_eq!(scene.edit().set(1, at(0.5)).commit(Report::Changes)?.begun(), [[0, 1]]);
    /// scene.restore(tick)?;
    /// assert_eq!(scene.get(1), Some(at(9.0)));
    /// assert_eq!(scene.edit().set(1, at(0.5)).commit(Report::Changes)?.begun(), [[0, 1]]);
    /// scene.forget_snapshot(tick)?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`Error::SharedSnapshot`].
    pub fn snapshot(&mut self) -> Result<SnapshotId, Error> {
        if self.backend.sharing().is_some() {
            return Err(Error::SharedSnapshot);
        }
        self.settle();
        if self.snapshots.needs_resync() {
            self.resync();
        }
        Ok(self.snapshots.take())
    }

    /// Goes back to a snapshot, or forward to one that was taken later: the scene is what it was, and what was reported
    /// is what was reported then. All snapshots are kept. No pair is reported for this: the client goes back too.
    ///
    /// It costs what differs between the scene and the snapshot: about a quarter of an edit that reports changes, and
    /// another such edit if changes were yet to be reported then.
    ///
    /// # Errors
    /// [`Error::Snapshot`], where the scene is what it was. Else as [`commit`](super::SceneEdit::commit): then it is to be
    /// restored again, for it may be between both, and the next changes are a resync.
    pub fn restore(&mut self, snapshot: SnapshotId) -> Result<(), Error> {
        self.settle();
        let replicas = replicas(&self.backend, self.margins.as_deref());
        self.snapshots.begin_restore(snapshot, &replicas)?;
        let mut last = None;
        while let Some(phase) = self.next_phase(last.as_ref()) {
            if let Err(error) = self.go(&phase) {
                let error = if last.is_some() { error.unanswered() } else { error };
                if error.is_applied() {
                    self.resync();
                }
                return Err(error);
            }
            last = Some(phase);
        }
        Ok(())
    }

    fn next_phase(&mut self, last: Option<&RestorePhase>) -> Option<RestorePhase> {
        let replicas = replicas(&self.backend, self.margins.as_deref());
        self.snapshots.next_phase(&replicas, last)
    }

    /// Makes the edit of a phase, and what follows it.
    fn go(&mut self, phase: &RestorePhase) -> Result<(), Error> {
        let Self { backend, margins, snapshots, .. } = &mut *self;
        let (steps, sent_steps) = (phase.steps(), phase.sent_steps());
        let (edit, sent) = (Edit { steps: &steps }, Edit { steps: &sent_steps });
        snapshots.note_phase(phase, &replicas(backend, margins.as_deref()));
        let (report, reported) = match (phase.then(), &margins) {
            // Which pairs are near is kept here: the daemon reports which of them began and ended.
            (AfterPhase::MarkReported(_), Some(_)) => (Report::Changes, None),
            (AfterPhase::MarkReported(pair_count), None) => (Report::Nothing, Some(pair_count)),
            _ => (Report::Nothing, None),
        };
        if let Some(margins) = margins {
            margins.begin_restore(edit)?;
        }
        let begun = backend.begin(sent, report, reported);
        if is_applied(&begun) {
            if let Some(margins) = margins {
                margins.apply(edit, report, true);
            }
            snapshots.note_applied(edit);
            snapshots.end_phase(phase);
        } else if let Some(margins) = margins {
            margins.cancel(edit);
        }
        let awaited = begun?;
        if report == Report::Changes {
            // What the answer reports is acknowledged, and the client knows it.
            let asked = Some(report);
            let submitted = Submitted { scene: self, report, asked, awaited };
            drop(Pending::<SceneAnswer<'_>>::new(submitted).wait()?);
        } else {
            self.end(awaited)?;
        }
        if phase.then() == AfterPhase::Resync {
            self.resync();
        }
        Ok(())
    }

    /// Forgets a snapshot.
    ///
    /// # Errors
    /// [`Error::Snapshot`].
    pub fn forget_snapshot(&mut self, snapshot: SnapshotId) -> Result<(), Error> {
        Ok(self.snapshots.forget(snapshot)?)
    }
}
