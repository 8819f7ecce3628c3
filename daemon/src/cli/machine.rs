//! Machine and build of a measurement, without which its figures mean nothing.

use std::fmt;
use std::sync::LazyLock;

use pairmask_wire::Version;
use serde::{Deserialize, Serialize};

/// The commit of this build, as `git describe` names it, or `unknown`.
const COMMIT: &str = env!("PAIRMASK_COMMIT");

static VERSION: LazyLock<String> = LazyLock::new(|| {
    format!("{} (wire {}, commit {COMMIT})", env!("CARGO_PKG_VERSION"), Version::CURRENT)
});

pub fn version() -> &'static str {
    &VERSION
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    pub cpu: String,
    pub cores: usize,
    pub os: String,
    pub kernel: String,
    pub toolchain: String,
    pub commit: String,
    pub command: String,
}

impl Machine {
    pub fn this() -> Self {
        let unknown = || "unknown".to_owned();
        Self {
            cpu: value("/proc/cpuinfo", "model name", ':').unwrap_or_else(unknown),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            os: value("/etc/os-release", "PRETTY_NAME", '=').unwrap_or_else(unknown),
            kernel: std::fs::read_to_string("/proc/sys/kernel/osrelease")
                .map_or_else(|_| unknown(), |text| text.trim().to_owned()),
            toolchain: env!("PAIRMASK_TOOLCHAIN").to_owned(),
            commit: COMMIT.to_owned(),
            command: command_line(),
        }
    }
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { cpu, cores, os, kernel, toolchain, commit, .. } = self;
        write!(f, "{cpu}, {cores} cores; {os}, {kernel}\n{toolchain}; commit {commit}")
    }
}

pub fn command_line() -> String {
    let mut words = std::env::args_os().map(|word| word.to_string_lossy().into_owned());
    let program = words.next().unwrap_or_default();
    let name = program.rsplit('/').next().unwrap_or_default().to_owned();
    std::iter::once(name).chain(words).collect::<Vec<_>>().join(" ")
}

/// The value of a key in a file of lines.
pub(super) fn value(path: &str, key: &str, separator: char) -> Option<String> {
    let text = std::fs::read_to_string(path).ok()?;
    text.lines().find_map(|line| {
        let (found, value) = line.split_once(separator)?;
        (found.trim() == key).then(|| value.trim().trim_matches('"').to_owned())
    })
}
