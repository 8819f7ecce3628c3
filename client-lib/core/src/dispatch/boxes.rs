//! The CPU engines of a process, kept warm, and the choice among them.

use std::time::Instant;

use super::crowded::{Barred, Crowded, TAKES_OVER};
use super::filtered::{Laid, Worlds};
use super::learned::Learned;
use super::{CullAnswer, nanoseconds_since};
use crate::engine::{
    AvailableIsa, CullError, CullInput, CullReport, Engine, EngineChoice, EngineName, RecentNeed,
    ReplyBuffer, cpu_engines,
};
use crate::plan::{
    Calibration, Capabilities, CullOptions, GpuCost, Plan, PlanMemory, SceneStats, plan,
};
use crate::precision::BoxSlice;
use crate::team::most_threads;
use crate::units::BoxCount;

/// All CPU engines, with the scratch memory and the order that they keep from frame to frame.
pub struct CpuEngines {
    engines: [Kept; EngineName::CPU.len()],
    calibration: Calibration,
    plans: PlanMemory,
    crowded: Option<Crowded>,
    learned: Learned,
    /// Memory of frames with rules: of those of many worlds, and of tests.
    pub(super) worlds: Worlds,
    pub(super) filter_memory: Laid,
    rules_need: RecentNeed,
}

/// An engine that is kept warm, and the scratch that its frames have needed of late.
struct Kept {
    name: EngineName,
    engine: Box<dyn Engine>,
    need: RecentNeed,
}

/// Scratch that a frame takes, bytes a box: the most that an engine was seen to take (240, of
/// `cpu-brute` on two threads), rounded up.
pub(super) const BOX_BYTES: usize = 256;
/// Scratch that a frame takes, bytes a word of its mask: three arrays, which grow by doubling.
pub(super) const WORD_BYTES: usize = 24;

impl Default for CpuEngines {
    fn default() -> Self {
        Self::new()
    }
}

impl CpuEngines {
    /// Engines with empty scratch memory and the built-in calibration of this machine's
    /// instruction set.
    pub fn new() -> Self {
        let isa = AvailableIsa::best();
        Self::on(isa, Calibration::built_in(isa.get()))
    }

    /// Engines of one instruction set, whose plans compute with `calibration`.
    pub fn on(isa: AvailableIsa, calibration: Calibration) -> Self {
        let engines = cpu_engines(isa).map(|engine| Kept {
            name: engine.name(),
            engine,
            need: RecentNeed::NONE,
        });
        Self {
            engines,
            calibration,
            plans: PlanMemory::default(),
            crowded: None,
            learned: Learned::default(),
            worlds: Worlds::on(isa),
            filter_memory: Laid::default(),
            rules_need: RecentNeed::NONE,
        }
    }

    /// Gives the scratch of all engines back. Answers do not depend on it; the next frame takes
    /// longer.
    pub fn give_back(&mut self) {
        self.engines.iter_mut().for_each(|kept| kept.engine.give_back());
        self.worlds.give_back();
        self.filter_memory = Laid::default();
    }

    /// Bytes of scratch that all engines keep from frame to frame, beside boxes and replies.
    pub fn scratch_bytes(&self) -> usize {
        let engines = self.engines.iter().map(|kept| kept.engine.scratch_bytes()).sum::<usize>();
        engines + self.rules_bytes()
    }

    /// Bytes of scratch that frames with rules have left.
    fn rules_bytes(&self) -> usize {
        self.worlds.scratch_bytes() + self.filter_memory.allocated_bytes()
    }

    /// Notes what a frame needed of the scratch for rules, and gives it back where frames of the past
    /// needed much more.
    pub(super) fn note_rules_need(&mut self, bytes: usize) {
        let mut need = self.rules_need;
        if need.note(bytes, || self.rules_bytes()) {
            self.worlds.shrink();
            self.filter_memory = Laid::default();
        }
        self.rules_need = need;
    }

