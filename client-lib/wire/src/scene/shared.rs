//! Scenes that several sessions write: joining, leases, and commits. The edit of a commit is that of a
//! [scene](super::SceneRequest).

use std::fmt;
use std::ops::Range;
use std::str::FromStr;
use std::time::Duration;

use pairmask_core::engine::EngineChoice;
use pairmask_core::scene::shared::{AtEnd, LeaseError, NotLeased, Scope};

use super::request::{SceneId, SceneRequest};
use crate::header::{Operation, RequestHeader, engine_number};
use crate::page::Page;
use crate::reject::Reject;
use crate::reply::{Reply, ReplyError, ReplyFields, ResponseHeader, envelope};
use crate::section::{Section, SectionKind, find, slots};
use crate::status_code::StatusCode;

const MAX_NAME_BYTES: usize = 64;
/// The longest deadline of a tick. A client waits for its session's deadline on top.
pub const LONGEST_TICK: Duration = Duration::from_secs(10);

/// Flags of a join: what becomes of a dead writer's boxes, where the member says so.
const REMOVES: u32 = 1;
const KEEPS: u32 = 1 << 1;
/// Flag of a join: all pairs are reported to the member.
const SCOPE_ALL: u32 = 1 << 2;

/// What a lease does.
const TAKE: u32 = 1;
const TAKE_ANY: u32 = 2;
const GIVE_BACK: u32 = 3;

/// Name of a shared scene: 1 to 64 letters, digits, and `-_.:/`.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SceneName(String);

/// What is no name of a scene.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("scene name '{name}' is not 1 to 64 letters, digits and '-_.:/'")]
pub struct SceneNameError {
    /// What was given.
    pub name: String,
}

impl SceneName {
    /// The name as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Reads the name of a request, once. `None` where it is none.
    pub fn read(request: &JoinRequest, pages: &[Page]) -> Option<Self> {
        String::from_utf8(request.name.bytes_in(pages)?.to_vec()).ok()?.parse().ok()
    }

    /// Writes the name at the start of a payload. Returns `false` where there is no page.
    #[must_use]
    pub fn write(&self, pages: &mut [Page]) -> bool {
        self.section().put(self.0.as_bytes(), pages, false)
    }

    /// The section of a name at the start of a payload.
    pub const fn section(&self) -> Section {
        Section::required(SectionKind::SceneName, 0, self.0.len() as u64)
    }
}

impl fmt::Display for SceneName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl FromStr for SceneName {
    type Err = SceneNameError;

    fn from_str(s: &str) -> Result<Self, SceneNameError> {
        let fits = |c: u8| c.is_ascii_alphanumeric() || b"-_.:/".contains(&c);
        if s.is_empty() || s.len() > MAX_NAME_BYTES || !s.bytes().all(fits) {
            // A name from outside may be of any length.
            let name = s.chars().take(MAX_NAME_BYTES).collect();
            return Err(SceneNameError { name });
        }
        Ok(Self(s.to_owned()))
    }
}

/// What a member asks of a shared scene: what is `None`, it leaves to who joined first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SharedTerms {
    /// Indices are below this.
    pub most_boxes: Option<u32>,
    /// How long a tick is open at the most: not 0, and at most [`LONGEST_TICK`].
    pub deadline: Option<Duration>,
    /// What becomes of a dead writer's boxes.
    pub at_end: Option<AtEnd>,
}

/// What holds in a shared scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AgreedTerms {
    /// Indices are below this.
    pub most_boxes: u32,
    /// How long a tick is open at the most.
    pub deadline: Duration,
    /// What becomes of a dead writer's boxes.
    pub at_end: AtEnd,
}

/// Which term of a shared scene is another one than a member asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TermsDiffer {
    /// The boxes that it may hold.
    #[error("the scene may hold {there} boxes")]
    MostBoxes {
        /// What holds.
        there: u32,
    },
    /// The deadline of its ticks.
    #[error("the scene's ticks have a deadline of {there:?}")]
    Deadline {
        /// What holds.
        there: Duration,
    },
    /// What becomes of a dead writer's boxes.
    #[error("the scene has another rule for a dead writer's boxes: {there:?}")]
    AtEnd {
        /// What holds.
        there: AtEnd,
    },
}

impl AgreedTerms {
    /// Whether what a member asks for holds.
    ///
    /// # Errors
    /// [`TermsDiffer`] with the first term that does not.
    pub fn agree(&self, asked: &SharedTerms) -> Result<(), TermsDiffer> {
        let Self { most_boxes, deadline, at_end } = *self;
        if asked.most_boxes.is_some_and(|asked| asked != most_boxes) {
            return Err(TermsDiffer::MostBoxes { there: most_boxes });
        }
        if asked.deadline.is_some_and(|asked| asked != deadline) {
            return Err(TermsDiffer::Deadline { there: deadline });
        }
        if asked.at_end.is_some_and(|asked| asked != at_end) {
            return Err(TermsDiffer::AtEnd { there: at_end });
        }
        Ok(())
    }
}

