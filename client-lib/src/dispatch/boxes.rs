//! The CPU engines of a process, kept warm, and the choice among them.

use std::time::Instant;

use super::{CullAnswer, nanoseconds_since};
use crate::aabb::Aabb;
use crate::engine::{
    AvailableIsa, BruteForce, CullError, CullInput, CullReport, Engine, EngineChoice, EngineName,
    Grid, RecentNeed, ReplyBuffer, SweepAndPrune,
};
use crate::plan::{Calibration, Capabilities, CullWish, GpuCost, Plan, SceneStats, plan};
use crate::precision::NarrowBoxes;
use crate::units::BoxCount;

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
        let stats = match (wish.engine, BoxCount::of_len(boxes.len())) {
            (EngineChoice::Only(engine), Some(n)) if engine.is_gpu() => {
                SceneStats::unseen(n, wish.last_pairs)
            }
            _ => SceneStats::glance(boxes, wish.last_pairs),
        };
        plan(&stats, &capabilities, &self.calibration, wish)
    }

    /// Runs a CPU engine.
    ///
    /// # Errors
    /// [`CullError`], among them an engine that is not one of the CPU's.
    pub fn run(
        &mut self,
        engine: EngineName,
        input: &CullInput<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let done = match engine {
            EngineName::CpuBrute => self.brute_force.cull(input, reply),
            EngineName::CpuSap => self.sweep_and_prune.cull(input, reply),
            EngineName::CpuGrid => self.grid.cull(input, reply),
            engine => Err(CullError::Unavailable { engine, why: "it needs a daemon with a GPU" }),
        };
        // Most words hold a pair each, of a dense mask too on its way. A refused frame has given its
        // words back.
        let most = BoxCount::of_len(input.objects.len()).map_or(0, BoxCount::sparse_words_max);
        let words = done.as_ref().map_or(0, |report| report.pair_count.min(most)) as usize;
        self.note_need(engine, BOX_BYTES * input.objects.len() + WORD_BYTES * words);
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
        match self.run(plan.engine, &plan.input(boxes), reply) {
            Ok(report) => Ok(CullAnswer::new(&plan, report, start, plan_ns)),
            Err(error) => match wish.after(&error, n, limit_words) {
                Some(dense) => self.cull(boxes, &dense, reply),
                None => Err(error),
            },
        }
    }
}
