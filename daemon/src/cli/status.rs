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
use serde_json::{Value, json};

use super::metrics::{self, Format, Scrape};
use super::options::CommonOptions;
use super::output::{print_json, print_text, size_text, time_text, write_stdout};
use super::program::{self, Fault};
use super::rates::{ClientRates, Look, Rates};
use super::skipped::Skipped;
use crate::daemon_cpu::{cpu_of, nanoseconds_a};
use crate::serve::fences::{Fence, FenceState, Fences};

/// A living daemon writes its status file within a second, or after the frame that it works on.
/// This is longer than most frames take, and short for a user who waits.
const DEADLINE: Duration = Duration::from_secs(3);
const LOOK: Duration = Duration::from_millis(10);

/// Rates are of so much time at least: a game's frame takes a tenth of it.
const RATE_TIME: Duration = Duration::from_millis(200);

/// Show instances: version, clients, frames, last errors
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pairmaskd status                     every instance of the runtime directory
  pairmaskd status --instance world --json
  pairmaskd status --metrics           OpenMetrics, for Prometheus and its like

Exit status: 0 where a daemon answers, 1 where none does.")]
pub struct Status {
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Print metrics, as `OpenMetrics` text
    #[arg(long, conflicts_with = "json")]
    metrics: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum State {
    Alive,
    Silent,
    Dead,
}

pub(super) struct Instance {
    pub(super) name: InstanceName,
    pub(super) record: DaemonRecord,
    pub(super) state: State,
    counters: Option<Counters>,
    pub(super) problem: Option<String>,
    /// What its clients did while it was asked, or before it died.
    rates: Option<Rates>,
}

struct Counters {
    body: StatusBody,
    skips: SkipTotals,
    gpus: GpuCounts,
    age: Duration,
    /// CPU time of the worker since it began; `None` where /proc does not show it.
    cpu: Option<Duration>,
}

impl Status {
    pub fn run(&self, common: &CommonOptions) -> program::Result {
        let dir = common.runtime_dir();
        match dir.check() {
            Err(InstanceError::Io { source, .. }) if source.kind() == ErrorKind::NotFound => {}
            checked => checked?,
        }
        let named = common.named_instance();
        if self.metrics {
            let found = records(&dir, named.as_ref());
            let scrapes: Vec<Scrape> =
                found.iter().map(|(dir, name, _)| Scrape::of(dir, name)).collect();
            write_stdout(metrics::text(&scrapes, Format::OpenMetrics).as_bytes())?;
            let is_alive = scrapes.iter().any(Scrape::is_alive);
            return if is_alive { Ok(()) } else { Err(none_answers(&dir, named.as_ref())) };
        }
        let instances = instances(&dir, named.as_ref());
        if self.json {
            let reports: Vec<Value> = instances.iter().map(Instance::json).collect();
            let runtime_dir = dir.path().display().to_string();
            print_json(&json!({"runtime_dir": runtime_dir, "instances": reports}))?;
        } else if !instances.is_empty() {
            let mut text = String::new();
            // Writing to a string cannot fail.
            let _ = instances.iter().try_for_each(|instance| instance.write_to(&mut text));
            print_text(text.trim_end())?;
        }
        if instances.iter().any(|instance| instance.state == State::Alive) {
            Ok(())
        } else {
            Err(none_answers(&dir, named.as_ref()))
        }
    }
}

/// The error where no daemon answers.
pub(super) fn none_answers(dir: &RuntimeDir, named: Option<&InstanceName>) -> Fault {
    let dir = dir.path().display();
    let none = match named {
        None => format!("no daemon answers under {dir}: start one with `pairmaskd serve`"),
        Some(name) => format!(
            "no daemon of instance '{name}' answers under {dir}: \
             start one with `pairmaskd serve --instance {name}`"
        ),
    };
    none.into()
}

pub(super) fn instances(dir: &RuntimeDir, only: Option<&InstanceName>) -> Vec<Instance> {
    let found = records(dir, only).into_iter();
    found.map(|(dir, name, record)| Instance::of(&dir, name, record)).collect()
}

/// The instances that have a record, each in the directory where clients find it.
pub(super) fn records(
    dir: &RuntimeDir,
    only: Option<&InstanceName>,
) -> Vec<(RuntimeDir, InstanceName, DaemonRecord)> {
    let mut found: Vec<(RuntimeDir, InstanceName, DaemonRecord)> = Vec::new();
    for dir in dir.all().filter(|dir| dir.check().is_ok()) {
        for (name, record) in dir.instances() {
            let is_requested = only.is_none_or(|only| *only == name);
            match found.iter_mut().find(|(_, known, _)| *known == name) {
                _ if !is_requested => {}
                None => found.push((dir.clone(), name, record)),
                // Of two records of one name, the one that clients find.
                Some(known) if !known.0.is_served(&name) && dir.is_served(&name) => {
                    *known = (dir.clone(), name, record);
                }
                Some(_) => {}
            }
        }
    }
    found
}

impl Instance {
    fn of(dir: &RuntimeDir, name: InstanceName, record: DaemonRecord) -> Self {
        let before = look(dir, &name);
        let (state, counters, problem) = match ask(dir, &name, &record) {
            Ok(Some(counters)) => (State::Alive, Some(counters), None),
            Err(silent) => (State::Silent, silent.0, Some(silent.1)),
            Ok(None) => {
                let problem =
                    format!("process {} of instance '{name}' has exited", record.worker_pid);
                (State::Dead, None, Some(problem))
            }
        };
        let rates = before.and_then(|before| {
            if state == State::Alive && !before.sample.clients.is_empty() {
                std::thread::sleep((before.at + RATE_TIME).saturating_sub(look(dir, &name)?.at));
            }
            Some(Rates::between(&before, &look(dir, &name)?))
        });
        Self { name, record, state, counters, problem, rates }
    }

