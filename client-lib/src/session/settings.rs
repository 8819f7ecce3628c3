//! What a session was asked to be.

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use pairmask_core::engine::{AvailableIsa, EngineChoice, UnknownName};
use pairmask_core::mask::EncodingChoice;
use pairmask_core::units::BoxCount;
use pairmask_wire::InstanceName;

#[cfg(feature = "daemon")]
use crate::transport::RuntimeDir;

/// Where the pairs are found. The results are identical.
///
/// A build without the feature `daemon` answers in process: there `Auto` is `InProcess`, and a
/// session that forces `Daemon` gets [`ConnectError::NotBuiltIn`](super::ConnectError::NotBuiltIn).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Backend {
    /// The daemon where one answers, else in process. The session returns to the daemon by itself.
    #[default]
    Auto,
    /// The daemon, or an error.
    Daemon,
    /// The CPU engines of this library.
    InProcess,
}

impl fmt::Display for Backend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Auto => "auto",
            Self::Daemon => "daemon",
            Self::InProcess => "in-process",
        })
    }
}

impl FromStr for Backend {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        [Self::Auto, Self::Daemon, Self::InProcess]
            .into_iter()
            .find(|b| b.to_string() == s)
            .ok_or_else(|| UnknownName {
                name: s.to_owned(),
                known: "auto, daemon, in-process".into(),
            })
    }
}

/// Longest time of any wait: instants of a clock overflow beyond some time ahead, and nobody waits a day.
pub(super) const LONGEST_WAIT: Duration = Duration::from_secs(24 * 60 * 60);

/// Settings of a session.
#[derive(Clone, Debug)]
pub(super) struct Settings {
    pub backend: Backend,
    pub instance: InstanceName,
    #[cfg(feature = "daemon")]
    pub dir: RuntimeDir,
    pub engine: EngineChoice,
    pub encoding: EncodingChoice,
    pub threads: Option<usize>,
    pub iterate_threads: Option<usize>,
    pub answer_repeats: bool,
    pub isa: AvailableIsa,
    pub spin: Duration,
    pub deadline: Duration,
    /// Boxes of the frames that memory is made present for before the first one; `None` for none.
    pub capacity: Option<BoxCount>,
}

impl Settings {
    /// Whether only a GPU, and so only a daemon, has the engine that was named.
    pub fn needs_gpu(&self) -> bool {
        matches!(self.engine, EngineChoice::Only(engine) if engine.is_gpu())
    }
}
