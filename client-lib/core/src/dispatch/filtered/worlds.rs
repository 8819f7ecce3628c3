//! Worlds side by side: each is culled by itself, and the list of pairs is ordered by world.

use std::num::NonZeroU64;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use super::super::crowded::TAKES_OVER;
use super::groups::{Group, Groups};
use super::laid::Laid;
use super::look::Look;
use super::small::{BATCH_BOXES, SMALL_BOXES, SmallWorlds};
use super::test::{FilterTest, Indices};
use crate::aabb::Aabb;
use crate::cancel::{BOX_TESTS, Cancel, Pace};
use crate::dispatch::boxes::{BOX_BYTES, WORD_BYTES};
use crate::dispatch::{CpuEngines, CullAnswer, CullOptions, StageTimes, nanoseconds_since};
use crate::engine::{
    AvailableIsa, Census, CullError, CullInput, CullReport, Engine, EngineChoice, EngineName,
    EngineTimes, HeapReply, PairRules, ReplyBuffer, ReserveError, counted, cpu_engines,
};
use crate::filters::{Rules, World};
use crate::mask::{Encoding, MaskShape};
use crate::precision::BoxSlice;
use crate::team::{self, for_each_in_parts, in_parts, part_count};

/// Boxes of a task, at least: some 10 µs.
const TASK_BOXES: usize = 1_024;
/// A box of a frame of many worlds takes so long on one thread, ns.
const BOX_NS: f64 = 40.0;
/// Boxes of a world from which several threads may cull it.
const SHARED_BOXES: usize = 1 << 14;
const PAIR_WORDS: u64 = 2;

/// Where the pairs of a world stand in a list that is ordered by world.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct WorldRange {
    /// The world.
    pub world: World,
    /// The places of its pairs in the list. Boxes of all worlds are in the pairs of each.
    pub pairs: Range<usize>,
}

impl WorldRange {
    /// A range of a world's pairs.
    pub const fn new(world: World, pairs: Range<usize>) -> Self {
        Self { world, pairs }
    }

    /// The range of a world, among those of all by rising world.
    pub fn of(ranges: &[Self], world: World) -> Option<Range<usize>> {
        let at = ranges.binary_search_by_key(&world, |range| range.world).ok()?;
        Some(ranges[at].pairs.clone())
    }
}

/// What is kept from frame to frame to cull worlds side by side.
pub struct Worlds {
    isa: AvailableIsa,
    groups: Groups,
    tasks: Vec<Task>,
    ranges: Vec<WorldRange>,
    /// What was seen of the rules of a number, for so many boxes.
    looked: Option<(NonZeroU64, usize, Look)>,
}

/// Some worlds in a row, and what one thread culls them with.
struct Task {
    isa: AvailableIsa,
    small: SmallWorlds,
    engines: [Box<dyn Engine>; EngineName::CPU.len()],
    reply: HeapReply,
    boxes: Vec<Aabb>,
    laid: Laid,
    /// Worlds of the task, by their places.
    groups: Range<usize>,
    /// Pairs of all of them, and how many each world has.
    pairs: Vec<[u32; 2]>,
    counts: Vec<usize>,
    compared: u64,
    census: Census,
}

/// Pairs that are copied, and where they come from.
type Copied<'a> = (&'a mut [[u32; 2]], &'a [[u32; 2]]);

/// What all tasks share.
#[derive(Clone, Copy)]
struct Scene<'a> {
    boxes: &'a [Aabb],
    rules: &'a Rules,
    look: &'a Look,
    groups: &'a Groups,
    choice: EngineChoice,
    threads: usize,
    limit_words: u64,
    found: &'a AtomicU64,
    cancel: &'a Cancel,
}

impl Worlds {
    /// Empty scratch memory.
    pub fn on(isa: AvailableIsa) -> Self {
        Self { isa, groups: Groups::default(), tasks: Vec::new(), ranges: Vec::new(), looked: None }
    }

    /// What there is to test of the first `n` boxes. Rules of the number of those before are those.
    pub(super) fn look(&mut self, rules: &Rules, known: Option<NonZeroU64>, n: usize) -> Look {
        let Some(number) = known else { return Look::at(rules, n) };
        match self.looked {
            Some((looked, of, look)) if (looked, of) == (number, n) => look,
            _ => self.looked.insert((number, n, Look::at(rules, n))).2,
        }
    }

