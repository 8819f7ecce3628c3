//! The report of a measurement: as text, and as the JSON that `CLI.md` documents.

use std::fmt;
use std::time::Duration;

use pairmask::FrameInfo;
use pairmask_core::engine::EngineId;
use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};

use super::Wait;
use crate::cli::machine::Machine;
use crate::cli::program::Result;
use crate::daemon_cpu::{Used, nanoseconds_a};
use crate::percentiles::{Percentiles, Recorder};
use crate::precision::PrecisionChoice;
use crate::timed_client::TimedFrame;

/// The JSON object of `bench latency --json`. Fields may be added, never changed or taken away.
#[derive(Debug, Serialize)]
pub struct LatencyReport {
    pub machine: Machine,
    pub rows: Vec<LatencyRow>,
}

#[derive(Debug)]
pub struct LatencyRow {
    pub n: u32,
    pub precision: PrecisionChoice,
    pub wait: Wait,
    pub decode_threads: usize,
    pub figures: Figures,
    pub cpu: CpuUsed,
}

/// CPU time of the frames of a row, of all clients that ran together.
#[derive(Clone, Copy, Debug)]
pub struct CpuUsed {
    pub daemon: Option<Used>,
    pub client: Option<Duration>,
    pub frames: u64,
}

impl CpuUsed {
    fn daemon_ns(&self) -> Option<u64> {
        self.daemon.map(|used| nanoseconds_a(used.cpu, self.frames))
    }

    fn client_ns(&self) -> Option<u64> {
        self.client.map(|used| nanoseconds_a(used, self.frames))
    }
}

/// Stages of a frame: how far each is indented below the one that holds it, and its name.
const STAGES: [(&str, &str); 7] = [
    ("", "total"),
    ("  ", "fill"),
    ("  ", "answer"),
    ("    ", "round_trip"),
    ("      ", "engine"),
    ("      ", "added"),
    ("    ", "decode"),
];

impl Serialize for LatencyRow {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { n, precision, wait, decode_threads, figures, cpu } = self;
        let mut row = serializer.serialize_map(None)?;
        row.serialize_entry("n", n)?;
        row.serialize_entry("backend", &figures.backend)?;
        row.serialize_entry("wait", &wait.to_string())?;
        row.serialize_entry("engine", &figures.engine)?;
        row.serialize_entry("precision", &precision.to_string())?;
        row.serialize_entry("box_bytes", &figures.box_bytes)?;
        row.serialize_entry("frames", &figures.frames)?;
        row.serialize_entry("requests", &figures.requests)?;
        row.serialize_entry("decode_threads", decode_threads)?;
        for ((_, stage), times) in STAGES.iter().zip(&figures.stages) {
            row.serialize_entry(&format!("{stage}_ns"), &times.percentiles())?;
        }
        row.serialize_entry("daemon_cpu_percent", &cpu.daemon.map(|used| used.percent()))?;
        row.serialize_entry("daemon_cpu_ns", &cpu.daemon_ns())?;
        row.serialize_entry("client_cpu_ns", &cpu.client_ns())?;
        row.end()
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
        let Self { n, precision, wait, figures, cpu, .. } = self;
        let Figures { backend, engine, frames, requests, .. } = figures;
        write!(f, "{n} boxes, {backend} ({wait}), {engine}, {precision}, {frames} frames")?;
        if requests != frames {
            write!(f, ", {requests} asked for")?;
        }
        writeln!(f)?;
        let us = |ns: u64| ns as f64 / 1e3;
        if let Some(ns) = cpu.client_ns() {
            writeln!(f, "CPU time a frame: client {:.2} µs", us(ns))?;
        }
        if let Some((ns, used)) = cpu.daemon_ns().zip(cpu.daemon) {
            let (us, percent) = (us(ns), used.percent());
            writeln!(f, "CPU time a frame: daemon {us:.2} µs, {percent} % of a core")?;
        }
        write!(f, "{:<14}", "µs")?;
        for head in ["p50", "p90", "p99", "p99.9", "max"] {
            write!(f, "{head:>12}")?;
        }
        for ((indent, stage), times) in STAGES.iter().zip(&figures.stages) {
            let Percentiles { p50, p90, p99, p999, max } = times.percentiles();
            write!(f, "\n{:<14}", format!("{indent}{}", stage.replace('_', " ")))?;
            for ns in [p50, p90, p99, p999, max] {
                write!(f, "{:>12.2}", us(ns))?;
            }
        }
        Ok(())
    }
}

const SEVERAL: &str = "auto";

/// The daemon died or started during the measurement: the row would mix two backends.
const CHANGED: &str =
    "the daemon came or went during the measurement: name a --backend, and try again";

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Figures {
    backend: String,
    /// The engine; `auto` where frames had different engines.
    engine: String,
    #[serde(skip)]
    engine_id: Option<EngineId>,
    box_bytes: u64,
    pub frames: u64,
    /// Frames for which a request was made; `margin=X` answers the others from an earlier mask.
    requests: u64,
    stages: [Recorder; STAGES.len()],
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
