//! The membership of a scene that several processes write: its name and terms, and what this member has leased.
//!
//! The daemon's refusals have types of their own here.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use pairmask_core::scene::shared::Ranges;
use pairmask_core::scene::{Edit, SceneCopy};
use pairmask_core::units::BoxCount;
use pairmask_wire::{
    AgreedTerms, JoinRequest, LeaseAction, LeaseRequest, Page, ReplyError, ReplyFields,
    RequestHeader, SceneId, SceneName, SharedTerms, StatusCode, TermsDiffer, lease_error,
    not_leased, parse_joined, parse_leased,
};

use super::options::SceneOptions;
use crate::session::core::Core;
use crate::session::error::Error;
use crate::session::link::{Answer, Exchange, Link};
use crate::session::settings::Settings;

/// What a member has before a commit that the daemon may refuse: only the daemon knows whose lease begins lowest, and only
/// that member gives the table of filters.
pub(super) struct Before {
    pub copy: SceneCopy,
    pub gave_filters: bool,
    pub discards: bool,
}

/// What makes a scene one that several processes write.
pub(super) struct Sharing {
    name: SceneName,
    /// What this member asks for; once it has joined, what holds.
    terms: SharedTerms,
    options: SceneOptions,
    pub leases: Vec<Range<u32>>,
    /// User data of all boxes, as of the last answer.
    pub others: OthersData,
    /// Whether this member has given the table of filters.
    pub gave_filters: bool,
    /// Until the commit of a table of filters is answered.
    pub before: Option<Box<Before>>,
    /// Whether the last such commit was refused, and taken back here.
    pub was_undone: bool,
    /// The last tick that was observed since it joined; 0 for none.
    pub observed: u64,
}

/// User data by index, where it is not 0.
#[derive(Default)]
pub(super) struct OthersData(HashMap<u32, u64>);

impl OthersData {
    pub fn of(&self, index: u32) -> u64 {
        self.0.get(&index).copied().unwrap_or(0)
    }

    /// Learns what has changed, of a scene whose indices are below a limit.
    pub fn learn(&mut self, changed: impl Iterator<Item = (u32, u64)>, limit: u32) {
        for (index, user_data) in changed.filter(|(index, _)| *index < limit) {
            if user_data == 0 {
                self.0.remove(&index);
            } else {
                self.0.insert(index, user_data);
            }
        }
    }

    pub fn clear(&mut self) {
        self.0.clear();
    }

    pub fn allocated_bytes(&self) -> usize {
        self.0.capacity() * (size_of::<(u32, u64)>() + 1)
    }
}

/// Whom the membership is asked of.
pub(super) struct Asked<'a> {
    pub core: &'a Core,
    pub link: &'a Arc<Link>,
    pub settings: &'a Settings,
    pub scene: SceneId,
}

impl Sharing {
    pub fn new(name: SceneName, options: SceneOptions) -> Self {
        let SceneOptions { most_boxes, tick_deadline, at_end, .. } = options;
        Self {
            name,
            terms: SharedTerms { most_boxes, deadline: tick_deadline, at_end },
            options,
            leases: Vec::new(),
            others: OthersData::default(),
            gave_filters: false,
            before: None,
            was_undone: false,
            observed: 0,
        }
    }

    /// What holds in the scene; before it is joined, what this member asks for.
    pub const fn terms(&self) -> &SharedTerms {
        &self.terms
    }

    /// Joins, or joins again what held.
    ///
    /// # Errors
    /// [`Error`].
    pub fn join(&mut self, of: &Asked<'_>) -> Result<AgreedTerms, Error> {
        let request = JoinRequest {
            scene: of.scene,
            name: self.name.section(),
            terms: self.terms,
            scope: self.options.scope,
            engine: of.core.settings().engine,
        };
        let (answer, asked) = of.ask(
            self.name.as_str().len() as u64,
            |token, frame| RequestHeader::join_shared(token, frame, &request),
            |pages| self.name.write(pages),
        )?;
        let agreed = parse_joined(&answer.header, &asked)?;
        // It may be another scene, whose ticks count anew.
        self.observed = 0;
        let AgreedTerms { most_boxes, deadline, at_end } = agreed;
        self.terms = SharedTerms {
            most_boxes: Some(most_boxes),
            deadline: Some(deadline),
            at_end: Some(at_end),
        };
        Ok(agreed)
    }

    /// Checks that an edit names nothing that is not leased. Whether this is the first writer, the daemon knows.
    ///
    /// # Errors
    /// [`Error::NotLeased`].
    pub fn allow(&self, edit: Edit<'_>) -> Result<(), Error> {
        let own: Ranges = self.leases.iter().cloned().collect();
        Ok(own.allow(edit, true)?)
    }
}

impl Asked<'_> {
    /// Takes a lease, or gives one back.
    ///
    /// # Errors
    /// [`Error`].
    pub fn lease(&self, action: LeaseAction) -> Result<Range<u32>, Error> {
        let request = LeaseRequest { scene: self.scene, action };
        let header = |token, frame| RequestHeader::lease_shared(token, frame, &request);
        let (answer, asked) = self.ask(0, header, |_| true)?;
        let range = parse_leased(&answer.header, &asked)?;
        let is_right = match action {
            LeaseAction::Take { first, count } => {
                (range.start, range.len()) == (first, count as usize)
            }
            LeaseAction::TakeAny { count } => range.len() == count as usize,
            LeaseAction::GiveBack { first } => range.start == first,
        };
        if is_right { Ok(range) } else { Err(ReplyError::Malformed { field: "lease" }.into()) }
    }

    /// Sends a small request, and waits for its answer.
    fn ask(
        &self,
        bytes: u64,
        header: impl FnOnce(u64, u64) -> RequestHeader,
        write: impl FnOnce(&mut [Page]) -> bool,
    ) -> Result<(Answer, ReplyFields), Error> {
        let mut shared = self.core.loan(self.link, bytes)?;
        if !write(shared.loan.pages_mut()) {
            return Err(Error::TooManyFrames);
        }
        let (client_token, frame) = (self.link.token(), self.core.next_frame());
        let exchange = Exchange::begin(shared, &header(client_token, frame))?;
        let asked = ReplyFields { client_token, frame, box_count: BoxCount::default() };
        let Settings { spin, deadline, .. } = *self.settings;
        Ok((exchange.end(self.link.expect(0), spin, deadline)?, asked))
    }
}

/// What a daemon has refused to a member, by its status; `None` of other errors.
pub(super) fn refusal(error: &Error, most_boxes: u32) -> Option<Error> {
    let Error::Reply(ReplyError::Status { status, detail }) = error else { return None };
    match status {
        StatusCode::SharedDiffers => TermsDiffer::of_detail(*detail).map(Into::into),
        StatusCode::LeaseRefused => lease_error(*detail, most_boxes).map(Error::Lease),
        StatusCode::NotLeased => not_leased(*detail).map(Error::NotLeased),
        _ => None,
    }
}