const fn at_end_number(at_end: AtEnd) -> u32 {
    match at_end {
        AtEnd::Remove => REMOVES,
        AtEnd::Keep => KEEPS,
    }
}

const fn at_end_of(number: u64) -> Option<AtEnd> {
    match number {
        1 => Some(AtEnd::Remove),
        2 => Some(AtEnd::Keep),
        _ => None,
    }
}

impl TermsDiffer {
    /// The numbers of a response.
    pub const fn detail(&self) -> [u64; 2] {
        match *self {
            Self::MostBoxes { there } => [1, there as u64],
            Self::Deadline { there } => [2, there.as_nanos() as u64],
            Self::AtEnd { there } => [3, at_end_number(there) as u64],
        }
    }

    /// What the numbers of a response say.
    pub fn of_detail([which, value]: [u64; 2]) -> Option<Self> {
        Some(match which {
            1 => Self::MostBoxes { there: u32::try_from(value).ok()? },
            2 => Self::Deadline { there: Duration::from_nanos(value) },
            3 => Self::AtEnd { there: at_end_of(value)? },
            _ => return None,
        })
    }
}

/// The numbers of a response about a lease.
pub fn lease_detail(error: &LeaseError) -> [u64; 2] {
    match *error {
        LeaseError::BeyondLimit { end, .. } => [2, end],
        LeaseError::Taken { first, end } => [3, u64::from(first) << 32 | u64::from(end)],
        LeaseError::Full { count } => [4, u64::from(count)],
        LeaseError::TooMany { limit } => [5, limit as u64],
        LeaseError::NotHeld { first } => [6, u64::from(first)],
        // Of no index; what a later core adds reads as this.
        _ => [1, 0],
    }
}

/// What the numbers of a response about a lease say, in a scene of so many boxes.
pub fn lease_error([which, value]: [u64; 2], limit: u32) -> Option<LeaseError> {
    let small = || u32::try_from(value).ok();
    Some(match which {
        1 => LeaseError::Empty,
        2 => LeaseError::BeyondLimit { end: value, limit },
        3 => LeaseError::Taken { first: (value >> 32) as u32, end: value as u32 },
        4 => LeaseError::Full { count: small()? },
        5 => LeaseError::TooMany { limit: usize::try_from(value).ok()? },
        6 => LeaseError::NotHeld { first: small()? },
        _ => return None,
    })
}

/// The numbers of a response about an edit of what is not leased.
pub const fn not_leased_detail(error: &NotLeased) -> [u64; 2] {
    match *error {
        NotLeased::Index { index } => [1, index],
        NotLeased::Filters => [2, 0],
    }
}

/// What those numbers say.
pub const fn not_leased([which, value]: [u64; 2]) -> Option<NotLeased> {
    match which {
        1 => Some(NotLeased::Index { index: value }),
        2 => Some(NotLeased::Filters),
        _ => None,
    }
}

/// A request to join a shared scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JoinRequest {
    /// The client's number of its membership.
    pub scene: SceneId,
    /// The name in the payload, whose bytes are not looked at yet.
    pub name: Section,
    /// What is asked of the scene.
    pub terms: SharedTerms,
    /// Which pairs are reported to the member.
    pub scope: Scope,
    /// The engine, where the member is the first.
    pub engine: EngineChoice,
}

/// What a member does with a lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeaseAction {
    /// Leases a range.
    Take {
        /// Its first index.
        first: u32,
        /// Its length.
        count: u32,
    },
    /// Leases the lowest free range.
    TakeAny {
        /// Its length.
        count: u32,
    },
    /// Gives back the lease that begins at an index, and removes its boxes, and listed pairs that name one of
    /// its indices.
    GiveBack {
        /// The index.
        first: u32,
    },
}

/// A request about a lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LeaseRequest {
    /// The client's number of its membership.
    pub scene: SceneId,
    /// What it does.
    pub action: LeaseAction,
}

impl RequestHeader {
    /// A request to join a shared scene. Its name lies in the payload.
    pub fn join_shared(client_token: u64, frame: u64, request: &JoinRequest) -> Self {
        let SharedTerms { most_boxes, deadline, at_end } = request.terms;
        let scope = if request.scope == Scope::All { SCOPE_ALL } else { 0 };
        Self {
            engine: engine_number(request.engine),
            sections: slots([request.name]),
            scene: request.scene.0,
            // 0 leaves it open, and one that is too long for a number is too long for the daemon.
            base: deadline.map_or(0, |deadline| {
                u64::try_from(deadline.as_nanos()).unwrap_or(u64::MAX).max(1)
            }),
            most_boxes: most_boxes.unwrap_or(0),
            scene_flags: at_end.map_or(0, at_end_number) | scope,
            ..Self::envelope(Operation::JoinShared, client_token, frame)
        }
    }

