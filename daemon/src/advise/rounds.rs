//! Which way is measured when, and for how long.
//!
//! Each way is looked at alone, for a short time. Those that come near the best one are then measured in turns, so that
//! what other programs do meanwhile meets all of them, and half of them stay in (successive halving: Jamieson, Talwalkar
//! 2016). The best one and its rivals are measured once more from a new beginning.

use std::time::{Duration, Instant};

use super::choose::{Sample, Sizes, best, plainest, stay_in};
use super::hosts::Hosts;
use super::measure::{Client, MeasureError};
use super::options::{Means, Way, hosts, ways};
use super::workload::{Work, Workload};
use crate::scene::Random;

/// Ways that are measured in turns after the first look, and after that.
const STAY: [usize; 3] = [8, 4, 3];
/// Shares of the time: the first look, the rounds in turns, several sizes.
const LOOK_SHARE: f64 = 0.35;
const ROUND_SHARES: [f64; 3] = [0.2, 0.15, 0.15];
const SIZES_SHARE: f64 = 0.15;
/// The part of a look in which engines learn what frames take, caches fill and clocks rise.
const WARM_UP_SHARE: f64 = 0.3;
/// Ticks of a turn, at least and at most, and the time that it takes about.
const TURN_TICKS: [usize; 2] = [4, 256];
const TURN: Duration = Duration::from_millis(4);
/// In which order ways take turns is random: what one leaves behind, in caches and clocks, meets all others.
const SEED: u64 = 1;
/// Turns of a round at least.
const LEAST_TURNS: u32 = 3;
/// Sizes that are measured to find where one host takes over from another.
const SIZES: [usize; 8] = [100, 300, 1_000, 3_000, 10_000, 30_000, 100_000, 300_000];

/// How long all of it may take.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    pub time: Duration,
    pub cores: usize,
}

/// What was measured, and what follows.
#[derive(Debug)]
pub struct Advice {
    /// All ways, the fastest first of those that were measured longest.
    pub samples: Vec<Sample>,
    /// The one to take.
    pub best: usize,
    /// What a program takes that asked nobody.
    pub plainest: Option<usize>,
    /// The fastest one with near pairs, where the best one has none.
    pub near: Option<usize>,
    pub sizes: Sizes,
    /// Ways that could not be measured, and why.
    pub failed: Vec<String>,
}

/// Reports how much is done, from 0 to 1, and with what it goes on.
pub type Progress<'a> = &'a mut dyn FnMut(f64, &str);

struct Rounds<'a> {
    workload: &'a Workload,
    hosts: &'a Hosts,
    time: Duration,
    begun: Instant,
    failed: Vec<String>,
    last_error: Option<MeasureError>,
    /// Names of shared scenes.
    names: u32,
}

/// Measures the ways that serve a work, and chooses.
pub fn advise(
    workload: &Workload,
    hosts: &Hosts,
    effort: Effort,
    progress: Progress<'_>,
) -> Result<Advice, MeasureError> {
    let means = Means { cores: effort.cores, has_gpu: hosts.has_gpu() };
    let mut rounds = Rounds::new(workload, hosts, effort.time);
    let accepts_near = workload.accepts_near;
    let mut samples = rounds.look(&ways(workload, means), progress);
    for (most, share) in STAY.into_iter().zip(ROUND_SHARES) {
        let stay = stay_in(&samples, accepts_near, most);
        let ways: Vec<Way> = stay.iter().map(|at| samples[*at].way).collect();
        progress(rounds.done(), &format!("the best {} of {} in turns", ways.len(), samples.len()));
        let measured = rounds.beside(workload, &ways, effort.time.mul_f64(share));
        for sample in measured {
            if let Some(known) = samples.iter_mut().find(|known| known.way == sample.way) {
                *known = Sample { rounds: known.rounds + 1, ..sample };
            }
        }
    }
    samples.sort_by_key(|sample| (u32::MAX - sample.rounds, sample.figures.usual_ns));
    let Some(best) = best(&samples, accepts_near) else {
        return Err(rounds.last_error.unwrap_or(MeasureError::NoWay));
    };
    let is_near = |sample: &Sample| !accepts_near && sample.way.is_near();
    let near = samples.iter().position(is_near);
    let way = samples[best].way;
    let sizes = rounds.sizes(way, means, effort.time.mul_f64(SIZES_SHARE), progress);
    let plainest = plainest(&samples);
    Ok(Advice { best, plainest, near, sizes, failed: rounds.failed, samples })
}

/// Measures all ways in turns for so long: what an advice is judged by.
pub fn measure_all(
    workload: &Workload,
    hosts: &Hosts,
    effort: Effort,
) -> Result<Vec<Sample>, MeasureError> {
    let means = Means { cores: effort.cores, has_gpu: hosts.has_gpu() };
    let mut rounds = Rounds::new(workload, hosts, effort.time);
    let samples = rounds.beside(workload, &ways(workload, means), effort.time);
    match rounds.last_error {
        Some(error) if samples.is_empty() => Err(error),
        _ => Ok(samples),
    }
}

impl<'a> Rounds<'a> {
    fn new(workload: &'a Workload, hosts: &'a Hosts, time: Duration) -> Self {
        let (begun, failed) = (Instant::now(), Vec::new());
        Self { workload, hosts, time, begun, failed, last_error: None, names: 0 }
    }

