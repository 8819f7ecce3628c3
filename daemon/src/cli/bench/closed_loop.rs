//! The measured loop: it holds only the frame and the clock.

use std::time::Duration;

use indicatif::ProgressBar;
use pairmask::{FrameInfo, ServedBy};
use pairmask_core::engine::EngineId;

use super::latency::BenchError;
use crate::cli::percentiles::Recorder;
use crate::scene::Scene;
use crate::timed_client::{Decoding, TimedClient, TimedFrame};

/// Frames between two moves of the progress bar: its cost is then nothing beside that of the
/// frames.
const FRAMES_PER_TICK: u64 = 64;

/// The numbers of frames.
#[derive(Clone, Copy, Debug)]
pub struct Lengths {
    /// Frames before the first recorded one: memory is touched, estimates settle, clocks rise.
    pub warm_up: u64,
    /// Recorded frames.
    pub frames: u64,
}

/// Latencies by stage, and the engine they belong to.
#[derive(Debug)]
pub struct Measured {
    pub served_by: ServedBy,
    /// The engine of every frame; `None` where frames had different engines.
    pub engine: Option<EngineId>,
    /// Bytes of the boxes of a frame.
    pub box_bytes: u64,
    /// Frames for which a request was made.
    pub requests: u64,
    pub total: Recorder,
    pub fill: Recorder,
    pub answer: Recorder,
    pub round_trip: Recorder,
    pub engine_time: Recorder,
    pub added: Recorder,
    pub decode: Recorder,
}

/// Runs frames of a scene in motion.
///
/// # Errors
/// [`BenchError`], also where the daemon served some frames and this process others.
pub fn measure(
    client: &mut TimedClient,
    mut scene: Scene,
    lengths: &Lengths,
    decoding: &mut Decoding,
    progress: &ProgressBar,
) -> Result<Measured, BenchError> {
    // The backend of this frame has to serve all frames.
    let mut measured = Measured::of(&client.frame_decoded(scene.boxes(), decoding, |_| ())?.info);
    for frame in 1..=lengths.warm_up + lengths.frames {
        scene.step();
        let answered = client.frame_decoded(scene.boxes(), decoding, |_| ())?;
        if frame > lengths.warm_up {
            measured.record(&answered)?;
        }
        if frame.is_multiple_of(FRAMES_PER_TICK) {
            progress.set_position(frame);
        }
    }
    Ok(measured)
}

const fn ns(duration: Duration) -> u64 {
    duration.as_nanos() as u64
}

impl Measured {
    fn of(info: &FrameInfo) -> Self {
        Self {
            served_by: info.served_by,
            engine: Some(info.engine),
            box_bytes: info.box_bytes,
            requests: 0,
            total: Recorder::new(),
            fill: Recorder::new(),
            answer: Recorder::new(),
            round_trip: Recorder::new(),
            engine_time: Recorder::new(),
            added: Recorder::new(),
            decode: Recorder::new(),
        }
    }

    fn record(&mut self, times: &TimedFrame) -> Result<(), BenchError> {
        let info = &times.info;
        if info.served_by != self.served_by {
            return Err(BenchError::Changed);
        }
        if self.engine != Some(info.engine) {
            self.engine = None;
        }
        let engine_ns = times.engine_ns();
        self.requests += u64::from(times.was_asked);
        self.total.record(ns(times.fill + times.round_trip + times.decode));
        self.fill.record(ns(times.fill));
        self.answer.record(ns(times.round_trip + times.decode));
        self.round_trip.record(ns(times.round_trip));
        self.engine_time.record(engine_ns);
        self.added.record(ns(times.round_trip).saturating_sub(engine_ns));
        self.decode.record(ns(times.decode));
        Ok(())
    }
}
