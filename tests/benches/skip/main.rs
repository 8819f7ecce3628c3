//! Scenes that persist beside whole frames and other broad phases: what an edit and its changes cost, by how
//! much moves.
//!
//! ```text
//! cargo bench -p pairmask-tests --bench skip -- [--n 10000,100000] [--scene uniform,pile]
//!     [--moving 0,0.01,0.1,1,10,50,100] [--motion drift,jitter,teleport,spawn] [--frames 20]
//!     [--backend in-process,daemon] [--peer whole-frame,rapier,parry,parry-queries]
//!     [--rate closed,60,240] [--svg FILE] [--json]
//! ```
//!
//! Scene and peers make the same changes, in turns. In process they have the threads of this machine: a pool
//! of which the calling thread is one, so that small edits do not wait for another to wake. `daemon` asks the
//! instance of the environment, which is to be started first. Write: the arrays of indices and boxes in, the
//! edit sent (in process: answered too); round trip: until the answer is there; visit: every change read,
//! and the answer taken; total: all of it. At a rate, frames of the scene are due at equal intervals, total
//! counts from when one was due, and the peers follow at the same pace, one after the other.
//!
//! The peer `whole-frame` is a frame of the same session, written, answered, and every pair of it visited.
//! Others (feature `peers`) are given the boxes that moved, and keep their list of pairs: `rapier`'s broad
//! phase and `parry`'s tree where it changed (both of pairs of boxes that grow by a margin), and
//! `parry-queries`, where each box that moved asks the tree. A ratio below 1 is in favour of the scene.
//! Spawning and dying takes place at 1 % unless shares are asked for. A row a peer; `bytes` are what the
//! daemon or, in process, this process keeps of the scene, a box. `--svg` draws the paper's Figure 6 beside it.

mod options;
mod peer;

use std::error::Error;
use std::hint::black_box;
use std::process::ExitCode;
use std::time::Instant;

use pairmask::scene::{Indices, SceneOptions, Want};
use pairmask::{Aabb, EngineId, Scene, Session};
use pairmask_lab::study::moving::{Motion, World};
use pairmask_tests::skip::pace::Pace;
use pairmask_tests::skip::picture::picture;
use pairmask_tests::skip::row::{Row, Times, percentile};
use serde_json::json;

use self::options::Options;
use self::peer::{Peer, PeerName, whole_frame};

/// Frames that are not counted: cells are built, memory is taken.
const WARM_UP: u32 = 3;

/// An edit of a scene, its changes visited and taken: write, round trip and visit, ns; how many changes, and
/// what answered.
fn edit(
    scene: &mut Scene,
    indices: &[u32],
    boxes: &[Aabb],
    is_spawn: bool,
) -> Result<([u64; 3], usize, EngineId), Box<dyn Error>> {
    let all = indices.len() == scene.len();
    let these = if all { Indices::from(0..indices.len() as u32) } else { indices.into() };
    let begin = Instant::now();
    let mut edit = scene.edit().set_all(these, boxes);
    if is_spawn {
        edit = edit.remove_all(these);
    }
    let pending = edit.submit(Want::Changes)?;
    let write = begin.elapsed().as_nanos() as u64;
    let answer = pending.wait()?;
    let answered = begin.elapsed().as_nanos() as u64;
    let told = answer.take();
    let mut sum = 0;
    let mut visit = |pairs: &[[u32; 2]]| {
        sum += pairs.iter().fold(0u64, |sum, [a, b]| sum + u64::from(a ^ b));
    };
    told.begun().for_each_slice(&mut visit);
    told.pairs().for_each_slice(&mut visit);
    sum += told.ended().iter().fold(0u64, |sum, e| sum + u64::from(e.pair[0] ^ e.pair[1]));
    black_box(sum);
    let times = [write, answered - write, begin.elapsed().as_nanos() as u64 - answered];
    Ok((times, told.begun().len() + told.ended().len(), told.engine()))
}

/// How the boxes of a run move.
#[derive(Clone, Copy)]
struct Moves {
    /// Boxes that move in a frame.
    count: usize,
    motion: Motion,
}

/// What a scene took, and what it said last.
struct Taken {
    times: Times,
    changes: usize,
    engine: EngineId,
    /// What each peer took, ns a frame.
    peers: Vec<Vec<u64>>,
}

/// A scene, what moves in it, and its peers. All of them have made the same changes.
struct Bench<'s> {
    session: &'s mut Session,
    scene: Scene,
    world: World,
    peers: Vec<(PeerName, Peer)>,
}

impl<'s> Bench<'s> {
    fn new(
        session: &'s mut Session,
        world: World,
        names: &[PeerName],
    ) -> Result<Self, Box<dyn Error>> {
        let mut scene = session.scene(SceneOptions::default());
        let all: Vec<u32> = (0..world.boxes().len() as u32).collect();
        edit(&mut scene, &all, world.boxes(), false)?;
        let made = names.iter().map(|name| Ok((*name, Peer::new(*name, world.boxes())?)));
        let peers = made.collect::<Result<_, Box<dyn Error>>>()?;
        Ok(Self { session, scene, world, peers })
    }

