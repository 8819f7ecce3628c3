//! A scene that a daemon keeps, and what this process keeps to send it again.
//!
//! The copy here is always right: an edit is checked against it, sent, and applied to it while the daemon
//! works. A daemon that has no scene, or an older one, gets the copy whole. Where no daemon answers, and
//! the backend allows it, a scene of this process is made from the copy. Whoever begins from the copy
//! does not know which pairs were told, so that the next changes are all pairs.
//!
//! One file, because edits and queries send the same copy again, and fall back in the same way.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::dispatch::CpuEngines;
use pairmask_core::filters::Tag;
use pairmask_core::plan::Calibration;
use pairmask_core::scene::{Edit, Report, Reported, Scene, SceneCopy, SceneOptions, Step, Tags};
use pairmask_core::units::BoxCount;
use pairmask_wire::{
    EditLayout, ReplyError, ReplyFields, RequestHeader, SceneId, SceneRequest, Section, StatusCode,
};

use super::answer::FromDaemon;
use crate::session::core::Core;
use crate::session::error::{Error, Loss};
use crate::session::estimate::{Answered, Estimate, Expected};
use crate::session::exchange::Exchange;
use crate::session::link::Link;
use crate::session::local::Asked;
use crate::session::pairs::PairMask;
use crate::session::unread::{Awaited, SentEdit, Unread};

/// A daemon that refuses a scene is not sent it again for this long, where this process can answer.
const REFUSED_FOR: Duration = Duration::from_secs(2);

/// The scene as a daemon keeps it.
struct There {
    link: Arc<Link>,
    /// The last edit's.
    revision: u64,
    /// Whether its answer was taken.
    is_acknowledged: bool,
}

/// Who answers now.
enum Keeper {
    /// Nobody has the scene.
    Nobody,
    Daemon(There),
    Here(Box<Scene>),
}

/// A scene by the copy of this process, answered by a daemon or here.
pub(super) struct RemoteScene {
    core: Arc<Core>,
    options: SceneOptions,
    id: SceneId,
    copy: SceneCopy,
    keeper: Keeper,
    /// The connection whose daemon was sent the scene: it may keep it, whoever answers now.
    sent_to: Option<Arc<Link>>,
    /// Whether who begins from the copy reports all pairs as a resync: the client acknowledged an answer, or asked for a
    /// resync.
    resyncs_anew: bool,
    /// Whether the next request asks its daemon for a resync.
    forgets: bool,
    revisions: u64,
    estimate: Estimate,
    query_estimate: Estimate,
    daemon_bytes: u64,
    /// Boxes that the edit under way names by its table of filters, where pairs of named boxes are wanted.
    named_by_table: Vec<u32>,
    /// Until when a daemon that refused the scene is asked nothing.
    stays_until: Option<Instant>,
    /// The edit that the daemon works on and nobody waits for.
    unread: Arc<Unread>,
    /// What a scene tells that is not here.
    nothing: Reported,
}

/// Where the answer to an edit lies.
pub(super) enum Found {
    Daemon(Box<FromDaemon>),
    /// In the scene of this process.
    Here,
}

impl RemoteScene {
    pub fn new(core: Arc<Core>, options: SceneOptions) -> Self {
        Self {
            id: core.next_scene(),
            unread: core.unread_of_scene(),
            copy: SceneCopy::new(options.most_boxes),
            core,
            options,
            keeper: Keeper::Nobody,
            sent_to: None,
            resyncs_anew: false,
            forgets: false,
            revisions: 0,
            estimate: Estimate::default(),
            query_estimate: Estimate::default(),
            daemon_bytes: 0,
            named_by_table: Vec::new(),
            stays_until: None,
            nothing: Reported::default(),
        }
    }

    pub const fn copy(&self) -> &SceneCopy {
        &self.copy
    }

