//! The report of a measurement: as text, and as the JSON that `CLI.md` documents.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::closed_loop::Measured;
use super::latency::Wait;
use crate::cli::cull::backend_name;
use crate::cli::machine::Machine;
use crate::cli::percentiles::Percentiles;
use crate::precision::PrecisionChoice;

/// The JSON object of `bench latency --json`. Fields may be added, never changed or taken away.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LatencyReport {
    /// The machine of the measurement.
    pub machine: Machine,
    /// One row for every wait, scene and precision.
    pub rows: Vec<LatencyRow>,
}

/// Latencies of one scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LatencyRow {
    /// Boxes.
    pub n: u32,
    /// Where the pairs were found: `daemon` or `in-process`.
    pub backend: String,
    /// How both sides waited: `spin` or `event`.
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
}

impl LatencyRow {
    /// The row of a finished measurement.
    pub fn new(
        n: u32,
        precision: PrecisionChoice,
        wait: Wait,
        frames: u64,
        measured: &Measured,
    ) -> Self {
        Self {
            n,
            backend: backend_name(measured.served_by).to_owned(),
            wait: wait.to_string(),
            engine: measured.engine.map_or_else(|| "auto".to_owned(), |engine| engine.to_string()),
            precision: precision.to_string(),
            box_bytes: measured.box_bytes,
            frames,
            requests: measured.requests,
            decode_threads: 1,
            total_ns: measured.total.percentiles(),
            fill_ns: measured.fill.percentiles(),
            answer_ns: measured.answer.percentiles(),
            round_trip_ns: measured.round_trip.percentiles(),
            engine_ns: measured.engine_time.percentiles(),
            added_ns: measured.added.percentiles(),
            decode_ns: measured.decode.percentiles(),
        }
    }
}

impl LatencyRow {
    /// The row of a measurement with a client of `threads` threads.
    pub fn decoded_by(self, threads: usize) -> Self {
        Self { decode_threads: threads as u64, ..self }
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
        Ok(())
    }
}

impl fmt::Display for LatencyRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { n, backend, wait, engine, precision, frames, requests, .. } = self;
        write!(f, "{n} boxes, {backend} ({wait}), {engine}, {precision}, {frames} frames")?;
        if requests == frames { writeln!(f) } else { writeln!(f, ", {requests} asked for") }?;
        write!(f, "{:<14}", "µs")?;
        for head in ["p50", "p90", "p99", "p99.9", "max"] {
            write!(f, "{head:>12}")?;
        }
        for (stage, found) in [
            ("total", &self.total_ns),
            ("  fill", &self.fill_ns),
            ("  answer", &self.answer_ns),
            ("    round trip", &self.round_trip_ns),
            ("      engine", &self.engine_ns),
            ("      added", &self.added_ns),
            ("    decode", &self.decode_ns),
        ] {
            let Percentiles { p50, p90, p99, p999, max } = found;
            write!(f, "\n{stage:<14}")?;
            for ns in [p50, p90, p99, p999, max] {
                write!(f, "{:>12.2}", *ns as f64 / 1e3)?;
            }
        }
        Ok(())
    }
}