    fn done(&self) -> f64 {
        (self.begun.elapsed().as_secs_f64() / self.time.as_secs_f64()).min(1.0)
    }

    /// Each way alone.
    fn look(&mut self, ways: &[Way], progress: Progress<'_>) -> Vec<Sample> {
        let time = self.time.mul_f64(LOOK_SHARE / ways.len().max(1) as f64);
        let mut samples = Vec::new();
        for way in ways {
            progress(self.done(), &way.to_string());
            let measured = self.open(self.workload, *way).and_then(|mut client| {
                run_for(&mut client, time.mul_f64(WARM_UP_SHARE))?;
                client.begin_round();
                run_for(&mut client, time.mul_f64(1.0 - WARM_UP_SHARE))?;
                Ok(Sample { way: *way, figures: client.figures(), rounds: 1 })
            });
            match measured {
                Ok(sample) => samples.push(sample),
                Err(error) => self.leave_out(error),
            }
        }
        samples
    }

    /// Ways in turns.
    fn beside(&mut self, workload: &Workload, ways: &[Way], time: Duration) -> Vec<Sample> {
        let mut clients = Vec::new();
        for way in ways {
            let opened = self.open(workload, *way).and_then(|mut client| {
                client.turn(TURN_TICKS[0])?;
                client.turn(TURN_TICKS[0])?;
                Ok(client)
            });
            match opened {
                Ok(client) => clients.push(client),
                Err(error) => self.leave_out(error),
            }
        }
        let warm = Instant::now();
        let (mut turns, mut begun, mut random) = (0, None, Random::new(SEED));
        loop {
            // A round begins when engines have learned.
            if begun.is_none() && (warm.elapsed() >= time.mul_f64(WARM_UP_SHARE) || turns >= 20) {
                clients.iter_mut().for_each(Client::begin_round);
                (begun, turns) = (Some(Instant::now()), 0);
            }
            let is_over = begun.is_some_and(|_| warm.elapsed() >= time) && turns >= LEAST_TURNS;
            if is_over || clients.is_empty() {
                break;
            }
            shuffle(&mut clients, &mut random);
            let mut stay = Vec::with_capacity(clients.len());
            for mut client in clients {
                let ticks = client.ticks_in(TURN).clamp(TURN_TICKS[0], TURN_TICKS[1]);
                match client.turn(ticks) {
                    Ok(()) => stay.push(client),
                    Err(error) => self.leave_out(error),
                }
            }
            clients = stay;
            turns += 1;
        }
        let sample = |client: &Client<'_>| Sample {
            way: client.way(),
            figures: client.figures(),
            rounds: 1,
        };
        clients.iter().map(sample).collect()
    }

    fn open<'b>(&mut self, workload: &'b Workload, way: Way) -> Result<Client<'b>, MeasureError>
    where
        'a: 'b,
    {
        self.names += 1;
        Client::open(workload, way, self.hosts, &format!("advise-{}", self.names))
    }

    fn leave_out(&mut self, error: MeasureError) {
        let text = error.to_string();
        log::debug!("left out: {text}");
        if !self.failed.contains(&text) {
            self.failed.push(text);
        }
        self.last_error = Some(error);
    }

    /// The form that is advised with each host, by the number of boxes.
    fn sizes(&mut self, way: Way, means: Means, time: Duration, progress: Progress<'_>) -> Sizes {
        let Work::Boxes(boxes) = &self.workload.work else { return Sizes::default() };
        if !boxes.writers.is_empty() {
            return Sizes::default();
        }
        let all = hosts(means, false).into_iter();
        let all = all.map(|(host, threads, engine)| Way { host, threads, engine, ..way });
        let mut sizes = Sizes { ways: all.collect(), rows: Vec::new() };
        let begun = Instant::now();
        for n in SIZES {
            if begun.elapsed() >= time {
                break;
            }
            progress(self.done(), &format!("{n} boxes"));
            let Some(boxes) = boxes.resized(n) else { break };
            let resized = Workload {
                work: Work::Boxes(boxes),
                accepts_near: self.workload.accepts_near,
                notes: Vec::new(),
            };
            let samples = self.beside(&resized, &sizes.ways, time / SIZES.len() as u32);
            let ns = sizes.ways.iter().map(|way| {
                samples
                    .iter()
                    .find(|sample| sample.way == *way)
                    .map(|sample| sample.figures.usual_ns)
            });
            // A size that one of them cannot serve, and those above it, are compared with nothing.
            let Some(ns) = ns.collect::<Option<Vec<u64>>>() else { break };
            sizes.rows.push((n, ns));
        }
        sizes
    }
}

fn shuffle<T>(all: &mut [T], random: &mut Random) {
    for end in (1..all.len()).rev() {
        all.swap(end, random.below(end as u64 + 1) as usize);
    }
}

/// Does ticks for so long, and some at least.
fn run_for(client: &mut Client<'_>, time: Duration) -> Result<(), MeasureError> {
    let begun = Instant::now();
    let mut ticks = TURN_TICKS[0];
    loop {
        client.turn(ticks)?;
        if begun.elapsed() >= time {
            return Ok(());
        }
        if begun.elapsed() < time / 4 {
            ticks = (2 * ticks).min(TURN_TICKS[1]);
        }
    }
}