    /// Bytes that this process keeps, and those that the daemon keeps.
    pub fn allocated_bytes(&self) -> (usize, u64) {
        let here = match &self.keeper {
            Keeper::Here(scene) => scene.allocated_bytes(),
            _ => 0,
        };
        let there = if matches!(self.keeper, Keeper::Daemon(_)) { self.daemon_bytes } else { 0 };
        (self.copy.allocated_bytes() + here, there)
    }

    /// What the scene of this process has reported.
    pub fn reported_here(&self) -> &Reported {
        match &self.keeper {
            Keeper::Here(scene) => scene.reported(),
            _ => &self.nothing,
        }
    }

    /// Takes the last answer to an edit that wanted this.
    pub fn acknowledge(&mut self, report: Report) {
        if !matches!(report, Report::Changes | Report::All) {
            return;
        }
        self.resyncs_anew = true;
        match &mut self.keeper {
            Keeper::Daemon(there) => there.is_acknowledged = true,
            Keeper::Here(scene) => scene.acknowledge(),
            Keeper::Nobody => {}
        }
    }

    pub fn resync(&mut self) {
        // A daemon that is asked may die before it reports pairs.
        self.resyncs_anew = true;
        match &mut self.keeper {
            Keeper::Here(scene) => scene.resync(),
            _ => self.forgets = true,
        }
    }

    /// Waits for the edit that nobody has waited for. The daemon serves a session's requests one after the
    /// other.
    fn settle(&mut self) {
        match self.unread.settle(self.core.settings()) {
            Some(Ok(reply)) => self.daemon_bytes = reply.scene_bytes,
            Some(Err(error)) => self.note_failure(&error),
            None => {}
        }
    }

