//! Eight ticks of a scene, then back by eight ticks and the same again: ms, p50, and the ratio of the second to eight
//! ticks of a scene without snapshots. A snapshot is taken before each tick, and the oldest is forgotten.
//!
//! Both scenes take turns, with the same boxes and the same moves: of the same boxes in all ticks, or of others in each.
//! The answers of the ticks that are played again are compared with the first ones.

use std::collections::VecDeque;
use std::error::Error;
use std::time::Instant;

use clap::Parser;
use pairmask::{Scene, SceneOptions, SnapshotId};
use pairmask_tests::measure::{self, percentile};
use pairmask_tests::prelude::*;
use pairmaskd::execute::gpu::GpuChoice;
use serde_json::json;

/// Ticks that a game goes back.
const BACK: usize = 8;
const WARM_UP: usize = 10;

/// Eight ticks of a scene, back, and the same again.
#[derive(Clone, Copy, Parser)]
struct Size {
    #[arg(long, default_value_t = 100_000)]
    boxes: u32,
    /// Boxes that move in a tick, %
    #[arg(long, default_value_t = 1)]
    share: u32,
    #[arg(long, default_value_t = 100)]
    rounds: usize,
    /// Keep the daemon's scene in video memory
    #[arg(long)]
    gpu: bool,
    #[arg(long)]
    json: bool,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

/// Where a box is in a tick: on a lattice, with neighbours.
fn box_at(index: u32, tick: usize, boxes: u32) -> Aabb {
    let side = f64::from(boxes).cbrt().ceil() as u32;
    let shift = 0.3 * (0.37 * tick as f32 + index as f32).sin();
    let at = [index % side, index / side % side, index / side / side].map(|c| c as f32 + shift);
    Aabb::new(at, at.map(|x| x + 0.8))
}

type Changes = (Vec<Pair>, Vec<Pair>);

/// Moves boxes, and takes the changes.
fn commit(scene: &mut Scene, (indices, boxes): &Moves) -> Result<Changes, pairmask::Error> {
    let answer = scene.edit().set_all(indices, boxes).commit(Report::Changes)?;
    Ok((answer.begun().to_vec(), answer.ended().map(|ended| ended.pair).collect()))
}

type Moves = (Vec<u32>, Vec<Aabb>);

impl Size {
    fn moves(&self, tick: usize, are_others: bool) -> Moves {
        let shift = if are_others { tick } else { 0 };
        let moves = |index: &u32| (*index as usize * 37 + shift) % 100 < self.share as usize;
        let indices: Vec<u32> = (0..self.boxes).filter(moves).collect();
        let boxes = indices.iter().map(|index| box_at(*index, tick, self.boxes)).collect();
        (indices, boxes)
    }

    fn measure(
        &self,
        by: &str,
        session: &mut Session,
        are_others: bool,
    ) -> Result<(), Box<dyn Error>> {
        let all: Vec<Aabb> = (0..self.boxes).map(|index| box_at(index, 0, self.boxes)).collect();
        let mut scenes = [(); 2].map(|()| session.scene(SceneOptions::default()));
        for scene in &mut scenes {
            let scene = scene.as_mut().map_err(|error| error.to_string())?;
            drop(scene.edit().set_all(0..self.boxes, &all).commit(Report::Changes)?);
        }
        let [plain, kept] = scenes;
        let (mut plain, mut kept) = (plain?, kept?);
        let mut times: [Vec<f64>; 4] = Default::default();
        let mut held: VecDeque<SnapshotId> = VecDeque::new();
        for round in 0..self.rounds + WARM_UP {
            let ticks: Vec<Moves> =
                (0..BACK).map(|tick| self.moves(1 + round * BACK + tick, are_others)).collect();
            let mut timed = [0.0; 4];
            let start = Instant::now();
            for moves in &ticks {
                commit(&mut plain, moves)?;
            }
            timed[0] = start.elapsed().as_secs_f64() * 1e3;
            let start = Instant::now();
            let first = play(&mut kept, &ticks, &mut held)?;
            timed[1] = start.elapsed().as_secs_f64() * 1e3;
            let start = Instant::now();
            let back = held.len() - BACK;
            kept.restore(held[back])?;
            // What followed is played anew, and has its snapshots.
            for later in held.drain(back..).rev() {
                kept.forget_snapshot(later)?;
            }
            timed[2] = start.elapsed().as_secs_f64() * 1e3;
            let again = play(&mut kept, &ticks, &mut held)?;
            timed[3] = start.elapsed().as_secs_f64() * 1e3;
            assert!(again == first, "round {round}: other changes");
            if round >= WARM_UP {
                times.iter_mut().zip(timed).for_each(|(times, time)| times.push(time));
            }
        }
        let [ticks, kept_ticks, restore, again] = times.map(|times| percentile(&times, 0.5));
        let row = json!({
            "by": by,
            "moving": if are_others { "others" } else { "the same" },
            "boxes": self.boxes,
            "ticks_ms": ticks,
            "with_snapshots_ms": kept_ticks,
            "back_ms": restore,
            "back_and_again_ms": again,
            "ratio": again / ticks,
        });
        if self.json {
            println!("{row}");
        } else {
            measure::print_row(
                &row,
                "by moving boxes ticks_ms with_snapshots_ms back_ms back_and_again_ms ratio",
            );
        }
        Ok(())
    }
}

/// Plays ticks, with a snapshot before each. Of a ring of snapshots the oldest is forgotten.
fn play(
    scene: &mut Scene,
    ticks: &[Moves],
    held: &mut VecDeque<SnapshotId>,
) -> Result<Vec<Changes>, pairmask::Error> {
    let mut changes = Vec::new();
    for moves in ticks {
        held.push_back(scene.snapshot()?);
        if held.len() > BACK {
            held.pop_front().map_or(Ok(()), |oldest| scene.forget_snapshot(oldest))?;
        }
        changes.push(commit(scene, moves)?);
    }
    Ok(changes)
}

fn main() -> Result<(), Box<dyn Error>> {
    let size = Size::parse();
    let gpu = if size.gpu { GpuChoice::Auto } else { GpuChoice::None };
    let daemon = measure::daemon(gpu)?;
    let mut by_daemon = daemon.session();
    if size.gpu {
        by_daemon = by_daemon.engine(EngineChoice::Only(EngineName::GpuGrid));
    }
    let (mut by_daemon, mut here) = (by_daemon.connect()?, in_process());
    for are_others in [false, true] {
        size.measure("in process", &mut here, are_others)?;
        size.measure("daemon", &mut by_daemon, are_others)?;
    }
    Ok(())
}
