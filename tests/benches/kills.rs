//! Workers that are killed in a row: how long a client of the daemon is without an answer.
//!
//! ```text
//! cargo bench -p pairmask-tests --bench kills -- [--gpu none] [--kills 100] [--pause-ms 300] [--n 1000]
//! ```
//!
//! A gap runs from SIGKILL to the first frame that the next worker has answered; the client asks again every
//! millisecond. The next kill comes after a pause.

use std::error::Error;
use std::hint::black_box;
use std::time::{Duration, Instant};

use pairmask::Session;
use pairmask_core::Aabb;
use pairmask_tests::daemon::{PATIENCE, TestDaemon};
use pairmaskd::scene::{Scene, SceneName};
use rustix::process::Signal;

/// The daemon's own main, which cargo builds beside this bench.
const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");
/// Between two tries of the client.
const RETRY: Duration = Duration::from_millis(1);

fn frame(session: &mut Session, boxes: &[Aabb]) -> Result<(), Box<dyn Error>> {
    let mut frame = session.frame(boxes.len())?;
    frame.write(boxes);
    black_box(frame.submit()?.wait()?.count());
    Ok(())
}

/// Time until the daemon has answered a frame.
fn answered(session: &mut Session, boxes: &[Aabb]) -> Result<Duration, Box<dyn Error>> {
    let start = Instant::now();
    loop {
        match frame(session, boxes) {
            Ok(()) => return Ok(start.elapsed()),
            Err(error) if start.elapsed() > PATIENCE => return Err(error),
            Err(_) => std::thread::sleep(RETRY),
        }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let (mut gpu, mut kills, mut pause_ms, mut n) = ("none".to_owned(), 100_usize, 300, 1000);
    // Cargo adds --bench.
    let mut arguments = std::env::args().skip(1).filter(|argument| argument != "--bench");
    while let Some(name) = arguments.next() {
        let value = arguments.next().ok_or_else(|| format!("{name} needs a value"))?;
        match name.as_str() {
            "--gpu" => gpu = value,
            "--kills" => kills = value.parse()?,
            "--pause-ms" => pause_ms = value.parse()?,
            "--n" => n = value.parse()?,
            _ => return Err(format!("{name} is no option of this bench").into()),
        }
    }
    let scene = Scene::new(SceneName::Uniform, n, 1);
    let daemon = TestDaemon::start(DAEMON, &["--gpu", &gpu]);
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
    gaps.sort_unstable();
    let at = |share: f64| gaps.get((share * (gaps.len() - 1) as f64).round() as usize).copied();
    println!(
        "gpu {gpu}, {kills} kills, {pause_ms} ms apart: gap p50 {:.1?}, p99 {:.1?}, longest {:.1?}",
        at(0.5).unwrap_or_default(),
        at(0.99).unwrap_or_default(),
        at(1.0).unwrap_or_default()
    );
    Ok(())
}
