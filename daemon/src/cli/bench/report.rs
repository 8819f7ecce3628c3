//! The report of a measurement: as text, and as the JSON that `CLI.md` documents.

use std::fmt;
use std::time::Duration;

use pairmask::FrameInfo;
use pairmask_core::engine::EngineId;
use serde::{Deserialize, Serialize};

use super::Wait;
use crate::cli::daemon_cpu::{Used, nanoseconds_a};
use crate::cli::machine::Machine;
use crate::cli::percentiles::{Percentiles, Recorder};
use crate::cli::program::Result;
use crate::precision::PrecisionChoice;
use crate::timed_client::TimedFrame;

/// The JSON object of `bench latency --json`. Fields may be added, never changed or taken away.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LatencyReport {
    pub machine: Machine,
    pub rows: Vec<LatencyRow>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LatencyRow {
    pub n: u32,
    /// Where the pairs were found: `daemon` or `in-process`.
    pub backend: String,
    /// How both sides waited: `spin`, `event` or `serve`.
    pub wait: String,
    pub engine: String,
    /// Precision of the boxes: `exact`, `q16`, `q8`, `f16` or `margin=X`.
    pub precision: String,
    /// Bytes of the boxes of one request.
    pub box_bytes: u64,
    pub frames: u64,
    /// Frames for which a request was made; `margin=X` answers the others from an earlier mask.
    pub requests: u64,
    /// Threads of the client, which wrote exact boxes and visited the pairs.
    pub decode_threads: u64,
    /// Fill and answer: the whole frame, frame by frame.
    pub total_ns: Percentiles,
    /// Time to borrow memory and write the boxes into it.
    pub fill_ns: Percentiles,
    /// Round trip and decode: from boxes written to the last pair visited.
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
    /// was asked.
    pub daemon_cpu_percent: Option<f64>,
    /// CPU time of the daemon for each frame, of all its threads; `None` where no daemon was asked.
    pub daemon_cpu_ns: Option<u64>,
    /// The same of this process, with what it takes to move the boxes; `None` where clients are other processes.
    pub client_cpu_ns: Option<u64>,
}

/// CPU time of the frames of a row, of all clients that ran together.
#[derive(Clone, Copy, Debug, Default)]
pub struct CpuUsed {
    pub daemon_percent: Option<f64>,
    /// Of a frame.
    pub daemon_ns: Option<u64>,
    /// Of a frame.
    pub client_ns: Option<u64>,
}

impl CpuUsed {
    /// What a daemon, and this process as its client, used for so many frames.
    pub fn of(frames: u64, daemon: Option<Used>, client: Option<Duration>) -> Self {
        Self {
            daemon_percent: daemon.map(|used| used.percent()),
            daemon_ns: daemon.map(|used| used.ns_a_frame(frames)),
            client_ns: client.map(|used| nanoseconds_a(used, frames)),
        }
    }
}

impl LatencyRow {
    pub fn new(
        n: u32,
        precision: PrecisionChoice,
        wait: Wait,
        decode_threads: usize,
        figures: &Figures,
        cpu: CpuUsed,
    ) -> Self {
        let stages = figures.stages.each_ref().map(Recorder::percentiles);
        let [total_ns, fill_ns, answer_ns, round_trip_ns, engine_ns, added_ns, decode_ns] = stages;
        Self {
            n,
            backend: figures.backend.clone(),
            wait: wait.to_string(),
            engine: figures.engine.clone(),
            precision: precision.to_string(),
            box_bytes: figures.box_bytes,
            frames: figures.frames,
            requests: figures.requests,
            decode_threads: decode_threads as u64,
            total_ns,
            fill_ns,
            answer_ns,
            round_trip_ns,
            engine_ns,
            added_ns,
            decode_ns,
            daemon_cpu_percent: cpu.daemon_percent,
            daemon_cpu_ns: cpu.daemon_ns,
            client_cpu_ns: cpu.client_ns,
        }
    }
}

impl fmt::Display for LatencyReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.machine)?;
        self.rows.iter().try_for_each(|row| write!(f, "\n\n{row}"))
    }
}

