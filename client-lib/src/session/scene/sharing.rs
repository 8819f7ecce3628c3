//! A scene that several processes write: leases, commits and ticks.
//!
//! This process keeps its own boxes. Where the daemon was restarted, or has lost the membership, it joins,
//! leases and sends them again with the next commit, whose answer is a resync then. One file, because a lease, a commit
//! and its answer change the same few fields.

use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;

use pairmask_core::scene::shared::{LeaseError, Ranges, Remains};
use pairmask_core::scene::{Edit, EditError, Report, Reported, SceneCopy, Step};
use pairmask_core::units::BoxCount;
use pairmask_wire::{
    AgreedTerms, JoinRequest, LeaseAction, LeaseRequest, Page, ReplyError, ReplyFields,
    RequestHeader, SceneId, SceneName, SceneRequest, Section, SharedTerms, StatusCode, TermsDiffer,
    TickMarks, lease_error, not_leased, parse_joined, parse_leased,
};

use super::answer::FromDaemon;
use super::remote::{is_stale, send_edit};
use super::{Kept, Scene, SceneOptions};
use crate::session::core::Core;
use crate::session::error::{Error, Loss};
use crate::session::estimate::Estimate;
use crate::session::exchange::{Answer, Exchange};
use crate::session::link::Link;
use crate::session::local::Asked;
use crate::session::pairs::PairMask;
use crate::session::settings::{Backend, Settings};
use crate::session::unread::{Awaited, SentEdit, Unread};

/// Scenes that several processes write: those with the option [`shared`](SceneOptions::shared).
impl Scene {
    fn member(&mut self) -> Result<&mut Member, Error> {
        self.settle();
        match &mut self.kept {
            Kept::Shared(member) => Ok(member),
            _ => Err(Error::NotShared),
        }
    }

    /// Leases a range of indices of a shared scene: this member alone may set boxes there.
    ///
    /// # Errors
    /// [`Error::Lease`], among others. The indices of a writer that has died are free within about a
    /// second.
    pub fn lease(&mut self, range: Range<u32>) -> Result<(), Error> {
        let member = self.member()?;
        let count = range.end.checked_sub(range.start).filter(|count| *count > 0);
        let count = count.ok_or(LeaseError::Empty)?;
        member.lease_by(LeaseAction::Take { first: range.start, count }).map(drop)
    }

    /// Leases the lowest free range of so many indices. Which one that is depends on who came first.
    ///
    /// # Errors
    /// As [`lease`](Self::lease).
    pub fn lease_any(&mut self, count: u32) -> Result<Range<u32>, Error> {
        self.member()?.lease_by(LeaseAction::TakeAny { count })
    }

    /// Gives back the lease that begins at an index. Its boxes are removed, and pairs of the include and the
    /// exclude list that name one of its indices.
    ///
    /// # Errors
    /// [`Error`].
    pub fn give_back(&mut self, first: u32) -> Result<(), Error> {
        let given_back = self.member()?.give_back(first)?;
        if let Some(margins) = &mut self.margins {
            margins.remove(given_back)?;
        }
        Ok(())
    }

    /// The ranges of a shared scene that this member has leased.
    pub fn leases(&self) -> &[Range<u32>] {
        match &self.kept {
            Kept::Shared(member) => &member.leases,
            _ => &[],
        }
    }

    /// How long a tick of a shared scene is open after its first commit, at the most; `None` of another scene.
    pub const fn tick_deadline(&self) -> Option<Duration> {
        match &self.kept {
            Kept::Shared(member) => Some(member.terms.deadline),
            _ => None,
        }
    }
}

/// The membership as the daemon has it.
struct There {
    link: Arc<Link>,
    revision: u64,
    is_acknowledged: bool,
    /// Both before the last commit was sent.
    before: (u64, bool),
}

/// What this member had before a commit that the daemon may refuse: only that knows whose lease begins lowest, who
/// alone gives the table of filters.
struct Before {
    copy: SceneCopy,
    gave_filters: bool,
    forgets: bool,
}

