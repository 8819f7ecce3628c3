//! `status`: who serves, and how it goes.

use std::fmt::Write;
use std::time::Duration;

use clap::Args;
use pairmask::session::StatusError;
use pairmask::transport::{DaemonRecord, InstanceName, ProcessWatch, RuntimeDir};
use pairmask::wire::{AuditCounts, RecordedError, StatusBody, StatusCode};
use pairmask::{Backend, Session};
use serde::{Deserialize, Serialize};

use super::config::Config;
use super::options::Place;
use super::output::{OutputError, print_json, print_text, time_text};

/// A daemon that lives answers between two frames. This is longer than most frames take, and
/// short enough for somebody who waits at a terminal.
const DEADLINE: Duration = Duration::from_secs(3);

/// Show instances: version, clients, frames, last errors
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pairmaskd status                     every instance of the runtime directory
  pairmaskd status --instance world --json

Exit status: 0 where a daemon answers, 1 where none does.")]
pub struct Status {
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Why there is no status.
#[derive(Debug, thiserror::Error)]
pub enum StatusCommandError {
    /// Nobody answers.
    #[error("no daemon answers under {}: start one with `pairmaskd serve`", dir.path().display())]
    NoDaemon { dir: RuntimeDir },
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// The JSON object of `status --json`. Fields may be added, never changed or taken away.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct StatusReport {
    /// The directory that was looked through.
    runtime_dir: String,
    /// Its instances, by name.
    instances: Vec<InstanceReport>,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct InstanceReport {
    /// Its name.
    instance: String,
    state: State,
    /// Wire version, `major.minor`.
    version: String,
    /// Process that serves.
    pid: u32,
    /// Process that watches it.
    supervisor_pid: u32,
    /// What the daemon says of itself; null where it does not answer.
    daemon: Option<DaemonReport>,
    /// Why it does not answer; null where it does.
    problem: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum State {
    /// It answers.
    Alive,
    /// Its process lives and does not answer.
    Silent,
    /// Its process is gone and left its record behind.
    Dead,
}

impl State {
    const fn as_str(self) -> &'static str {
        match self {
            Self::Alive => "alive",
            Self::Silent => "silent",
            Self::Dead => "dead",
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct DaemonReport {
    /// Time since it began to serve.
    uptime_ns: u64,
    /// Clients that have a connection, without the one that asks.
    clients: u32,
    /// Frames answered with a mask.
    frames: u64,
    /// Boxes in those frames.
    boxes: u64,
    /// Spheres in those frames.
    spheres: u64,
    /// Pairs in those frames.
    pairs: u64,
    /// Requests answered with an error.
    errors: u64,
    /// The last of them, newest first.
    last_errors: Vec<ErrorReport>,
    /// What the auditor found; null where there is none (`serve --audit`).
    audit: Option<AuditReport>,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct AuditReport {
    /// One frame in so many is checked.
    one_in: u64,
    /// Frames checked.
    frames: u64,
    /// Frames drawn while the auditor was busy.
    skipped: u64,
    /// Pairs of boxes compared again.
    pairs: u64,
    /// Pairs that were not in the mask and overlap.
    missed: u64,
    /// Pairs that were in the mask and do not overlap.
    extra: u64,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct ErrorReport {
    /// What was wrong.
    status: String,
    /// How long ago.
    ago_ns: u64,
    /// The client's token, hexadecimal.
    client: String,
    /// The client's number of the frame.
    frame: u64,
}

impl Status {
    /// Looks through the runtime directory and asks every instance.
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), StatusCommandError> {
        let dir = place.runtime_dir(config);
        let report = StatusReport::of(&dir, place.named_instance(config).as_ref());
        if self.json {
            print_json(&report)?;
        } else if !report.instances.is_empty() {
            print_text(report.text().trim_end())?;
        }
        if report.instances.iter().any(|instance| instance.state == State::Alive) {
            Ok(())
        } else {
            Err(StatusCommandError::NoDaemon { dir })
        }
    }
}

impl StatusReport {
    fn of(dir: &RuntimeDir, only: Option<&InstanceName>) -> Self {
        let instances = dir
            .instances()
            .iter()
            .filter(|(name, _)| only.is_none_or(|only| only == name))
            .map(|(name, record)| InstanceReport::of(dir, name, record))
            .collect();
        Self { runtime_dir: dir.path().display().to_string(), instances }
    }

    fn text(&self) -> String {
        let mut text = String::new();
        for instance in &self.instances {
            // Writing to a string cannot fail.
            let _ = instance.write_to(&mut text);
        }
        text
    }
}

impl InstanceReport {
    fn of(dir: &RuntimeDir, name: &InstanceName, record: &DaemonRecord) -> Self {
        let (state, answer) = match ask(dir, name) {
            Ok(body) => (State::Alive, Ok(DaemonReport::of(&body))),
            Err(error) => {
                let lives = ProcessWatch::open(record.worker_pid).is_some();
                (if lives { State::Silent } else { State::Dead }, Err(error.to_string()))
            }
        };
        Self {
            instance: name.to_string(),
            state,
            version: record.version.to_string(),
            pid: record.worker_pid,
            supervisor_pid: record.supervisor_pid,
            problem: answer.as_ref().err().cloned(),
            daemon: answer.ok(),
        }
    }

    fn write_to(&self, text: &mut String) -> std::fmt::Result {
        let Self { instance, state, version, pid, .. } = self;
        writeln!(text, "{instance}: {}, process {pid}, wire {version}", state.as_str())?;
        if let Some(problem) = &self.problem {
            writeln!(text, "  {problem}")?;
        }
        let Some(daemon) = &self.daemon else { return Ok(()) };
        let DaemonReport { clients, frames, boxes, spheres, pairs, errors, uptime_ns, .. } = daemon;
        writeln!(text, "  serving for {}, {clients} clients", time_text(*uptime_ns))?;
        let spheres = if *spheres == 0 { String::new() } else { format!(" {spheres} spheres,") };
        writeln!(
            text,
            "  {frames} frames, {boxes} boxes,{spheres} {pairs} pairs, {errors} errors"
        )?;
        if let Some(AuditReport { one_in, frames, skipped, pairs, missed, extra }) = &daemon.audit {
            writeln!(
                text,
                "  audit of 1/{one_in}: {frames} frames, {pairs} pairs, {missed} missed, {extra} extra, {skipped} frames skipped"
            )?;
        }
        for error in &daemon.last_errors {
            let ErrorReport { status, ago_ns, client, frame } = error;
            let ago = time_text(*ago_ns);
            writeln!(text, "  {status} {ago} ago, client {client}, frame {frame}")?;
        }
        Ok(())
    }
}

fn ask(dir: &RuntimeDir, name: &InstanceName) -> Result<StatusBody, StatusError> {
    Session::builder()
        .runtime_dir(dir.clone())
        .instance(name.as_str())
        .backend(Backend::Daemon)
        .deadline(DEADLINE)
        .connect()?
        .daemon_status()
}

impl DaemonReport {
    fn of(body: &StatusBody) -> Self {
        Self {
            uptime_ns: body.uptime_ns,
            // The question itself came through a connection.
            clients: body.client_count.saturating_sub(1),
            frames: body.frames,
            boxes: body.boxes,
            spheres: body.spheres,
            pairs: body.pairs,
            errors: body.errors,
            last_errors: body
                .last_errors
                .iter()
                .filter(|error| error.status != StatusCode::Ok as u32)
                .map(|error| ErrorReport::of(error, body.uptime_ns))
                .collect(),
            audit: (body.audit.one_in != 0).then(|| AuditReport::of(&body.audit)),
        }
    }
}

impl AuditReport {
    fn of(counts: &AuditCounts) -> Self {
        let AuditCounts { one_in, frames, skipped, pairs, missed, extra } = *counts;
        Self { one_in, frames, skipped, pairs, missed, extra }
    }
}

impl ErrorReport {
    fn of(error: &RecordedError, uptime_ns: u64) -> Self {
        let code = StatusCode::from_wire(error.status);
        Self {
            status: code.map_or_else(|| format!("code {}", error.status), |c| c.as_str().into()),
            ago_ns: uptime_ns.saturating_sub(error.at_ns),
            client: format!("{:016x}", error.client_token),
            frame: error.frame,
        }
    }
}
