//! One suite for every engine, encoding and thread count: it compares masks with the oracle.
//!
//! It compares sets and names the first bad pair; equal counts prove nothing. Each frame has a caller of
//! other floating-point flags, and pool threads of yet others.

use pairmask_core::engine::{CullInput, Engine, HeapReply, Isa, cpu_engine};
pub use pairmask_core::oracle::check::{Mismatch, check_frame, check_pairs, check_reply};
use pairmask_core::{Encoding, EngineName};
use pairmask_lab::stress::{FloatFlags, MixedFlags};
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::oracle;
use crate::stress_scenes;
use crate::tier;

pub fn best_engine(name: EngineName) -> Box<dyn Engine> {
    cpu_engine(name, Isa::best()).expect("of the CPU")
}

pub fn cpu_engines() -> Vec<Box<dyn Engine>> {
    EngineName::CPU.map(best_engine).into()
}

#[derive(Clone, Debug)]
pub struct Suite {
    pub sizes: Vec<u32>,
    /// Most boxes of a scene in which a fixed share of all pairs overlaps: the naive side of the
    /// suite takes seconds beyond.
    pub quadratic_limit: u32,
    pub encodings: Vec<Encoding>,
    /// Thread counts; each gets a rayon pool of its own.
    pub threads: Vec<usize>,
    pub seed: u64,
    /// Floating-point flags of the caller and of its pool, frame by frame in turn.
    pub flags: Vec<MixedFlags>,
}

impl Default for Suite {
    /// 0 to 70 boxes, 345 and 1,234, every encoding, one thread, [`mixed_flags`].
    fn default() -> Self {
        Self {
            sizes: (0..=70).chain([345, 1234]).collect(),
            quadratic_limit: 1234,
            encodings: Encoding::ALL.into(),
            threads: vec![1],
            seed: 1,
            flags: mixed_flags(),
        }
    }
}

impl Suite {
    /// As by default, but for engines that take long: of the sizes up to 70 those of the [tier](tier::small_sizes).
    pub fn of_tier() -> Self {
        Self {
            sizes: tier::small_sizes().into_iter().chain([345, 1234]).collect(),
            ..Self::default()
        }
    }
}

/// Callers of all flags, each with a pool of other flags, two of whose threads differ. There are 37
/// mixtures, so that their cycle falls together with none of sizes, encodings or thread counts.
pub fn mixed_flags() -> Vec<MixedFlags> {
    let all: Vec<FloatFlags> = FloatFlags::all().collect();
    let at = |i: usize| all[i % all.len()];
    // 5, 7 and 11 are odd: each runs through all sixteen.
    let mixed = |i: usize| MixedFlags {
        caller: at(5 * i),
        pool: [at(7 * i + i / 16), at(11 * i + 3)],
        writers: [at(i), at(3 * i + 1), at(9 * i + 2)],
    };
    (0..37).map(mixed).collect()
}

pub fn pool(threads: usize) -> ThreadPool {
    ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool")
}

/// Runs the whole suite and returns how many frames were checked, or which one the engine got wrong.
pub fn check_engine(engine: &mut dyn Engine, suite: &Suite) -> Result<usize, String> {
    let pools: Vec<ThreadPool> = suite.threads.iter().map(|&threads| pool(threads)).collect();
    let mut reply = HeapReply::new();
    let mut frames = 0;
    let crowded = if engine.name().is_gpu() { &[] } else { stress_scenes::CROWDED };
    for scene in stress_scenes::ALL.iter().chain(crowded) {
        for &n in &suite.sizes {
            if scene.is_quadratic && n > suite.quadratic_limit {
                continue;
            }
            let boxes = scene.boxes(n, suite.seed);
            let truth = oracle::truth(&boxes);
            for &encoding in &suite.encodings {
                for pool in &pools {
                    let threads = pool.current_num_threads();
                    let input = CullInput::boxes(&boxes).encoding(encoding).threads(threads);
                    let flags = suite.flags[frames % suite.flags.len()];
                    flags
                        .install(pool, || check_frame(engine, &input, &truth, &mut reply))
                        .map_err(|what| {
                            let (engine, scene) = (engine.name(), scene.name());
                            format!(
                                "{engine}, scene '{scene}', {n} boxes, {encoding}, {threads} threads, {flags}: {what}"
                            )
                        })?;
                    frames += 1;
                }
            }
        }
    }
    Ok(frames)
}

/// As [`check_engine`], for tests.
pub fn conform(engine: &mut dyn Engine, suite: &Suite) {
    match check_engine(engine, suite) {
        Ok(frames) => assert!(frames > 0, "the suite ran nothing"),
        Err(failure) => panic!("{failure}"),
    }
}
