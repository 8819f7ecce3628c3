//! Why a call did nothing: a code and a text.

use std::borrow::Cow;
use std::fmt::Display;

use pairmask::error::{BoundsError, CullError, MarginError};
use pairmask::filters::TooManyFilters;
use pairmask::scene::{EditError, QueryError, SceneError};
use pairmask::{
    CommitError, ConnectError, FindError, FrameError, IsaError, SharedError, StatusError, WaitError,
};

#[allow(clippy::wildcard_imports)] // Every code is one of an error.
use crate::code::*;

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

    fn of(code: pm_code, error: &impl Display) -> Self {
        Self { code, text: error.to_string().into() }
    }
}

/// Turns an error of the library into a failure by its code.
macro_rules! failure_by {
    ($($error:ty => $code:ident),* $(,)?) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::of($code(&error), &error)
            }
        })*
    };
}

failure_by! {
    ConnectError => of_connect,
    FrameError => of_frame,
    WaitError => of_wait,
    CommitError => of_commit,
    FindError => of_find,
    SharedError => of_shared,
    StatusError => of_status,
    EditError => of_edit,
}

/// The same for errors that have one code.
macro_rules! failure_of {
    ($($error:ty => $code:ident),* $(,)?) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::of($code, &error)
            }
        })*
    };
}

failure_of! {
    TooManyFilters => PM_ERR_TOO_MANY_FILTERS,
    BoundsError => PM_ERR_BOUNDS,
    MarginError => PM_ERR_MARGINS,
    IsaError => PM_ERR_ISA,
    pairmask::error::UnknownName => PM_ERR_ARGUMENT,
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

const fn of_cull(error: &CullError) -> pm_code {
    match error {
        CullError::TooManyBoxes { .. } => PM_ERR_TOO_MANY_BOXES,
        _ => PM_ERR_CULL,
    }
}

const fn of_frame(error: &FrameError) -> pm_code {
    match error {
        FrameError::TooManyBoxes { .. } => PM_ERR_TOO_MANY_BOXES,
        FrameError::DaemonTooOld { .. } => PM_ERR_DAEMON_TOO_OLD,
        FrameError::TooManyListedPairs(_) => PM_ERR_TOO_MANY_LISTED_PAIRS,
        FrameError::FirstSet { .. } => PM_ERR_FIRST_SET,
        FrameError::WrongCount { .. } | FrameError::Unsupported { .. } => PM_ERR_ARGUMENT,
        FrameError::TooManyFrames => PM_ERR_TOO_MANY_FRAMES,
        FrameError::NoMemory { .. } => PM_ERR_OUT_OF_MEMORY,
        FrameError::Connect(error) => of_connect(error),
        FrameError::OutOfMemory(_) => PM_ERR_OUT_OF_SHARED_MEMORY,
        FrameError::Transport(_) => PM_ERR_TRANSPORT,
        FrameError::Cull(error) => of_cull(error),
        _ => PM_ERR_OTHER,
    }
}

const fn of_wait(error: &WaitError) -> pm_code {
    match error {
        WaitError::Timeout { .. } => PM_ERR_TIMEOUT,
        WaitError::Taken => PM_ERR_TAKEN,
        WaitError::DaemonDied => PM_ERR_DAEMON_DIED,
        WaitError::Reply(_) => PM_ERR_REPLY,
        WaitError::Transport(_) => PM_ERR_TRANSPORT,
        WaitError::Cull(error) => of_cull(error),
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
        EditError::NoMemory { .. } => PM_ERR_OUT_OF_MEMORY,
        _ => PM_ERR_OTHER,
    }
}

const fn of_scene(error: &SceneError) -> pm_code {
    match error {
        SceneError::Edit(error) => of_edit(error),
        SceneError::Cull(error) => of_cull(error),
        _ => PM_ERR_OTHER,
    }
}

const fn of_commit(error: &CommitError) -> pm_code {
    match error {
        CommitError::Edit(error) => of_edit(error),
        CommitError::Frame(error) => of_frame(error),
        CommitError::Wait(error) => of_wait(error),
        CommitError::Scene(error) => of_scene(error),
        CommitError::Shared(error) => of_shared(error),
        _ => PM_ERR_OTHER,
    }
}

const fn of_find(error: &FindError) -> pm_code {
    match error {
        FindError::TooMany { .. } => PM_ERR_TOO_MANY_QUERIES,
        FindError::Query(QueryError::Tags { .. }) => PM_ERR_QUERY_TAGS,
        FindError::Query(QueryError::Cull(error)) => of_cull(error),
        FindError::Frame(error) => of_frame(error),
        FindError::Wait(error) => of_wait(error),
        FindError::Scene(error) => of_scene(error),
        FindError::Shared => PM_ERR_STATE,
        _ => PM_ERR_OTHER,
    }
}

const fn of_shared(error: &SharedError) -> pm_code {
    match error {
        SharedError::Name(_) => PM_ERR_SCENE_NAME,
        SharedError::InProcess => PM_ERR_IN_PROCESS,
        SharedError::Moved => PM_ERR_MOVED,
        SharedError::Differs(_) => PM_ERR_TERMS_DIFFER,
        SharedError::Lease(_) => PM_ERR_LEASE,
        SharedError::NotLeased(_) => PM_ERR_NOT_LEASED,
        SharedError::NotShared => PM_ERR_STATE,
        SharedError::Edit(error) => of_edit(error),
        SharedError::Frame(error) => of_frame(error),
        SharedError::Wait(error) => of_wait(error),
        _ => PM_ERR_OTHER,
    }
}

const fn of_status(error: &StatusError) -> pm_code {
    match error {
        StatusError::Connect(error) => of_connect(error),
        StatusError::Frame(error) => of_frame(error),
        StatusError::Wait(error) => of_wait(error),
        _ => PM_ERR_OTHER,
    }
}