    /// An element of `instances` of `status --json`, whose fields `CLI.md` explains. Fields may be added, never
    /// changed or taken away.
    pub(super) fn json(&self) -> Value {
        json!({
            "instance": self.name.as_str(),
            "state": self.state,
            "version": self.record.version.to_string(),
            "pid": self.record.worker_pid,
            "supervisor_pid": self.record.supervisor_pid,
            "fences": Fences::from_number(self.record.fences).map(fences_json),
            "daemon": self.counters.as_ref().map(Counters::json),
            "problem": self.problem,
            "counters": self.rates,
        })
    }

    fn write_to(&self, text: &mut String) -> std::fmt::Result {
        let state = format!("{:?}", self.state).to_lowercase();
        let DaemonRecord { worker_pid, version, .. } = &self.record;
        writeln!(text, "{}: {state}, process {worker_pid}, wire {version}", self.name)?;
        if let Some(problem) = &self.problem {
            writeln!(text, "  {problem}")?;
        }
        if let Some(fences) = Fences::from_number(self.record.fences) {
            writeln!(text, "  fences: {}", fences_text(fences))?;
        }
        self.counters.as_ref().map_or(Ok(()), |counters| counters.write_to(text))?;
        let rates = self.rates.iter().filter(|_| self.state != State::Dead);
        rates.flat_map(|rates| &rates.clients).try_for_each(|client| write_client(client, text))
    }
}

impl Counters {
    fn json(&self) -> Value {
        let Self { body, skips, gpus, age, cpu } = self;
        let AuditCounts { one_in, frames, skipped, pairs, missed, extra } = body.audit;
        let audit = json!({
            "one_in": one_in,
            "frames": frames,
            "skipped": skipped,
            "pairs": pairs,
            "missed": missed,
            "extra": extra,
        });
        let error = |error: &RecordedError| {
            json!({
                "status": status_text(error),
                "ago_ns": body.uptime_ns.saturating_sub(error.at_ns),
                "client": format!("{:016x}", error.client_token),
                "frame": error.frame,
            })
        };
        json!({
            "age_ns": age.as_nanos() as u64,
            "uptime_ns": body.uptime_ns,
            "cpu_ns": cpu.map(|cpu| cpu.as_nanos() as u64),
            "clients": body.client_count,
            "gpus_opening": gpus.opening,
            "gpus": gpus.open,
            "frames": body.frames,
            "boxes": body.boxes,
            "spheres": body.spheres,
            "pairs": body.pairs,
            "scenes": body.scenes,
            "scene_mib": body.scene_mib,
            "repeats": skips.repeats,
            "skipped": Skipped::from(skips),
            "errors": body.errors,
            "last_errors": self.last_errors().map(error).collect::<Vec<_>>(),
            "audit": (one_in != 0).then_some(audit),
        })
    }

    fn last_errors(&self) -> impl Iterator<Item = &RecordedError> {
        self.body.last_errors.iter().filter(|error| error.status != StatusCode::Ok as u32)
    }

