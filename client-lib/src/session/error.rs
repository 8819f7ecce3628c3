//! One error enum for each operation of a session.

use std::path::PathBuf;
use std::time::Duration;

use pairmask_core::engine::{CullError, IsaError};
use pairmask_core::scene::{EditError, QueryError, SceneError};
use pairmask_wire::{InstanceError, InstanceName, ReplyError, TooManyPairs, Version};

use super::scene::SharedError;
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
    /// The daemon speaks another major version of the wire contract.
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
    /// Somebody has removed the files of a daemon that serves.
    #[error(
        "the daemon of instance '{instance}' serves, but its files in /dev/shm were removed: it starts anew within a second, try again then"
    )]
    FilesGone {
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

/// Why there is no memory for a frame, or why it could not be submitted.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// More boxes or spheres than an index can name.
    #[error("{n} boxes or spheres are too many: a frame holds at most {limit}")]
    TooManyBoxes {
        /// Boxes or spheres asked for.
        n: usize,
        /// How many are allowed.
        limit: u64,
    },
    /// The daemon is older than what the frame needs ([`Backend::Daemon`](super::Backend::Daemon)
    /// only).
    #[error(
        "the daemon is too old to know {what}: install a newer pairmaskd, or use Backend::Auto"
    )]
    DaemonTooOld {
        /// What it does not know: spheres, for one.
        what: &'static str,
    },
    /// The include and exclude lists of a frame's rules are too long to be sent
    /// ([`Backend::Daemon`](super::Backend::Daemon) only).
    #[error("{0}: use Backend::Auto")]
    TooManyListedPairs(#[from] TooManyPairs),
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
    /// The first of two sets has more boxes than the frame.
    #[error("a first set of {first} boxes in a frame of {n}")]
    FirstSet {
        /// Boxes of the first set.
        first: usize,
        /// Boxes of the frame.
        n: u32,
    },
    /// All places for frames are held. With [`Backend::Auto`](super::Backend::Auto) frames are answered in process then,
    /// and this is the error of edits and queries of scenes that the daemon has.
    #[error("three frames are being filled, under way or held as masks: drop one before the next")]
    TooManyFrames,
    /// This process has no memory for the frame.
    #[error("this process has no memory for {n} boxes or spheres")]
    NoMemory {
        /// Boxes or spheres of the frame.
        n: u32,
    },
    /// There is no daemon any more ([`Backend::Daemon`](super::Backend::Daemon) only).
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// /dev/shm is full.
    #[error(transparent)]
    OutOfMemory(#[from] PopulateError),
    /// The transport failed.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// The in-process engine failed.
    #[error(transparent)]
    Cull(#[from] CullError),
}

/// Why a submitted frame has no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WaitError {
    /// The deadline passed. The frame is still under way and may be awaited again.
    #[error("no answer within {waited:?}: wait again, or check the daemon with `pairmaskd status`")]
    Timeout {
        /// How long this call waited.
        waited: Duration,
    },
    /// The pairs of the frame were taken before.
    #[error("the pairs of this frame were taken already")]
    Taken,
    /// The daemon died.
    #[error("the daemon died before it answered: ask again, or start it with `pairmaskd serve`")]
    DaemonDied,
    /// The daemon has no file left to connect to a new client.
    #[error(
        "the daemon can open no more files and takes no new clients: raise its limit (RLIMIT_NOFILE, `ulimit -n`), or wait until others have gone"
    )]
    DaemonFull,
    /// The daemon answered with an error, or with a response that is malformed.
    #[error(transparent)]
    Reply(#[from] ReplyError),
    /// The transport failed.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// The daemon has lost the scene, which could not be sent again.
    #[error("the daemon has lost the scene, and it was not sent again: {0}")]
    NotSentAgain(#[source] Box<FrameError>),
    /// The in-process engine, which answers when the daemon cannot, failed too.
    #[error(transparent)]
    Cull(#[from] CullError),
}

/// Why an edit of a scene has no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CommitError {
    /// The edit is wrong. Nothing of it was applied.
    #[error(transparent)]
    Edit(#[from] EditError),
    /// The edit could not be sent. Nothing of it was applied.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// The edit was applied and has no answer. The next answer makes up for it.
    #[error(transparent)]
    Wait(#[from] WaitError),
    /// As a later version of the engines says.
    #[error(transparent)]
    Scene(SceneError),
    /// An edit of a scene that several processes write. Nothing of it was applied where it names what is not leased
    /// ([`SharedError::NotLeased`]) or asks for pairs of moved boxes ([`SharedError::Moved`]). Else it is applied, and
    /// has no answer.
    #[error(transparent)]
    Shared(SharedError),
}

/// Why a query of a scene has no answer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FindError {
    /// More queries and indices than a mask has objects.
    #[error(
        "{queries} queries of a scene with indices below {index_end} are too many: ask in parts"
    )]
    TooMany {
        /// Queries.
        queries: usize,
        /// Indices are below this.
        index_end: u32,
    },
    /// The query is wrong, or this process cannot answer it.
    #[error(transparent)]
    Query(#[from] QueryError),
    /// The query could not be sent.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// The daemon has not answered.
    #[error(transparent)]
    Wait(#[from] WaitError),
    /// The scene could not be made in this process.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A scene that several processes write answers no queries.
    #[error("a shared scene answers no queries: ask a scene of this session alone")]
    Shared,
}

impl From<CommitError> for FindError {
    fn from(error: CommitError) -> Self {
        match error {
            CommitError::Edit(error) => Self::Scene(error.into()),
            CommitError::Frame(error) => Self::Frame(error),
            CommitError::Wait(error) => Self::Wait(error),
            CommitError::Scene(error) => Self::Scene(error),
            CommitError::Shared(_) => Self::Shared,
        }
    }
}

/// Why the daemon's status is not known.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StatusError {
    /// No connection.
    #[error(transparent)]
    Connect(#[from] ConnectError),
    /// The request could not be sent.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// No answer.
    #[error(transparent)]
    Wait(#[from] WaitError),
}