/// What a process has of a scene that several write: its own boxes, and its membership.
pub(in crate::session) struct Member {
    core: Arc<Core>,
    /// With a deadline that holds the tick's as well.
    settings: Settings,
    name: SceneName,
    options: SceneOptions,
    terms: AgreedTerms,
    id: SceneId,
    leases: Vec<Range<u32>>,
    copy: SceneCopy,
    /// Whether this member has given the table of filters.
    gave_filters: bool,
    there: Option<There>,
    /// The connection over which a membership was last asked for.
    asked_of: Option<Arc<Link>>,
    revisions: u64,
    query_estimate: Estimate,
    /// Whether the next request asks for a resync.
    forgets: bool,
    /// An answer without pairs, for a member that has none yet.
    nothing: Reported,
    /// Until the commit of a table of filters is answered.
    before: Option<Box<Before>>,
    /// Whether the last such commit was refused, and taken back here.
    was_undone: bool,
    /// The commit that the daemon works on and nobody waits for.
    unread: Arc<Unread>,
}

impl Member {
    pub fn join(core: &Arc<Core>, name: SceneName, options: SceneOptions) -> Result<Self, Error> {
        if core.settings().backend == Backend::InProcess {
            return Err(Error::NeedsDaemon);
        }
        let nothing = AgreedTerms {
            most_boxes: 0,
            deadline: Duration::ZERO,
            at_end: options.at_end.unwrap_or_default(),
        };
        let mut scene = Self {
            settings: core.settings().clone(),
            name,
            options,
            terms: nothing,
            id: core.next_scene(),
            leases: Vec::new(),
            copy: SceneCopy::new(0),
            gave_filters: false,
            there: None,
            asked_of: None,
            revisions: 0,
            query_estimate: Estimate::default(),
            forgets: false,
            nothing: Reported::default(),
            before: None,
            was_undone: false,
            unread: core.unread_of_scene(),
            core: Arc::clone(core),
        };
        scene.join_again()?;
        scene.copy = SceneCopy::new(scene.terms.most_boxes);
        Ok(scene)
    }

    pub const fn most_boxes(&self) -> u32 {
        self.terms.most_boxes
    }

    /// The boxes of this member.
    pub const fn copy(&self) -> &SceneCopy {
        &self.copy
    }

    fn lease_by(&mut self, action: LeaseAction) -> Result<Range<u32>, Error> {
        let link = self.present()?;
        let range = self.ask_lease(&link, action)?;
        self.leases.push(range.clone());
        Ok(range)
    }

    fn give_back(&mut self, first: u32) -> Result<Range<u32>, Error> {
        let link = self.present()?;
        let range = self.ask_lease(&link, LeaseAction::GiveBack { first })?;
        self.leases.retain(|lease| lease.start != first);
        // Nothing of it may be sent again: the indices are no longer this member's.
        remove(&mut self.copy, range.clone())?;
        Ok(range)
    }

    /// The last answer is acknowledged, whatever it reported: moved pairs are counted from it.
    pub const fn acknowledge(&mut self) {
        if let Some(there) = &mut self.there {
            there.is_acknowledged = true;
        }
    }

    pub const fn resync(&mut self) {
        self.forgets = true;
    }

    /// What a scene tells that is not here.
    pub const fn reported_here(&self) -> &Reported {
        &self.nothing
    }

    /// The connection, with a membership.
    fn present(&mut self) -> Result<Arc<Link>, Error> {
        let link = self.core.link()?;
        match &self.there {
            Some(there) if Arc::ptr_eq(&there.link, &link) => Ok(link),
            _ => {
                self.join_again()?;
                Ok(link)
            }
        }
    }

