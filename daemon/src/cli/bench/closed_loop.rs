//! The measured loop: nothing in it but the frame and the clock.

use std::hint::black_box;
use std::time::{Duration, Instant};

use indicatif::ProgressBar;
use pairmask::{EngineChoice, PairMask, ServedBy, Session};

use super::latency::BenchError;
use crate::cli::percentiles::Recorder;
use crate::scene::Scene;

/// The progress bar moves this often: seldom enough to cost nothing beside a frame.
const FRAMES_PER_TICK: u64 = 64;

/// How many frames.
#[derive(Clone, Copy, Debug)]
pub struct Lengths {
    /// Before anything is recorded: memory is touched, estimates settle, clocks rise.
    pub warm_up: u64,
    /// Recorded.
    pub frames: u64,
}

/// Latencies by stage, and who caused them.
#[derive(Debug)]
pub struct Measured {
    pub served_by: ServedBy,
    /// The engine of every frame, or auto where the plan chose now this one, now that one.
    pub engine: EngineChoice,
    pub fill: Recorder,
    pub round_trip: Recorder,
    pub engine_time: Recorder,
    pub added: Recorder,
    pub decode: Recorder,
    pub total: Recorder,
}

/// One frame's times.
struct FrameTimes {
    fill: Duration,
    round_trip: Duration,
    decode: Duration,
}

/// Runs frames of a scene in motion.
///
/// # Errors
/// [`BenchError`], also where frames were not all served alike.
pub fn measure(
    session: &mut Session,
    mut scene: Scene,
    lengths: &Lengths,
    progress: &ProgressBar,
) -> Result<Measured, BenchError> {
    // Whoever serves this frame has to serve them all.
    let mut measured = Measured::of(&run_frame(session, &scene, 0)?.0);
    for frame in 1..=lengths.warm_up + lengths.frames {
        scene.step();
        let (mask, times) = run_frame(session, &scene, frame)?;
        if frame > lengths.warm_up {
            measured.record(&mask, &times)?;
        }
        if frame.is_multiple_of(FRAMES_PER_TICK) {
            progress.set_position(frame);
        }
    }
    Ok(measured)
}

fn run_frame(
    session: &mut Session,
    scene: &Scene,
    number: u64,
) -> Result<(PairMask, FrameTimes), BenchError> {
    let start = Instant::now();
    let mut frame = session.frame(scene.boxes().len())?;
    frame.boxes_mut().copy_from_slice(scene.boxes());
    let filled = Instant::now();
    let mask = frame.submit()?.wait()?;
    let answered = Instant::now();
    let mut decoded = 0;
    let mut indices = 0;
    mask.view().for_each(|a, b| {
        decoded += 1;
        indices ^= a ^ b;
    });
    black_box(indices);
    let end = Instant::now();

    let counted = mask.count();
    if counted != decoded {
        return Err(BenchError::Miscounted { frame: number, counted, decoded });
    }
    let times =
        FrameTimes { fill: filled - start, round_trip: answered - filled, decode: end - answered };
    Ok((mask, times))
}

const fn ns(duration: Duration) -> u64 {
    duration.as_nanos() as u64
}

impl Measured {
    fn of(mask: &PairMask) -> Self {
        Self {
            served_by: mask.info().served_by,
            engine: EngineChoice::Only(mask.info().engine),
            fill: Recorder::new(),
            round_trip: Recorder::new(),
            engine_time: Recorder::new(),
            added: Recorder::new(),
            decode: Recorder::new(),
            total: Recorder::new(),
        }
    }

    fn record(&mut self, mask: &PairMask, times: &FrameTimes) -> Result<(), BenchError> {
        let info = mask.info();
        if info.served_by != self.served_by {
            return Err(BenchError::Changed);
        }
        if self.engine != EngineChoice::Only(info.engine) {
            self.engine = EngineChoice::Auto;
        }
        let engine_ns = info.times.total_ns;
        self.fill.record(ns(times.fill));
        self.round_trip.record(ns(times.round_trip));
        self.engine_time.record(engine_ns);
        self.added.record(ns(times.round_trip).saturating_sub(engine_ns));
        self.decode.record(ns(times.decode));
        self.total.record(ns(times.fill + times.round_trip + times.decode));
        Ok(())
    }
}
