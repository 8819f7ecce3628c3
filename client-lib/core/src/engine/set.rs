//! The CPU engines of a process, kept warm, and the choice among them.

use std::time::Instant;

use super::gather::PairTest;
use super::scratch::RecentNeed;
use super::{
    AvailableIsa, BruteForce, CullError, CullJob, CullReport, EngineChoice, EngineName, Grid,
    ReplyBuffer, ReserveError, SweepAndPrune,
};
use crate::aabb::Aabb;
use crate::mask::{Encoding, EncodingChoice, ReadableEncodings};
use crate::plan::{Calibration, Capabilities, GpuCost, Plan, SceneStats, Wishes, plan};
use crate::precision::NarrowBoxes;
use crate::units::BoxCount;

/// What a client leaves open and what it insists on, and what is known of its last frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CullWish {
    /// Which engine.
    pub engine: EngineChoice,
    /// Which encoding.
    pub encoding: EncodingChoice,
    /// How many threads; `None` leaves it to the plan.
    pub threads: Option<usize>,
    /// Pairs of the client's last frame, for the plan. The answer does not depend on it.
    pub last_pairs: Option<u64>,
    /// Encodings that the client can read.
    pub readable: ReadableEncodings,
}

impl CullWish {
    /// The wish of a frame of `n` boxes whose reply holds at most `limit_words` words: where the
    /// client left the encoding open and a dense mask does not fit, it is sparse.
    #[must_use]
    pub fn within(self, n: usize, limit_words: u64) -> Self {
        let may_be_sparse =
            self.encoding == EncodingChoice::Auto && self.readable.contains(Encoding::Sparse);
        if may_be_sparse && !dense_fits(n, limit_words) {
            return Self { encoding: EncodingChoice::Only(Encoding::Sparse), ..self };
        }
        self
    }

    /// The wish to try after `error`, if there is one: where the client left the encoding open, more
    /// words were found than the reply holds, and a dense mask fits.
    #[must_use]
    pub fn after(self, error: &CullError, n: usize, limit_words: u64) -> Option<Self> {
        let is_too_large = matches!(error, CullError::Reserve(ReserveError::TooLarge { .. }));
        let dense = Self { encoding: EncodingChoice::Only(Encoding::Dense), ..self };
        let is_open =
            self.encoding == EncodingChoice::Auto && self.readable.contains(Encoding::Dense);
        (is_too_large && is_open && dense_fits(n, limit_words)).then_some(dense)
    }
}

/// Whether a reply of so many words holds the dense mask of `n` boxes.
fn dense_fits(n: usize, limit_words: u64) -> bool {
    BoxCount::of_len(n).is_some_and(|n| n.dense_words() <= limit_words)
}

/// Time of a frame's stages in the daemon or in process, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StageTimes {
    /// Boxes read and turned into the engine's form.
    pub ingest_ns: u64,
    /// Plan made.
    pub plan_ns: u64,
    /// Pairs tested.
    pub execute_ns: u64,
    /// Mask written.
    pub publish_ns: u64,
    /// From the request in hand to the response ready to be sent. At least the sum of the stages.
    pub total_ns: u64,
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

impl CullAnswer {
    /// The answer of an engine to a plan that was begun at `start` and took `plan_ns`.
    pub fn new(plan: &Plan, report: CullReport, start: Instant, plan_ns: u64) -> Self {
        Self {
            engine: plan.engine,
            threads: plan.threads,
            report,
            times: StageTimes {
                ingest_ns: report.times.ingest_ns,
                plan_ns,
                execute_ns: report.times.execute_ns,
                publish_ns: report.times.publish_ns,
                total_ns: nanoseconds_since(start),
            },
        }
    }
}

/// Nanoseconds since `start`; u64 holds 584 years of them.
pub fn nanoseconds_since(start: Instant) -> u64 {
    start.elapsed().as_nanos() as u64
}

/// All CPU engines, with the scratch memory and the order that they keep from frame to frame.
pub struct CpuEngines {
    brute_force: BruteForce,
    sweep_and_prune: SweepAndPrune,
    grid: Grid,
    calibration: Calibration,
    /// Of `cpu-brute`, `cpu-sap` and `cpu-grid`.
    needs: [RecentNeed; 3],
}

/// Scratch that a frame takes, bytes a box: the most that an engine was seen to take (240, of
/// `cpu-brute` on two threads), rounded up.
const BOX_BYTES: usize = 256;
/// Scratch that a frame takes, bytes a word of its mask: three arrays, which grow by doubling.
const WORD_BYTES: usize = 24;

impl Default for CpuEngines {
    fn default() -> Self {
        Self::new()
    }
}

impl CpuEngines {
    /// Engines with empty scratch memory and the built-in calibration of this machine's
    /// instruction set.
    pub fn new() -> Self {
        Self::with_calibration(Calibration::built_in(AvailableIsa::best().get()))
    }

