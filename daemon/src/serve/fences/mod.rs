//! Fences of the worker: what its process may no longer do once it serves.
//!
//! The worker reads what other processes write, and runs drivers of GPUs on it. Should one of them take it over, it
//! can start no program, open none of the user's files and reach no network. The supervisor has no fences: it reads
//! nothing of clients, of the worker what any client reads, and starts the next worker.
//!
//! They are raised before the worker starts its first thread, and hold for all that it starts: Landlock is the calling
//! thread's and of those that it starts. GPUs are opened later, and again when they are lost, so a driver has to
//! open and run inside of them. None is an error where the kernel lacks it: the worker's record says which hold, and
//! `pairmaskd status` shows that.
//!
//! ```text
//! no-new-privs   programs with set-user-id give no rights
//! landlock       files and TCP ports by a list of what is allowed   (landlock)
//! seccomp        system calls by a list of what is denied           (seccomp)
//! rlimits        no core dumps
//! ```

mod landlock;
mod seccomp;

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use rustix::process::{Resource, Rlimit, setrlimit};
use rustix::thread::set_no_new_privs;

pub use self::landlock::driver_caches;
pub use self::seccomp::Refusal;
use super::ServeSettings;

/// One of the fences.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fence {
    /// `landlock` and `seccomp` bring it along: the kernel asks for it.
    NoNewPrivs,
    Landlock,
    Seccomp,
    Rlimits,
}

impl Fence {
    /// Their order is that of [`Fences::number`]: further ones follow.
    pub const ALL: [Self; 4] = [Self::NoNewPrivs, Self::Landlock, Self::Seccomp, Self::Rlimits];

    pub const fn as_str(self) -> &'static str {
        match self {
            Self::NoNewPrivs => "no-new-privs",
            Self::Landlock => "landlock",
            Self::Seccomp => "seccomp",
            Self::Rlimits => "rlimits",
        }
    }
}

/// The fences that a worker does without: names with commas between them, `all` or `none`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WithoutFences([bool; Fence::ALL.len()]);

impl WithoutFences {
    /// No fence at all: for a worker that is a thread of another program.
    pub const ALL: Self = Self([true; Fence::ALL.len()]);

    const fn contains(self, fence: Fence) -> bool {
        self.0[fence as usize]
    }
}

impl FromStr for WithoutFences {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "none" => return Ok(Self::default()),
            "all" => return Ok(Self::ALL),
            _ => {}
        }
        let mut without = Self::default();
        for name in text.split(',') {
            let fence = Fence::ALL.into_iter().find(|fence| fence.as_str() == name);
            let fence = fence.ok_or_else(|| {
                let names = Fence::ALL.map(Fence::as_str).join(", ");
                format!(
                    "'{name}' is no fence: write {names}, with commas between several, all or none"
                )
            })?;
            without.0[fence as usize] = true;
        }
        Ok(without)
    }
}

impl fmt::Display for WithoutFences {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<_> = Fence::ALL.into_iter().filter(|fence| self.contains(*fence)).collect();
        let names: Vec<_> = names.into_iter().map(Fence::as_str).collect();
        f.write_str(if names.is_empty() { "none".into() } else { names.join(",") }.as_str())
    }
}

/// How much of a fence holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FenceState {
    Holds,
    /// The kernel has an older version of it, with less.
    Partly,
    /// The kernel does not have it, or refused it.
    Unavailable,
    /// It is among [`WithoutFences`].
    Off,
}

impl FenceState {
    /// Their place is their number less one: 0 is that of a record without fences.
    const ALL: [Self; 4] = [Self::Holds, Self::Partly, Self::Unavailable, Self::Off];

    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Holds => "holds",
            Self::Partly => "partly",
            Self::Unavailable => "unavailable",
            Self::Off => "off",
        }
    }
}

/// The state of each fence of a worker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fences([FenceState; Fence::ALL.len()]);

/// Bits of a state in [`Fences::number`].
const STATE_BITS: u32 = 4;

impl Fences {
    pub const fn state(&self, fence: Fence) -> FenceState {
        self.0[fence as usize]
    }

    /// As a worker's record has them: four bits a fence, the first fence lowest.
    pub fn number(&self) -> u32 {
        self.0.iter().rev().fold(0, |number, state| number << STATE_BITS | (*state as u32 + 1))
    }

