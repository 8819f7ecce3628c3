//! The auditor: it checks a share of the frames again with the oracle, in the background.
//!
//! A drawn frame costs two copies. Before the reply is sent, the serving thread copies the bits of
//! a window of the mask, at most 256 KiB, with the order of that window. After it is sent, the
//! thread copies the boxes of the window, at most 0.9 MB. No reply waits for a check: while the
//! auditor is busy with two windows, drawn frames count as skipped. Other frames cost one random
//! number.
//!
//! Up to 2,048 boxes the window is the whole frame. Of larger frames it is some rows against some
//! columns of the mask, drawn at random, because a naive comparison of all pairs takes longer than a
//! frame. Spheres are compared in exact rational arithmetic, a microsecond a pair: up to 256 of them
//! the window is the whole frame, and a larger frame's window has a 64th of the pairs that one of
//! boxes has.
//!
//! Of persistent scenes, one in so many is followed from its beginning to its end: each of its edits and
//! answers is copied, and so is a window of the answer to each query. While the auditor is far behind, an
//! edit counts as skipped, and its scene is followed no more. A scene that several sessions write is followed tick by
//! tick: all edits of a tick, and all that they changed, copied while its members wait for their parts.
//!
//! The boxes or spheres are copied after the reply was sent: a client that writes to a submitted frame may
//! spoil its own audit.
//!
//! ```text
//! window         which rows and columns, and their bits           (pure)
//! check          bits against the oracle                          (pure)
//! sphere_oracle  two spheres, in exact rational arithmetic        (pure)
//! scene          what a scene reported, added up, against the oracle  (pure)
//! thread         hands windows over and keeps the counts
//! ```

mod check;
mod scene;
pub mod sphere_oracle;
mod thread;
mod window;

pub use self::scene::SceneNote;
pub use self::thread::{AuditedFrame, AuditedScene, Auditor};
pub use self::window::Window;

use std::fmt;
use std::num::NonZeroU32;
use std::str::FromStr;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NotedName {
    Request {
        client_token: u64,
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

/// No frame, or one in N, drawn at random.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AuditRate {
    #[default]
    Off,
    OneIn(NonZeroU32),
}

impl FromStr for AuditRate {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        if s == "off" {
            return Ok(Self::Off);
        }
        let one_in = s.strip_prefix("1/").and_then(|n| n.parse().ok()).map(Self::OneIn);
        one_in.ok_or_else(|| {
            format!("'{s}' is no rate of audits: write 1/1000 for one frame in a thousand, or off")
        })
    }
}

impl fmt::Display for AuditRate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Off => f.write_str("off"),
            Self::OneIn(n) => write!(f, "1/{n}"),
        }
    }
}