    /// Checks an edit, and sends it or applies it here. The caller binds what is returned to its borrow of
    /// the scene.
    pub fn begin<'s>(&mut self, edit: Edit<'_>, report: Report) -> Result<Awaited<'s>, Error> {
        self.copy.check(edit)?;
        self.settle();
        self.named_by_table.clear();
        if report == Report::Moved {
            self.named_by_table = self.copy.named_by_table(edit);
        }
        let begun = if self.stays_here() {
            self.edit_here(edit, report).map(|()| Awaited::default())
        } else {
            let sent = self.send(edit, report);
            sent.map(|sent| Awaited::new(sent, Arc::clone(&self.unread))).or_else(|error| {
                self.stay(error)?;
                self.edit_here(edit, report).map(|()| Awaited::default())
            })
        };
        match &begun {
            Err(error) if !error.is_applied() => self.copy.cancel(edit),
            // Perhaps without an answer, as the error says: the copy has it, and the scene's next keeper.
            Ok(_) | Err(_) => self.copy.apply(edit),
        }
        begun
    }

    /// Waits for the answer to the edit that was begun. Where the daemon has none, the scene is sent again,
    /// or answered here.
    pub fn end(&mut self, awaited: Awaited<'_>, edit: Edit<'_>) -> Result<Found, Error> {
        let Some(sent) = awaited.take() else { return Ok(Found::Here) };
        let report = sent.report;
        let error = match self.receive(sent) {
            Ok(found) => return Ok(Found::Daemon(found)),
            Err(error) => error,
        };
        let is_stale = is_stale(&error);
        self.note_failure(&error);
        // The copy has the edit already. What it named is named again, for pairs of moved boxes; what it removed is
        // not there to be removed.
        let named = std::mem::take(&mut self.named_by_table);
        let tags: Vec<Tag> = named.iter().map(|index| self.copy.states().tag(*index)).collect();
        let is_made = |step: &&Step<'_>| matches!(step, Step::Remove(_));
        let mut steps: Vec<Step<'_>> =
            edit.steps.iter().filter(|step| !is_made(step)).copied().collect();
        if !named.is_empty() {
            steps.push(Step::Tag(Tags { indices: (&named).into(), tags: &tags }));
        }
        let again = Edit { steps: &steps };
        if is_stale {
            // A daemon that has restarted, or has forgotten the scene.
            let answered = self.send(again, report).and_then(|sent| self.receive(sent));
            match answered {
                Ok(found) => return Ok(Found::Daemon(found)),
                Err(error) => {
                    self.note_failure(&error);
                    // The copy has the edit: it is not as if nothing had happened.
                    self.stay(error).map_err(Error::unanswered)?;
                }
            }
        } else {
            self.stay(error)?;
        }
        self.edit_here(again, report)?;
        Ok(Found::Here)
    }

    /// Asks the scene as the last edit made it.
    pub fn query(&mut self, asked: &Asked<'_>) -> Result<PairMask, Error> {
        self.settle();
        if self.copy.is_empty() || asked.boxes.is_empty() {
            return Ok(self.core.query_here(&mut new_scene(self.options, &self.core), asked)?);
        }
        if self.stays_here() {
            return self.query_here(asked);
        }
        let mut answered = self.ask(asked);
        if let Err(error) = &answered
            && is_stale(error)
        {
            // A daemon that has restarted, or has forgotten the scene.
            self.note_failure(error);
            answered = self.ask(asked);
        }
        let error = match answered {
            Ok(mask) => return Ok(mask),
            Err(error) => error,
        };
        if let Error::Reply(ReplyError::Status { .. }) = &error {
            // Refused, for this query is too large for instance: the daemon keeps the scene.
            self.stay(error)?;
            return Ok(self.core.query_here(&mut *self.copied()?, asked)?);
        }
        self.note_failure(&error);
        self.stay(error)?;
        self.query_here(asked)
    }

    /// Asks the daemon, which gets the scene first where it does not have it.
    fn ask(&mut self, asked: &Asked<'_>) -> Result<PairMask, Error> {
        let link = self.core.link()?;
        self.load_once(&link)?;
        let Keeper::Daemon(there) = &self.keeper else {
            return Err(Error::DaemonDied);
        };
        let (scene, revision) = (self.id, Some(there.revision));
        let threads = self.options.threads.or(self.core.settings().threads);
        asked.ask(&self.core, &link, (scene, revision), threads, &mut self.query_estimate)
    }

    /// Asks the scene of this process, which is made from the copy if need be.
    fn query_here(&mut self, asked: &Asked<'_>) -> Result<PairMask, Error> {
        let core = Arc::clone(&self.core);
        Ok(core.query_here(self.here()?, asked)?)
    }

    /// Whether a daemon refused the scene a moment ago, and this process answers.
    fn stays_here(&self) -> bool {
        let until = self.stays_until.filter(|_| self.core.may_cull_here());
        until.is_some_and(|until| Instant::now() < until)
    }

    /// Whether this process may answer in place of the daemon; else the error.
    fn stay(&self, error: Error) -> Result<(), Error> {
        match &error {
            Error::TooManyFrames | Error::Edit(_) | Error::Scene(_) => Err(error),
            _ if !self.core.may_cull_here() => Err(error),
            error if error.is_applied() => {
                log::debug!("a scene is answered in process: {error}");
                Ok(())
            }
            error => {
                self.core.say_in_process(error);
                Ok(())
            }
        }
    }

    /// Gives up what a failure after sending says is lost.
    fn note_failure(&mut self, error: &Error) {
        if !error.is_applied() {
            return;
        }
        let keeper = std::mem::replace(&mut self.keeper, Keeper::Nobody);
        let Keeper::Daemon(there) = keeper else { return };
        match (error, Loss::of(error)) {
            (_, Some(how)) => {
                // Its scenes end with it.
                self.sent_to = None;
                let _ = self.core.lose(&there.link, how);
            }
            (Error::Reply(refused), None) if !is_stale(error) => {
                there.link.say_refused(refused);
                self.stays_until = Some(Instant::now() + REFUSED_FOR);
            }
            _ => {}
        }
    }

    /// Sends an edit to the daemon, after the scene where that does not have it.
    fn send(&mut self, edit: Edit<'_>, report: Report) -> Result<SentEdit, Error> {
        let link = self.core.link()?;
        self.load_once(&link)?;
        self.send_to(&link, edit, report)
    }

    /// Sends the whole scene, unless the daemon has it.
    fn load_once(&mut self, link: &Arc<Link>) -> Result<(), Error> {
        let has_scene =
            matches!(&self.keeper, Keeper::Daemon(there) if Arc::ptr_eq(&there.link, link));
        if has_scene { Ok(()) } else { self.load(link) }
    }

    /// Sends the whole scene.
    fn load(&mut self, link: &Arc<Link>) -> Result<(), Error> {
        // Another connection's scenes ended with it.
        self.sent_to = self.sent_to.take().filter(|sent_to| Arc::ptr_eq(sent_to, link));
        let there = There { link: Arc::clone(link), revision: 0, is_acknowledged: false };
        let before = std::mem::replace(&mut self.keeper, Keeper::Daemon(there));
        let loaded = self.send_whole(link);
        if loaded.is_err() {
            // A scene of this process goes on where it was.
            let is_here = matches!(before, Keeper::Here(_));
            self.keeper = if is_here { before } else { Keeper::Nobody };
        }
        loaded
    }

    fn send_whole(&mut self, link: &Arc<Link>) -> Result<(), Error> {
        self.forgets |= self.resyncs_anew;
        // Filters and lists are there without boxes as well.
        if self.copy.is_empty() && !self.copy.states().filters.is_used() {
            return Ok(());
        }
        let sent = {
            // The copy cannot be borrowed while the scene is: it is given back at once.
            let copy = std::mem::replace(&mut self.copy, SceneCopy::new(0));
            let whole = copy.whole();
            let sent = self.send_to(link, Edit { steps: &whole.steps() }, Report::Nothing);
            drop(whole);
            self.copy = copy;
            sent?
        };
        match self.receive(sent) {
            Ok(_) => Ok(()),
            Err(error) => {
                self.note_failure(&error);
                Err(error)
            }
        }
    }

    /// Sends an edit to a daemon that has the scene.
    fn send_to(
        &mut self,
        link: &Arc<Link>,
        edit: Edit<'_>,
        report: Report,
    ) -> Result<SentEdit, Error> {
        let Keeper::Daemon(there) = &mut self.keeper else {
            return Err(Error::DaemonDied);
        };
        self.revisions += 1;
        let request = |[boxes, steps, indices]: [Section; 3]| SceneRequest {
            scene: self.id,
            base: there.revision,
            revision: self.revisions,
            is_acknowledged: there.is_acknowledged,
            is_lost: self.forgets,
            report,
            most_boxes: self.options.most_boxes,
            engine: self.core.settings().engine,
            threads: self.options.threads.or(self.core.settings().threads),
            boxes,
            steps,
            indices,
        };
        match send_edit(&self.core, link, edit, request, RequestHeader::edit_scene) {
            Ok(sent) => {
                // Whether it is received or not: a daemon at another revision says so.
                (there.revision, there.is_acknowledged, self.forgets) =
                    (self.revisions, false, false);
                self.sent_to = Some(Arc::clone(link));
                let expected = self.estimate.expect(sent.asked.box_count.get());
                Ok(SentEdit { expected, ..sent })
            }
            Err(error) => {
                if error.is_applied() {
                    self.forgets |= self.resyncs_anew;
                }
                self.note_failure(&error);
                Err(error)
            }
        }
    }

    /// Waits for the daemon's answer.
    fn receive(&mut self, sent: SentEdit) -> Result<Box<FromDaemon>, Error> {
        let n = sent.asked.box_count.get();
        let (answer, reply) = sent.receive(self.core.settings())?;
        self.estimate.note(Answered {
            n,
            round_trip: answer.sent_at.elapsed(),
            took: Duration::from_nanos(reply.total_ns),
            threads: reply.threads,
        });
        self.daemon_bytes = reply.scene_bytes;
        let (index_end, isa) = (self.copy.index_end() as u32, self.core.settings().isa);
        Ok(Box::new(FromDaemon { answer, reply, index_end, isa }))
    }

    /// Applies an edit in this process, where the scene is made from the copy if need be.
    fn edit_here(&mut self, edit: Edit<'_>, report: Report) -> Result<(), Error> {
        self.here()?.edit(edit, report).map(drop).map_err(Error::from)
    }

    /// The scene of this process, which is made from the copy if need be.
    fn here(&mut self) -> Result<&mut Scene, Error> {
        // What belongs to a connection is freed with it.
        self.sent_to = self.sent_to.take().filter(|link| link.is_alive());
        if !matches!(self.keeper, Keeper::Here(_)) {
            let mut scene = self.copied()?;
            self.forgets = false;
            if self.resyncs_anew {
                scene.resync();
            }
            self.keeper = Keeper::Here(scene);
        }
        match &mut self.keeper {
            Keeper::Here(scene) => Ok(scene),
            _ => Err(Error::DaemonDied),
        }
    }

    /// A scene of this process with the boxes of the copy, which has told nothing.
    fn copied(&self) -> Result<Box<Scene>, Error> {
        let mut scene = Box::new(new_scene(self.options, &self.core));
        let whole = self.copy.whole();
        let edit = Edit { steps: &whole.steps() };
        scene.edit(edit, Report::Nothing)?;
        Ok(scene)
    }
}

