//! Persistent scenes beside whole frames and other broad phases: what an edit and its changes cost, by how
//! much moves.
//!
//! Scene and peers make the same changes, in turns. In process they have the threads of this machine: a pool
//! of which the calling thread is one, so that small edits do not wait for another to wake. `daemon` asks the
//! instance of the environment, which is to be started first. Write: the arrays of indices and boxes in, the
//! edit sent (in process: answered too); round trip: until the answer is there; iterate: every change read,
//! and the answer taken; total: all of it. At a rate, frames of the scene are due at equal intervals, total
//! counts from when one was due, and the peers follow at the same pace, one after the other.
//!
//! The peer `whole-frame` is a frame of the same session, written, answered, and every pair of it iterated over.
//! Others (feature `peers`) are given the boxes that moved, and keep their list of pairs: `rapier`'s broad
//! phase and `parry`'s tree where it changed (both of pairs of boxes that grow by a margin), and
//! `parry-queries`, where each box that moved asks the tree. A ratio below 1 is in favour of the scene.
//! `cpu µs` is the CPU time of an edit, of this process and of the daemon: spinning counts.
//! Spawning and dying takes place at 1 % unless shares are asked for. A row a peer; `bytes` are what the
//! daemon or, in process, this process keeps of the scene, a box.

mod peer;

use std::error::Error;
use std::hint::black_box;
use std::time::{Duration, Instant};

use clap::{Parser, ValueEnum};
use pairmask::Scene;
use pairmask_core::engine::EngineId;
use pairmask_core::scene::Indices;
use pairmask_lab::study::moving::{Motion, World};
use pairmask_tests::measure::{Pace, iterate, percentile};
use pairmask_tests::prelude::*;
use pairmask_transport::RuntimeDir;
use pairmask_wire::InstanceName;
use pairmaskd::daemon_cpu::{DaemonCpu, nanoseconds_a, own_cpu};
use pairmaskd::scene::SceneName;
use serde_json::{Value, json};

use self::peer::{Peer, PeerName, peer, whole_frame};

/// Frames that are not counted: cells are built, memory is taken.
const WARM_UP: u32 = 3;
/// Shares of boxes that move, %, unless some are asked for; and of those that spawn and die.
const PERCENTS: &[f64] = &[0.0, 0.01, 0.1, 1.0, 10.0, 50.0, 100.0];
const SPAWN_PERCENTS: &[f64] = &[1.0];

/// Persistent scenes beside whole frames and other broad phases.
#[derive(Parser)]
#[command(name = "skip")]
struct Options {
    #[arg(long, value_delimiter = ',', default_values_t = [10_000, 100_000])]
    n: Vec<usize>,
    #[arg(long, value_delimiter = ',', default_values_t = [SceneName::Uniform, SceneName::Pile])]
    scene: Vec<SceneName>,
    /// Shares of boxes that move, %
    #[arg(long, value_delimiter = ',')]
    moving: Vec<f64>,
    #[arg(long, value_delimiter = ',', default_value = "drift,jitter,teleport,spawn")]
    motion: Vec<Motion>,
    #[arg(long, default_value_t = 20)]
    frames: u32,
    #[arg(long, value_delimiter = ',', default_values_t = [Backend::InProcess])]
    backend: Vec<Backend>,
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [PeerName::WholeFrame])]
    peer: Vec<PeerName>,
    /// Frames a second, or closed: one after the other
    #[arg(long, value_delimiter = ',', default_value = "closed")]
    rate: Vec<String>,
    #[arg(long)]
    json: bool,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

impl Options {
    /// The shares of boxes that move in this way, %.
    fn percents(&self, motion: Motion) -> &[f64] {
        match motion {
            _ if !self.moving.is_empty() => &self.moving,
            Motion::Spawn => SPAWN_PERCENTS,
            _ => PERCENTS,
        }
    }
}

/// An edit of a scene, its changes iterated over and taken: write, round trip and iteration, ns; how many changes, and
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
    let pending = edit.submit(Report::Changes)?;
    let write = begin.elapsed().as_nanos() as u64;
    let answer = pending.wait()?;
    let answered = begin.elapsed().as_nanos() as u64;
    iterate(|each| answer.begun().for_each_slice(each));
    iterate(|each| answer.pairs().for_each_slice(each));
    black_box(answer.ended().fold(0, |sum, e| sum + u64::from(e.pair[0] ^ e.pair[1])));
    let times = [write, answered - write, begin.elapsed().as_nanos() as u64 - answered];
    Ok((times, answer.begun().len() + answer.ended().count(), answer.engine()))
}

