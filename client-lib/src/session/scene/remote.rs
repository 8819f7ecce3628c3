//! A scene that a daemon keeps, and what this process keeps to send it again.
//!
//! The copy here is always right: an edit is checked against it, sent, and applied to it while the daemon
//! works. A daemon that has no scene, or an older one, gets the copy whole. Where no daemon answers, and
//! the backend allows it, a scene of this process is made from the copy. Who begins from the copy
//! does not know which pairs were reported, so that the next changes are all pairs.
//!
//! Of a scene that several processes write, the copy has this member's boxes. A daemon that has lost the membership is
//! joined again, and sent leases and boxes with the next commit. No such scene is answered here.
//!
//! One file, because edits, leases and queries send the same copy again, and fall back in the same way.

use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::dispatch::CpuEngines;
use pairmask_core::filters::FilterData;
use pairmask_core::pacing::{Answered, Estimate, Expected};
use pairmask_core::plan::Calibration;
use pairmask_core::scene::shared::remove_range;
use pairmask_core::scene::{
    Edit, FilterDataSets, Report, Reported, Scene, SceneCopy, SceneOptions, Step,
};
use pairmask_core::units::BoxCount;
use pairmask_wire::{
    EditLayout, LeaseAction, ReplyError, ReplyFields, RequestHeader, SceneId, SceneRequest,
    Section, StatusCode, TickMarks, words_in,
};

use super::lists::FromDaemon;
use super::question::{Asked, Question};
use super::sharing::{Asked as AskedOf, Before, Sharing, refusal};
use crate::session::core::{Core, say_refused};
use crate::session::error::{Error, Loss};
use crate::session::link::{Exchange, Link};
use crate::session::settings::{Backend, Settings};
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
    /// Both before the last edit was sent.
    before: (u64, bool),
}

impl There {
    /// An empty scene.
    fn new(link: &Arc<Link>) -> Self {
        let (link, revision, is_acknowledged) = (Arc::clone(link), 0, false);
        Self { link, revision, is_acknowledged, before: (revision, is_acknowledged) }
    }
}

/// Who answers now.
enum Holder {
    /// Nobody has the scene.
    Nobody,
    Daemon(There),
    Here(Box<Scene>),
}

/// A scene by the copy of this process, answered by a daemon or here.
pub(super) struct RemoteScene {
    core: Arc<Core>,
    /// With a deadline that holds a shared scene's tick as well.
    settings: Settings,
    options: SceneOptions,
    sharing: Option<Box<Sharing>>,
    id: SceneId,
    copy: SceneCopy,
    holder: Holder,
    /// The connection whose daemon was sent the scene, or asked for a membership: it may keep it, although another answers now.
    sent_to: Option<Arc<Link>>,
    /// Whether who begins from the copy reports all pairs as a resync: the client acknowledged an answer, or asked for a
    /// resync.
    resyncs_anew: bool,
    /// Whether the next request asks its daemon for a resync.
    discards: bool,
    revisions: u64,
    estimate: Estimate,
    query_estimate: Estimate,
    daemon_bytes: u64,
    /// Boxes that the edit under way names, where pairs of named boxes are needed.
    named: Vec<u32>,
    /// Of the last edit, how many pairs count as reported after it; of one that goes back to a snapshot.
    reported: Option<u64>,
    /// Until when a daemon that refused the scene is asked nothing.
    stays_until: Option<Instant>,
    /// The edit that the daemon works on and nobody waits for.
    unread: Arc<Unread>,
    /// What a scene reports that is not here.
    nothing: Reported,
}

/// Where the answer to an edit lies.
pub(super) enum Found {
    Daemon(Box<FromDaemon>),
    /// In the scene of this process.
    Here,
}

impl RemoteScene {
    pub fn new(core: &Arc<Core>, options: SceneOptions, sharing: Option<Sharing>) -> Self {
        Self {
            settings: core.settings().clone(),
            options,
            sharing: sharing.map(Box::new),
            id: core.next_scene(),
            copy: SceneCopy::new(options.most_boxes),
            holder: Holder::Nobody,
            sent_to: None,
            resyncs_anew: false,
            discards: false,
            revisions: 0,
            estimate: Estimate::default(),
            query_estimate: Estimate::default(),
            daemon_bytes: 0,
            named: Vec::new(),
            reported: None,
            stays_until: None,
            unread: core.unread_of_scene(),
            nothing: Reported::default(),
            core: Arc::clone(core),
        }
    }

