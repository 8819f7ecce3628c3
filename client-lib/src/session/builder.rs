//! Describes a session.

use std::ffi::OsStr;
use std::time::Duration;

use pairmask_core::engine::{AvailableIsa, EngineChoice, IsaError};
use pairmask_core::mask::EncodingChoice;
use pairmask_core::units::BoxCount;
use pairmask_wire::{InstanceError, InstanceName};

use super::error::ConnectError;
use super::settings::{Backend, LONGEST_WAIT, Settings};
#[cfg(feature = "daemon")]
use crate::transport::RuntimeDir;

/// How long a waiting client spins beyond the time when it expects the answer, before it sleeps. A
/// spinning thread sees the answer within 1 µs and holds a core; a sleeping one is woken in 3 to 70
/// µs.
const DEFAULT_SPIN: Duration = Duration::from_micros(50);
/// How long [`Pending::wait`](super::Pending::wait) waits for a daemon that lives but
/// does not answer. No scene that fits a default reply takes as long.
const DEFAULT_DEADLINE: Duration = Duration::from_secs(5);
/// Describes a session; [`connect`](SessionBuilder::connect) makes it.
#[derive(Clone, Debug)]
#[must_use]
pub struct SessionBuilder {
    settings: Settings,
    instance: Result<InstanceName, String>,
    isa: Result<AvailableIsa, IsaError>,
}

/// The instruction set that the value of `PAIRMASK_ISA` names, else the widest of this machine.
fn isa_named(value: Option<&OsStr>) -> Result<AvailableIsa, IsaError> {
    match value.filter(|name| !name.is_empty()) {
        Some(name) => name.to_string_lossy().parse(),
        None => Ok(AvailableIsa::best()),
    }
}

impl Default for SessionBuilder {
    fn default() -> Self {
        Self {
            instance: Ok(InstanceName::default()),
            isa: isa_named(std::env::var_os("PAIRMASK_ISA").as_deref()),
            settings: Settings {
                backend: Backend::default(),
                instance: InstanceName::default(),
                #[cfg(feature = "daemon")]
                dir: RuntimeDir::from_env(),
                engine: EngineChoice::Auto,
                encoding: EncodingChoice::Auto,
                threads: None,
                iterate_threads: None,
                answer_repeats: true,
                isa: AvailableIsa::best(),
                spin: DEFAULT_SPIN,
                deadline: DEFAULT_DEADLINE,
                capacity: None,
            },
        }
    }
}

impl SessionBuilder {
    /// The instance to connect to; `default` unless set. [`connect`](Self::connect) returns an
    /// error if it is not a valid name.
    pub fn instance(mut self, name: &str) -> Self {
        self.instance = name.parse().map_err(|_| name.to_owned());
        self
    }

    /// Where the pairs are found; [`Backend::Auto`] unless set.
    pub fn backend(mut self, backend: Backend) -> Self {
        self.settings.backend = backend;
        self
    }

    /// The directory where instances live; unless set, `$PAIRMASK_RUNTIME_DIR`, else `pairmask` in
    /// `$XDG_RUNTIME_DIR`, else `/tmp/pairmask-UID`.
    #[cfg(feature = "daemon")]
    pub fn runtime_dir(mut self, dir: impl Into<RuntimeDir>) -> Self {
        self.settings.dir = dir.into();
        self
    }

    /// One engine and no other. With [`Backend::Auto`], a GPU engine has no in-process stand-in:
    /// without a daemon its frames fail.
    pub fn engine(mut self, engine: EngineChoice) -> Self {
        self.settings.engine = engine;
        self
    }

    /// One encoding and no other.
    pub fn encoding(mut self, encoding: EncodingChoice) -> Self {
        self.settings.encoding = encoding;
        self
    }

    /// Most threads of a frame; unless set, all of the pool, a daemon's or this program's. A frame takes as many as
    /// shorten it by enough for what they cost.
    pub fn threads(mut self, threads: usize) -> Self {
        self.settings.threads = Some(threads.max(1));
        self
    }

