//! A small physics loop that uses the pairs: boxes fall on a floor and hold each other up.
//!
//!     falling_boxes [--backend auto|daemon|in-process] [--boxes N] [--frames N]

mod arguments;
mod world;

use std::process::ExitCode;
use std::time::Instant;

use pairmask::{ServedBy, Session};

use arguments::Arguments;
use world::World;

fn main() -> ExitCode {
    // The session logs once when it falls back to this process.
    env_logger::init();
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("falling_boxes: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Box<dyn std::error::Error>> {
    let Arguments { backend, boxes, frames } = Arguments::parse(std::env::args().skip(1))?;
    let mut session = Session::builder().backend(backend).connect()?;
    let mut world = World::new(boxes);

    let start = Instant::now();
    let mut pairs = Vec::new();
    let (mut pair_count, mut by_daemon) = (0, 0);
    for _ in 0..frames {
        world.fall();
        let mut frame = session.frame(world.len())?;
        world.write_boxes(frame.boxes_mut());
        let mask = frame.submit()?.wait()?;
        // Engines find the same pairs in different orders. Pushes depend on the order, so the pairs
        // are sorted: the world is then the same with every backend.
        pairs.clear();
        pairs.extend(mask.pairs());
        pairs.sort_unstable();
        world.push_apart(&pairs);
        pair_count += mask.count();
        by_daemon += u64::from(mask.info().served_by == ServedBy::Daemon);
    }
    let seconds = start.elapsed().as_secs_f64();

    println!("{boxes} boxes, {frames} frames, {by_daemon} of them by the daemon");
    println!("{:.1} pairs a frame", pair_count as f64 / frames.max(1) as f64);
    println!("{:.0} frames a second", frames as f64 / seconds.max(1e-9));
    println!("highest box at {:.2} m, deepest overlap {:.3} m", world.height(), world.overlap());
    Ok(())
}