    /// Joins, and leases what this member had. Its boxes are sent with the next commit.
    fn join_again(&mut self) -> Result<(), Error> {
        self.there = None;
        let link = self.core.link()?;
        let SceneOptions { most_boxes, tick_deadline, at_end, scope, .. } = self.options;
        let request = JoinRequest {
            scene: self.id,
            name: self.name.section(),
            terms: SharedTerms { most_boxes, deadline: tick_deadline, at_end },
            scope,
            engine: self.core.settings().engine,
        };
        let name = self.name.clone();
        self.asked_of = Some(Arc::clone(&link));
        let (answer, asked) = self.ask(
            &link,
            name.as_str().len() as u64,
            |token, frame| RequestHeader::join_shared(token, frame, &request),
            |pages| name.write(pages),
        )?;
        let terms = parse_joined(&answer.header, &asked).map_err(|e| self.refused(&link, e))?;
        drop(answer);
        self.terms = terms;
        // Every later join asks for what held.
        (self.options.most_boxes, self.options.tick_deadline, self.options.at_end) =
            (Some(terms.most_boxes), Some(terms.deadline), Some(terms.at_end));
        self.settings.deadline = self.core.settings().deadline + terms.deadline;
        for range in self.leases.clone() {
            let (first, count) = (range.start, range.end - range.start);
            self.ask_lease(&link, LeaseAction::Take { first, count })?;
        }
        self.there = Some(There { link, revision: 0, is_acknowledged: false, before: (0, false) });
        Ok(())
    }

    fn ask_lease(&mut self, link: &Arc<Link>, action: LeaseAction) -> Result<Range<u32>, Error> {
        let request = LeaseRequest { scene: self.id, action };
        let (answer, asked) = self.ask(
            link,
            0,
            |token, frame| RequestHeader::lease_shared(token, frame, &request),
            |_| true,
        )?;
        let range = parse_leased(&answer.header, &asked).and_then(|range| {
            let is_right = match action {
                LeaseAction::Take { first, count } => {
                    (range.start, range.len()) == (first, count as usize)
                }
                LeaseAction::TakeAny { count } => range.len() == count as usize,
                LeaseAction::GiveBack { first } => range.start == first,
            };
            if is_right { Ok(range) } else { Err(ReplyError::Malformed { field: "lease" }) }
        });
        range.map_err(|error| self.refused(link, error))
    }

    /// Sends a small request, and waits for its answer.
    fn ask(
        &mut self,
        link: &Arc<Link>,
        bytes: u64,
        header: impl FnOnce(u64, u64) -> RequestHeader,
        write: impl FnOnce(&mut [Page]) -> bool,
    ) -> Result<(Answer, ReplyFields), Error> {
        let mut shared = self.core.loan(link, bytes)?;
        if !write(shared.loan.pages_mut()) {
            return Err(Error::TooManyFrames);
        }
        let asked = ReplyFields {
            client_token: link.token(),
            frame: self.core.next_frame(),
            box_count: BoxCount::default(),
        };
        let header = header(asked.client_token, asked.frame);
        let answered = Exchange::begin(shared, &header)
            .map_err(Error::from)
            .and_then(|exchange| exchange.end(link.expect(0), &self.settings));
        match answered {
            Ok(answer) => Ok((answer, asked)),
            Err(error) => {
                self.lost(link, &error);
                Err(error)
            }
        }
    }

    /// What the daemon refused, by its status.
    fn refused(&mut self, link: &Arc<Link>, error: ReplyError) -> Error {
        if let ReplyError::Status { status, detail } = &error {
            let (status, detail) = (*status, *detail);
            let typed = match status {
                StatusCode::SharedDiffers => TermsDiffer::of_detail(detail).map(Into::into),
                StatusCode::LeaseRefused => {
                    lease_error(detail, self.terms.most_boxes).map(Error::Lease)
                }
                StatusCode::NotLeased => not_leased(detail).map(Error::NotLeased),
                _ => None,
            };
            match (status, self.before.take()) {
                (StatusCode::NotLeased, Some(before)) => self.undo(*before),
                (StatusCode::StaleScene | StatusCode::NotLeased, _) => self.there = None,
                _ => {}
            }
            if let Some(typed) = typed {
                return typed;
            }
        }
        let error = Error::from(error);
        self.lost(link, &error);
        error
    }

