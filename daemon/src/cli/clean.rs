//! `clean`: removes what killed processes left.

use std::fmt::Write;
use std::path::Path;

use clap::Args;
use pairmask_transport::{LeftFile, left_files};
use pairmask_wire::InstanceError;
use serde_json::{Value, json};

use super::options::CommonOptions;
use super::output::{print_json, print_text, size_text};
use super::program::Result;
use crate::file_error::{Access, FileError};

/// Remove what killed daemons and clients left
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pairmaskd clean --dry-run            what would be removed
  pairmaskd clean --json

Files of your own in /dev/shm that no process has, and of instances of the runtime directory that
nobody serves. What belongs to a daemon or client that lives, or to another user, stays.")]
pub struct Clean {
    /// Remove nothing
    #[arg(long)]
    dry_run: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Clean {
    pub fn run(&self, common: &CommonOptions) -> Result {
        let dir = common.runtime_dir();
        match dir.check() {
            Err(InstanceError::Io { source, .. })
                if source.kind() == std::io::ErrorKind::NotFound => {}
            checked => checked?,
        }
        let (mut removed, mut failed) = (Vec::new(), Vec::new());
        for file in left_files(&dir) {
            match if self.dry_run { Ok(true) } else { file.remove() } {
                Ok(true) => removed.push(file),
                // Somebody else removed it, or its instance is served now.
                Ok(false) => {}
                Err(error) => failed.push(FileError::of(file.path, Access::Remove)(error)),
            }
        }
        if self.json {
            print_json(&report(self.dry_run, &removed, &failed))?;
        } else {
            print_text(&text(self.dry_run, &removed))?;
        }
        match failed.into_iter().next() {
            None => Ok(()),
            Some(error) => Err(error.into()),
        }
    }
}

fn bytes(files: &[LeftFile]) -> u64 {
    files.iter().map(|file| file.bytes).sum()
}

/// The object of `clean --json`, whose fields `CLI.md` explains. Fields may be added, never changed or taken away.
fn report(is_dry_run: bool, removed: &[LeftFile], failed: &[FileError]) -> Value {
    let shown = |path: &Path| path.display().to_string();
    let file = |file: &LeftFile| json!({ "path": shown(&file.path), "bytes": file.bytes });
    let problem = |error: &FileError| json!({ "path": shown(&error.path), "problem": error.source.to_string() });
    json!({
        "dry_run": is_dry_run,
        "files": removed.len(),
        "bytes": bytes(removed),
        "removed": removed.iter().map(file).collect::<Vec<_>>(),
        "failed": failed.iter().map(problem).collect::<Vec<_>>(),
    })
}

fn text(is_dry_run: bool, files: &[LeftFile]) -> String {
    let what = if is_dry_run { "would remove" } else { "removed" };
    let mut text = format!("{what} {} files, {}", files.len(), size_text(bytes(files)));
    for file in files {
        // Writing to a string cannot fail.
        let _ = write!(text, "\n  {}", file.path.display());
    }
    text
}