    /// A request about a lease.
    pub fn lease_shared(client_token: u64, frame: u64, request: &LeaseRequest) -> Self {
        let (what, first, count) = match request.action {
            LeaseAction::Take { first, count } => (TAKE, first, count),
            LeaseAction::TakeAny { count } => (TAKE_ANY, 0, count),
            LeaseAction::GiveBack { first } => (GIVE_BACK, first, 0),
        };
        Self {
            encoding: what,
            scene: request.scene.0,
            base: u64::from(first),
            revision: u64::from(count),
            ..Self::envelope(Operation::LeaseShared, client_token, frame)
        }
    }

    /// A member's commit: an edit, and what is to be reported to it. The scene's `most_boxes` counts.
    pub fn commit_shared(client_token: u64, frame: u64, request: &SceneRequest) -> Self {
        Self {
            operation: Operation::CommitShared as u32,
            ..Self::edit_scene(client_token, frame, request)
        }
    }

    /// A request to leave a shared scene.
    pub fn leave_shared(client_token: u64, frame: u64, scene: SceneId) -> Self {
        Self { scene: scene.0, ..Self::envelope(Operation::LeaveShared, client_token, frame) }
    }
}

impl JoinRequest {
    /// Checks a copied header against the payload's length.
    pub(crate) fn parse(header: &RequestHeader, payload_bytes: u64) -> Result<Self, Reject> {
        let engine = header.engine_choice()?;
        let name = find(&header.sections, SectionKind::SceneName, 1, payload_bytes);
        let name = name.filter(|name| (1..=MAX_NAME_BYTES as u64).contains(&name.bytes));
        let name = name.ok_or(Reject::Edit("name"))?;
        let deadline = (header.base != 0).then(|| Duration::from_nanos(header.base));
        if deadline.is_some_and(|deadline| deadline > LONGEST_TICK) {
            return Err(Reject::Edit("deadline"));
        }
        let at_end = match header.scene_flags & (REMOVES | KEEPS) {
            0 => None,
            number => Some(at_end_of(u64::from(number)).ok_or(Reject::Edit("flags"))?),
        };
        let most_boxes = (header.most_boxes != 0).then_some(header.most_boxes);
        let all_pairs = header.scene_flags & SCOPE_ALL != 0;
        Ok(Self {
            scene: SceneId(header.scene),
            name,
            terms: SharedTerms { most_boxes, deadline, at_end },
            scope: if all_pairs { Scope::All } else { Scope::Own },
            engine,
        })
    }
}

impl LeaseRequest {
    /// Checks a copied header.
    pub(crate) fn parse(header: &RequestHeader) -> Result<Self, Reject> {
        let first = u32::try_from(header.base).map_err(|_| Reject::Edit("first index"));
        let count = u32::try_from(header.revision).map_err(|_| Reject::Edit("count"));
        let action = match header.encoding {
            TAKE => LeaseAction::Take { first: first?, count: count? },
            TAKE_ANY => LeaseAction::TakeAny { count: count? },
            GIVE_BACK => LeaseAction::GiveBack { first: first? },
            _ => return Err(Reject::Edit("lease")),
        };
        Ok(Self { scene: SceneId(header.scene), action })
    }
}

/// The header that answers a join.
pub fn response_joined(fields: &ReplyFields, terms: &AgreedTerms) -> ResponseHeader {
    let mut header = envelope(fields, StatusCode::Ok);
    let deadline = terms.deadline.as_nanos() as u64;
    header.detail[..3].copy_from_slice(&[
        u64::from(terms.most_boxes),
        deadline,
        u64::from(at_end_number(terms.at_end)),
    ]);
    header
}

/// What an answered join says.
///
/// # Errors
/// [`ReplyError`].
pub fn parse_joined(
    header: &ResponseHeader,
    asked: &ReplyFields,
) -> Result<AgreedTerms, ReplyError> {
    Reply::check_envelope(header, asked)?;
    let malformed = |field| ReplyError::Malformed { field };
    let deadline = Duration::from_nanos(header.detail[1]);
    if deadline.is_zero() || deadline > LONGEST_TICK {
        return Err(malformed("deadline"));
    }
    let most_boxes = u32::try_from(header.detail[0]).ok().filter(|most| *most > 0);
    Ok(AgreedTerms {
        most_boxes: most_boxes.ok_or(malformed("most boxes"))?,
        deadline,
        at_end: at_end_of(header.detail[2]).ok_or(malformed("end"))?,
    })
}

/// The header that answers a request about a lease: its range.
pub fn response_leased(fields: &ReplyFields, range: &Range<u32>) -> ResponseHeader {
    let mut header = envelope(fields, StatusCode::Ok);
    header.detail[..2].copy_from_slice(&[u64::from(range.start), u64::from(range.end)]);
    header
}

/// The range that an answer about a lease names.
///
/// # Errors
/// [`ReplyError`].
pub fn parse_leased(
    header: &ResponseHeader,
    asked: &ReplyFields,
) -> Result<Range<u32>, ReplyError> {
    Reply::check_envelope(header, asked)?;
    let malformed = ReplyError::Malformed { field: "lease" };
    let [start, end] = [header.detail[0], header.detail[1]].map(u32::try_from);
    match (start, end) {
        (Ok(start), Ok(end)) if start < end => Ok(start..end),
        _ => Err(malformed),
    }
}