    /// The daemon has refused a commit, and applied nothing of it: neither has this member.
    fn undo(&mut self, before: Before) {
        (self.copy, self.gave_filters) = (before.copy, before.gave_filters);
        self.was_undone = true;
        self.forgets |= before.forgets;
        if let Some(there) = &mut self.there {
            (there.revision, there.is_acknowledged) = there.before;
        }
    }

    /// Notes what a failure says is lost.
    fn lost(&mut self, link: &Arc<Link>, error: &Error) {
        self.there = None;
        if let Some(how) = Loss::of(error) {
            let _ = self.core.lose(link, how);
        }
    }

    /// Whether a commit was refused, and taken back here, since this was last asked.
    pub const fn was_undone(&mut self) -> bool {
        std::mem::replace(&mut self.was_undone, false)
    }

    /// Receives the answer to a commit that nobody waited for.
    pub fn settle(&mut self) {
        match self.unread.settle(&self.settings) {
            Some(Err(Error::Reply(error))) => {
                if let Some(link) = self.there.as_ref().map(|there| Arc::clone(&there.link)) {
                    // Nobody waited for this commit, and nobody is told of its refusal.
                    let _ = self.refused(&link, error);
                }
            }
            Some(Err(_)) => self.there = None,
            Some(Ok(_)) | None => {}
        }
        self.before = None;
    }

    /// Asks the scene as the last tick made it. A commit that nobody has waited for may be part of the next one: it is
    /// not waited for here.
    pub fn query(&mut self, asked: &Asked<'_>) -> Result<PairMask, Error> {
        let mut answered = self.ask_query(asked);
        if answered.as_ref().is_err_and(is_stale) {
            self.there = None;
            answered = self.ask_query(asked);
        }
        answered
    }

    fn ask_query(&mut self, asked: &Asked<'_>) -> Result<PairMask, Error> {
        let link = self.present()?;
        let (scene, threads) = ((self.id, None), self.core.settings().threads);
        let answered = asked.ask(&self.core, &link, scene, threads, &mut self.query_estimate);
        if let Some(error) = answered.as_ref().err().filter(|error| Loss::of(error).is_some()) {
            self.lost(&link, error);
        }
        answered
    }