impl fmt::Display for LatencyRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { n, backend, wait, engine, precision, frames, requests, .. } = self;
        write!(f, "{n} boxes, {backend} ({wait}), {engine}, {precision}, {frames} frames")?;
        if requests != frames {
            write!(f, ", {requests} asked for")?;
        }
        writeln!(f)?;
        let us = |ns: u64| ns as f64 / 1e3;
        if let Some(ns) = self.client_cpu_ns {
            writeln!(f, "CPU time a frame: client {:.2} µs", us(ns))?;
        }
        if let Some((ns, percent)) = self.daemon_cpu_ns.zip(self.daemon_cpu_percent) {
            writeln!(f, "CPU time a frame: daemon {:.2} µs, {percent} % of a core", us(ns))?;
        }
        write!(f, "{:<14}", "µs")?;
        for head in ["p50", "p90", "p99", "p99.9", "max"] {
            write!(f, "{head:>12}")?;
        }
        let stages = [
            ("total", &self.total_ns),
            ("  fill", &self.fill_ns),
            ("  answer", &self.answer_ns),
            ("    round trip", &self.round_trip_ns),
            ("      engine", &self.engine_ns),
            ("      added", &self.added_ns),
            ("    decode", &self.decode_ns),
        ];
        for (stage, found) in stages {
            let Percentiles { p50, p90, p99, p999, max } = found;
            write!(f, "\n{stage:<14}")?;
            for ns in [p50, p90, p99, p999, max] {
                write!(f, "{:>12.2}", *ns as f64 / 1e3)?;
            }
        }
        Ok(())
    }
}

/// The engine's name where frames had different engines.
const SEVERAL: &str = "auto";

/// The daemon died or started during the measurement: the row would mix two backends.
const CHANGED: &str =
    "the daemon came or went during the measurement: name a --backend, and try again";

/// Frames under measurement, all of one backend.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Figures {
    pub backend: String,
    /// The engine; `auto` where frames had different engines.
    pub engine: String,
    #[serde(skip)]
    engine_id: Option<EngineId>,
    pub box_bytes: u64,
    pub frames: u64,
    pub requests: u64,
    /// Of each frame: total, fill, answer, round trip, engine, added, decode.
    pub(super) stages: [Recorder; 7],
}

impl Figures {
    /// No frame yet. All will have the backend of `info`.
    pub fn of(info: &FrameInfo) -> Self {
        Self {
            backend: info.served_by.as_str().to_owned(),
            engine: info.engine.to_string(),
            engine_id: Some(info.engine),
            box_bytes: info.box_bytes,
            frames: 0,
            requests: 0,
            stages: Default::default(),
        }
    }

    /// Adds a frame.
    pub fn record(&mut self, times: &TimedFrame) -> Result {
        let info = &times.info;
        if info.served_by.as_str() != self.backend {
            return Err(CHANGED.into());
        }
        if self.engine_id.is_some_and(|engine| engine != info.engine) {
            self.engine_id = None;
            SEVERAL.clone_into(&mut self.engine);
        }
        self.frames += 1;
        self.requests += u64::from(times.was_asked);
        let ns = |duration: Duration| duration.as_nanos() as u64;
        let (round_trip, engine) = (ns(times.round_trip), times.engine_ns());
        let answer = ns(times.round_trip + times.decode);
        let total = ns(times.fill + times.round_trip + times.decode);
        let added = round_trip.saturating_sub(engine);
        let all = [total, ns(times.fill), answer, round_trip, engine, added, ns(times.decode)];
        self.stages.iter_mut().zip(all).for_each(|(stage, ns)| stage.record(ns));
        Ok(())
    }

    /// The median round trip, ns.
    pub fn round_trip_p50(&self) -> u64 {
        self.stages[3].percentiles().p50
    }

    /// Adds those of another client.
    pub fn add(&mut self, other: &Self) -> Result {
        if self.backend != other.backend {
            return Err(CHANGED.into());
        }
        if self.engine != other.engine {
            SEVERAL.clone_into(&mut self.engine);
        }
        self.frames += other.frames;
        self.requests += other.requests;
        self.stages.iter_mut().zip(&other.stages).for_each(|(own, other)| own.add(other));
        Ok(())
    }
}
