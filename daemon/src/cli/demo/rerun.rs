//! `--rerun`: a recording for the viewer Rerun, written by its own Python package, which the viewer comes with. The crate
//! that writes one, `re_sdk`, would bring some 440 crates.

use std::io::{self, BufRead, BufReader, BufWriter, Read, Write};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, ChildStderr, ChildStdin, Command, Stdio};
use std::thread::JoinHandle;

use pairmask_core::Aabb;
use pairmask_core::oracle::Pair;

/// Reads frames, and writes the recording.
const SCRIPT: &str = include_str!("rerun.py");

/// Why there is no recording.
#[derive(Debug, thiserror::Error)]
pub enum RerunError {
    /// Python, or the package, is missing, or the file cannot be written.
    #[error("--rerun: {0}: it needs python3 with the package of the viewer: pip install rerun-sdk")]
    Start(String),
    /// It ended before all was written.
    #[error("--rerun: writing the recording: {0}")]
    Write(String),
}

/// A recording that is being written.
pub struct Recording {
    writer: Child,
    frames: BufWriter<ChildStdin>,
    /// The last line that it prints to stderr, once it has ended. A thread reads all of it, so that it never waits.
    last_line: JoinHandle<String>,
}

impl Recording {
    /// Starts the program that writes a file.
    ///
    /// # Errors
    /// [`RerunError::Start`].
    pub fn start(file: &Path) -> Result<Self, RerunError> {
        let mut command = Command::new("python3");
        command.args(["-c", SCRIPT]).arg(file);
        // Ctrl-C ends the demo, and the demo ends this.
        command.process_group(0);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let start = |error: io::Error| RerunError::Start(format!("python3: {error}"));
        let mut writer = command.spawn().map_err(start)?;
        let stderr = writer.stderr.take();
        let last_line = std::thread::spawn(move || last_line(stderr));
        let mut ready = String::new();
        if let Some(stdout) = writer.stdout.take() {
            BufReader::new(stdout).read_line(&mut ready).map_err(start)?;
        }
        match writer.stdin.take().filter(|_| ready == "ready\n") {
            Some(stdin) => Ok(Self { frames: BufWriter::new(stdin), writer, last_line }),
            None => Err(RerunError::Start(last_line.join().unwrap_or_default())),
        }
    }

    /// Adds a frame. Returns whether it could; [`end`](Self::end) says why not.
    pub fn add(&mut self, frame: u64, boxes: &[Aabb], pairs: &[Pair]) -> bool {
        let head = [frame as u32, boxes.len() as u32, pairs.len() as u32];
        let head = head.map(u32::to_le);
        let parts =
            [bytemuck::bytes_of(&head), bytemuck::cast_slice(boxes), bytemuck::cast_slice(pairs)];
        parts.iter().try_for_each(|part| self.frames.write_all(part)).is_ok()
    }

    /// Waits until all is written.
    ///
    /// # Errors
    /// [`RerunError::Write`].
    pub fn end(self) -> Result<(), RerunError> {
        let Self { mut writer, frames, last_line } = self;
        let is_flushed = frames.into_inner().is_ok();
        let has_ended = writer.wait().is_ok_and(|status| status.success());
        let line = last_line.join().unwrap_or_default();
        if is_flushed && has_ended { Ok(()) } else { Err(RerunError::Write(line)) }
    }
}

fn last_line(stderr: Option<ChildStderr>) -> String {
    let mut text = Vec::new();
    if let Some(mut stderr) = stderr {
        // What came until then is as good.
        let _ = stderr.read_to_end(&mut text);
    }
    String::from_utf8_lossy(&text).trim_end().lines().last().unwrap_or_default().to_owned()
}