struct Taken {
    /// The edit written and sent, until the answer is there, every change read and taken, and all of it: the sum of
    /// these, or more where the frame began late; ns a frame.
    times: [Vec<u64>; 4],
    /// CPU time of an edit, ns, of this process and of the daemon.
    cpu_ns: u64,
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
    peers: Vec<(PeerName, Box<dyn Peer>)>,
    daemon: Option<DaemonCpu>,
}

impl<'s> Bench<'s> {
    fn new(
        (session, backend): (&'s mut Session, Backend),
        world: World,
        names: &[PeerName],
    ) -> Result<Self, Box<dyn Error>> {
        let mut scene = session.scene(pairmask::SceneOptions::default())?;
        let all: Vec<u32> = (0..world.boxes().len() as u32).collect();
        edit(&mut scene, &all, world.boxes(), false)?;
        let made = names.iter().map(|name| Ok((*name, peer(*name, world.boxes())?)));
        let peers = made.collect::<Result<_, Box<dyn Error>>>()?;
        let (dir, instance) = (RuntimeDir::from_env(), InstanceName::default());
        let daemon = match backend {
            Backend::InProcess => None,
            Backend::Auto | Backend::Daemon => DaemonCpu::of(&dir, &instance),
        };
        Ok(Self { session, scene, world, peers, daemon })
    }

    /// Frames of the scene and of the peers: in turns in a closed loop, else one after the other.
    fn run(
        &mut self,
        (count, motion): (usize, Motion),
        frames: u32,
        rate: Option<f64>,
    ) -> Result<Taken, Box<dyn Error>> {
        let mut peer_times = vec![Vec::new(); self.peers.len()];
        // Peers at a pace follow later, from the same boxes: beside them no frame would be on time.
        let mut behind: Vec<World> =
            rate.map(|_| vec![self.world.clone(); self.peers.len()]).unwrap_or_default();
        let mut times = [const { Vec::new() }; 4];
        let mut last = None;
        let pace = Pace::from_now(rate);
        let of_daemon =
            |daemon: &Option<DaemonCpu>| daemon.as_ref().map_or(Duration::ZERO, DaemonCpu::used);
        let (mut cpu, mut daemon_before) = (Duration::ZERO, of_daemon(&self.daemon));
        for frame in 0..frames + WARM_UP {
            let (indices, boxes) = self.world.step(count, motion);
            let due = pace.wait(frame);
            let is_spawn = motion == Motion::Spawn;
            // At a pace a daemon awaits its client, and peers follow later: all that it does is for the edits.
            if rate.is_none() {
                daemon_before = of_daemon(&self.daemon);
            }
            let own_before = own_cpu();
            let begin = Instant::now();
            let (took, changes, engine) = edit(&mut self.scene, &indices, &boxes, is_spawn)?;
            if frame >= WARM_UP {
                cpu += own_cpu().saturating_sub(own_before);
                cpu += of_daemon(&self.daemon).saturating_sub(daemon_before);
                let late = begin.saturating_duration_since(due).as_nanos() as u64;
                let late = if rate.is_some() { late } else { 0 };
                let all = took.into_iter().chain([late + took.iter().sum::<u64>()]);
                times.iter_mut().zip(all).for_each(|(times, ns)| times.push(ns));
            }
            daemon_before = of_daemon(&self.daemon);
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
        for (slot, world) in behind.iter_mut().enumerate() {
            let pace = Pace::from_now(rate);
            for frame in 0..frames + WARM_UP {
                let (indices, _) = world.step(count, motion);
                let due = pace.wait(frame);
                self.peers[slot].1.change(self.session, world.boxes(), &indices)?;
                if frame >= WARM_UP {
                    peer_times[slot].push(due.elapsed().as_nanos() as u64);
                }
            }
        }
        let (changes, engine) = last.ok_or("no frame")?;
        let cpu_ns = nanoseconds_a(cpu, frames.into());
        Ok(Taken { times, cpu_ns, changes, engine, peers: peer_times })
    }

    /// Whether scene and peers have as many pairs as a whole frame.
    fn check(&mut self) -> Result<(), Box<dyn Error>> {
        let pair_count = whole_frame(self.session, self.world.boxes())?;
        let reported = self.scene.edit().commit(Report::Changes)?;
        assert_eq!(reported.pair_count(), Some(pair_count), "the scene and the frame differ");
        for (name, peer) in &mut self.peers {
            let pairs = peer.pairs(self.world.boxes())?;
            assert!(pairs.is_none_or(|pairs| pairs == pair_count), "{name:?} has other pairs");
        }
        Ok(())
    }

    fn held_bytes(&self) -> f64 {
        match self.scene.daemon_bytes() {
            0 => self.scene.allocated_bytes() as f64,
            bytes => bytes as f64,
        }
    }

    /// The rows of a share, one a peer: what the JSON has of it, and the line of the table.
    fn rows(
        &mut self,
        (motion, percent): (Motion, f64),
        (frames, rate): (u32, Option<f64>),
        (scene, backend): (SceneName, Backend),
    ) -> Result<Vec<(Value, String)>, Box<dyn Error>> {
        let n = self.world.boxes().len();
        let count = (n as f64 * percent / 100.0).round() as usize;
        let taken = self.run((count, motion), frames, rate)?;
        self.check()?;
        let Taken { times, cpu_ns, changes, engine, peers } = taken;
        let engine = engine.to_string();
        let [write, round_trip, iterate, total] = times.each_ref().map(|t| percentile(t, 0.5));
        let us = |ns: u64| ns as f64 / 1e3;
        let bytes_a_box = self.held_bytes() / n as f64;
        let of_peer = |((name, _), took): (&(PeerName, Box<dyn Peer>), &Vec<u64>)| {
            let peer = name.to_possible_value();
            let peer = peer.as_ref().map_or("", |value| value.get_name());
            let peer_ns = percentile(took, 0.5);
            // Below 1 is in favour of the scene.
            let ratio = total as f64 / peer_ns.max(1) as f64;
            let json = json!({
                "scene": scene.as_str(), "n": n, "moving": percent / 100.0, "motion": motion.name(),
                "backend": backend.to_string(), "engine": engine, "write_ns": write,
                "round_trip_ns": round_trip, "iterate_ns": iterate, "total_ns": total, "cpu_ns": cpu_ns,
                "peer": peer, "peer_ns": peer_ns, "ratio": ratio,
            });
            let line = format!(
                "{scene:>9} {n:>9} {percent:>7}% {:>9} {:>10} {engine:>10} {:>9.1} {:>10.1} {:>9.1} {:>10.1} {:>10.1} {:>9.1} {peer:>13} {:>10.1} {ratio:>7.4} {changes:>9} {bytes_a_box:>6.0}",
                motion.name(),
                backend.to_string(),
                us(write),
                us(round_trip),
                us(iterate),
                us(total),
                us(percentile(&times[3], 0.99)),
                us(cpu_ns),
                us(peer_ns),
            );
            (json, line)
        };
        Ok(self.peers.iter().zip(&peers).map(of_peer).collect())
    }
}

const HEAD: &str = "    scene         n   moving    motion    backend     engine  write µs     answer     iterate over      total        p99    cpu µs          peer    peer µs   ratio   changes  bytes";

fn main() -> Result<(), Box<dyn Error>> {
    let options = Options::parse();
    rayon::ThreadPoolBuilder::new().use_current_thread().build_global()?;
    let mut rows = Vec::new();
    for rate in &options.rate {
        let rate = if rate == "closed" { None } else { Some(rate.parse::<f64>()?) };
        if !options.json {
            match rate {
                None => println!("Frames one after the other."),
                Some(rate) => println!("Frames at {rate} Hz, from when they were due."),
            }
            println!("{HEAD}");
        }
        for &backend in &options.backend {
            // The whole frame of a scene at rest is culled, too: that is what the scene is set beside.
            let mut session =
                Session::builder().backend(backend).answer_repeats(false).connect()?;
            for &name in &options.scene {
                for &n in &options.n {
                    for &motion in &options.motion {
                        let world = World::new(name, n);
                        let mut bench = Bench::new((&mut session, backend), world, &options.peer)?;
                        for &percent in options.percents(motion) {
                            let pace = (options.frames.max(1), rate);
                            for (json, line) in
                                bench.rows((motion, percent), pace, (name, backend))?
                            {
                                if !options.json {
                                    println!("{line}");
                                }
                                rows.push(json);
                            }
                        }
                    }
                }
            }
        }
    }
    if options.json {
        println!("{}", serde_json::to_string_pretty(&json!({ "rows": rows }))?);
    }
    Ok(())
}
