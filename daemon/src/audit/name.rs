//! What the log calls what was checked.

use std::fmt;

/// A frame, a query, or an edit of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotedName {
    /// Of one client.
    Request {
        /// Token of the client.
        client_token: u64,
        /// The client's number of the request.
        frame: u64,
    },
    /// An edit of a scene that several sessions write, by its number among those that changed the scene.
    Tick(u64),
}

impl fmt::Display for NotedName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Request { client_token, frame } => {
                write!(f, "frame {frame} of client {client_token:016x}")
            }
            Self::Tick(number) => write!(f, "edit {number} of a shared scene"),
        }
    }
}