    /// Threads with which pairs are iterated over ([`PairMask::par_pairs`](super::PairMask::par_pairs)); one
    /// unless set. The plan weighs the time of that against that of finding the pairs: which
    /// engine and which encoding are best depends on it. The pairs do not.
    pub fn iterate_threads(mut self, threads: usize) -> Self {
        self.settings.iterate_threads = Some(threads.max(1));
        self
    }

    /// Whether a frame that is equal to the last one, bit by bit, gets that one's answer without an engine;
    /// `true` unless set. A paused game then costs a comparison of its boxes
    /// ([`SkipMeter::is_repeat`](pairmask_core::engine::SkipMeter::is_repeat) says so). Measurements of engines set it
    /// to `false`, or name an engine: a named engine always works.
    pub fn answer_repeats(mut self, answer_repeats: bool) -> Self {
        self.settings.answer_repeats = answer_repeats;
        self
    }

    /// The instruction set that engines of this process and decoders use: for measurements and tests;
    /// unless set, the one that `$PAIRMASK_ISA` names, else the widest of this machine. Pairs do not
    /// depend on it. A daemon has a setting of its own.
    pub fn isa(mut self, isa: AvailableIsa) -> Self {
        self.isa = Ok(isa);
        self
    }

    /// How long to spin for an answer beyond its expected time before sleeping; 50 µs unless set,
    /// zero never spins. A frame that takes more than 250 µs is slept through up to 120 µs before
    /// its expected end. More than a day is a day.
    pub fn spin(mut self, spin: Duration) -> Self {
        self.settings.spin = spin.min(LONGEST_WAIT);
        self
    }

    /// How long `wait` waits; 5 s unless set. More than a day is a day.
    pub fn deadline(mut self, deadline: Duration) -> Self {
        self.settings.deadline = deadline.min(LONGEST_WAIT);
        self
    }

    /// Boxes of the largest frame. Memory for three such frames is present as soon as the session is
    /// connected, and its segment never has to grow. Unless set, a frame's memory becomes present with the
    /// first frame that needs it, which takes 1 ms longer for each megabyte of boxes.
    pub fn capacity(mut self, boxes: BoxCount) -> Self {
        self.settings.capacity = Some(boxes);
        self
    }

    /// What was asked for, checked.
    pub(super) fn settings(mut self) -> Result<Settings, ConnectError> {
        self.settings.isa = self.isa?;
        self.settings.instance = self.instance.map_err(|name| InstanceError::Name { name })?;
        Ok(self.settings)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use pairmask_core::engine::Isa;

    use super::*;

    #[test]
    fn a_wait_without_end_is_one_of_a_day() {
        let builder = SessionBuilder::default().deadline(Duration::MAX).spin(Duration::MAX);
        assert_eq!([builder.settings.deadline, builder.settings.spin], [LONGEST_WAIT; 2]);
        assert!(Instant::now().checked_add(2 * LONGEST_WAIT).is_some());
        let short = Duration::from_millis(3);
        assert_eq!(builder.deadline(short).settings.deadline, short);
    }

    #[test]
    fn the_environment_names_a_set_of_this_machine_or_the_session_fails() {
        let named = |value: Option<&str>| isa_named(value.map(OsStr::new));
        assert_eq!(named(None), Ok(AvailableIsa::best()));
        assert_eq!(named(Some("")), Ok(AvailableIsa::best()), "blank counts as not set");
        assert_eq!(named(Some("portable")).map(AvailableIsa::get), Ok(Isa::Portable));
        let missing = Isa::ALL.into_iter().filter(|isa| !isa.is_available()).map(Isa::as_str);
        for wrong in ["fast"].into_iter().chain(missing) {
            let isa = named(Some(wrong));
            assert!(isa.is_err(), "{wrong}");
            let builder = SessionBuilder { isa, ..SessionBuilder::default() };
            let builder = builder.backend(Backend::InProcess);
            let error = builder.clone().connect().expect_err(wrong);
            assert!(matches!(error, ConnectError::Isa(_)), "{error}");
            assert!(builder.isa(AvailableIsa::best()).connect().is_ok(), "a setting goes first");
        }
    }
}