    /// Joins a scene that several processes write.
    pub fn join(core: &Arc<Core>, options: SceneOptions, sharing: Sharing) -> Result<Self, Error> {
        if core.settings().backend == Backend::InProcess {
            return Err(Error::NeedsDaemon);
        }
        let mut scene = Self::new(core, options, Some(sharing));
        scene.present()?;
        scene.copy = SceneCopy::new(scene.options.most_boxes);
        Ok(scene)
    }

    pub const fn copy(&self) -> &SceneCopy {
        &self.copy
    }

    /// Indices are below this.
    pub const fn most_boxes(&self) -> u32 {
        self.options.most_boxes
    }

    /// What there is of a scene that several processes write.
    pub fn sharing(&self) -> Option<&Sharing> {
        self.sharing.as_deref()
    }

    /// Indices that a query may find are below this.
    pub fn index_end(&self) -> u32 {
        // Other members may have a box at any index.
        if self.sharing.is_some() { self.most_boxes() } else { self.copy.index_end() as u32 }
    }

    /// Bytes that this process keeps, and those that the daemon keeps.
    pub fn allocated_bytes(&self) -> (usize, u64) {
        let (here, there) = match &self.holder {
            Holder::Here(scene) => (scene.allocated_bytes(), 0),
            Holder::Daemon(_) if self.sharing.is_none() => (0, self.daemon_bytes),
            _ => (0, 0),
        };
        let others = self.sharing.as_ref().map_or(0, |sharing| sharing.others.allocated_bytes());
        (self.copy.allocated_bytes() + others + here, there)
    }

    /// What the scene of this process has reported.
    pub fn reported_here(&self) -> &Reported {
        match &self.holder {
            Holder::Here(scene) => scene.reported(),
            _ => &self.nothing,
        }
    }

    /// How long an answer is waited for.
    pub const fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The last answer to an edit that asked for this is acknowledged. A member's is so for all reports: moved pairs are
    /// counted from it.
    pub fn acknowledge(&mut self, report: Report) {
        let is_shared = self.sharing.is_some();
        if !is_shared && !matches!(report, Report::Changes | Report::All) {
            return;
        }
        self.resyncs_anew |= !is_shared;
        match &mut self.holder {
            Holder::Daemon(there) => there.is_acknowledged = true,
            Holder::Here(scene) => scene.acknowledge(),
            Holder::Nobody => {}
        }
    }

    pub fn resync(&mut self) {
        // A daemon that is asked may die before it reports pairs.
        self.resyncs_anew |= self.sharing.is_none();
        self.reported = None;
        match &mut self.holder {
            Holder::Here(scene) => scene.resync(),
            _ => self.discards = true,
        }
    }

    /// Waits for the edit that nobody has waited for. The daemon serves a session's requests one after the
    /// other. Whether it was refused, and taken back here.
    pub fn settle(&mut self) -> bool {
        match self.unread.settle(&self.settings) {
            Some(Ok(reply)) => self.daemon_bytes = reply.scene_bytes,
            // Nobody waited for this edit, and its refusal is not reported.
            Some(Err(error)) => drop(self.refused(error)),
            None => {}
        }
        let Some(sharing) = &mut self.sharing else { return false };
        sharing.before = None;
        self.was_undone()
    }

    /// Whether a commit was refused, and taken back here, since this was last asked.
    pub fn was_undone(&mut self) -> bool {
        self.sharing.as_mut().is_some_and(|sharing| std::mem::take(&mut sharing.was_undone))
    }

    /// Takes a lease, or gives one back. What was given back is not sent again: the indices are no longer this member's.
    pub fn lease(&mut self, action: LeaseAction) -> Result<Range<u32>, Error> {
        if self.sharing.is_none() {
            return Err(Error::NotShared);
        }
        let link = self.present()?;
        let range = self.ask_lease(&link, action)?;
        let leases = self.sharing.as_mut().map(|sharing| &mut sharing.leases);
        let leases = leases.ok_or(Error::NotShared)?;
        if let LeaseAction::GiveBack { first } = action {
            leases.retain(|lease| lease.start != first);
            remove_range(&mut self.copy, range.clone())?;
        } else {
            leases.push(range.clone());
        }
        Ok(range)
    }

    fn ask_lease(&mut self, link: &Arc<Link>, action: LeaseAction) -> Result<Range<u32>, Error> {
        let Self { core, settings, id, .. } = &*self;
        let leased = AskedOf { core, link, settings, scene: *id }.lease(action);
        leased.map_err(|error| self.refused(error))
    }