    /// Where the pairs of each world stand, of the last frame.
    pub fn ranges(&self) -> &[WorldRange] {
        &self.ranges
    }

    pub fn scratch_bytes(&self) -> usize {
        self.groups.allocated_bytes()
            + self.ranges.capacity() * size_of::<WorldRange>()
            + self.tasks.iter().map(Task::allocated_bytes).sum::<usize>()
    }

    /// Gives the scratch back, and with it the ranges of the last frame.
    pub fn give_back(&mut self) {
        *self = Self::on(self.isa);
    }

    /// Gives all scratch back but the ranges of the last frame.
    pub fn shrink(&mut self) {
        self.groups = Groups::default();
        self.tasks = Vec::new();
    }

    /// Shares the worlds out, so that tasks have about as many boxes.
    fn assign(&mut self, n: usize, threads: usize) {
        let parts = part_count(n, TASK_BOXES, threads);
        let isa = self.isa;
        self.tasks.resize_with(parts, || Task::on(isa));
        let (groups, mut culled, mut next) = (self.groups.groups(), 0, 0);
        for (part, task) in self.tasks.iter_mut().enumerate() {
            let (first, until) = (next, n * (part + 1) / parts);
            while next < groups.len() && (culled < until || part + 1 == parts) {
                culled += groups[next].members.len();
                next += 1;
            }
            task.groups = first..next;
        }
    }

    /// Puts the pairs of all tasks into one list.
    fn gather(&mut self, reply: &mut dyn ReplyBuffer) -> Result<u64, CullError> {
        let count: usize = self.tasks.iter().map(|task| task.pairs.len()).sum();
        let words = reply.reserve(PAIR_WORDS * count as u64)?;
        let (mut rest, _) = words[..PAIR_WORDS as usize * count].as_chunks_mut();
        self.ranges.clear();
        let mut parts = Vec::with_capacity(self.tasks.len());
        let mut start = 0;
        for task in &self.tasks {
            let (own, after) = rest.split_at_mut(task.pairs.len());
            parts.push((own, task.pairs.as_slice()));
            rest = after;
            for (group, count) in self.groups.groups()[task.groups.clone()].iter().zip(&task.counts)
            {
                let end = start + count;
                self.ranges.push(WorldRange { world: group.world, pairs: start..end });
                start = end;
            }
        }
        let part_count = parts.len();
        for_each_in_parts(&mut parts, part_count, |(to, from): &mut Copied<'_>| {
            to.copy_from_slice(from);
        });
        Ok(count as u64)
    }
}

impl CpuEngines {
    /// Culls each world by itself, and writes a list.
    pub(super) fn cull_worlds(
        &mut self,
        boxes: BoxSlice<'_>,
        (rules, known): (&Rules, Option<NonZeroU64>),
        look: &Look,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        let start = Instant::now();
        let engine = match options.engine {
            EngineChoice::Only(engine) if engine.is_gpu() => {
                return Err(CullError::Unavailable { engine, why: "it needs a daemon with a GPU" });
            }
            EngineChoice::Only(engine) => engine,
            EngineChoice::Auto => EngineName::CpuGrid,
        };
        let (boxes, n) = CullInput::boxes(boxes).f32_boxes(engine)?;
        let threads = team::threads_for(boxes.len() as f64 * BOX_NS, options.threads);
        let _team = team::enter(threads);
        let worlds = &mut self.worlds;
        worlds.groups.sort(rules, known, boxes.len(), look.worlds.unwrap_or_default());
        worlds.assign(boxes.len(), threads);
        let ingest_ns = nanoseconds_since(start);
        let scene = Scene {
            boxes,
            rules,
            look,
            groups: &worlds.groups,
            choice: options.engine,
            threads,
            limit_words: reply.limit_words(),
            found: &AtomicU64::new(0),
            cancel: &Cancel::by(reply.asker()),
        };
        set_asker(&mut worlds.tasks, reply);
        let run = |tasks: &mut [Task]| tasks.iter_mut().try_for_each(|task| task.run(scene));
        let parts = worlds.tasks.len();
        let done = in_parts(worlds.tasks.as_mut_slice(), parts, &run, &Result::and);
        set_asker(&mut worlds.tasks, &HeapReply::new());
        done?;
        let executed_ns = nanoseconds_since(start);
        let pair_count = worlds.gather(reply)?;
        let needed_bytes = BOX_BYTES * boxes.len() + WORD_BYTES * pair_count as usize;
        let total_ns = nanoseconds_since(start);
        let (execute_ns, publish_ns) = (executed_ns - ingest_ns, total_ns - executed_ns);
        let report = CullReport::new(
            n,
            MaskShape::list(pair_count),
            worlds.census(boxes),
            pair_count,
            worlds.tasks.iter().map(|task| task.compared).sum(),
            EngineTimes { ingest_ns, execute_ns, publish_ns },
        );
        let times = StageTimes { ingest_ns, plan_ns: 0, execute_ns, publish_ns, total_ns };
        let engine = worlds.most_used(options.engine);
        self.note_rules_need(needed_bytes);
        Ok(CullAnswer { engine, threads, report, times, expected_ns: 0 })
    }
}

