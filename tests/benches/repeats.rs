//! Frames that are equal to the last one, answered again or culled anew: median µs from submission to mask.
//!
//! ```text
//! cargo bench -p pairmask-tests --bench repeats -- [--n 1000,10000] [--frames 200]
//! ```
//!
//! Two sessions take turns: one whose equal frames are answered again, and one that culls every frame. Of
//! `moving` boxes all move: the ratio is what the look at a frame costs. Of `one` box alone moves, one that
//! no sample has: copies are made in vain. Of `equal` none moves.

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use pairmask::{Backend, Session};
use pairmask_core::{Aabb, BoxCount};
use pairmaskd::scene::{Scene, SceneName};
use pairmaskd::spawn::{PrivateDaemon, PrivateSettings};

/// The daemon's own main, which cargo builds beside this bench.
const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");
/// Frames that are not counted.
const WARM_UP: usize = 20;

/// Which boxes move.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Motion {
    Moving,
    One,
    Equal,
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_unstable_by(f64::total_cmp);
    times[times.len() / 2]
}

/// A frame: µs from submission to mask, and whether it was answered again.
fn frame(session: &mut Session, boxes: &[Aabb]) -> Result<(f64, bool), Box<dyn Error>> {
    let mut frame = session.frame(boxes.len())?;
    frame.write(boxes);
    let start = Instant::now();
    let mask = frame.submit()?.wait()?;
    let took = start.elapsed().as_secs_f64() * 1e6;
    mask.for_each_slice(|pairs| {
        black_box(pairs);
    });
    Ok((took, mask.info().skipped.is_repeat()))
}

fn row(
    daemon: &PrivateDaemon,
    backend: Backend,
    motion: Motion,
    n: usize,
    frames: usize,
) -> Result<(), Box<dyn Error>> {
    let capacity = BoxCount::new(u32::try_from(n)?);
    let builder = daemon.session().backend(backend).capacity(capacity);
    let mut sessions = [builder.clone().connect()?, builder.answer_repeats(false).connect()?];
    let mut scene = Scene::new(SceneName::Uniform, n, 1);
    let mut boxes = scene.boxes().to_vec();
    let mut times = [Vec::new(), Vec::new()];
    let mut repeats = 0;
    for i in 0..WARM_UP + frames {
        match motion {
            Motion::Moving => {
                scene.step();
                boxes.copy_from_slice(scene.boxes());
            }
            Motion::One => {
                let middle = &mut boxes[n / 2];
                middle.max[0] = f32::from_bits(middle.max[0].to_bits() ^ 1);
            }
            Motion::Equal => {}
        }
        for turn in 0..2 {
            // Each is first as often as the other.
            let who = (i + turn) % 2;
            let (took, is_repeat) = frame(&mut sessions[who], &boxes)?;
            if i >= WARM_UP {
                times[who].push(took);
                repeats += usize::from(is_repeat);
            }
        }
    }
    let [again, anew] = times.each_mut().map(|times| median(times));
    println!(
        "{:<10} {:<7} {n:>9} {again:>11.2} {anew:>11.2} {:>7.3} {:>7}",
        backend.to_string(),
        format!("{motion:?}").to_lowercase(),
        again / anew,
        format!("{}%", 100 * repeats / frames)
    );
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let (mut sizes, mut frames) = (vec![64, 1_000, 10_000, 100_000, 1_000_000], 200);
    let mut args = std::env::args().skip(1).filter(|a| a != "--bench");
    while let Some(flag) = args.next() {
        let value = args.next().ok_or_else(|| format!("{flag} needs a value"))?.replace('_', "");
        match flag.as_str() {
            "--n" => sizes = value.split(',').map(str::parse).collect::<Result<_, _>>()?,
            "--frames" => frames = value.parse::<usize>()?.max(1),
            _ => return Err(format!("unknown option {flag}").into()),
        }
    }
    let daemon = PrivateDaemon::start(DAEMON.as_ref(), &PrivateSettings::default())?;
    println!("backend    boxes           n    again µs     anew µs   ratio repeats");
    for backend in [Backend::InProcess, Backend::Daemon] {
        for motion in [Motion::Moving, Motion::One, Motion::Equal] {
            for &n in &sizes {
                row(&daemon, backend, motion, n, frames)?;
            }
        }
    }
    Ok(())
}
