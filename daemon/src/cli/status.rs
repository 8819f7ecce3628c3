//! `status`: the instances of a runtime directory and the status of their daemons.

use std::fmt::Write;
use std::io::ErrorKind;
use std::time::{Duration, Instant};

use clap::Args;
use pairmask::{Backend, Error, Session};
use pairmask_transport::{DaemonRecord, GpuCounts, RuntimeDir};
use pairmask_wire::{
    AuditCounts, InstanceError, InstanceName, RecordedError, SkipTotals, StatusBody, StatusCode,
};
use serde::Serialize;

use super::config::Config;
use super::options::Place;
use super::output::{OutputError, print_json, print_text, time_text};
use super::skipped::Skipped;

/// A living daemon writes its status file within a second, or after the frame that it works on.
/// This is longer than most frames take, and short for a user who waits.
const DEADLINE: Duration = Duration::from_secs(3);
/// Time between two reads of the status file.
const LOOK: Duration = Duration::from_millis(10);

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

#[derive(Debug, thiserror::Error)]
pub enum StatusCommandError {
    #[error("no daemon answers under {}: start one with `pairmaskd serve`", dir.path().display())]
    NoDaemon { dir: RuntimeDir },
    #[error("no daemon of instance '{instance}' answers under {}: start one with `pairmaskd serve --instance {instance}`", dir.path().display())]
    NoInstance { instance: InstanceName, dir: RuntimeDir },
    #[error(transparent)]
    Place(#[from] InstanceError),
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// The JSON object of `status --json`, whose fields `CLI.md` explains. Fields may be added, never changed or taken away.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
struct StatusReport {
    runtime_dir: String,
    instances: Vec<InstanceReport>,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
struct InstanceReport {
    instance: String,
    state: State,
    version: String,
    pid: u32,
    supervisor_pid: u32,
    daemon: Option<DaemonReport>,
    problem: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum State {
    Alive,
    Silent,
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

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
struct DaemonReport {
    age_ns: u64,
    uptime_ns: u64,
    clients: u32,
    gpus_opening: u32,
    gpus: u32,
    frames: u64,
    boxes: u64,
    spheres: u64,
    pairs: u64,
    scenes: u32,
    scene_mib: u32,
    repeats: u64,
    skipped: Skipped,
    errors: u64,
    last_errors: Vec<ErrorReport>,
    audit: Option<AuditReport>,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
struct AuditReport {
    one_in: u64,
    frames: u64,
    skipped: u64,
    pairs: u64,
    missed: u64,
    extra: u64,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
struct ErrorReport {
    status: String,
    ago_ns: u64,
    client: String,
    frame: u64,
}

impl Status {
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), StatusCommandError> {
        let dir = place.runtime_dir(config);
        match dir.check() {
            Err(InstanceError::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {}
            checked => checked?,
        }
        let named = place.named_instance(config);
        let report = StatusReport::of(&dir, named.as_ref());
        if self.json {
            print_json(&report)?;
        } else if !report.instances.is_empty() {
            print_text(report.text().trim_end())?;
        }
        if report.instances.iter().any(|instance| instance.state == State::Alive) {
            Ok(())
        } else {
            Err(match named {
                Some(instance) => StatusCommandError::NoInstance { instance, dir },
                None => StatusCommandError::NoDaemon { dir },
            })
        }
    }
}

impl StatusReport {
    fn of(dir: &RuntimeDir, only: Option<&InstanceName>) -> Self {
        let mut found: Vec<(RuntimeDir, InstanceName, DaemonRecord)> = Vec::new();
        for dir in dir.all().filter(|dir| dir.check().is_ok()) {
            for (name, record) in dir.instances() {
                let is_wanted = only.is_none_or(|only| *only == name);
                match found.iter_mut().find(|(_, known, _)| *known == name) {
                    _ if !is_wanted => {}
                    None => found.push((dir.clone(), name, record)),
                    // Of two records of one name, the one that clients find.
                    Some(known) if !known.0.is_served(&name) && dir.is_served(&name) => {
                        *known = (dir.clone(), name, record);
                    }
                    Some(_) => {}
                }
            }
        }
        let report = |(dir, name, record)| InstanceReport::of(&dir, &name, &record);
        let instances = found.into_iter().map(report).collect();
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
        let (state, daemon, problem) = match ask(dir, name, record) {
            Answer::Alive(daemon) => (State::Alive, Some(daemon), None),
            Answer::Silent(daemon, problem) => (State::Silent, daemon, Some(problem)),
            Answer::Dead => {
                let problem = format!("process {} of instance '{name}' is gone", record.worker_pid);
                (State::Dead, None, Some(problem))
            }
        };
        Self {
            instance: name.to_string(),
            state,
            version: record.version.to_string(),
            pid: record.worker_pid,
            supervisor_pid: record.supervisor_pid,
            daemon,
            problem,
        }
    }

    fn write_to(&self, text: &mut String) -> std::fmt::Result {
        let Self { instance, state, version, pid, .. } = self;
        let state = state.as_str();
        writeln!(text, "{instance}: {state}, process {pid}, wire {version}")?;
        if let Some(problem) = &self.problem {
            writeln!(text, "  {problem}")?;
        }
        let Some(daemon) = &self.daemon else { return Ok(()) };
        let DaemonReport { clients, frames, boxes, spheres, pairs, errors, uptime_ns, .. } = daemon;
        let gpus = match (daemon.gpus_opening, daemon.gpus) {
            (0, 0) => String::new(),
            (0, open) => format!(", {open} GPU(s)"),
            (opening, 0) => format!(", opening {opening} GPU(s)"),
            (opening, open) => format!(", {open} GPU(s), opening {opening} more"),
        };
        writeln!(text, "  serving for {}, {clients} clients{gpus}", time_text(*uptime_ns))?;
        let spheres = if *spheres == 0 { String::new() } else { format!(" {spheres} spheres,") };
        writeln!(
            text,
            "  {frames} frames, {boxes} boxes,{spheres} {pairs} pairs, {errors} errors"
        )?;
        if daemon.skipped != Skipped::default() {
            writeln!(
                text,
                "  skipped {}; {} frames equal to the last",
                daemon.skipped, daemon.repeats
            )?;
        }
        if daemon.scenes > 0 {
            writeln!(text, "  {} scenes of {} MiB", daemon.scenes, daemon.scene_mib)?;
        }
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

/// What was learned of a daemon.
enum Answer {
    Alive(DaemonReport),
    /// The last known figures, and why the daemon counts as silent.
    Silent(Option<DaemonReport>, String),
    Dead,
}

/// Waits until the daemon writes a status file that is not the one of before the question. That takes no
/// client's slot, and compares no clocks.
fn ask(dir: &RuntimeDir, name: &InstanceName, record: &DaemonRecord) -> Answer {
    let (asked, mut before) = (Instant::now(), None);
    let watch = match dir.watch(name, Some(record)) {
        Ok(Some(watch)) => watch,
        Ok(None) => return Answer::Dead,
        Err(error) => return Answer::Silent(None, error.to_string()),
    };
    let beats = watch.beats();
    loop {
        if !watch.is_alive() {
            return Answer::Dead;
        }
        let status = match dir.read_status(name) {
            Ok(Some(status)) if status.body().pid == record.worker_pid => status,
            Ok(_) => return ask_over_wire(dir, name),
            Err(error) => return Answer::Silent(None, error.to_string()),
        };
        let age = dir.status_age(name);
        let report = DaemonReport::of(status.body(), status.skips(), status.gpus(), age);
        if *before.get_or_insert(status) != status {
            return Answer::Alive(report);
        }
        if asked.elapsed() >= DEADLINE {
            let age = time_text(report.age_ns);
            let how = match beats {
                None => "its process lives",
                Some(_) if watch.beats() == beats => {
                    "its worker is stopped, its heartbeat stands still"
                }
                Some(_) => "its worker runs, and does not serve",
            };
            let problem =
                format!("instance '{name}' does not answer: {how}; its counters are {age} old");
            return Answer::Silent(Some(report), problem);
        }
        std::thread::sleep(LOOK);
    }
}

/// Asks a daemon without a status file over the wire: it is of an earlier version, or could not
/// write one.
fn ask_over_wire(dir: &RuntimeDir, name: &InstanceName) -> Answer {
    let ask = || -> Result<StatusBody, Error> {
        Session::builder()
            .runtime_dir(dir.clone())
            .instance(name.as_str())
            .backend(Backend::Daemon)
            .deadline(DEADLINE)
            .connect()?
            .daemon_status()
    };
    match ask() {
        Ok(body) => {
            // The question itself takes one connection.
            let client_count = body.client_count.saturating_sub(1);
            let body = StatusBody { client_count, ..body };
            let (skips, gpus) = Default::default();
            Answer::Alive(DaemonReport::of(&body, &skips, gpus, Duration::ZERO))
        }
        Err(error) => Answer::Silent(None, error.to_string()),
    }
}

impl DaemonReport {
    fn of(body: &StatusBody, skips: &SkipTotals, gpus: GpuCounts, age: Duration) -> Self {
        Self {
            age_ns: age.as_nanos() as u64,
            uptime_ns: body.uptime_ns,
            clients: body.client_count,
            gpus_opening: gpus.opening,
            gpus: gpus.open,
            frames: body.frames,
            boxes: body.boxes,
            spheres: body.spheres,
            pairs: body.pairs,
            scenes: body.scenes,
            scene_mib: body.scene_mib,
            repeats: skips.repeats,
            skipped: skips.into(),
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