impl Worlds {
    /// The census of all boxes. That of the tasks has it where no box is invalid and none is in all worlds.
    fn census(&self, boxes: &[Aabb]) -> Census {
        let sum = self.tasks.iter().fold(Census::default(), |sum, task| sum.then(&task.census));
        if sum.invalid == 0 && self.groups.of_all().is_empty() {
            return sum;
        }
        Census::of(boxes)
    }

    /// The engine by which most boxes were culled.
    fn most_used(&self, choice: EngineChoice) -> EngineName {
        let of_all = self.groups.of_all().len();
        let mut boxes = [0; EngineName::CPU.len()];
        for group in self.groups.groups() {
            let engine = engine_of(choice, group.members.len() + of_all);
            boxes[index_of(engine)] += group.members.len();
        }
        let most = (0..boxes.len()).max_by_key(|at| boxes[*at]).unwrap_or(0);
        EngineName::CPU[most]
    }
}

/// Has tasks look whether the mask of a reply is still wanted.
fn set_asker(tasks: &mut [Task], reply: &dyn ReplyBuffer) {
    for task in tasks {
        task.reply.set_asker(reply.asker());
    }
}

/// The engine that culls a world of `n` boxes.
fn engine_of(choice: EngineChoice, n: usize) -> EngineName {
    match choice {
        EngineChoice::Only(engine) => engine,
        EngineChoice::Auto if n <= SMALL_BOXES => EngineName::CpuBrute,
        EngineChoice::Auto => EngineName::CpuGrid,
    }
}

/// Its place among the engines of the CPU.
fn index_of(engine: EngineName) -> usize {
    EngineName::CPU.iter().position(|name| *name == engine).unwrap_or(0)
}

impl Task {
    fn on(isa: AvailableIsa) -> Self {
        Self {
            isa,
            small: SmallWorlds::default(),
            engines: cpu_engines(isa),
            reply: HeapReply::new(),
            boxes: Vec::new(),
            laid: Laid::default(),
            groups: 0..0,
            pairs: Vec::new(),
            counts: Vec::new(),
            compared: 0,
            census: Census::default(),
        }
    }

    fn allocated_bytes(&self) -> usize {
        self.engines.iter().map(|engine| engine.scratch_bytes()).sum::<usize>()
            + self.small.allocated_bytes()
            + self.reply.allocated_bytes()
            + self.boxes.capacity() * size_of::<Aabb>()
            + self.laid.allocated_bytes()
            + self.pairs.capacity() * size_of::<[u32; 2]>()
            + self.counts.capacity() * size_of::<usize>()
    }