    /// Checks an edit, and sends it or applies it here, once the last one is [settled](Self::settle). The caller binds
    /// what is returned to its borrow of the scene. Where it is said how many pairs there are afterwards, these count as
    /// reported.
    pub fn begin(
        &mut self,
        edit: Edit<'_>,
        report: Report,
        reported: Option<u64>,
    ) -> Result<Awaited, Error> {
        if let Some(sharing) = &self.sharing {
            sharing.allow(edit)?;
        }
        self.copy.check(edit)?;
        self.reported = reported;
        self.named.clear();
        if report == Report::Moved && self.sharing.is_none() {
            let named = &mut self.named;
            self.copy.for_each_named(edit, |index| named.push(index));
        }
        let begun = if self.sharing.is_some() {
            self.commit(edit, report)
        } else {
            self.start(edit, report)
        };
        Ok(begun?
            .map_or_else(Awaited::default, |sent| Awaited::new(sent, Arc::clone(&self.unread))))
    }

    /// Sends an edit that was checked, or applies it here: `None`.
    fn start(&mut self, edit: Edit<'_>, report: Report) -> Result<Option<SentEdit>, Error> {
        let here = |scene: &mut Self| scene.edit_here(edit, report).map(|()| None);
        let begun = if self.stays_here() {
            here(self)
        } else {
            self.send(edit, report).map(Some).or_else(|error| {
                self.stay(error)?;
                here(self)
            })
        };
        match &begun {
            Err(error) if !error.is_applied() => {
                self.copy.cancel(edit);
                self.reported = None;
            }
            // Perhaps without an answer, as the error says: the copy has it, and the scene's next holder.
            Ok(_) | Err(_) => self.copy.apply(edit),
        }
        begun
    }

    /// Sends an edit that was checked as a commit of this member. One that begins from the copy is the whole copy.
    fn commit(&mut self, edit: Edit<'_>, report: Report) -> Result<Option<SentEdit>, Error> {
        if let Err(error) = self.present() {
            self.apply_commit(edit);
            return Err(error.unanswered());
        }
        if let Some(sharing) = self.sharing.as_mut().filter(|_| edit.has_table()) {
            let mut copy = self.copy.clone();
            copy.cancel(edit);
            let (gave_filters, discards) = (sharing.gave_filters, self.discards);
            sharing.before = Some(Box::new(Before { copy, gave_filters, discards }));
        }
        if matches!(&self.holder, Holder::Daemon(there) if there.revision == 0) {
            self.apply_commit(edit);
            return self.send_whole(report).map(Some).map_err(Error::unanswered);
        }
        let sent = self.send_to(edit, report);
        if matches!(&sent, Err(error) if !error.is_applied()) {
            // The daemon has received nothing, and has all that came before.
            self.copy.cancel(edit);
        } else {
            self.apply_commit(edit);
        }
        sent.map(Some)
    }

    fn apply_commit(&mut self, edit: Edit<'_>) {
        if let Some(sharing) = &mut self.sharing {
            sharing.gave_filters |= edit.has_table();
        }
        self.copy.apply(edit);
    }

    /// Waits for the answer to the edit that was begun. Where the daemon has none, the scene is sent again,
    /// or answered here.
    pub fn end(&mut self, awaited: Awaited) -> Result<Found, Error> {
        let Some(sent) = awaited.take() else { return Ok(Found::Here) };
        let report = sent.report;
        let error = match self.receive(sent) {
            Ok(found) => return Ok(found),
            Err(error) => error,
        };
        // A daemon that has restarted, or has dropped the scene.
        let is_stale = is_stale(&error);
        if self.sharing.is_some() {
            if !is_stale {
                return Err(error);
            }
            self.present()?;
            let sent = self.send_whole(report)?;
            return self.receive(sent);
        }
        // The copy has the edit already. What it named is named again, for pairs of moved boxes.
        let (mut named, states) = (std::mem::take(&mut self.named), self.copy.states());
        named.sort_unstable();
        named.dedup();
        named.retain(|index| self.copy.get(*index).is_some());
        let filter_data: Vec<FilterData> =
            named.iter().map(|index| states.filter_data(*index)).collect();
        let step = Step::FilterData(FilterDataSets {
            indices: (&named).into(),
            filter_data: &filter_data,
        });
        let again = Edit { steps: if named.is_empty() { &[] } else { &[step] } };
        if is_stale {
            match self.send(again, report).and_then(|sent| self.receive(sent)) {
                Ok(found) => return Ok(found),
                // The copy has the edit: it is not as if nothing had happened.
                Err(error) => self.stay(error).map_err(Error::unanswered)?,
            }
        } else {
            self.stay(error)?;
        }
        self.edit_here(again, report)?;
        Ok(Found::Here)
    }