    fn write_to(&self, text: &mut String) -> std::fmt::Result {
        let Self { body, skips, gpus, cpu, .. } = self;
        let StatusBody { client_count, frames, boxes, spheres, pairs, errors, .. } = body;
        let gpus = match (gpus.opening, gpus.open) {
            (0, 0) => String::new(),
            (0, open) => format!(", {open} GPU(s)"),
            (opening, 0) => format!(", opening {opening} GPU(s)"),
            (opening, open) => format!(", {open} GPU(s), opening {opening} more"),
        };
        let uptime = time_text(body.uptime_ns);
        writeln!(text, "  serving for {uptime}, {client_count} clients{gpus}")?;
        let spheres = if *spheres == 0 { String::new() } else { format!(" {spheres} spheres,") };
        writeln!(
            text,
            "  {frames} frames, {boxes} boxes,{spheres} {pairs} pairs, {errors} errors"
        )?;
        if let Some(cpu) = cpu {
            let [all, each] = [1, *frames].map(|shares| time_text(nanoseconds_a(*cpu, shares)));
            let a_frame = if *frames == 0 { String::new() } else { format!(", {each} a frame") };
            writeln!(text, "  CPU time {all}{a_frame}")?;
        }
        let skipped = Skipped::from(skips);
        if skipped != Skipped::default() {
            writeln!(text, "  skipped {skipped}; {} frames equal to the last", skips.repeats)?;
        }
        if body.scenes > 0 {
            writeln!(text, "  {} scenes of {} MiB", body.scenes, body.scene_mib)?;
        }
        let AuditCounts { one_in, frames, skipped, pairs, missed, extra } = body.audit;
        if one_in != 0 {
            writeln!(
                text,
                "  audit of 1/{one_in}: {frames} frames, {pairs} pairs, {missed} missed, {extra} extra, {skipped} frames skipped"
            )?;
        }
        for error in self.last_errors() {
            let ago = time_text(body.uptime_ns.saturating_sub(error.at_ns));
            let RecordedError { client_token, frame, .. } = error;
            let status = status_text(error);
            writeln!(text, "  {status} {ago} ago, client {client_token:016x}, frame {frame}")?;
        }
        Ok(())
    }
}

fn look(dir: &RuntimeDir, name: &InstanceName) -> Option<Look> {
    // Counters that cannot be read are not shown; that the instance is another user's, the question has said.
    Look::read(dir, name).ok().flatten()
}

fn write_client(client: &ClientRates, text: &mut String) -> std::fmt::Result {
    let ClientRates { session, process, name, frames_per_second, boxes, pairs, .. } = client;
    write!(
        text,
        "  client #{session}, {name}, process {process}: {frames_per_second:.1} frames/s"
    )?;
    if let Some(engine) = client.engine {
        write!(text, ", {boxes} boxes, {pairs} pairs by {engine}")?;
    }
    if let Some(total_ns) = client.stages.total_ns {
        let percent = client.cpu_share * 100.0;
        write!(text, ", {} a frame, {percent:.1} % of a core", time_text(total_ns))?;
    }
    if !client.scenes.is_empty() {
        write!(text, ", {} scenes", client.scenes.len())?;
    }
    if client.errors > 0 {
        write!(text, ", {} errors", client.errors)?;
    }
    writeln!(text, ", {}", size_text(client.memory_bytes))
}

/// The states by the names of the fences.
fn fences_json(fences: Fences) -> Value {
    let state = |fence: Fence| (fence.as_str().to_owned(), fences.state(fence).as_str().into());
    Value::Object(Fence::ALL.into_iter().map(state).collect())
}

pub(super) fn fences_text(fences: Fences) -> String {
    let text = |fence: Fence| match fences.state(fence) {
        FenceState::Holds => fence.as_str().to_owned(),
        other => format!("{} ({})", fence.as_str(), other.as_str()),
    };
    Fence::ALL.map(text).join(", ")
}

fn status_text(error: &RecordedError) -> String {
    let code = StatusCode::from_wire(error.status);
    code.map_or_else(|| format!("code {}", error.status), |code| code.as_str().into())
}

/// The figures of a daemon; `None` where it is dead, and an error with the last ones where it is silent.
type Answer = Result<Option<Counters>, Box<(Option<Counters>, String)>>;

/// Waits until the daemon writes a status file that is not the one of before the question. That takes no
/// client's slot, and compares no clocks.
fn ask(dir: &RuntimeDir, name: &InstanceName, record: &DaemonRecord) -> Answer {
    let unknown = |error: &dyn std::error::Error| Box::new((None, error.to_string()));
    let (asked, mut before) = (Instant::now(), None);
    let Some(watch) = dir.watch(name, Some(record)).map_err(|error| unknown(&error))? else {
        return Ok(None);
    };
    let beats = watch.beats();
    loop {
        if !watch.is_alive() {
            return Ok(None);
        }
        let status = match dir.read_status(name).map_err(|error| unknown(&error))? {
            Some(status) if status.body.pid == record.worker_pid => status,
            _ => return ask_over_wire(dir, name),
        };
        let (body, skips, gpus) = (status.body, status.skips, status.gpus);
        let counters =
            Counters { body, skips, gpus, age: dir.status_age(name), cpu: cpu_of(body.pid) };
        if *before.get_or_insert(status) != status {
            return Ok(Some(counters));
        }
        if asked.elapsed() >= DEADLINE {
            let age = time_text(counters.age.as_nanos() as u64);
            let how = match beats {
                None => "its process lives",
                Some(_) if watch.beats() == beats => {
                    "its worker is stopped, its heartbeat stands still"
                }
                Some(_) => "its worker runs, and does not serve",
            };
            let problem =
                format!("instance '{name}' does not answer: {how}; its counters are {age} old");
            return Err(Box::new((Some(counters), problem)));
        }
        std::thread::sleep(LOOK);
    }
}

/// Asks a daemon over the wire that is of an earlier version, or could not write a status file.
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
    let body = ask().map_err(|error| Box::new((None, error.to_string())))?;
    // The question itself takes one connection.
    let client_count = body.client_count.saturating_sub(1);
    let body = StatusBody { client_count, ..body };
    let ((skips, gpus), age) = Default::default();
    Ok(Some(Counters { body, skips, gpus, age, cpu: cpu_of(body.pid) }))
}
