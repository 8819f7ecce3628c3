//! Runs a binary with a command line, under a watchdog, in a directory of its own.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::io::{Read, Write};
use std::marker::PhantomData;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use pairmask_core::Aabb;
use pairmaskd::cli::usage::one_line;
use serde_json::Value;
use tempfile::TempDir;

use crate::daemon::{within, without_probe};

/// A process that runs longer than this counts as hanging.
pub const TIMEOUT: Duration = Duration::from_secs(120);

pub trait Program {
    const BINARY: &str;
    const NAME: &str;
}

#[derive(Debug)]
pub struct Finished {
    pub name: &'static str,
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Finished {
    pub fn json(&self) -> Value {
        assert_eq!(self.code, Some(0), "{self:?}");
        serde_json::from_str(&self.stdout).unwrap_or_else(|e| panic!("{e}: {self:?}"))
    }

    /// The one line on stderr of a process that failed with `code`.
    pub fn error(&self, code: i32) -> &str {
        assert_eq!(self.code, Some(code), "{self:?}");
        let line = self.stderr.trim_end();
        let reported = line.strip_prefix(self.name).is_some_and(|rest| rest.starts_with(": "));
        assert!(reported && !line.contains('\n'), "{self:?}");
        line
    }
}

/// A directory for one test: files, instances, private daemons, configuration.
pub struct Sandbox<P> {
    dir: TempDir,
    program: PhantomData<P>,
}

impl<P: Program> Default for Sandbox<P> {
    fn default() -> Self {
        Self::new()
    }
}

impl<P: Program> Sandbox<P> {
    pub fn new() -> Self {
        Self { dir: tempfile::tempdir().expect("a temporary directory"), program: PhantomData }
    }

    pub fn path(&self) -> &Path {
        self.dir.path()
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.path().join(name)
    }

    pub fn boxes(&self, boxes: &[Aabb]) -> PathBuf {
        let path = self.file("boxes.f32");
        std::fs::write(&path, bytemuck::cast_slice(boxes)).expect("the directory can be written");
        path
    }

    /// A command of the program with arguments, an empty environment, and no GPU.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(P::BINARY);
        command.args(arguments).current_dir(self.path()).env_clear();
        command.env("PAIRMASK_GPU", "none");
        without_probe(&mut command);
        command.env("PAIRMASK_RUNTIME_DIR", self.path());
        command.env("TMPDIR", self.path()).env("XDG_CONFIG_HOME", self.path());
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    pub fn run(&self, arguments: &[&str]) -> Finished {
        finish(self.command(arguments).spawn().expect("the program starts"), P::NAME)
    }

    /// A command of the words of a line.
    pub fn line(&self, line: &str) -> Command {
        self.command(&line.split_whitespace().collect::<Vec<_>>())
    }

    pub fn run_line(&self, line: &str) -> Finished {
        finish(self.line(line).spawn().expect("the program starts"), P::NAME)
    }

    pub fn run_with_input(&self, arguments: &[&str], input: &[u8]) -> Finished {
        let child = self.command(arguments).stdin(Stdio::piped()).spawn();
        let mut child = child.expect("the program starts");
        // The input fits into the pipe, so that writing does not wait for the reader.
        child.stdin.take().expect("a pipe").write_all(input).expect("the pipe takes the input");
        finish(child, P::NAME)
    }

    pub fn entries(&self) -> BTreeSet<String> {
        let entries = std::fs::read_dir(self.path()).expect("the directory can be read");
        let name = |entry: std::io::Result<std::fs::DirEntry>| {
            entry.expect("an entry").file_name().to_string_lossy().into_owned()
        };
        entries.map(name).collect()
    }

    /// Processes of the program whose command line or environment names the directory.
    pub fn processes(&self) -> Vec<String> {
        let needle = self.path().to_string_lossy().into_owned();
        let mut found = Vec::new();
        for entry in std::fs::read_dir("/proc").expect("/proc").flatten() {
            // Processes that end meanwhile, or belong to others, cannot be read.
            let command = std::fs::read(entry.path().join("cmdline")).unwrap_or_default();
            let environment = std::fs::read(entry.path().join("environ")).unwrap_or_default();
            let command = String::from_utf8_lossy(&command).replace('\0', " ");
            if command.contains(P::BINARY)
                && (command.contains(&needle)
                    || String::from_utf8_lossy(&environment).contains(&needle))
            {
                found.push(command);
            }
        }
        found
    }

