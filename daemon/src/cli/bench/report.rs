//! The report of a measurement: as text, and as the JSON that `CLI.md` documents.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::latency::Wait;
use super::load::{Case, GroupFigures};
use super::measured::Figures;
use crate::cli::machine::Machine;
use crate::cli::percentiles::Percentiles;
use crate::precision::PrecisionChoice;

/// The JSON object of `bench latency --json`. Fields may be added, never changed or taken away.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LatencyReport {
    /// The machine of the measurement.
    pub machine: Machine,
    /// One row for every wait, scene and precision; of a load for every rate and size of clients too.
    pub rows: Vec<LatencyRow>,
    /// What daemons use while the clients of a load send nothing, one for every wait.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub idle: Vec<IdleRow>,
}

/// A daemon whose clients send nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IdleRow {
    /// How both sides waited.
    pub wait: String,
    /// Clients that were connected.
    pub clients: u32,
    /// What the daemon used of a core, percent.
    pub daemon_cpu_percent: f64,
}

/// Latencies of one scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LatencyRow {
    /// Boxes.
    pub n: u32,
    /// Where the pairs were found: `daemon` or `in-process`.
    pub backend: String,
    /// How both sides waited: `spin`, `event` or `serve`.
    pub wait: String,
    /// The engine.
    pub engine: String,
    /// Precision of the boxes: `exact`, `q16`, `q8`, `f16` or `margin=X`.
    pub precision: String,
    /// Bytes of the boxes of one request.
    pub box_bytes: u64,
    /// Frames measured.
    pub frames: u64,
    /// Frames for which a request was made; `margin=X` answers the others from an earlier mask.
    pub requests: u64,
    /// Threads of the client, which wrote exact boxes and visited the pairs; 1 in records of older
    /// versions.
    #[serde(default = "one")]
    pub decode_threads: u64,
    /// Fill and answer: the whole frame, frame by frame.
    pub total_ns: Percentiles,
    /// Time to borrow memory and write the boxes into it.
    pub fill_ns: Percentiles,
    /// Round trip and decode: from boxes written to the last pair visited. Zeros in records of older
    /// versions.
    #[serde(default)]
    pub answer_ns: Percentiles,
    /// From submission to the mask.
    pub round_trip_ns: Percentiles,
    /// The engine's part of the round trip.
    pub engine_ns: Percentiles,
    /// The round trip less the engine's part, frame by frame.
    pub added_ns: Percentiles,
    /// Time to visit every pair of the mask once.
    pub decode_ns: Percentiles,
    /// What the daemon used of a core meanwhile, percent, for all its clients; `None` where no daemon
    /// was asked, and in records of older versions.
    #[serde(default)]
    pub daemon_cpu_percent: Option<f64>,
    /// What a load has beside the rest; `None` for one client in a closed loop.
    #[serde(flatten)]
    pub load: Option<LoadRow>,
}

/// The fields of clients that are processes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoadRow {
    /// Frames a second of each client, or `closed`.
    pub rate: String,
    /// Clients of this size.
    pub clients: u32,
    /// Clients of all sizes, which ran at the same time.
    pub clients_in_all: u32,
    /// Frames a second of this size's clients together.
    pub frames_per_second: f64,
    /// The largest of these clients' median round trips.
    pub worst_client_p50_ns: u64,
    /// Frames that were due before the client was done with the one before.
    pub late_frames: u64,
    /// From when a frame was due to its last pair; zeros in a closed loop.
    pub from_due_ns: Percentiles,
}

impl LatencyRow {
    /// The row of a finished measurement.
    pub fn new(n: u32, precision: PrecisionChoice, wait: Wait, figures: &Figures) -> Self {
        let stages = &figures.stages;
        Self {
            n,
            backend: figures.backend.clone(),
            wait: wait.to_string(),
            engine: figures.engine.clone(),
            precision: precision.to_string(),
            box_bytes: figures.box_bytes,
            frames: figures.frames,
            requests: figures.requests,
            decode_threads: 1,
            total_ns: stages.total.percentiles(),
            fill_ns: stages.fill.percentiles(),
            answer_ns: stages.answer.percentiles(),
            round_trip_ns: stages.round_trip.percentiles(),
            engine_ns: stages.engine.percentiles(),
            added_ns: stages.added.percentiles(),
            decode_ns: stages.decode.percentiles(),
            daemon_cpu_percent: None,
            load: None,
        }
    }