    /// Asks the scene as the last edit made it; a shared one as the last tick did. A commit that nobody has waited for
    /// may be part of the next tick: it is not waited for here.
    pub fn ask<Q: Question>(&mut self, question: &Q) -> Result<Q::Answer, Error> {
        let is_shared = self.sharing.is_some();
        if !is_shared {
            self.settle();
            if self.copy.is_empty() || question.is_empty() {
                return question.ask_here(&self.core, &mut new_scene(self.options, &self.core));
            }
            if self.stays_here() {
                return self.ask_here(question);
            }
        }
        let mut answered = self.ask_daemon(question);
        if let Err(error) = &answered
            && is_stale(error)
        {
            self.note_failure(error);
            answered = self.ask_daemon(question);
        }
        let error = match answered {
            Ok(mask) => return Ok(mask),
            Err(error) => error,
        };
        // Refused, for this query is too large for instance: the daemon keeps the scene.
        let is_refused = matches!(&error, Error::Reply(ReplyError::Status { .. }));
        if !is_refused && (!is_shared || Loss::of(&error).is_some()) {
            self.note_failure(&error);
        }
        self.stay(error)?;
        if is_refused {
            let mut copied = self.copied()?;
            return question.ask_here(&self.core, &mut copied);
        }
        self.ask_here(question)
    }

    /// The observer knows of all up to a tick.
    pub fn note_observed(&mut self, tick: u64) {
        if let Some(sharing) = &mut self.sharing {
            sharing.observed = tick;
        }
    }

    /// Asks the daemon, which gets the scene first where it does not have it.
    fn ask_daemon<Q: Question>(&mut self, question: &Q) -> Result<Q::Answer, Error> {
        let link = self.present()?;
        let Holder::Daemon(there) = &self.holder else {
            return Err(Error::DaemonDied);
        };
        let revision = self.sharing.is_none().then_some(there.revision);
        let asked = Asked {
            core: &self.core,
            link: &link,
            scene: self.id,
            revision,
            threads: self.options.threads,
            index_end: self.index_end(),
            observed: self.sharing.as_ref().map_or(0, |sharing| sharing.observed),
        };
        question.ask(asked, &mut self.query_estimate)
    }

