//! All sphere engines of a process, and the choice between them.

use std::time::Instant;

use super::{CpuEngines, CullAnswer, CullOptions, StageTimes, nanoseconds_since};
use crate::engine::word_budget::WordBudget;
use crate::engine::{
    AvailableIsa, CullError, CullInput, EngineChoice, EngineName, PairRules, ReplyBuffer, counted,
};
use crate::mask::{Encoding, EncodingChoice};
use crate::sphere::{Sphere, SphereAllPairs, SphereFilter};
use crate::team;

/// Up to this many spheres every pair is tested: finding candidates first would take longer.
const ALL_PAIRS_SPHERES: usize = 256;

/// A test of two spheres among all takes so long on one thread, ns.
const TEST_NS: f64 = 0.3;

/// Up to this many spheres a dense mask is chosen where the client leaves it open: 16 KB.
const DENSE_SPHERES: usize = 512;

/// The sphere engines, with the scratch memory that they keep from frame to frame.
///
/// A request is answered as one for boxes is, by the same names: `cpu-brute` tests all pairs, the
/// others find candidates among the spheres' bounds first.
#[derive(Default)]
pub struct SphereEngines {
    ways: SphereWays,
    boxes: CpuEngines,
}

/// The ways to find pairs of spheres, for those who have box engines already: sessions and daemons
/// answer frames of boxes and of spheres with the same ones.
#[derive(Default)]
pub struct SphereWays {
    all_pairs: SphereAllPairs,
    filter: SphereFilter,
}

impl SphereEngines {
    /// Engines with empty scratch memory.
    pub fn new() -> Self {
        Self::default()
    }

    /// Finds the pairs of `spheres`.
    ///
    /// # Errors
    /// [`CullError`], among them an engine that is not one of the CPU's.
    pub fn cull(
        &mut self,
        spheres: &[Sphere],
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        self.ways.cull(&mut self.boxes, spheres, options, reply)
    }
}

impl SphereWays {
    /// The ways with one instruction set in place of the widest, with empty scratch memory.
    pub fn on(isa: AvailableIsa) -> Self {
        Self { all_pairs: SphereAllPairs::on(isa), filter: SphereFilter::default() }
    }

    /// Finds the pairs of `spheres`. Where there are many, `boxes` finds the candidates among their
    /// bounds.
    ///
    /// # Errors
    /// [`CullError`], among them an engine that is not one of the CPU's.
    pub fn cull(
        &mut self,
        boxes: &mut CpuEngines,
        spheres: &[Sphere],
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        if let EngineChoice::Only(engine) = options.engine
            && engine.is_gpu()
        {
            let why = "no GPU takes these spheres here";
            return Err(CullError::Unavailable { engine, why });
        }
        let (n, limit_words) = (spheres.len(), reply.limit_words());
        let options = options.within(n, limit_words);
        let encoding = match options.encoding {
            EncodingChoice::Only(encoding) => encoding,
            EncodingChoice::Auto if n <= DENSE_SPHERES && !options.no_dense => Encoding::Dense,
            EncodingChoice::Auto => Encoding::Sparse,
        };
        self.cull_in(boxes, spheres, &options, encoding, reply).or_else(|error| {
            let dense = options.after(encoding, &error, n, limit_words).ok_or(error)?;
            self.cull_in(boxes, spheres, &dense, Encoding::Dense, reply)
        })
    }

    /// Bytes of scratch that is kept from frame to frame, beside that of the box engines.
    pub fn scratch_bytes(&self) -> usize {
        self.all_pairs.scratch_bytes() + self.filter.scratch_bytes()
    }

    fn cull_in(
        &mut self,
        boxes: &mut CpuEngines,
        spheres: &[Sphere],
        options: &CullOptions,
        encoding: Encoding,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let all_pairs = match options.engine {
            EngineChoice::Auto => spheres.len() <= ALL_PAIRS_SPHERES,
            EngineChoice::Only(engine) => engine == EngineName::CpuBrute,
        };
        if !all_pairs {
            return self.cull_candidates(boxes, spheres, options, encoding, reply);
        }
        let start = Instant::now();
        let tests = (spheres.len() * spheres.len()) as f64 / 2.0;
        let threads = team::threads_for(tests * TEST_NS, options.threads);
        let input = CullInput::spheres(spheres).encoding(encoding).threads(threads);
        let report = self.all_pairs.cull(&input, reply)?;
        let times = StageTimes::new(report.times, 0, start);
        Ok(CullAnswer { engine: EngineName::CpuBrute, threads, report, times, expected_ns: 0 })
    }

    /// A box engine finds the candidates among the bounds, and its tasks test each.
    fn cull_candidates(
        &mut self,
        boxes: &mut CpuEngines,
        spheres: &[Sphere],
        options: &CullOptions,
        encoding: Encoding,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let start = Instant::now();
        let n = counted(spheres, EngineName::CpuGrid)?;
        let budget = WordBudget::new(n, encoding, true, reply)?;
        budget.look_at(|index| spheres.get(index).copied(), None)?;
        let (bounds, balls) = self.filter.candidates(spheres, budget.cancel())?;
        let bounds_ns = nanoseconds_since(start);
        // The engine that finds candidates soonest, regardless of what is made of them.
        let sparse = CullOptions { encoding: EncodingChoice::Only(Encoding::Sparse), ..*options };
        let plan_start = Instant::now();
        let mut plan = boxes.plan(bounds, &sparse, None);
        plan.encoding = encoding;
        let plan_ns = nanoseconds_since(plan_start);
        let input = plan.input(bounds).rules(PairRules::tested_by(&balls));
        let (engine, mut report) = boxes.run(plan.engine, &input, reply)?;
        plan.engine = engine;
        report.times.ingest_ns += bounds_ns;
        Ok(CullAnswer::new(&plan, report, start, plan_ns))
    }
}
