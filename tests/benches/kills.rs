//! Workers that are killed in a row: how long a client of the daemon is without an answer.
//!
//! A gap runs from SIGKILL to the first frame that the next worker has answered; the client asks again every
//! millisecond. The next kill comes after a pause.

use std::error::Error;
use std::hint::black_box;
use std::time::{Duration, Instant};

use clap::Parser;
use pairmask_tests::measure::percentile;
use pairmask_tests::prelude::*;
use pairmaskd::scene::{Scene, SceneName};

/// Between two tries of the client.
const RETRY: Duration = Duration::from_millis(1);

/// Workers that are killed in a row: how long a client is without an answer.
#[derive(Parser)]
struct Options {
    #[arg(long, default_value = "none")]
    gpu: String,
    #[arg(long, default_value_t = 100)]
    kills: usize,
    #[arg(long, default_value_t = 300)]
    pause_ms: u64,
    #[arg(long, default_value_t = 1000)]
    n: usize,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

fn frame(session: &mut Session, boxes: &[Aabb]) -> Result<(), Box<dyn Error>> {
    let mut frame = session.frame(boxes.len())?;
    frame.write(boxes)?;
    black_box(frame.submit()?.wait()?.count());
    Ok(())
}

fn answered(session: &mut Session, boxes: &[Aabb]) -> Result<Duration, Box<dyn Error>> {
    let start = Instant::now();
    loop {
        match frame(session, boxes) {
            Ok(()) => return Ok(start.elapsed()),
            Err(error) if start.elapsed() > TIMEOUT => return Err(error),
            Err(_) => std::thread::sleep(RETRY),
        }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let Options { gpu, kills, pause_ms, n, .. } = Options::parse();
    let scene = Scene::new(SceneName::Uniform, n, 1);
    let daemon = TestDaemon::start(&["--gpu", &gpu]);
    let mut session = daemon.session().answer_repeats(false).connect()?;
    answered(&mut session, scene.boxes())?;
    let mut gaps = Vec::new();
    for _ in 0..kills {
        daemon.signal_worker(Signal::KILL);
        gaps.push(answered(&mut session, scene.boxes())?);
        std::thread::sleep(Duration::from_millis(pause_ms));
    }
    let in_turn: Vec<u128> = gaps.iter().map(Duration::as_millis).collect();
    eprintln!("gaps in turn, ms: {in_turn:?}");
    let at = |share: f64| percentile(&gaps, share);
    println!(
        "gpu {gpu}, {kills} kills, {pause_ms} ms apart: gap p50 {:.1?}, p99 {:.1?}, longest {:.1?}",
        at(0.5),
        at(0.99),
        at(1.0)
    );
    Ok(())
}
