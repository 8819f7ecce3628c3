//! Why a call did nothing: a code and a text.

use std::borrow::Cow;

use pairmask::{ConnectError, EditError, Error};
use pairmask_core::engine::{CullError, IsaError, UnknownName};
use pairmask_core::filters::TooManyFilters;
use pairmask_core::precision::{BoundsError, MarginError};
use pairmask_core::scene::QueryError;

#[allow(clippy::enum_glob_use)] // A table of nearly all of them.
use crate::code::pm_code::{self, *};

/// Why a call did nothing.
#[derive(Debug)]
pub struct Failure {
    /// What the function returns.
    pub code: pm_code,
    /// What [`pm_last_error`](crate::call::pm_last_error) returns.
    pub text: Cow<'static, str>,
}

impl Failure {
    /// A failure that no error of the library stands behind.
    pub const fn new(code: pm_code, text: &'static str) -> Self {
        Self { code, text: Cow::Borrowed(text) }
    }

    /// An argument that is wrong.
    pub const fn argument(text: &'static str) -> Self {
        Self::new(PM_ERR_ARGUMENT, text)
    }
}

/// Turns errors of the library into failures by their codes.
macro_rules! failures {
    ($($error:ty => $code_of:expr),* $(,)?) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self { code: ($code_of)(&error), text: error.to_string().into() }
            }
        })*
    };
}

failures! {
    ConnectError => of_connect,
    Error => of_error,
    EditError => of_edit,
    TooManyFilters => |_| PM_ERR_TOO_MANY_FILTERS,
    BoundsError => |_| PM_ERR_BOUNDS,
    MarginError => |_| PM_ERR_MARGINS,
    IsaError => |_| PM_ERR_ISA,
    UnknownName => |_| PM_ERR_ARGUMENT,
}

const fn of_connect(error: &ConnectError) -> pm_code {
    match error {
        ConnectError::NoDaemon { .. } => PM_ERR_NO_DAEMON,
        ConnectError::NotBuiltIn => PM_ERR_NOT_BUILT_IN,
        ConnectError::Silent { .. } => PM_ERR_SILENT,
        ConnectError::OtherUser { .. } => PM_ERR_OTHER_USER,
        ConnectError::VersionMismatch { .. } => PM_ERR_VERSION_MISMATCH,
        ConnectError::TooManyClients { .. } => PM_ERR_TOO_MANY_CLIENTS,
        ConnectError::OutOfMemory => PM_ERR_OUT_OF_SHARED_MEMORY,
        ConnectError::Isa(_) => PM_ERR_ISA,
        ConnectError::Instance(_) => PM_ERR_INSTANCE,
        ConnectError::Transport(_) => PM_ERR_TRANSPORT,
        _ => PM_ERR_OTHER,
    }
}

const fn of_edit(error: &EditError) -> pm_code {
    match error {
        EditError::BeyondLimit { .. } => PM_ERR_BEYOND_LIMIT,
        EditError::Lengths { .. } => PM_ERR_LENGTHS,
        EditError::Margins { .. } => PM_ERR_MARGINS,
        EditError::SetTwice { .. } => PM_ERR_SET_TWICE,
        EditError::Absent { .. } => PM_ERR_ABSENT,
        EditError::NoMargins => PM_ERR_NO_MARGINS,
        EditError::InexactShift { .. } => PM_ERR_INEXACT_SHIFT,
        EditError::NoMemory { .. } => PM_ERR_OUT_OF_MEMORY,
        _ => PM_ERR_OTHER,
    }
}

const fn of_error(error: &Error) -> pm_code {
    match error {
        Error::TooManyBoxes { .. }
        | Error::Query(QueryError::Cull(CullError::TooManyBoxes { .. }))
        | Error::Cull(CullError::TooManyBoxes { .. }) => PM_ERR_TOO_MANY_BOXES,
        Error::WrongCount { .. }
        | Error::Unsupported { .. }
        | Error::FilterData { .. }
        | Error::Listed { .. } => PM_ERR_ARGUMENT,
        Error::FirstSet { .. } => PM_ERR_FIRST_SET,
        Error::Edit(error) => of_edit(error),
        Error::SceneFile(_) => PM_ERR_SCENE_FILE,
        Error::Snapshot(_) | Error::SharedSnapshot => PM_ERR_SNAPSHOT,
        Error::Query(QueryError::FilterData { .. }) => PM_ERR_QUERY_FILTER_DATA,
        Error::Query(QueryError::Cull(_)) | Error::Cull(_) => PM_ERR_CULL,
        Error::TooManyQueries { .. } => PM_ERR_TOO_MANY_QUERIES,
        Error::SceneName(_) => PM_ERR_SCENE_NAME,
        Error::NeedsDaemon => PM_ERR_IN_PROCESS,
        Error::NotShared => PM_ERR_STATE,
        Error::TermsDiffer(_) => PM_ERR_TERMS_DIFFER,
        Error::Lease(_) => PM_ERR_LEASE,
        Error::NotLeased(_) => PM_ERR_NOT_LEASED,
        Error::TooManyFrames => PM_ERR_TOO_MANY_FRAMES,
        Error::NoMemory { .. } => PM_ERR_OUT_OF_MEMORY,
        Error::OutOfMemory(_) => PM_ERR_OUT_OF_SHARED_MEMORY,
        Error::Connect(error) => of_connect(error),
        Error::TooManyListedPairs(_) => PM_ERR_TOO_MANY_LISTED_PAIRS,
        Error::NotSent(_) | Error::Transport(_) => PM_ERR_TRANSPORT,
        Error::Timeout { .. } => PM_ERR_TIMEOUT,
        Error::AlreadyReceived => PM_ERR_ALREADY_RECEIVED,
        Error::DaemonDied => PM_ERR_DAEMON_DIED,
        Error::Reply(_) => PM_ERR_REPLY,
        Error::Unanswered(error) => of_error(error),
        _ => PM_ERR_OTHER,
    }
}
