//! Latencies by stage, as they are collected and as one process tells another.

use std::time::Duration;

use pairmask::{FrameInfo, ServedBy};
use pairmask_core::engine::EngineId;
use serde::{Deserialize, Serialize};

use super::latency::BenchError;
use crate::cli::cull::backend_name;
use crate::cli::percentiles::Recorder;
use crate::timed_client::TimedFrame;

/// Latencies of each stage of a frame.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Stages {
    pub total: Recorder,
    pub fill: Recorder,
    pub answer: Recorder,
    pub round_trip: Recorder,
    pub engine: Recorder,
    pub added: Recorder,
    pub decode: Recorder,
    /// From when the frame was due to its last pair; empty in a closed loop.
    pub from_due: Recorder,
}

impl Stages {
    fn add(&mut self, other: &Self) {
        for (own, other) in [
            (&mut self.total, &other.total),
            (&mut self.fill, &other.fill),
            (&mut self.answer, &other.answer),
            (&mut self.round_trip, &other.round_trip),
            (&mut self.engine, &other.engine),
            (&mut self.added, &other.added),
            (&mut self.decode, &other.decode),
            (&mut self.from_due, &other.from_due),
        ] {
            own.add(other);
        }
    }
}

/// Frames under measurement, all of one backend.
#[derive(Debug)]
pub struct Measured {
    served_by: ServedBy,
    /// The engine of every frame; `None` where frames had different engines.
    engine: Option<EngineId>,
    /// Bytes of the boxes of a frame.
    box_bytes: u64,
    frames: u64,
    /// Frames for which a request was made.
    requests: u64,
    late_frames: u64,
    stages: Stages,
}

const fn ns(duration: Duration) -> u64 {
    duration.as_nanos() as u64
}

impl Measured {
    /// No frame yet. All will have the backend of `info`.
    pub fn of(info: &FrameInfo) -> Self {
        Self {
            served_by: info.served_by,
            engine: Some(info.engine),
            box_bytes: info.box_bytes,
            frames: 0,
            requests: 0,
            late_frames: 0,
            stages: Stages::default(),
        }
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// [`BenchError::Changed`] where another backend answered it.
    pub fn record(&mut self, times: &TimedFrame) -> Result<(), BenchError> {
        let info = &times.info;
        if info.served_by != self.served_by {
            return Err(BenchError::Changed);
        }
        if self.engine != Some(info.engine) {
            self.engine = None;
        }
        let engine_ns = times.engine_ns();
        self.frames += 1;
        self.requests += u64::from(times.was_asked);
        let stages = &mut self.stages;
        stages.total.record(ns(times.fill + times.round_trip + times.decode));
        stages.fill.record(ns(times.fill));
        stages.answer.record(ns(times.round_trip + times.decode));
        stages.round_trip.record(ns(times.round_trip));
        stages.engine.record(engine_ns);
        stages.added.record(ns(times.round_trip).saturating_sub(engine_ns));
        stages.decode.record(ns(times.decode));
        Ok(())
    }

    /// Whether no frame was added.
    pub const fn is_empty(&self) -> bool {
        self.frames == 0
    }

    /// Says of the last frame how long after its due time it was done, and whether it began late.
    pub fn record_due(&mut self, from_due: Duration, is_late: bool) {
        self.late_frames += u64::from(is_late);
        self.stages.from_due.record(ns(from_due));
    }
}

/// What one or more clients of one size measured.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Figures {
    /// `daemon` or `in-process`.
    pub backend: String,
    /// The engine; `auto` where frames had different engines.
    pub engine: String,
    /// Bytes of the boxes of a frame.
    pub box_bytes: u64,
    pub frames: u64,
    pub requests: u64,
    /// Frames that were due before the client was done with the one before.
    pub late_frames: u64,
    /// Frames a second of all clients.
    pub frames_per_second: f64,
    pub stages: Stages,
}

/// The engine's name where frames had different engines.
const SEVERAL: &str = "auto";

impl Figures {
    /// The figures of one client that measured for `elapsed`.
    pub fn of(measured: Measured, elapsed: Duration) -> Self {
        let Measured { served_by, engine, box_bytes, frames, requests, late_frames, stages } =
            measured;
        Self {
            backend: backend_name(served_by).to_owned(),
            engine: engine.map_or_else(|| SEVERAL.to_owned(), |engine| engine.to_string()),
            box_bytes,
            frames,
            requests,
            late_frames,
            frames_per_second: frames as f64 / elapsed.as_secs_f64().max(f64::MIN_POSITIVE),
            stages,
        }
    }

    /// Adds those of another client of the same size.
    ///
    /// # Errors
    /// [`BenchError::Changed`] where another backend answered it.
    pub fn add(&mut self, other: &Self) -> Result<(), BenchError> {
        if self.backend != other.backend {
            return Err(BenchError::Changed);
        }
        if self.engine != other.engine {
            SEVERAL.clone_into(&mut self.engine);
        }
        self.frames += other.frames;
        self.requests += other.requests;
        self.late_frames += other.late_frames;
        self.frames_per_second += other.frames_per_second;
        self.stages.add(&other.stages);
        Ok(())
    }
}
