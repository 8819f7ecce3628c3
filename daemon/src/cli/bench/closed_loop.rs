//! The measured loop: it holds only the frame and the clock.

use std::time::Instant;

use indicatif::ProgressBar;

use super::latency::BenchError;
use super::measured::{Figures, Measured};
use crate::cli::daemon_cpu::DaemonCpu;
use crate::scene::Scene;
use crate::timed_client::{Decoding, TimedClient};

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

/// Runs frames of a scene in motion. With the figures comes what the daemon used of a core meanwhile,
/// percent.
///
/// # Errors
/// [`BenchError`], also where the daemon served some frames and this process others.
pub fn measure(
    client: &mut TimedClient,
    mut scene: Scene,
    lengths: &Lengths,
    decoding: &mut Decoding,
    daemon: Option<&DaemonCpu>,
    progress: &ProgressBar,
) -> Result<(Figures, Option<f64>), BenchError> {
    // The backend of this frame has to serve all frames.
    let mut measured = Measured::of(&client.frame_decoded(scene.boxes(), decoding, |_| ())?.info);
    let mut frame = 0;
    let mut turn = |recorded: Option<&mut Measured>| {
        scene.step();
        let answered = client.frame_decoded(scene.boxes(), decoding, |_| ())?;
        frame += 1;
        if u64::is_multiple_of(frame, FRAMES_PER_TICK) {
            progress.set_position(frame);
        }
        recorded.map_or(Ok(()), |measured| measured.record(&answered))
    };
    for _ in 0..lengths.warm_up {
        turn(None)?;
    }
    let since = daemon.map(DaemonCpu::since_now);
    let begun = Instant::now();
    for _ in 0..lengths.frames {
        turn(Some(&mut measured))?;
    }
    let elapsed = begun.elapsed();
    let used = daemon.zip(since).map(|(daemon, since)| daemon.percent(&since));
    Ok((Figures::of(measured, elapsed), used))
}
