//! Latencies by stage, as they are collected and as one process tells another.

use std::time::Duration;

use pairmask::FrameInfo;
use pairmask_core::engine::EngineId;
use serde::{Deserialize, Serialize};

use super::latency::BenchError;
use crate::cli::cull::backend_name;
use crate::cli::percentiles::Recorder;
use crate::timed_client::TimedFrame;

/// The engine's name where frames had different engines.
const SEVERAL: &str = "auto";

/// Frames under measurement, all of one backend.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Figures {
    /// `daemon` or `in-process`.
    pub backend: String,
    /// The engine; `auto` where frames had different engines.
    pub engine: String,
    #[serde(skip)]
    engine_id: Option<EngineId>,
    /// Bytes of the boxes of a frame.
    pub box_bytes: u64,
    /// Frames.
    pub frames: u64,
    /// Frames for which a request was made.
    pub requests: u64,
    /// Of each frame: total, fill, answer, round trip, engine, added, decode.
    pub(super) stages: [Recorder; 7],
}

impl Figures {
    /// No frame yet. All will have the backend of `info`.
    pub fn of(info: &FrameInfo) -> Self {
        Self {
            backend: backend_name(info.served_by).to_owned(),
            engine: info.engine.to_string(),
            engine_id: Some(info.engine),
            box_bytes: info.box_bytes,
            frames: 0,
            requests: 0,
            stages: Default::default(),
        }
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// [`BenchError::Changed`] where another backend answered it.
    pub fn record(&mut self, times: &TimedFrame) -> Result<(), BenchError> {
        let info = &times.info;
        if backend_name(info.served_by) != self.backend {
            return Err(BenchError::Changed);
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
        self.stages.iter_mut().zip(&other.stages).for_each(|(own, other)| own.add(other));
        Ok(())
    }
}