    /// The row of a measurement with a client of `threads` threads.
    pub fn decoded_by(self, threads: usize) -> Self {
        Self { decode_threads: threads as u64, ..self }
    }

    /// The row of a measurement during which the daemon used so much of a core.
    pub fn of_daemon(self, daemon_cpu_percent: Option<f64>) -> Self {
        Self { daemon_cpu_percent, ..self }
    }

    /// The row of one size of clients of a load.
    pub fn of_load(self, case: &Case, found: &GroupFigures) -> Self {
        let row = LoadRow {
            rate: case.rate.to_string(),
            clients: found.group.clients,
            clients_in_all: case.groups.iter().map(|group| group.clients).sum(),
            frames_per_second: (found.figures.frames_per_second * 10.0).round() / 10.0,
            worst_client_p50_ns: found.worst_p50_ns,
            late_frames: found.figures.late_frames,
            from_due_ns: found.figures.stages.from_due.percentiles(),
        };
        Self { load: Some(row), ..self }
    }
}

const fn one() -> u64 {
    1
}

impl fmt::Display for LatencyReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Machine { cpu, cores, os, kernel, toolchain, commit, .. } = &self.machine;
        writeln!(f, "{cpu}, {cores} cores; {os}, {kernel}")?;
        write!(f, "{toolchain}; commit {commit}")?;
        for row in &self.rows {
            write!(f, "\n\n{row}")?;
        }
        for IdleRow { wait, clients, daemon_cpu_percent } in &self.idle {
            let them = if *clients == 1 { "client sends" } else { "clients send" };
            write!(f, "\n\nidle ({wait}): while {clients} {them} nothing, the daemon uses ")?;
            write!(f, "{daemon_cpu_percent} % of a core")?;
        }
        Ok(())
    }
}

impl fmt::Display for LatencyRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { n, backend, wait, engine, precision, frames, requests, .. } = self;
        write!(f, "{n} boxes, {backend} ({wait}), {engine}, {precision}, {frames} frames")?;
        if requests == frames { writeln!(f) } else { writeln!(f, ", {requests} asked for") }?;
        if let Some(load) = &self.load {
            writeln!(f, "{load}")?;
        }
        if let Some(percent) = self.daemon_cpu_percent {
            writeln!(f, "the daemon used {percent} % of a core")?;
        }
        write!(f, "{:<14}", "µs")?;
        for head in ["p50", "p90", "p99", "p99.9", "max"] {
            write!(f, "{head:>12}")?;
        }
        let from_due = self.load.as_ref().filter(|load| load.is_paced());
        for (stage, found) in
            from_due.map(|load| ("from due", &load.from_due_ns)).into_iter().chain([
                ("total", &self.total_ns),
                ("  fill", &self.fill_ns),
                ("  answer", &self.answer_ns),
                ("    round trip", &self.round_trip_ns),
                ("      engine", &self.engine_ns),
                ("      added", &self.added_ns),
                ("    decode", &self.decode_ns),
            ])
        {
            let Percentiles { p50, p90, p99, p999, max } = found;
            write!(f, "\n{stage:<14}")?;
            for ns in [p50, p90, p99, p999, max] {
                write!(f, "{:>12.2}", *ns as f64 / 1e3)?;
            }
        }
        Ok(())
    }
}

impl LoadRow {
    /// Whether frames were due at their times.
    pub const fn is_paced(&self) -> bool {
        self.from_due_ns.max > 0
    }
}

impl fmt::Display for LoadRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rate, clients, clients_in_all, frames_per_second, late_frames, .. } = self;
        let them = if *clients == 1 { "client" } else { "clients" };
        write!(f, "{clients} {them}")?;
        if clients_in_all != clients {
            write!(f, " of {clients_in_all} at a time")?;
        }
        if self.is_paced() {
            write!(f, " at {rate} Hz, {late_frames} frames late")?;
        } else {
            f.write_str(" in a closed loop")?;
        }
        let worst = self.worst_client_p50_ns as f64 / 1e3;
        write!(f, "; {frames_per_second} frames a second in all; ")?;
        write!(f, "worst client's median round trip {worst:.2} µs")
    }
}
