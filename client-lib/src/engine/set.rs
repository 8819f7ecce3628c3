//! The CPU engines of a process, kept warm, and the choice among them.

use std::time::Instant;

use super::{
    BruteForce, CullError, CullJob, CullReport, Engine, EngineChoice, EngineName, ReplyBuffer,
};
use crate::aabb::Aabb;
use crate::mask::{Encoding, EncodingChoice};
use crate::units::BoxCount;
use crate::wire::StageTimes;

/// What a client leaves open and what it insists on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CullWish {
    /// Which engine.
    pub engine: EngineChoice,
    /// Which encoding.
    pub encoding: EncodingChoice,
    /// How many threads; `None` leaves it to the plan.
    pub threads: Option<usize>,
}

/// An answered cull.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CullAnswer {
    /// Which engine answered.
    pub engine: EngineName,
    /// Threads that it could use.
    pub threads: usize,
    /// What it says of the frame.
    pub report: CullReport,
    /// Time by stage.
    pub times: StageTimes,
}

/// All CPU engines, with the scratch memory that they keep from frame to frame.
pub struct CpuEngines {
    brute_force: BruteForce,
}

impl Default for CpuEngines {
    fn default() -> Self {
        Self::new()
    }
}

/// A dense mask of at most this many boxes is one that a client scans in a few microseconds:
/// 1 MiB, beyond which the sparse words of a usual scene are shorter to write and to read.
const DENSE_UP_TO: BoxCount = BoxCount::new(2048);

/// The encoding of a frame of `n` boxes.
pub fn choose_encoding(wish: EncodingChoice, n: BoxCount) -> Encoding {
    match wish {
        EncodingChoice::Only(encoding) => encoding,
        EncodingChoice::Auto if n <= DENSE_UP_TO => Encoding::Dense,
        EncodingChoice::Auto => Encoding::Sparse,
    }
}

impl CpuEngines {
    /// Engines with empty scratch memory.
    pub fn new() -> Self {
        Self { brute_force: BruteForce::new() }
    }

    /// Plans the frame and finds its pairs.
    ///
    /// # Errors
    /// [`CullError`], among them an engine that is not one of the CPU's.
    pub fn cull(
        &mut self,
        boxes: &[Aabb],
        wish: &CullWish,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let start = Instant::now();
        let engine: &mut dyn Engine = match wish.engine {
            EngineChoice::Auto | EngineChoice::Only(EngineName::CpuBrute) => &mut self.brute_force,
            EngineChoice::Only(engine) => {
                return Err(CullError::Unavailable {
                    engine,
                    why: "this process has no such engine",
                });
            }
        };
        let n = BoxCount::of_len(boxes.len()).unwrap_or(BoxCount::new(u32::MAX));
        let encoding = choose_encoding(wish.encoding, n);
        let threads = wish.threads.unwrap_or(1).clamp(1, rayon::current_num_threads());
        let plan_ns = start.elapsed().as_nanos() as u64;
        let report = engine.cull(boxes, &CullJob { encoding, threads }, reply)?;
        Ok(CullAnswer {
            engine: engine.name(),
            threads,
            report,
            times: StageTimes {
                ingest_ns: report.times.ingest_ns,
                plan_ns,
                execute_ns: report.times.execute_ns,
                publish_ns: report.times.publish_ns,
                total_ns: start.elapsed().as_nanos() as u64,
            },
        })
    }
}