    /// Asks the scene of this process, which is made from the copy if need be.
    fn ask_here<Q: Question>(&mut self, question: &Q) -> Result<Q::Answer, Error> {
        let core = Arc::clone(&self.core);
        question.ask_here(&core, self.here()?)
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
            _ if self.sharing.is_some() || !self.core.may_cull_here() => Err(error),
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

    /// Gives up what a failure after sending says is lost, and says what a member was refused. A table of filters that
    /// was refused is taken back.
    fn refused(&mut self, error: Error) -> Error {
        if let (Some(sharing), Error::Reply(ReplyError::Status { status, .. })) =
            (&mut self.sharing, &error)
        {
            match (status, sharing.before.take(), &mut self.holder) {
                (StatusCode::NotLeased, Some(before), holder) => {
                    (self.copy, sharing.gave_filters) = (before.copy, before.gave_filters);
                    self.discards |= before.discards;
                    sharing.was_undone = true;
                    if let Holder::Daemon(there) = holder {
                        (there.revision, there.is_acknowledged) = there.before;
                    }
                }
                (StatusCode::StaleScene | StatusCode::NotLeased, _, holder) => {
                    *holder = Holder::Nobody;
                }
                _ => {}
            }
            if let Some(typed) = refusal(&error, self.options.most_boxes) {
                return typed;
            }
        }
        self.note_failure(&error);
        error
    }

    /// Gives up what a failure after sending says is lost.
    fn note_failure(&mut self, error: &Error) {
        let link = match &self.holder {
            _ if !error.is_applied() => return,
            Holder::Here(_) => return,
            Holder::Daemon(there) => Some(Arc::clone(&there.link)),
            Holder::Nobody => self.sent_to.clone(),
        };
        self.holder = Holder::Nobody;
        let Some(link) = link else { return };
        match (error, Loss::of(error)) {
            (_, Some(how)) => {
                // Its scenes end with it. A membership may not, where its answer alone was lost.
                self.sent_to = self.sent_to.take().filter(|_| self.sharing.is_some());
                let _ = self.core.lose(&link, how);
            }
            (Error::Reply(refused), None) if !is_stale(error) && self.sharing.is_none() => {
                say_refused(&link, refused);
                self.stays_until = Some(Instant::now() + REFUSED_FOR);
            }
            _ => {}
        }
    }

    /// Sends an edit to the daemon, after the scene where that does not have it.
    fn send(&mut self, edit: Edit<'_>, report: Report) -> Result<SentEdit, Error> {
        self.present()?;
        self.send_to(edit, report)
    }

    /// The connection to a daemon that has the scene: it is sent whole, or joined, where it is not there.
    fn present(&mut self) -> Result<Arc<Link>, Error> {
        let link = self.core.link()?;
        match &self.holder {
            Holder::Daemon(there) if Arc::ptr_eq(&there.link, &link) => {}
            _ if self.sharing.is_some() => self.join_again(&link)?,
            _ => self.load(&link)?,
        }
        Ok(link)
    }

    /// Joins, and leases what this member had. Its boxes are sent with the next commit.
    fn join_again(&mut self, link: &Arc<Link>) -> Result<(), Error> {
        (self.holder, self.sent_to) = (Holder::Nobody, Some(Arc::clone(link)));
        let Self { core, settings, id, sharing, .. } = &mut *self;
        let Some(sharing) = sharing else { return Err(Error::NotShared) };
        sharing.others.clear();
        let joined = sharing.join(&AskedOf { core, link, settings, scene: *id });
        let leases = sharing.leases.clone();
        let terms = joined.map_err(|error| self.refused(error))?;
        self.options.most_boxes = terms.most_boxes;
        self.settings.deadline = self.core.settings().deadline + terms.deadline;
        for range in leases {
            let (first, count) = (range.start, range.end - range.start);
            self.ask_lease(link, LeaseAction::Take { first, count })?;
        }
        self.holder = Holder::Daemon(There::new(link));
        Ok(())
    }

    /// Sends the whole scene, and waits for it to be there.
    fn load(&mut self, link: &Arc<Link>) -> Result<(), Error> {
        // Another connection's scenes ended with it.
        self.sent_to = self.sent_to.take().filter(|sent_to| Arc::ptr_eq(sent_to, link));
        let before = std::mem::replace(&mut self.holder, Holder::Daemon(There::new(link)));
        self.discards |= self.resyncs_anew;
        // Filters and lists are there without boxes as well.
        if self.copy.is_empty() && !self.copy.states().filters.is_used() {
            return Ok(());
        }
        // The edit that is sent next may say what counts as reported; the scene before it does not.
        let reported = self.reported.take();
        let loaded = self.send_whole(Report::Nothing).and_then(|sent| self.receive(sent));
        self.reported = reported;
        if loaded.is_err() {
            // A scene of this process goes on where it was.
            let is_here = matches!(before, Holder::Here(_));
            self.holder = if is_here { before } else { Holder::Nobody };
        }
        loaded.map(drop)
    }

    /// Sends all boxes of the copy as one edit.
    fn send_whole(&mut self, report: Report) -> Result<SentEdit, Error> {
        // The copy cannot be borrowed while the scene is: it is given back at once.
        let copy = std::mem::replace(&mut self.copy, SceneCopy::new(0));
        let sent = {
            let whole = copy.whole();
            let mut steps = whole.steps();
            if self.sharing.as_ref().is_some_and(|sharing| !sharing.gave_filters) {
                steps.retain(|step| !matches!(step, Step::Filters(_)));
            }
            self.send_to(Edit { steps: &steps }, report)
        };
        self.copy = copy;
        sent
    }

    /// Sends an edit to a daemon that has the scene.
    fn send_to(&mut self, edit: Edit<'_>, report: Report) -> Result<SentEdit, Error> {
        let Holder::Daemon(there) = &mut self.holder else {
            return Err(Error::DaemonDied);
        };
        self.revisions += 1;
        let is_shared = self.sharing.is_some();
        let request = |[boxes, steps, indices]: [Section; 3]| SceneRequest {
            scene: self.id,
            base: there.revision,
            revision: self.revisions,
            is_acknowledged: there.is_acknowledged,
            is_lost: self.discards,
            reported: self.reported,
            report,
            most_boxes: self.options.most_boxes,
            engine: self.settings.engine,
            threads: self.options.threads,
            boxes,
            steps,
            indices,
        };
        let header =
            if is_shared { RequestHeader::commit_shared } else { RequestHeader::edit_scene };
        match send_edit(&self.core, &there.link, edit, request, header) {
            Ok(mut sent) => {
                there.before = (there.revision, there.is_acknowledged);
                // Whether it is received or not: a daemon at another revision says so.
                (there.revision, there.is_acknowledged, self.discards) =
                    (self.revisions, false, false);
                self.sent_to = Some(Arc::clone(&there.link));
                if !is_shared {
                    // Of a shared scene, others decide when the tick ends: there is nothing to nap by.
                    sent.expected = self.estimate.expect(sent.asked.box_count.get());
                }
                Ok(sent)
            }
            Err(error) => {
                if error.is_applied() {
                    self.discards |= self.resyncs_anew;
                }
                self.note_failure(&error);
                Err(error)
            }
        }
    }

    /// Waits for the daemon's answer.
    fn receive(&mut self, sent: SentEdit) -> Result<Found, Error> {
        let n = sent.asked.box_count.get();
        let received = sent.receive(&self.settings);
        let (answer, reply) = received.map_err(|error| self.refused(error))?;
        let mut tick = None;
        if let Some(sharing) = &mut self.sharing {
            sharing.before = None;
            let marks = TickMarks::parse(&answer.header, size_of_val(answer.memory.pages()) as u64);
            if let Ok(marks) = &marks {
                let words = words_in(answer.memory.pages());
                sharing.others.learn(marks.user_data_in(words), self.options.most_boxes);
            }
            tick = Some(marks.map_err(|error| self.refused(error.into()))?);
        } else {
            self.estimate.note(Answered {
                n,
                round_trip: answer.round_trip,
                took: Duration::from_nanos(reply.total_ns),
                threads: reply.threads,
            });
        }
        self.daemon_bytes = reply.scene_bytes;
        let (index_end, isa) = (self.index_end(), self.settings.isa);
        Ok(Found::Daemon(Box::new(FromDaemon { answer, reply, tick, index_end, isa })))
    }

    /// Applies an edit in this process, where the scene is made from the copy if need be.
    fn edit_here(&mut self, edit: Edit<'_>, report: Report) -> Result<(), Error> {
        let reported = self.reported;
        edit_here(self.here()?, edit, report, reported)
    }

    /// The scene of this process, which is made from the copy if need be.
    fn here(&mut self) -> Result<&mut Scene, Error> {
        // What belongs to a connection is freed with it.
        self.sent_to = self.sent_to.take().filter(|link| link.is_alive());
        if !matches!(self.holder, Holder::Here(_)) {
            let mut scene = self.copied()?;
            self.discards = false;
            if self.resyncs_anew {
                scene.resync();
            }
            self.holder = Holder::Here(scene);
        }
        match &mut self.holder {
            Holder::Here(scene) => Ok(scene),
            _ => Err(Error::DaemonDied),
        }
    }

    /// A scene of this process with the boxes of the copy, which has reported nothing.
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
        let end = if self.sharing.is_some() {
            RequestHeader::leave_shared
        } else {
            RequestHeader::end_scene
        };
        let header = end(link.token(), self.core.next_frame(), self.id);
        self.core.end_scene(link, &header, &self.unread);
    }
}

/// Sends an edit, in the request that its sections of boxes, steps and indices are made part of.
///
/// # Errors
/// [`Error`]. Of one that [is not applied](Error::is_applied), nothing was sent.
fn send_edit(
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

/// Applies an edit to a scene of this process. Where it is said how many pairs there are afterwards, these count as reported.
pub(super) fn edit_here(
    scene: &mut Scene,
    edit: Edit<'_>,
    report: Report,
    reported: Option<u64>,
) -> Result<(), Error> {
    scene.edit(edit, report)?;
    if let Some(pair_count) = reported {
        scene.mark_reported(pair_count);
    }
    Ok(())
}

/// Whether the daemon says that it has no scene of this revision.
const fn is_stale(error: &Error) -> bool {
    let stale = StatusCode::StaleScene;
    matches!(error, Error::Reply(ReplyError::Status { status, .. }) if *status as u32 == stale as u32)
}

/// A scene of this process, with the settings of a session.
pub(super) fn new_scene(options: SceneOptions, core: &Core) -> Scene {
    let isa = core.settings().isa;
    Scene::with_engines(options, CpuEngines::on(isa, Calibration::built_in(isa.get())))
}