    fn run(&mut self, scene: Scene<'_>) -> Result<(), CullError> {
        let limit_bytes = scene.limit_words.saturating_mul(size_of::<u32>() as u64);
        self.reply.set_limit_bytes(limit_bytes);
        self.pairs.clear();
        self.counts.clear();
        (self.compared, self.census) = (0, Census::default());
        let mut pace = Pace::default();
        let mut groups = &scene.groups.groups()[self.groups.clone()];
        while let Some((group, after)) = groups.split_first() {
            let before = self.pairs.len();
            self.small.clear();
            while let Some((group, after)) = groups.split_first()
                && self.small.len() < BATCH_BOXES
                && self.add_small(group, scene)
            {
                groups = after;
            }
            if self.small.len() > 0 {
                self.cull_small(scene)?;
            } else {
                self.cull(group, scene)?;
                self.counts.push(self.pairs.len() - before);
                groups = after;
            }
            let count = (self.pairs.len() - before) as u64;
            let boxes = group.members.len().max(BATCH_BOXES) as u64;
            if scene.cancel.look_after(BOX_TESTS * boxes, &mut pace) {
                return Err(CullError::Cancelled);
            }
            let found = scene.found.fetch_add(count, Ordering::Relaxed) + count;
            let words = found.saturating_mul(PAIR_WORDS);
            if words > scene.limit_words {
                let at_least_bytes = words.saturating_mul(size_of::<u32>() as u64);
                return Err(ReserveError::TooLarge { at_least_bytes, limit_bytes }.into());
            }
        }
        Ok(())
    }

    /// Adds a world to the batch of small ones, if it is one.
    fn add_small(&mut self, group: &Group, scene: Scene<'_>) -> bool {
        let (own, of_all) = scene.groups.boxes_of(group);
        let n = own.len() + of_all.len();
        let is_small = n <= SMALL_BOXES && engine_of(scene.choice, n) == EngineName::CpuBrute;
        if is_small {
            self.small.add(own, of_all);
        }
        is_small
    }

    /// Adds the pairs of the batch of small worlds.
    fn cull_small(&mut self, scene: Scene<'_>) -> Result<(), CullError> {
        let rules = (!scene.look.world_mates_meet).then_some((scene.rules, scene.look));
        let found = (&mut self.pairs, &mut self.counts, &mut self.laid);
        let (census, compared) = self.small.cull(scene.boxes, rules, self.isa, found)?;
        self.census = self.census.then(&census);
        self.compared += compared;
        Ok(())
    }

    /// Adds the pairs of a world that is not small.
    fn cull(&mut self, group: &Group, scene: Scene<'_>) -> Result<(), CullError> {
        let (own, of_all) = scene.groups.boxes_of(group);
        let (first, n) = (own[0] as usize, own.len() + of_all.len());
        let is_run = of_all.is_empty() && own[own.len() - 1] as usize - first + 1 == own.len();
        let boxes = if is_run {
            &scene.boxes[first..first + own.len()]
        } else {
            let gathered = own.iter().chain(of_all).map(|index| scene.boxes[*index as usize]);
            self.boxes.clear();
            self.boxes.extend(gathered);
            &self.boxes
        };
        let indices = Indices::Of(own, of_all);
        let laid = std::mem::take(&mut self.laid);
        let test = FilterTest::new(scene.rules, scene.look, indices, laid);
        let rules = if scene.look.world_mates_meet && of_all.is_empty() {
            PairRules::NONE
        } else {
            PairRules::tested_by(&test)
        };
        let engine = engine_of(scene.choice, n);
        let is_shared = n >= SHARED_BOXES && n > scene.boxes.len() / (2 * scene.threads);
        let input = CullInput::boxes(boxes)
            .encoding(Encoding::List)
            .threads(if is_shared { scene.threads } else { 1 })
            .may_hand_over(scene.choice == EngineChoice::Auto)
            .rules(rules);
        let mut done = self.engines[index_of(engine)].cull(&input, &mut self.reply);
        if matches!(done, Err(CullError::TooCrowded { .. })) {
            done = self.engines[index_of(TAKES_OVER)].cull(&input, &mut self.reply);
        }
        self.laid = test.into_memory();
        let report = done?;
        let count = counted(boxes, engine)?;
        self.compared += count.pair_count().saturating_sub(report.skipped.pairs);
        self.census = self.census.then(&report.census);
        // Engines write what they are asked for: a list.
        let pairs = &self.reply.words().as_chunks().0[..report.pair_count as usize];
        if is_run {
            let first = first as u32;
            self.pairs.extend(pairs.iter().map(|[a, b]| [first + a, first + b]));
        } else {
            self.pairs.extend(pairs.iter().map(|pair| {
                let [a, b] = pair.map(|culled| indices.global(culled));
                [a.min(b), a.max(b)]
            }));
        }
        Ok(())
    }
}