    /// Frames of the scene and of the peers: in turns in a closed loop, else one after the other.
    fn run(
        &mut self,
        moves: Moves,
        frames: u32,
        rate: Option<f64>,
    ) -> Result<Taken, Box<dyn Error>> {
        let mut peer_times = vec![Vec::new(); self.peers.len()];
        // Peers at a pace follow later, from the same boxes: beside them no frame would be on time.
        let mut behind: Vec<World> =
            rate.map(|_| vec![self.world.clone(); self.peers.len()]).unwrap_or_default();
        let mut times = Times::default();
        let mut last = None;
        let pace = Pace::from_now(rate);
        for frame in 0..frames + WARM_UP {
            let (indices, boxes) = self.world.step(moves.count, moves.motion);
            let due = pace.wait(frame);
            let is_spawn = moves.motion == Motion::Spawn;
            let begin = Instant::now();
            let (took, changes, engine) = edit(&mut self.scene, &indices, &boxes, is_spawn)?;
            if frame >= WARM_UP {
                let [write, round_trip, visit] = took;
                times.write.push(write);
                times.round_trip.push(round_trip);
                times.visit.push(visit);
                let late = begin.saturating_duration_since(due).as_nanos() as u64;
                let late = if rate.is_some() { late } else { 0 };
                times.total.push(late + write + round_trip + visit);
            }
            last = Some((changes, engine));
            if rate.is_none() {
                for ((_, peer), times) in self.peers.iter_mut().zip(&mut peer_times) {
                    let begin = Instant::now();
                    peer.change(self.session, self.world.boxes(), &indices)?;
                    if frame >= WARM_UP {
                        times.push(begin.elapsed().as_nanos() as u64);
                    }
                }
            }
        }
        for (place, world) in behind.iter_mut().enumerate() {
            let pace = Pace::from_now(rate);
            for frame in 0..frames + WARM_UP {
                let (indices, _) = world.step(moves.count, moves.motion);
                let due = pace.wait(frame);
                self.peers[place].1.change(self.session, world.boxes(), &indices)?;
                if frame >= WARM_UP {
                    peer_times[place].push(due.elapsed().as_nanos() as u64);
                }
            }
        }
        let (changes, engine) = last.ok_or("no frame")?;
        Ok(Taken { times, changes, engine, peers: peer_times })
    }

    /// Whether the scene has as many pairs as a whole frame.
    fn check(&mut self) -> Result<(), Box<dyn Error>> {
        let pair_count = whole_frame(self.session, self.world.boxes())?;
        let told = self.scene.edit().commit(Want::Changes)?;
        assert_eq!(told.pair_count(), Some(pair_count), "the scene and the frame differ");
        Ok(())
    }

    fn kept_bytes(&self) -> f64 {
        match self.scene.daemon_bytes() {
            0 => self.scene.allocated_bytes() as f64,
            bytes => bytes as f64,
        }
    }

    /// The rows of a share, one a peer.
    fn rows(
        &mut self,
        (motion, percent): (Motion, f64),
        (frames, rate): (u32, Option<f64>),
        (scene, backend): (String, String),
    ) -> Result<Vec<Row>, Box<dyn Error>> {
        let n = self.world.boxes().len();
        let count = (n as f64 * percent / 100.0).round() as usize;
        let taken = self.run(Moves { count, motion }, frames, rate)?;
        self.check()?;
        let Taken { times, changes, engine, peers } = taken;
        let median = |times: &[u64]| percentile(times, 0.5);
        let bytes_a_box = self.kept_bytes() / n as f64;
        let of_peer = |((name, _), peer): (&(PeerName, Peer), &Vec<u64>)| Row {
            scene: scene.clone(),
            n,
            moving: percent / 100.0,
            motion,
            backend: backend.clone(),
            engine: engine.to_string(),
            write_ns: median(&times.write),
            round_trip_ns: median(&times.round_trip),
            visit_ns: median(&times.visit),
            total_ns: median(&times.total),
            p99_ns: percentile(&times.total, 0.99),
            peer: name.as_str(),
            peer_ns: median(peer),
            changes,
            bytes_a_box,
        };
        Ok(self.peers.iter().zip(&peers).map(of_peer).collect())
    }
}

/// In words, when frames begin.
fn pace_in_words(rate: Option<f64>) -> String {
    rate.map_or("Frames one after the other.".to_owned(), |rate| {
        format!("Frames at {rate} Hz, from when they were due.")
    })
}

fn run() -> Result<(), Box<dyn Error>> {
    let options = Options::parse(std::env::args().skip(1))?;
    rayon::ThreadPoolBuilder::new().use_current_thread().build_global()?;
    let mut rows = Vec::new();
    for &rate in &options.rates {
        if !options.json {
            println!("{}\n{}", pace_in_words(rate), Row::head());
        }
        let first = rows.len();
        for &backend in &options.backends {
            // The whole frame of a scene at rest is culled, too: that is what the scene is set beside.
            let mut session =
                Session::builder().backend(backend).answer_repeats(false).connect()?;
            for &name in &options.scenes {
                for &n in &options.sizes {
                    for &motion in &options.motions {
                        let world = World::new(name, n);
                        let mut bench = Bench::new(&mut session, world, &options.peers)?;
                        for &percent in options.percents(motion) {
                            let labels = (name.to_string(), backend.to_string());
                            let pace = (options.frames, rate);
                            let new = bench.rows((motion, percent), pace, labels)?;
                            if !options.json {
                                for row in &new {
                                    println!("{}", row.line());
                                }
                            }
                            rows.extend(new);
                        }
                    }
                }
            }
        }
        if let Some(path) = &options.svg {
            let path = match rate {
                Some(rate) if options.rates.len() > 1 => {
                    path.with_extension(format!("{rate}hz.svg"))
                }
                _ => path.clone(),
            };
            std::fs::write(&path, picture(&rows[first..], &pace_in_words(rate)))?;
        }
    }
    if options.json {
        let rows: Vec<_> = rows.iter().map(Row::json).collect();
        println!("{}", serde_json::to_string_pretty(&json!({ "rows": rows }))?);
    }
    Ok(())
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
