//! A small physics loop on a persistent scene: boxes fall on a floor, hold each other up, and sleep.
//!
//!     falling_boxes [--backend auto|daemon|in-process] [--boxes N] [--frames N]

mod arguments;
mod contacts;
mod simulation;
mod world;

use std::process::ExitCode;
use std::time::Instant;

use pairmask::{ServedBy, Session};

use arguments::Arguments;
use simulation::Simulation;
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
    let mut simulation = Simulation::new(&mut session, World::new(boxes))?;

    let start = Instant::now();
    let (mut pair_count, mut sent_count, mut by_daemon) = (0, 0, 0);
    for _ in 0..frames {
        let frame = simulation.step()?;
        pair_count += simulation.contacts.iter().len();
        sent_count += frame.sent;
        by_daemon += u64::from(frame.served_by == ServedBy::Daemon);
    }
    let seconds = start.elapsed().as_secs_f64();

    let a_frame = |count: usize| count as f64 / frames.max(1) as f64;
    println!("{boxes} boxes, {frames} frames, {by_daemon} of them by the daemon");
    println!("{:.1} pairs a frame, {:.1} boxes sent", a_frame(pair_count), a_frame(sent_count));
    println!("{:.0} frames a second", frames as f64 / seconds.max(1e-9));
    let world = &simulation.world;
    println!("highest box at {:.2} m, deepest overlap {:.3} m", world.height(), world.overlap());
    Ok(())
}