    /// Checks that all processes of this directory have ended and left only the files `kept`.
    pub fn assert_clean(&self, kept: &[&str]) {
        eventually("processes end", || self.processes().is_empty().then_some(()));
        let kept = kept.iter().map(ToString::to_string).collect();
        assert_eq!(self.entries(), kept);
    }
}

/// Waits for the end of a process of the program `name`, and kills one that hangs.
pub fn finish(mut child: Child, name: &'static str) -> Finished {
    let stdout = collect(child.stdout.take());
    let stderr = collect(child.stderr.take());
    let text = |reader: JoinHandle<String>| reader.join().expect("output is text");
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().expect("a child of ours") {
            break status;
        }
        if start.elapsed() > TIMEOUT {
            child.kill().expect("SIGKILL");
            child.wait().expect("its end");
            panic!("{name} hangs: {:?} {:?}", text(stdout), text(stderr));
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    Finished { name, code: status.code(), stdout: text(stdout), stderr: text(stderr) }
}

fn collect(stream: Option<impl Read + Send + 'static>) -> JoinHandle<String> {
    let mut stream = stream.expect("output is piped");
    std::thread::spawn(move || {
        let mut text = String::new();
        stream.read_to_string(&mut text).expect("output is text");
        text
    })
}

pub fn eventually<T>(what: &str, check: impl FnMut() -> Option<T>) -> T {
    within(TIMEOUT, what, check)
}

pub fn keys(value: &Value) -> BTreeSet<&str> {
    value.as_object().expect("an object").keys().map(String::as_str).collect()
}

/// Names in a text, for a comparison with [`keys`].
pub fn names(text: &str) -> BTreeSet<&str> {
    text.split_whitespace().collect()
}

/// The commands of a command line that have none below them, with the words that name them.
pub fn leaves(command: &clap::Command) -> Vec<(String, clap::Command)> {
    fn iterate(command: &clap::Command, path: &str, found: &mut Vec<(String, clap::Command)>) {
        for inner in command.get_subcommands().filter(|inner| inner.get_name() != "help") {
            let path = format!("{path} {}", inner.get_name());
            iterate(inner, &path, found);
            if !inner.has_subcommands() {
                found.push((path.trim_start().to_owned(), inner.clone()));
            }
        }
    }
    let (mut built, mut found) = (command.clone(), Vec::new());
    built.build();
    iterate(&built, "", &mut found);
    found
}

/// Checks that no message about a wrong number has Rust's words; how many messages there were.
pub fn check_numbers(command: &clap::Command) -> usize {
    let mut tried = 0;
    for (path, inner) in leaves(command) {
        for arg in inner.get_arguments().filter(|arg| arg.get_action().takes_values()) {
            let Some(long) = arg.get_long() else { continue };
            for value in ["0", "-1", "x", "", "99999999999999999999999"] {
                let line = format!("{} {path} --{long}={value}", command.get_name());
                let words: Vec<OsString> = line.split(' ').map(OsString::from).collect();
                let Err(error) = command.clone().try_get_matches_from(&words) else { continue };
                let text = one_line(&error, command, &words);
                for jargon in [" type", "digit found", "cannot parse", "zero for", "not in "] {
                    assert!(!text.contains(jargon), "{line}: {text}");
                }
                tried += 1;
            }
        }
    }
    tried
}

/// Checks that a command takes settings that others share, whether it uses them or not.
pub fn check_shared(command: &clap::Command, path: &str) {
    for flag in ["--runtime-dir", "--config", "--instance", "--isa"] {
        let line = format!("{} {flag} x {path} --help", command.get_name());
        let error = command.clone().try_get_matches_from(line.split(' ')).expect_err("help");
        assert_eq!(error.kind(), clap::error::ErrorKind::DisplayHelp, "{line}");
    }
}
