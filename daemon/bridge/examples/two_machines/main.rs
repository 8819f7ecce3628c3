//! A crowd of one machine that walks across the borders to its neighbours and back: `run` beside this file starts one on each
//! of two machines, or more, which are network namespaces.

use std::collections::BTreeSet;
use std::error::Error;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Parser;
use pairmask::{Aabb, Backend, Report, SceneOptions, Session};

/// The part of the plaza that is a machine's own: its length along x, and its width.
const LENGTH: f32 = 50.0;
const WIDTH: f32 = 20.0;
/// Units that a crowd walks beyond its own part.
const BEYOND: f32 = 10.0;
/// A tick of a game at 60 Hz.
const TICK: Duration = Duration::from_micros(16_667);
/// Units that a walker walks in a tick, at the most.
const SPEED: f32 = 0.1;

#[derive(Debug, Parser)]
struct Arguments {
    /// Parts lie side by side, from 0 on.
    #[arg(long)]
    machine: u32,
    #[arg(long, default_value_t = 500)]
    boxes: u32,
    #[arg(long, default_value_t = 10)]
    seconds: u64,
    /// Writes where all stand at the end to a file, and waits for so many seconds.
    #[arg(long, num_args = 2, value_names = ["FILE", "SECONDS"])]
    stand: Option<Vec<String>>,
    /// The shared scene.
    #[arg(long, default_value = "town")]
    scene: String,
    #[arg(long, env = "PAIRMASK_INSTANCE", default_value = "default")]
    instance: String,
}

/// From 0 to below 1, the same for the same numbers.
fn part(a: u32, b: u32) -> f32 {
    let mixed = (u64::from(a) << 32 | u64::from(b)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let mixed = (mixed ^ mixed >> 29).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    (mixed >> 40) as f32 / (1 << 24) as f32
}

fn to_and_fro(x: f32, length: f32) -> f32 {
    let x = x.rem_euclid(2.0 * length);
    if x > length { 2.0 * length - x } else { x }
}

fn walker(machine: u32, index: u32, tick: u32) -> Aabb {
    let (a, b) = (2 * machine, 2 * machine + 1);
    let length = LENGTH + 2.0 * BEYOND;
    let speed = SPEED * (2.0 * part(b, index) - 1.0);
    let begin = machine as f32 * LENGTH - BEYOND;
    let x = begin + to_and_fro(part(a, index) * length + speed * tick as f32, length);
    let y = WIDTH * part(a ^ 64, index);
    Aabb::new([x, y, 0.0], [x + 0.5, y + 0.5, 1.8])
}

fn main() -> Result<(), Box<dyn Error>> {
    let Arguments { machine, boxes, seconds, stand, scene, instance } = Arguments::parse();
    let mut session = Session::builder().instance(&instance).backend(Backend::Daemon).connect()?;
    let mut scene = session.scene(SceneOptions::default().with_shared(scene))?;
    let own = scene.lease_any(boxes)?;
    let (start, mut tick) = (Instant::now(), 0);
    let (mut met, mut now) = (BTreeSet::new(), BTreeSet::new());
    while start.elapsed() < Duration::from_secs(seconds) {
        let edit =
            scene.edit().set_with(own.clone(), |index| walker(machine, index - own.start, tick));
        let answer = edit.commit(Report::Changes)?;
        if answer.is_resync() {
            now.clear();
        }
        let pairs = answer.pairs();
        let begun = pairs.iter().chain(answer.begun().iter());
        // A pair with an index of another lease is one with a ghost.
        let is_with_ghost = |pair: &[u32; 2]| pair.iter().any(|index| !own.contains(index));
        let with_ghosts: Vec<[u32; 2]> = begun.filter(is_with_ghost).collect();
        met.extend(with_ghosts.iter().copied());
        now.extend(with_ghosts);
        for ended in answer.ended() {
            now.remove(&ended.pair);
        }
        tick += 1;
        std::thread::sleep((TICK * tick).saturating_sub(start.elapsed()));
    }
    println!(
        "machine {machine}: {tick} ticks, {} pairs with walkers of the other machine, {} of them at the end",
        met.len(),
        now.len()
    );
    if let Some([path, seconds]) = stand.as_deref() {
        let mut lines = String::new();
        for index in own.clone() {
            let Aabb { min, max } = walker(machine, index - own.start, tick - 1);
            writeln!(lines, "[{index},{min:?},{max:?}]")?;
        }
        let (path, parts) = (PathBuf::from(path), PathBuf::from(format!("{path}.part")));
        std::fs::write(&parts, lines)?;
        std::fs::rename(parts, path)?;
        let until = start.elapsed() + Duration::from_secs(seconds.parse()?);
        while start.elapsed() < until {
            // A writer that commits nothing has the others wait.
            drop(scene.edit().commit(Report::Nothing)?);
            std::thread::sleep(TICK);
        }
    }
    if met.is_empty() { Err("nobody of the other machine was met".into()) } else { Ok(()) }
}
