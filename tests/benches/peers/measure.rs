//! Turns: every contender runs every frame, a few frames at a time.

use std::time::{Duration, Instant};

use pairmask_tests::peers::contender::{Contender, ContenderError, Tally, sorted};
use pairmask_tests::peers::line::{Comparison, Line, Spread, Who};
use pairmask_tests::prelude::*;
use pairmaskd::scene::{Scene, SceneName};
use rayon::ThreadPool;

use crate::options::Options;

/// Up to this many boxes, the sweep is the reference where the oracle is too slow: an engine that the
/// plan chooses for small scenes only.
const SWEEP_BOXES: usize = 200_000;
/// Up to this many boxes the naive oracle is the reference: 50 million tests, a tenth of a second.
const ORACLE_BOXES: usize = 10_000;
/// Turns between two comparisons of sets; they are compared after the last turn too.
const TURNS_BETWEEN_CHECKS: usize = 10;

/// A peer that has run for this long in all is left out of the other turns: on some scenes one peer
/// takes seconds a frame where others take milliseconds.
const TIMEOUT: Duration = Duration::from_secs(60);

pub struct Entrant {
    pub who: Who,
    pub threads: usize,
    pub contender: Box<dyn Contender>,
    pub pool: ThreadPool,
    frame_ns: Vec<u64>,
    write_ns: Vec<u64>,
    fault: Option<String>,
    spent: Duration,
}

#[derive(Default)]
struct Turn {
    frame_ns: Vec<u64>,
    write_ns: Vec<u64>,
    tallies: Vec<Tally>,
    pairs: Option<Vec<Pair>>,
}

impl Entrant {
    pub fn new(who: Who, threads: usize, contender: Box<dyn Contender>, pool: ThreadPool) -> Self {
        let (frame_ns, write_ns, spent) = (Vec::new(), Vec::new(), Duration::ZERO);
        Self { who, threads, contender, pool, frame_ns, write_ns, fault: None, spent }
    }

    fn turn(&mut self, frames: &[Vec<Aabb>], with_pairs: bool) -> Result<Turn, ContenderError> {
        let left = TIMEOUT.saturating_sub(self.spent);
        let is_peer = matches!(self.who, Who::Peer(_));
        let contender = &mut self.contender;
        let run = || {
            let mut turn = Turn::default();
            let began = Instant::now();
            for boxes in frames {
                let start = Instant::now();
                contender.write(boxes)?;
                let written = start.elapsed();
                let tally = contender.find(boxes)?;
                let found = start.elapsed();
                turn.write_ns.push(written.as_nanos() as u64);
                turn.frame_ns.push(found.as_nanos() as u64);
                turn.tallies.push(tally);
                if is_peer && began.elapsed() > left {
                    return Ok(turn);
                }
            }
            if let (Some(boxes), true) = (frames.last(), with_pairs) {
                turn.pairs = Some(contender.pairs(boxes)?);
            }
            Ok(turn)
        };
        let turn = self.pool.install(run);
        self.contender.settle();
        if let Ok(Turn { frame_ns, .. }) = &turn {
            self.spent += Duration::from_nanos(frame_ns.iter().sum());
        }
        turn
    }

    fn is_given_up(&self) -> bool {
        matches!(self.who, Who::Peer(_)) && self.spent > TIMEOUT
    }

    fn note(&mut self, fault: impl FnOnce() -> String) {
        self.fault.get_or_insert_with(fault);
    }

    fn line(self) -> Line {
        let is_given_up = self.is_given_up();
        let who = match (self.who, self.contender.engine()) {
            (Who::Ours { backend, engine: asked }, Some(engine)) if asked == "auto" => {
                Who::Ours { backend, engine: format!("auto:{engine}") }
            }
            (who, _) => who,
        };
        let late = self.frame_ns.len() - self.frame_ns.len() / 10;
        Line {
            threads: self.threads,
            frame: Spread::of(&self.frame_ns),
            is_given_up,
            late: Spread::of(self.frame_ns.get(late..).unwrap_or_default()),
            write: Spread::of(&self.write_ns),
            fault: self.fault,
            who,
        }
    }
}

/// Runs all lanes over the frames of a scene.
///
/// # Errors
/// A lane that cannot go on.
pub fn measure(
    name: SceneName,
    mut scene: Scene,
    mut entrants: Vec<Entrant>,
    options: &Options,
) -> Result<Comparison, Box<dyn std::error::Error>> {
    let n = scene.boxes().len();
    let turn_frames = options.turn.max(1);
    let turns = options.frames.div_ceil(turn_frames).max(1);
    let mut frames: Vec<Vec<Aabb>> = vec![Vec::with_capacity(n); turn_frames];
    let mut pairs = 0;
    for turn in 0..turns {
        for frame in &mut frames {
            scene.step();
            frame.clear();
            frame.extend_from_slice(scene.boxes());
        }
        let with_pairs = turn % TURNS_BETWEEN_CHECKS == 0 || turn + 1 == turns;
        let truth = if with_pairs { Some(reference(scene.boxes())?) } else { None };
        let mut tallies = vec![Vec::new(); entrants.len()];
        for slot in 0..entrants.len() {
            let index = (turn + slot) % entrants.len();
            let Some(entrant) = entrants.get_mut(index).filter(|entrant| !entrant.is_given_up())
            else {
                continue;
            };
            let result = entrant.turn(&frames, with_pairs)?;
            let uncounted = usize::from(result.frame_ns.len() > 1);
            entrant
                .frame_ns
                .extend_from_slice(result.frame_ns.get(uncounted..).unwrap_or_default());
            entrant
                .write_ns
                .extend_from_slice(result.write_ns.get(uncounted..).unwrap_or_default());
            tallies[index] = result.tallies;
            if let (Some(truth), Some(found)) = (&truth, result.pairs)
                && let Err(difference) = check_pairs(&sorted(found), truth)
            {
                entrant.note(|| format!("turn {turn}: {difference}"));
            }
        }
        // Between the turns whose sets are compared, tallies are compared with those of our first
        // lane, whose sets equal the reference.
        for (entrant, found) in entrants.iter_mut().zip(&tallies) {
            // Fewer tallies where a peer was given up.
            let ours = tallies.first().and_then(|ours| ours.get(..found.len()));
            if ours != Some(found) {
                entrant.note(|| format!("turn {turn}: other pairs than ours were iterated over"));
            }
        }
        if let Some(truth) = &truth {
            pairs = truth.len() as u64;
        }
    }
    let lines = entrants.into_iter().map(Entrant::line).collect();
    Ok(Comparison { scene: name, n, pairs, lines })
}

/// The pairs of a frame: the oracle's, or where that takes too long, those of an engine whose state
/// no timed lane shares.
fn reference(boxes: &[Aabb]) -> Result<Vec<Pair>, Box<dyn std::error::Error>> {
    if boxes.len() <= ORACLE_BOXES {
        return Ok(oracle::truth(boxes).pairs);
    }
    let engine = if boxes.len() <= SWEEP_BOXES { EngineName::CpuSap } else { EngineName::CpuGrid };
    let builder = Session::builder().backend(Backend::InProcess);
    let mut session = builder.engine(EngineChoice::Only(engine)).connect()?;
    let mut frame = session.frame(boxes.len())?;
    frame.write(boxes)?;
    Ok(sorted(frame.submit()?.wait()?.to_vec()))
}