    /// Plans a frame, among the CPU engines and a GPU if there is one. Boxes may be in any form: a
    /// few are looked at, and none is expanded. Where the last frames were about the same, none is looked
    /// at either, and their plan is taken again ([`PlanMemory`]).
    pub fn plan<'a>(
        &mut self,
        boxes: impl Into<BoxSlice<'a>>,
        options: &CullOptions,
        gpu: Option<GpuCost>,
    ) -> Plan {
        let boxes = boxes.into();
        let gpu = gpu.map(|cost| cost.of_form(boxes.form()));
        let capabilities = Capabilities { threads: most_threads(options.threads), gpu };
        let n = BoxCount::of_len(boxes.len());
        if let Some(again) = n.and_then(|n| self.plans.again(n, &capabilities, options)) {
            return self.replanned(again);
        }
        let planned = |stats: SceneStats| plan(&stats, &capabilities, &self.calibration, options);
        let plan = match (options.engine, n) {
            (EngineChoice::Only(engine), Some(n)) if engine.is_gpu() => {
                planned(SceneStats::unseen(n, options.last_pairs))
            }
            (EngineChoice::Auto, Some(n)) if gpu.is_some() => {
                // A GPU that wins against the best that a look could show wins without it: the look
                // takes 10 to 20 µs at boxes that no cache of this core holds.
                let at_best = planned(SceneStats::at_best(n, options.last_pairs));
                if at_best.engine.is_gpu() {
                    at_best
                } else {
                    planned(SceneStats::glance(boxes, options.last_pairs))
                }
            }
            _ => planned(SceneStats::glance(boxes, options.last_pairs)),
        };
        self.plans.keep(&plan, &capabilities);
        self.replanned(plan)
    }

    /// The plan by what was learned, without the engines that handed the scene over.
    #[allow(clippy::large_types_passed_by_value)] // It is the result of what calls this.
    fn replanned(&mut self, mut plan: Plan) -> Plan {
        let crowded = self.crowded.as_mut();
        let barred = crowded.map_or(Barred::default(), |crowded| crowded.bars(&plan));
        self.learned.replan(&mut plan, barred);
        plan
    }

    /// Finds the pairs of a frame as it is planned, for a CPU engine, and learns from what it took. As
    /// [`Self::run`].
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn run_plan(
        &mut self,
        plan: &Plan,
        boxes: BoxSlice<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<(EngineName, CullReport), CullError> {
        let (engine, report) = self.run(plan.engine, &plan.input(boxes), reply)?;
        let has_handed_over = engine != plan.engine;
        let took_ns = if has_handed_over { u64::MAX } else { report.times.sum_ns() };
        self.learned.note(plan.engine, plan.expected_ns(), plan.stats.n, took_ns);
        Ok((engine, report))
    }

    /// Learns from a frame of so many boxes that a GPU answered: what it took with all waits, since the plan is to have
    /// frames answered soonest.
    pub fn note_gpu(&mut self, n: BoxCount, answer: &CullAnswer) {
        if answer.engine.is_gpu() {
            let took_ns = answer.times.total_ns.saturating_sub(answer.times.plan_ns);
            self.learned.note(answer.engine, answer.expected_ns, n, took_ns);
        }
    }

    /// Runs a CPU engine, and `cpu-tree` where that one finds the scene too crowded and may hand it over: the
    /// engine that answered, and its report.
    ///
    /// # Errors
    /// [`CullError`], among them an engine that is not one of the CPU's.
    pub fn run(
        &mut self,
        engine: EngineName,
        input: &CullInput<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<(EngineName, CullReport), CullError> {
        match self.run_alone(engine, input, reply) {
            Err(CullError::TooCrowded { engine }) => {
                self.note_crowded(input.objects.len(), engine);
                Ok((TAKES_OVER, self.run_alone(TAKES_OVER, input, reply)?))
            }
            done => Ok((engine, done?)),
        }
    }

    /// Notes that a frame of so many boxes was too crowded for an engine: the frames to come go to others, and one at
    /// times to it.
    pub fn note_crowded(&mut self, n: usize, engine: EngineName) {
        self.crowded = BoxCount::of_len(n).map(|n| Crowded::again(self.crowded, n, engine));
    }

    fn run_alone(
        &mut self,
        engine: EngineName,
        input: &CullInput<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let kept = self.engines.iter_mut().find(|kept| kept.name == engine);
        let done = match kept {
            Some(kept) => kept.engine.cull(input, reply),
            None => Err(CullError::Unavailable { engine, why: "it needs a daemon with a GPU" }),
        };
        if matches!(done, Err(CullError::Cancelled)) {
            // It says nothing of what frames need.
            return done;
        }
        // Most words hold a pair each, of a dense mask too on its way. A refused frame has given its
        // words back.
        let most = BoxCount::of_len(input.objects.len()).map_or(0, BoxCount::sparse_words_max);
        let words = done.as_ref().map_or(0, |report| report.pair_count.min(most)) as usize;
        self.note_need(engine, BOX_BYTES * input.objects.len() + WORD_BYTES * words);
        self.note_rules_need(0);
        done
    }

    /// Gives the scratch of engines back that much larger scenes left behind.
    fn note_need(&mut self, ran: EngineName, bytes: usize) {
        for Kept { name, engine, need } in &mut self.engines {
            let needed = if *name == ran { bytes } else { 0 };
            if need.note(needed, || engine.scratch_bytes()) {
                engine.give_back();
            }
        }
    }

    /// Plans a frame among the CPU engines and finds its pairs. Where the encoding is left open, a
    /// mask that fits into the reply in any encoding is found.
    ///
    /// # Errors
    /// As [`run`](Self::run). Boxes in narrow forms are to be expanded first
    /// ([`BoxSlice::expand`]): the engines of the CPU read f32 alone.
    pub fn cull<'a>(
        &mut self,
        boxes: impl Into<BoxSlice<'a>>,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let boxes = boxes.into();
        self.cull_by(boxes, options, reply, |engines, plan, reply| {
            engines.run_plan(plan, boxes, reply)
        })
    }

    /// Plans a frame, and has `run` find its pairs: in other encodings where the reply has no room for the
    /// planned one, and the encoding is left open.
    pub(super) fn cull_by(
        &mut self,
        boxes: BoxSlice<'_>,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
        mut run: impl FnMut(
            &mut Self,
            &Plan,
            &mut dyn ReplyBuffer,
        ) -> Result<(EngineName, CullReport), CullError>,
    ) -> Result<CullAnswer, CullError> {
        let (n, limit_words) = (boxes.len(), reply.limit_words());
        let mut options = options.within(n, limit_words);
        loop {
            let start = Instant::now();
            let plan = self.plan(boxes, &options, None);
            let plan_ns = nanoseconds_since(start);
            match run(self, &plan, reply) {
                Ok((engine, report)) => {
                    let plan = Plan { engine, ..plan };
                    return Ok(CullAnswer::new(&plan, report, start, plan_ns));
                }
                Err(error) => {
                    options = options.after(plan.encoding, &error, n, limit_words).ok_or(error)?;
                }
            }
        }
    }
}