    /// The states behind a record's number; `None` where a worker of an earlier version has none.
    pub fn from_number(number: u32) -> Option<Self> {
        let mut states = [FenceState::Off; Fence::ALL.len()];
        for (place, state) in states.iter_mut().enumerate() {
            let bits = number >> (place as u32 * STATE_BITS) & ((1 << STATE_BITS) - 1);
            *state = *FenceState::ALL.get(bits.checked_sub(1)? as usize)?;
        }
        Some(Self(states))
    }
}

/// Why a fence could not be raised. It says so in the log, and the worker serves without it.
#[derive(Debug, thiserror::Error)]
enum FenceError {
    #[error(transparent)]
    System(#[from] std::io::Error),
    #[error(transparent)]
    Landlock(#[from] ::landlock::RulesetError),
    #[error(transparent)]
    Seccomp(#[from] seccompiler::BackendError),
}

impl From<rustix::io::Errno> for FenceError {
    fn from(errno: rustix::io::Errno) -> Self {
        Self::System(errno.into())
    }
}

/// Raises the fences around the process, which has this thread alone. The directories of the instance have to exist.
pub fn raise(settings: &ServeSettings) -> Fences {
    let without = settings.daemon.without_fences;
    let mut states = [FenceState::Off; Fence::ALL.len()];
    // Those first that the others need.
    for fence in Fence::ALL.into_iter().filter(|fence| !without.contains(*fence)) {
        let raised = match fence {
            Fence::NoNewPrivs => forbid_new_privileges(),
            Fence::Landlock => landlock::raise(settings),
            Fence::Seccomp => seccomp::raise(settings.refusal),
            Fence::Rlimits => forbid_core_dumps(),
        };
        let name = fence.as_str();
        states[fence as usize] = raised.unwrap_or_else(|error| {
            log::info!("serving without the fence {name}: {error}");
            FenceState::Unavailable
        });
    }
    let has =
        |fence: Fence| matches!(states[fence as usize], FenceState::Holds | FenceState::Partly);
    if has(Fence::Landlock) || has(Fence::Seccomp) {
        states[Fence::NoNewPrivs as usize] = FenceState::Holds;
    }
    Fences(states)
}

fn forbid_new_privileges() -> Result<FenceState, FenceError> {
    set_no_new_privs(true)?;
    Ok(FenceState::Holds)
}

/// A process of the same user can make the worker die, as often as it likes, and a core dump holds what all its
/// clients wrote: gigabytes.
fn forbid_core_dumps() -> Result<FenceState, FenceError> {
    setrlimit(Resource::Core, Rlimit { current: Some(0), maximum: Some(0) })?;
    Ok(FenceState::Holds)
}

/// The directories of an environment variable, as the dynamic loader and Vulkan's loader separate them.
fn paths_in(variable: &str) -> Vec<PathBuf> {
    let value = std::env::var_os(variable).unwrap_or_default();
    std::env::split_paths(&value).filter(|path: &PathBuf| Path::is_absolute(path)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip_and_others_are_refused() {
        for text in
            ["none", "landlock", "no-new-privs,seccomp", "no-new-privs,landlock,seccomp,rlimits"]
        {
            assert_eq!(text.parse::<WithoutFences>().expect(text).to_string(), text);
        }
        assert_eq!("all".parse(), Ok(WithoutFences::ALL));
        assert_eq!(WithoutFences::ALL.to_string().parse(), Ok(WithoutFences::ALL));
        for text in ["", "lock", "landlock,", "none,landlock", "landlock seccomp"] {
            let error = text.parse::<WithoutFences>().expect_err(text);
            assert!(error.contains("no-new-privs, landlock, seccomp, rlimits"), "{error}");
        }
    }

    #[test]
    fn states_round_trip_through_a_record() {
        let states = FenceState::ALL;
        for turn in 0..states.len() {
            let mut turned = states;
            turned.rotate_left(turn);
            let fences = Fences(turned);
            assert_eq!(Fences::from_number(fences.number()), Some(fences));
            // A later version has more fences.
            assert_eq!(Fences::from_number(fences.number() | 7 << 16), Some(fences));
        }
        assert_eq!(Fences::from_number(0), None);
        assert_eq!(Fences::from_number(0x0111), None, "one is missing");
        assert_eq!(Fences::from_number(0x1115), None, "a state that is not known");
    }
}
