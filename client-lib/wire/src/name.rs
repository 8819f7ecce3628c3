//! Names of instances, and the errors of a name or of an instance's place on disk.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

/// Name of an instance: 1 to 32 of `a-z 0-9 - _`. It becomes part of file names.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct InstanceName(String);

/// Bytes of the longest instance name. Names of shared memory files have a limit of 255 in all.
const MAX_NAME_BYTES: usize = 32;

impl InstanceName {
    /// The name as text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl Default for InstanceName {
    /// `default`: what `serve` and clients use when no name is given.
    fn default() -> Self {
        Self("default".to_owned())
    }
}

impl fmt::Display for InstanceName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl FromStr for InstanceName {
    type Err = InstanceError;

    fn from_str(s: &str) -> Result<Self, InstanceError> {
        let fits = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || c == b'-' || c == b'_';
        if s.is_empty() || s.len() > MAX_NAME_BYTES || !s.bytes().all(fits) {
            return Err(InstanceError::Name { name: s.to_owned() });
        }
        Ok(Self(s.to_owned()))
    }
}

/// Why an instance's place on disk cannot be used.
#[derive(Clone, Debug, thiserror::Error)]
pub enum InstanceError {
    /// Not a valid name.
    #[error("instance name '{name}' is not 1 to 32 of a-z, 0-9, '-' and '_'")]
    Name {
        /// What was given.
        name: String,
    },
    /// Another user owns the directory, a file in it, or a file of the transport.
    #[error("{} belongs to user {owner}, not to you: set PAIRMASK_RUNTIME_DIR to a directory of your own", path.display())]
    Foreign {
        /// The directory or file.
        path: PathBuf,
        /// Its owner's user id.
        owner: u32,
    },
    /// Other users may change a directory or file.
    #[error("{} is open to other users (mode {mode:o}): take their rights away with chmod, or set PAIRMASK_RUNTIME_DIR to a directory of your own", path.display())]
    Open {
        /// The directory or file.
        path: PathBuf,
        /// Its mode.
        mode: u32,
    },
    /// A daemon is to let a group in, and its directory is not open to that.
    #[error("{} is not open to group {group} alone: as a member of it, `chgrp {group}` and `chmod 2750` the directory, or name a new one by --runtime-dir", path.display())]
    NotOfGroup {
        /// The directory.
        path: PathBuf,
        /// The group's id.
        group: u32,
    },
    /// The path is a link, or not of the expected kind.
    #[error("{} is not {expected}: remove it, or set PAIRMASK_RUNTIME_DIR to another directory", path.display())]
    NotPlain {
        /// The path.
        path: PathBuf,
        /// The expected kind.
        expected: &'static str,
    },
    /// A daemon already serves this instance.
    #[error(
        "instance '{name}' is already served by process {pid}: stop it, or serve under another --instance name"
    )]
    AlreadyServed {
        /// The instance.
        name: InstanceName,
        /// Its process; 0 while that is not known.
        pid: u32,
    },
    /// The file system refused.
    #[error("{}: {source}: set PAIRMASK_RUNTIME_DIR to a directory that you may write to", path.display())]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// The system's error.
        source: Arc<std::io::Error>,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_checked() {
        for good in ["a", "world", "a-b_9"] {
            assert_eq!(
                good.parse::<InstanceName>().ok().as_ref().map(InstanceName::as_str),
                Some(good)
            );
        }
        for bad in ["", "A", "a/b", "..", "a b", &"x".repeat(33)] {
            assert!(bad.parse::<InstanceName>().is_err(), "{bad}");
        }
    }
}