impl Drop for RemoteScene {
    fn drop(&mut self) {
        // Also where the daemon refused an edit of it, and this process answers since then.
        let Some(link) = self.sent_to.as_ref().filter(|link| link.is_alive()) else { return };
        let header = RequestHeader::end_scene(link.token(), self.core.next_frame(), self.id);
        self.core.end_scene(link, &header, &self.unread);
    }
}

/// Sends an edit, in the request that its sections of boxes, steps and indices are made part of.
///
/// # Errors
/// [`Error`]. Of one that [is not applied](Error::is_applied), nothing was sent.
pub(super) fn send_edit(
    core: &Core,
    link: &Arc<Link>,
    edit: Edit<'_>,
    request: impl FnOnce([Section; 3]) -> SceneRequest,
    header: fn(u64, u64, &SceneRequest) -> RequestHeader,
) -> Result<SentEdit, Error> {
    let too_large = || Error::TooManyBoxes { n: edit.boxes(), limit: u64::from(u32::MAX) };
    let layout = EditLayout::of(edit).ok_or_else(too_large)?;
    let box_count = BoxCount::of_len(edit.boxes()).ok_or_else(too_large)?;
    let mut shared = core.loan(link, layout.payload_bytes())?;
    if !layout.write(edit, shared.loan.pages_mut()) {
        return Err(too_large());
    }
    let request = request(layout.sections());
    let asked = ReplyFields { client_token: link.token(), frame: core.next_frame(), box_count };
    let header = header(asked.client_token, asked.frame, &request);
    let exchange = Exchange::begin(shared, &header)?;
    Ok(SentEdit { exchange, asked, report: request.report, expected: Expected::default() })
}

/// Whether the daemon says that it has no scene of this revision.
pub(super) const fn is_stale(error: &Error) -> bool {
    let stale = StatusCode::StaleScene;
    matches!(error, Error::Reply(ReplyError::Status { status, .. }) if *status as u32 == stale as u32)
}

/// A scene of this process, with the settings of a session.
pub(super) fn new_scene(options: SceneOptions, core: &Core) -> Scene {
    let settings = core.settings();
    let threads = options.threads.or(settings.threads);
    let options = threads.map_or(options, |threads| options.with_threads(threads));
    Scene::with_engines(
        options,
        CpuEngines::on(settings.isa, Calibration::built_in(settings.isa.get())),
    )
}
