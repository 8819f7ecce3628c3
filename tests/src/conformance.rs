//! One suite for every engine, encoding and thread count: its mask against the oracle.
//!
//! It compares sets and names the first bad pair; equal counts prove nothing.

use pairmask::Encoding;
use pairmask::engine::{CullJob, Engine, HeapReply};
pub use pairmask::oracle::check::{Mismatch, check_frame, check_pairs, check_reply};
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::oracle;
use crate::stress_scenes::{self, Overlaps};

/// What an engine is put through.
#[derive(Clone, Debug)]
pub struct Suite {
    /// Numbers of boxes.
    pub sizes: Vec<u32>,
    /// Most boxes of a scene in which a fixed share of all pairs overlaps: the naive side of the
    /// suite takes seconds beyond.
    pub quadratic_limit: u32,
    /// Encodings.
    pub encodings: Vec<Encoding>,
    /// Thread counts; each gets a rayon pool of its own.
    pub threads: Vec<usize>,
    /// Seed of the scenes.
    pub seed: u64,
}

impl Default for Suite {
    /// 0 to 70 boxes, 345 and 1,234, both encodings, one thread.
    fn default() -> Self {
        Self {
            sizes: (0..=70).chain([345, 1234]).collect(),
            quadratic_limit: 1234,
            encodings: vec![Encoding::Dense, Encoding::Sparse],
            threads: vec![1],
            seed: 1,
        }
    }
}

/// A frame that an engine got wrong.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{engine}, scene '{scene}', {n} boxes, {encoding}, {threads} threads: {what}")]
pub struct Failure {
    /// The engine.
    pub engine: pairmask::EngineName,
    /// The scene.
    pub scene: &'static str,
    /// Boxes.
    pub n: u32,
    /// Encoding asked for.
    pub encoding: Encoding,
    /// Threads.
    pub threads: usize,
    /// What is wrong.
    pub what: Mismatch,
}

/// Runs the whole suite and returns how many frames were checked.
///
/// # Errors
/// [`Failure`] names the first frame that the engine got wrong.
///
/// # Panics
/// When no thread pool can be had.
pub fn check_engine(engine: &mut dyn Engine, suite: &Suite) -> Result<usize, Box<Failure>> {
    let pools: Vec<(usize, ThreadPool)> = suite
        .threads
        .iter()
        .map(|&t| (t, ThreadPoolBuilder::new().num_threads(t).build().expect("a thread pool")))
        .collect();
    let mut reply = HeapReply::new();
    let mut frames = 0;
    for scene in stress_scenes::ALL {
        for &n in &suite.sizes {
            if scene.overlaps() == Overlaps::Quadratic && n > suite.quadratic_limit {
                continue;
            }
            let boxes = scene.boxes(n, suite.seed);
            let truth = oracle::truth(&boxes);
            for &encoding in &suite.encodings {
                for (threads, pool) in &pools {
                    let job = CullJob { encoding, threads: *threads };
                    pool.install(|| check_frame(engine, &boxes, &truth, &job, &mut reply))
                        .map_err(|what| Failure {
                            engine: engine.name(),
                            scene: scene.name(),
                            n,
                            encoding,
                            threads: *threads,
                            what,
                        })?;
                    frames += 1;
                }
            }
        }
    }
    Ok(frames)
}