    /// Checks an edit, and sends it, once the last commit is [settled](Self::settle).
    pub fn begin<'s>(&mut self, edit: Edit<'_>, report: Report) -> Result<Awaited<'s>, Error> {
        let own: Ranges = self.leases.iter().cloned().collect();
        // Whether this is the first writer, the daemon knows.
        own.allow(edit, true)?;
        self.copy.check(edit)?;
        let was_there = self.there.is_some();
        let link = match self.present() {
            Ok(link) => link,
            Err(error) => {
                self.apply(edit);
                return Err(error.unanswered());
            }
        };
        let is_new = self.there.as_ref().is_some_and(|there| there.revision == 0);
        if edit.has_table() {
            let mut copy = self.copy.clone();
            copy.cancel(edit);
            let Self { gave_filters, forgets, .. } = *self;
            self.before = Some(Box::new(Before { copy, gave_filters, forgets }));
        }
        let sent = if was_there && !is_new {
            match self.send(&link, edit, report) {
                Err(error) if !error.is_applied() => {
                    // The daemon has heard nothing, and has all that came before.
                    self.copy.cancel(edit);
                    return Err(error);
                }
                sent => {
                    self.apply(edit);
                    sent
                }
            }
        } else {
            self.apply(edit);
            self.send_whole(&link, report).map_err(Error::unanswered)
        };
        let sent = sent?;
        Ok(Awaited::new(sent, Arc::clone(&self.unread)))
    }

    /// Makes an edit that was checked part of what this member has.
    fn apply(&mut self, edit: Edit<'_>) {
        self.gave_filters |= edit.has_table();
        self.copy.apply(edit);
    }

    /// Sends all boxes of this member as one commit.
    fn send_whole(&mut self, link: &Arc<Link>, report: Report) -> Result<SentEdit, Error> {
        // The copy cannot be borrowed while the scene is: it is given back at once.
        let copy = std::mem::replace(&mut self.copy, SceneCopy::new(0));
        let sent = {
            let whole = copy.whole();
            let mut steps = whole.steps();
            steps.retain(|step| self.gave_filters || !matches!(step, Step::Filters(_)));
            self.send(link, Edit { steps: &steps }, report)
        };
        self.copy = copy;
        sent
    }

    fn send(
        &mut self,
        link: &Arc<Link>,
        edit: Edit<'_>,
        report: Report,
    ) -> Result<SentEdit, Error> {
        let Some(there) = &mut self.there else { return Err(Error::DaemonDied) };
        self.revisions += 1;
        let request = |[boxes, steps, indices]: [Section; 3]| SceneRequest {
            scene: self.id,
            base: there.revision,
            revision: self.revisions,
            is_acknowledged: there.is_acknowledged,
            is_lost: self.forgets,
            report,
            most_boxes: self.terms.most_boxes,
            engine: self.core.settings().engine,
            threads: self.core.settings().threads,
            boxes,
            steps,
            indices,
        };
        // Others decide when the tick ends: there is nothing to nap by.
        match send_edit(&self.core, link, edit, request, RequestHeader::commit_shared) {
            Ok(sent) => {
                there.before = (there.revision, there.is_acknowledged);
                (there.revision, there.is_acknowledged) = (self.revisions, false);
                self.forgets = false;
                Ok(sent)
            }
            Err(error) => {
                if error.is_applied() {
                    self.lost(link, &error);
                }
                Err(error)
            }
        }
    }

    /// Waits for the answer to a commit. A daemon that has lost the membership is joined again, and sent all
    /// boxes.
    pub fn end(&mut self, awaited: Awaited<'_>) -> Result<(Box<FromDaemon>, TickMarks), Error> {
        let Some(sent) = awaited.take() else { return Err(Error::Taken) };
        let report = sent.report;
        match self.receive(sent) {
            Err(error) if is_stale(&error) => {
                let link = self.present()?;
                let sent = self.send_whole(&link, report)?;
                self.receive(sent)
            }
            received => received,
        }
    }

    fn receive(&mut self, sent: SentEdit) -> Result<(Box<FromDaemon>, TickMarks), Error> {
        let Some(link) = self.there.as_ref().map(|there| Arc::clone(&there.link)) else {
            return Err(Error::DaemonDied);
        };
        let (answer, reply) = match sent.receive(&self.settings) {
            Ok(received) => received,
            Err(Error::Reply(error)) => return Err(self.refused(&link, error)),
            Err(error) => {
                self.lost(&link, &error);
                return Err(error);
            }
        };
        self.before = None;
        let payload_bytes = size_of_val(answer.response.pages()) as u64;
        let marks = TickMarks::parse(&answer.header, payload_bytes);
        let marks = marks.map_err(|error| self.refused(&link, error))?;
        let (index_end, isa) = (self.terms.most_boxes, self.core.settings().isa);
        Ok((Box::new(FromDaemon { answer, reply, index_end, isa }), marks))
    }
}

/// Removes the boxes of indices that are no longer this member's, and listed pairs that name them.
pub(super) fn remove(copy: &mut SceneCopy, range: Range<u32>) -> Result<(), EditError> {
    let remains = Remains::of(copy, &std::iter::once(range).collect());
    let steps = remains.steps();
    let edit = Edit { steps: &steps };
    copy.check(edit)?;
    copy.apply(edit);
    Ok(())
}

impl Drop for Member {
    fn drop(&mut self) {
        // Also where an answer was lost: the daemon may have the membership.
        let Some(link) = self.asked_of.as_ref().filter(|link| link.is_alive()) else { return };
        let header = RequestHeader::leave_shared(link.token(), self.core.next_frame(), self.id);
        self.core.end_scene(link, &header, &self.unread);
    }
}
