//! Running the binary with a watchdog, in a directory of its own.

use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use pairmask::Aabb;
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::spawn::{PrivateDaemon, PrivateSettings};
use serde_json::Value;
use tempfile::TempDir;

pub const PAIRMASKD: &str = env!("CARGO_BIN_EXE_pairmaskd");

/// Nothing here takes as long; a hang ends here.
pub const PATIENCE: Duration = Duration::from_secs(120);

/// What a finished process left.
#[derive(Debug)]
pub struct Finished {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Finished {
    /// The JSON document on stdout, of a process that succeeded.
    pub fn json(&self) -> Value {
        assert_eq!(self.code, Some(0), "{self:?}");
        serde_json::from_str(&self.stdout).unwrap_or_else(|e| panic!("{e}: {self:?}"))
    }

    /// The one line on stderr of a process that failed with `code`.
    pub fn error(&self, code: i32) -> &str {
        assert_eq!(self.code, Some(code), "{self:?}");
        let line = self.stderr.trim_end();
        assert!(line.starts_with("pairmaskd: ") && !line.contains('\n'), "{self:?}");
        line
    }
}

/// A directory for one test: files, instances, private daemons, configuration.
pub struct Place {
    dir: TempDir,
}

impl Place {
    pub fn new() -> Self {
        Self { dir: tempfile::tempdir().unwrap() }
    }

    pub fn path(&self) -> &Path {
        self.dir.path()
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.path().join(name)
    }

    /// Writes a file of boxes.
    pub fn boxes(&self, boxes: &[Aabb]) -> PathBuf {
        let path = self.file("boxes.f32");
        std::fs::write(&path, bytemuck::cast_slice(boxes)).unwrap();
        path
    }

    /// `pairmaskd ARGUMENTS` with nothing of the caller's environment, and no GPU.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(PAIRMASKD);
        command.args(arguments).current_dir(self.path()).env_clear();
        command.env("PAIRMASK_GPU", "none");
        command.env("PAIRMASK_RUNTIME_DIR", self.path());
        command.env("TMPDIR", self.path()).env("XDG_CONFIG_HOME", self.path());
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    /// Runs it to its end.
    pub fn run(&self, arguments: &[&str]) -> Finished {
        finish(self.command(arguments).spawn().unwrap())
    }

    /// Runs it to its end with `input` on stdin.
    pub fn run_with_input(&self, arguments: &[&str], input: &[u8]) -> Finished {
        let mut child = self.command(arguments).stdin(Stdio::piped()).spawn().unwrap();
        // Small enough for the pipe: nobody has to read meanwhile.
        child.stdin.take().unwrap().write_all(input).unwrap();
        finish(child)
    }

    /// Names of what is in the directory.
    pub fn entries(&self) -> BTreeSet<String> {
        let entries = std::fs::read_dir(self.path()).unwrap();
        entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect()
    }

    /// Processes whose command line or environment names the directory.
    pub fn processes(&self) -> Vec<String> {
        let needle = self.path().to_string_lossy().into_owned();
        let mut found = Vec::new();
        for entry in std::fs::read_dir("/proc").unwrap().flatten() {
            // Processes that end meanwhile, or belong to others, cannot be read.
            let command = std::fs::read(entry.path().join("cmdline")).unwrap_or_default();
            let environment = std::fs::read(entry.path().join("environ")).unwrap_or_default();
            let command = String::from_utf8_lossy(&command).replace('\0', " ");
            if command.contains(PAIRMASKD)
                && (command.contains(&needle)
                    || String::from_utf8_lossy(&environment).contains(&needle))
            {
                found.push(command);
            }
        }
        found
    }

    /// Checks that whatever ran here has ended and cleaned up, but for `kept` files.
    pub fn assert_clean(&self, kept: &[&str]) {
        eventually("processes end", || self.processes().is_empty().then_some(()));
        let kept = kept.iter().map(ToString::to_string).collect();
        assert_eq!(self.entries(), kept);
    }
}

/// A daemon of the test's own.
pub fn daemon() -> PrivateDaemon {
    let settings = PrivateSettings { gpu: GpuChoice::None, ..PrivateSettings::default() };
    PrivateDaemon::start(PAIRMASKD.as_ref(), &settings).unwrap()
}

/// Waits for the end of a process, and kills it where it hangs.
pub fn finish(mut child: Child) -> Finished {
    let stdout = collect(child.stdout.take());
    let stderr = collect(child.stderr.take());
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if start.elapsed() > PATIENCE {
            child.kill().unwrap();
            child.wait().unwrap();
            panic!("pairmaskd hangs: {:?} {:?}", stdout.join(), stderr.join());
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    Finished { code: status.code(), stdout: stdout.join().unwrap(), stderr: stderr.join().unwrap() }
}

fn collect(stream: Option<impl Read + Send + 'static>) -> JoinHandle<String> {
    std::thread::spawn(move || {
        let mut text = String::new();
        stream.unwrap().read_to_string(&mut text).unwrap();
        text
    })
}

/// Waits until `check` gives something.
pub fn eventually<T>(what: &str, mut check: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(value) = check() {
            return value;
        }
        assert!(start.elapsed() < PATIENCE, "waited {PATIENCE:?} in vain: {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Names of an object's fields.
pub fn keys(value: &Value) -> BTreeSet<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

/// u32 words of a file.
pub fn words(path: &Path) -> Vec<u32> {
    let bytes = std::fs::read(path).unwrap();
    assert!(bytes.len().is_multiple_of(4), "{} bytes", bytes.len());
    bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}
