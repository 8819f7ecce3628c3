//! Why there is no session, and why a session gives no answer.

use std::path::PathBuf;
use std::time::Duration;

use pairmask_core::engine::{CullError, IsaError};
use pairmask_core::scene::shared::{LeaseError, NotLeased};
use pairmask_core::scene::{EditError, QueryError, SceneError, UnknownSnapshot};
use pairmask_wire::{
    InstanceError, InstanceName, ReplyError, SceneFileError, SceneNameError, TermsDiffer,
    TooManyPairs, Version,
};

use crate::transport::{LimitError, PopulateError, TransportError};

fn paths(all: &[PathBuf]) -> String {
    let all: Vec<_> = all.iter().map(|path| path.display().to_string()).collect();
    all.join(" or ")
}

/// Why there is no session.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConnectError {
    /// No daemon serves the instance.
    #[error(
        "no daemon serves instance '{instance}' in {}: start one with `pairmaskd serve --instance {instance}`",
        paths(looked_in)
    )]
    NoDaemon {
        /// The instance.
        instance: InstanceName,
        /// The runtime directories that were searched.
        looked_in: Vec<PathBuf>,
    },
    /// This build of the library has no transport.
    #[error(
        "this build has no daemon backend: enable pairmask's feature `daemon`, or use Backend::InProcess"
    )]
    NotBuiltIn,
    /// The daemon lives and did not answer within the session's deadline, or its heartbeat stands still.
    /// The session asks it nothing until it runs again, with pauses that grow.
    #[error(
        "the daemon of instance '{instance}' did not answer in time: look at it with `pairmaskd status --instance {instance}`"
    )]
    Silent {
        /// The instance.
        instance: InstanceName,
    },
    /// The instance is another user's, and its memory is closed to this user.
    #[error(
        "instance '{instance}' belongs to user {uid}: run as that user, or start a daemon of your own, with PAIRMASK_RUNTIME_DIR set to a directory of your own"
    )]
    OtherUser {
        /// The instance.
        instance: InstanceName,
        /// The user's id.
        uid: u32,
    },
    /// The daemon speaks another major version of the wire contract, or an older minor one.
    #[error(
        "the daemon speaks wire version {daemon}, this client {client}: install matching versions of pairmask and pairmaskd"
    )]
    VersionMismatch {
        /// Our version.
        client: Version,
        /// The daemon's.
        daemon: Version,
    },
    /// The daemon has no slot for another client.
    #[error(
        "instance '{instance}' has all the clients that it may have: close one, or serve with a larger --max-clients"
    )]
    TooManyClients {
        /// The instance.
        instance: InstanceName,
    },
    /// No shared memory for the client's segment.
    #[error("no shared memory for a segment: free space in /dev/shm or make it larger")]
    OutOfMemory,
    /// A limit of this process: open files or address space.
    #[error(transparent)]
    Limit(#[from] LimitError),
    /// The daemon has no shared memory for a client, or can open no more files.
    #[error(
        "the daemon of instance '{instance}' has no room for a client: free space in /dev/shm, raise its limit of open files (RLIMIT_NOFILE, `ulimit -n`), or wait until others have disconnected"
    )]
    DaemonFull {
        /// The instance.
        instance: InstanceName,
    },
    /// The instruction set that `PAIRMASK_ISA` names cannot be used.
    #[error("PAIRMASK_ISA: {0}")]
    Isa(#[from] IsaError),
    /// The instance's directory cannot be used.
    #[error(transparent)]
    Instance(#[from] InstanceError),
    /// The transport failed.
    #[error(transparent)]
    Transport(#[from] TransportError),
}

/// Why a frame, an edit or a query was not sent, or has no answer.
///
/// Of an edit, [`is_applied`](Self::is_applied) says whether the scene has it nevertheless.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// More boxes or spheres than an index can name.
    #[error("{n} boxes or spheres are too many: a frame holds at most {limit}")]
    TooManyBoxes {
        /// Boxes or spheres asked for.
        n: usize,
        /// How many are allowed.
        limit: u64,
    },
    /// Not as many boxes as the frame has.
    #[error("{given} boxes for a frame of {n}: give as many as it has")]
    WrongCount {
        /// Boxes that were given.
        given: usize,
        /// Boxes of the frame.
        n: u32,
    },
    /// Options that frames do not have together.
    #[error("frames of {what} are not supported")]
    Unsupported {
        /// What was asked for.
        what: &'static str,
    },
    /// Not as much filter data as boxes.
    #[error("filter data of {filter_data} boxes for {n} boxes: give it for each box, or for none")]
    FilterData {
        /// Boxes that have filter data.
        filter_data: usize,
        /// Boxes of the frame.
        n: u32,
    },
    /// A listed pair of the filters names no box of the frame.
    #[error("a listed pair names box {index} of a frame of {n}")]
    Listed {
        /// What it names.
        index: u32,
        /// Boxes of the frame.
        n: u32,
    },
    /// The first of two sets has more boxes than the frame.
    #[error("a first set of {first} boxes in a frame of {n}")]
    FirstSet {
        /// Boxes of the first set.
        first: usize,
        /// Boxes of the frame.
        n: u32,
    },
    /// The edit is wrong.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// A scene cannot be saved, or loaded.
    #[error(transparent)]
    SceneFile(#[from] SceneFileError),
    /// The scene has no such snapshot.
    #[error(transparent)]
    Snapshot(#[from] UnknownSnapshot),
    /// A shared scene has no snapshots: its other writers would have to go back too.
    #[error("a shared scene has no snapshots: its other writers would have to go back too")]
    SharedSnapshot,
    /// The query is wrong, or this process cannot answer it.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// More queries and indices than a mask has objects.
    #[error(
        "{queries} queries of a scene with indices below {index_end} are too many: ask in parts"
    )]
    TooManyQueries {
        /// Queries.
        queries: usize,
        /// Indices are below this.
        index_end: u32,
    },
    /// No name of a shared scene.
    #[error(transparent)]
    SceneName(#[from] SceneNameError),
    /// The session answers in process, where there is no shared scene.
    #[error("a shared scene needs a daemon: use Backend::Auto or Backend::Daemon")]
    NeedsDaemon,
    /// The scene is no shared one.
    #[error("this scene is not shared: join one to lease indices")]
    NotShared,
    /// The shared scene has other terms than this member asks for.
    #[error(transparent)]
    TermsDiffer(#[from] TermsDiffer),
    /// The lease is refused.
    #[error(transparent)]
    Lease(#[from] LeaseError),
    /// The edit names what is not leased. A table of filters is refused by the daemon where another writer's
    /// lease begins lower.
    #[error(transparent)]
    NotLeased(#[from] NotLeased),
    /// All slots for frames are held. With [`Backend::Auto`](super::Backend::Auto) frames are answered in process
    /// then, and this is the error of edits and queries of scenes that the daemon has.
    #[error("three frames are being filled, under way or held as masks: drop one before the next")]
    TooManyFrames,
    /// This process has no memory for the frame.
    #[error("this process has no memory for {n} boxes or spheres")]
    NoMemory {
        /// Boxes or spheres of the frame.
        n: u32,
    },
    /// /dev/shm is full.
    #[error(transparent)]
    OutOfMemory(#[from] PopulateError),
    /// There is no daemon any more ([`Backend::Daemon`](super::Backend::Daemon) only).
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The include and exclude lists of a frame's rules are too long to be sent
    /// ([`Backend::Daemon`](super::Backend::Daemon) only).
    #[error("{0}: use Backend::Auto")]
    TooManyListedPairs(#[from] TooManyPairs),
    /// The transport gave no memory for the request.
    #[error(transparent)]
    NotSent(TransportError),
    /// The deadline passed. The frame is still under way and may be awaited again.
    #[error("no answer within {waited:?}: wait again, or check the daemon with `pairmaskd status`")]
    Timeout {
        /// How long this call waited.
        waited: Duration,
    },
    /// The answer was received before.
    #[error("the answer was received already")]
    AlreadyReceived,
    /// The daemon died.
    #[error("the daemon died before it answered: ask again, or start it with `pairmaskd serve`")]
    DaemonDied,
    /// The daemon answered with an error, or with a response that is malformed.
    #[error(transparent)]
    Reply(#[from] ReplyError),
    /// The transport failed.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// The in-process engine failed.
    #[error(transparent)]
    Cull(#[from] CullError),
    /// The scene has the edit, which was not sent: for lack of a daemon, for one. The next edit sends both.
    #[error("the edit is applied and was not sent: {0}")]
    Unanswered(#[source] Box<Self>),
    /// As a later version of the engines says.
    #[error(transparent)]
    Scene(SceneError),
}

impl Error {
    /// Of an edit, whether the scene has it all the same: it has no answer, and the next one makes up for that.
    /// Otherwise nothing of it was applied.
    pub const fn is_applied(&self) -> bool {
        matches!(
            self,
            Self::Timeout { .. }
                | Self::AlreadyReceived
                | Self::DaemonDied
                | Self::Reply(_)
                | Self::Transport(_)
                | Self::Cull(_)
                | Self::Unanswered(_)
        )
    }

    /// The same, of an edit that the scene has.
    pub(super) fn unanswered(self) -> Self {
        if self.is_applied() { self } else { Self::Unanswered(Box::new(self)) }
    }
}

impl From<SceneError> for Error {
    fn from(error: SceneError) -> Self {
        match error {
            SceneError::Edit(error) => Self::Edit(error),
            SceneError::Cull(error) => Self::Cull(error),
            error => Self::Scene(error),
        }
    }
}

/// How a daemon was lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Loss {
    Died,
    Silent,
}

impl Loss {
    /// What an error of a wait says; `None` where the daemon answered.
    pub(super) const fn of(error: &Error) -> Option<Self> {
        match error {
            Error::DaemonDied | Error::Transport(_) => Some(Self::Died),
            Error::Timeout { .. } => Some(Self::Silent),
            _ => None,
        }
    }
}
