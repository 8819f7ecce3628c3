//! The connection of a session to a daemon: that of the transport, by the session's settings and with its errors.

use pairmask_wire::Version;

pub(super) use super::error::{ConnectError, Error, Loss};
use super::settings::{Backend, Settings};
pub(super) use crate::transport::{
    Answer, AnswerMemory, CheckedResponse, Exchange, LeftDaemon, Link, LinkError, SharedFrame,
    Unsent,
};
use crate::transport::{ConnectFailure, LinkOptions, OpenError, quiet_transport_log};

/// The backend that a session uses for the one asked for: in a build with a transport, the same.
#[allow(clippy::unnecessary_wraps)] // A build without one refuses a backend.
pub(super) fn backend(asked: Backend) -> Result<Backend, ConnectError> {
    quiet_transport_log();
    Ok(asked)
}

/// Connects to the daemon that serves the instance now.
pub(super) fn open(settings: &Settings) -> Result<Link, ConnectError> {
    let Settings { dir, instance, capacity, .. } = settings;
    let leaves_silent = settings.backend == Backend::Auto;
    let options = LinkOptions { dir, instance, capacity: *capacity, leaves_silent };
    let instance = instance.clone();
    Link::open(&options).map_err(|failure| match failure {
        // A daemon that lets nobody in is none.
        ConnectFailure::NoDaemon
        | ConnectFailure::Open(OpenError::NotServed | OpenError::Incompatible) => {
            no_daemon(settings)
        }
        ConnectFailure::OtherUser { uid } => ConnectError::OtherUser { instance, uid },
        ConnectFailure::OtherVersion(daemon) => {
            ConnectError::VersionMismatch { client: Version::CURRENT, daemon }
        }
        ConnectFailure::Instance(error) => error.into(),
        ConnectFailure::Open(OpenError::TooManyClients) => {
            ConnectError::TooManyClients { instance }
        }
        ConnectFailure::Open(OpenError::OutOfMemory) => ConnectError::OutOfMemory,
        ConnectFailure::Open(OpenError::Limit(limit)) => limit.into(),
        ConnectFailure::Open(OpenError::Transport(error)) => error.into(),
        ConnectFailure::Open(OpenError::DaemonFull) => ConnectError::DaemonFull { instance },
        ConnectFailure::Open(OpenError::Silent) => ConnectError::Silent { instance },
    })
}

/// The error of a session that finds no daemon.
pub(super) fn no_daemon(settings: &Settings) -> ConnectError {
    let looked_in = settings.dir.all().map(|dir| dir.path().to_owned()).collect();
    ConnectError::NoDaemon { instance: settings.instance.clone(), looked_in }
}

impl From<LinkError> for Error {
    fn from(error: LinkError) -> Self {
        match error {
            LinkError::TooManyFrames => Self::TooManyFrames,
            LinkError::OutOfMemory(error) => error.into(),
            LinkError::Limit(limit) => ConnectError::from(limit).into(),
            LinkError::NotSent(error) => Self::NotSent(error),
            LinkError::Transport(error) => error.into(),
            LinkError::Died => Self::DaemonDied,
            LinkError::Timeout { waited } => Self::Timeout { waited },
            LinkError::Reply(error) => error.into(),
        }
    }
}

impl From<Unsent> for Error {
    fn from(unsent: Unsent) -> Self {
        unsent.into_error().into()
    }
}

/// How the daemon was lost that a request could not be sent to.
pub(super) const fn loss_of(unsent: &Unsent) -> Loss {
    match unsent.error() {
        LinkError::Timeout { .. } => Loss::Silent,
        _ => Loss::Died,
    }
}