    /// Engines with empty scratch memory, whose plans compute with `calibration`.
    pub fn with_calibration(calibration: Calibration) -> Self {
        Self {
            brute_force: BruteForce::new(),
            sweep_and_prune: SweepAndPrune::new(),
            grid: Grid::new(),
            calibration,
            needs: [RecentNeed::default(); 3],
        }
    }

    /// Gives the scratch of all engines back. Answers do not depend on it; the next frame takes
    /// longer.
    pub fn give_back(&mut self) {
        self.brute_force = BruteForce::new();
        self.sweep_and_prune = SweepAndPrune::new();
        self.grid = Grid::new();
    }

    /// Bytes of scratch that all engines keep from frame to frame, beside boxes and replies.
    pub fn scratch_bytes(&self) -> usize {
        self.brute_force.scratch_bytes()
            + self.sweep_and_prune.scratch_bytes()
            + self.grid.scratch_bytes()
    }

    /// Plans a frame, among the CPU engines and a GPU if there is one. Boxes may be in any form: a
    /// few are looked at, and none is expanded.
    pub fn plan<'a>(
        &self,
        boxes: impl Into<NarrowBoxes<'a>>,
        wish: &CullWish,
        gpu: Option<GpuCost>,
    ) -> Plan {
        let boxes = boxes.into();
        let gpu = gpu.map(|cost| cost.of_form(boxes.form()));
        let pool = rayon::current_num_threads();
        let capabilities =
            Capabilities { threads: wish.threads.unwrap_or(pool).clamp(1, pool), gpu };
        let wishes =
            Wishes { engine: wish.engine, encoding: wish.encoding, readable: wish.readable };
        let stats = match (wish.engine, BoxCount::of_len(boxes.len())) {
            (EngineChoice::Only(engine), Some(n)) if engine.is_gpu() => {
                SceneStats::unseen(n, wish.last_pairs)
            }
            _ => SceneStats::glance(boxes, wish.last_pairs),
        };
        plan(&stats, &capabilities, &self.calibration, &wishes)
    }

    /// Runs a plan for a CPU engine.
    ///
    /// # Errors
    /// [`CullError`], among them an engine that is not one of the CPU's.
    pub fn run(
        &mut self,
        plan: &Plan,
        boxes: &[Aabb],
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        self.run_passing(plan, boxes, None, reply)
    }

    /// [`Self::run`], less the pairs that do not pass a test.
    pub(crate) fn run_passing(
        &mut self,
        plan: &Plan,
        boxes: &[Aabb],
        test: Option<&dyn PairTest>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let job = CullJob { encoding: plan.encoding, threads: plan.threads };
        let done = match plan.engine {
            EngineName::CpuBrute => self.brute_force.cull_passing(boxes, &job, test, reply),
            EngineName::CpuSap => self.sweep_and_prune.cull_passing(boxes, &job, test, reply),
            EngineName::CpuGrid => self.grid.cull_passing(boxes, &job, test, reply),
            engine => Err(CullError::Unavailable { engine, why: "it needs a daemon with a GPU" }),
        };
        // Most words hold a pair each, of a dense mask too on its way. A refused frame has given its
        // words back.
        let most = plan.stats.n.sparse_words_max();
        let words = done.as_ref().map_or(0, |report| report.pair_count.min(most)) as usize;
        self.note_need(plan.engine, BOX_BYTES * boxes.len() + WORD_BYTES * words);
        done
    }

    /// Gives the scratch of engines back that much larger scenes left behind.
    fn note_need(&mut self, ran: EngineName, bytes: usize) {
        let need = |engine| if engine == ran { bytes } else { 0 };
        let [brute_force, sweep_and_prune, grid] = &mut self.needs;
        if brute_force.note(need(EngineName::CpuBrute), || self.brute_force.scratch_bytes()) {
            self.brute_force = BruteForce::new();
        }
        if sweep_and_prune.note(need(EngineName::CpuSap), || self.sweep_and_prune.scratch_bytes()) {
            self.sweep_and_prune = SweepAndPrune::new();
        }
        if grid.note(need(EngineName::CpuGrid), || self.grid.scratch_bytes()) {
            self.grid = Grid::new();
        }
    }

    /// Plans a frame among the CPU engines and finds its pairs. Where the encoding is left open, a
    /// mask that fits into the reply in either encoding is found.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub fn cull(
        &mut self,
        boxes: &[Aabb],
        wish: &CullWish,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let start = Instant::now();
        let (n, limit_words) = (boxes.len(), reply.limit_words());
        let wish = wish.within(n, limit_words);
        let plan = self.plan(boxes, &wish, None);
        let plan_ns = nanoseconds_since(start);
        match self.run(&plan, boxes, reply) {
            Ok(report) => Ok(CullAnswer::new(&plan, report, start, plan_ns)),
            Err(error) => match wish.after(&error, n, limit_words) {
                Some(dense) => self.cull(boxes, &dense, reply),
                None => Err(error),
            },
        }
    }
}
