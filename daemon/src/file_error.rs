//! Errors of files, with advice in words.

use std::fmt;
use std::io::{self, ErrorKind};
use std::path::PathBuf;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    Read,
    Write,
    /// Create a directory, and files in it.
    WriteInto,
    Remove,
}

#[derive(Debug, thiserror::Error)]
#[error("{}: {}", path.display(), advice(*access, source))]
pub struct FileError {
    pub path: PathBuf,
    pub access: Access,
    pub source: io::Error,
}

impl FileError {
    pub fn of(path: impl Into<PathBuf>, access: Access) -> impl FnOnce(io::Error) -> Self {
        move |source| Self { path: path.into(), access, source }
    }
}

/// The problem and the advice: the end of a sentence that begins with the file's name.
pub fn advice(access: Access, error: &io::Error) -> impl fmt::Display {
    let text = match (error.kind(), access) {
        (ErrorKind::NotFound, Access::Read) => "there is no such file: check its name",
        (ErrorKind::NotFound, _) => "there is no such directory: create it, or name another",
        (ErrorKind::PermissionDenied, Access::Read) => {
            "you may not read it: change its permissions, or run as its owner"
        }
        (ErrorKind::PermissionDenied, Access::Remove) => {
            "you may not remove it: look at the permissions of its directory"
        }
        (ErrorKind::PermissionDenied, _) => {
            "you may not write there: change the permissions, or name another place"
        }
        (ErrorKind::IsADirectory, _) => "it is a directory: name a file",
        (ErrorKind::NotADirectory | ErrorKind::AlreadyExists, Access::WriteInto) => {
            "it is no directory: name another"
        }
        (ErrorKind::NotADirectory, _) => "a directory in its name is a file: check the name",
        (ErrorKind::StorageFull, _) => "the disk is full: free space, or name another place",
        (ErrorKind::ReadOnlyFilesystem, _) => "the disk is read-only: name another place",
        (ErrorKind::UnexpectedEof, _) => "it became shorter while it was read: try again",
        (ErrorKind::InvalidData, _) => "it is no text: check its name",
        _ => return without_number(error),
    };
    text.to_owned()
}

fn without_number(error: &io::Error) -> String {
    let text = error.to_string();
    text.split(" (os error").next().unwrap_or_default().to_owned()
}
