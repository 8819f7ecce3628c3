//! Cases, a scene of some size each, that are culled in several ways. The machine may be busy: ways that
//! are compared are interleaved frame by frame, and the shortest of many frames counts.

use std::collections::BTreeMap;
use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::dispatch::{CullOptions, nanoseconds_since};
use pairmask_core::engine::{
    AvailableIsa, CullError, CullInput, Engine, EngineName, HeapReply, cpu_engine,
};
use pairmask_core::plan::{Calibration, Capabilities, PlanMemory, SceneStats, plan};
use pairmask_core::{Aabb, BoxCount, Encoding, MaskView};
use pairmaskd::scene::{Scene, SceneName};
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::Result;

/// Seed of the scenes: every run has the same boxes and motions.
const SEED: u64 = 1;
/// Frames before the first measured one: they touch memory and settle orders.
const WARM_UP: usize = 2;
/// Frames that are measured: at least so many, and until this time is over, at most so many.
const LEAST_FRAMES: usize = 7;
const MOST_FRAMES: usize = 200;
const TIME: Duration = Duration::from_millis(400);
/// A way is left out when its prediction is this many times the fastest …
const HOPELESS: f64 = 12.0;
/// … and above this, ns.
const HOPELESS_NS: f64 = 2.0e6;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Case {
    pub scene: SceneName,
    pub n: usize,
}

/// The numbers of the frames of a measurement, as long as it lasts, after some that warm up.
pub fn frames(warm_up: usize) -> impl Iterator<Item = usize> {
    let start = Instant::now();
    let least = LEAST_FRAMES + warm_up;
    (0..MOST_FRAMES + warm_up).take_while(move |frame| *frame < least || start.elapsed() <= TIME)
}

pub struct CaseTimes {
    pub case: Case,
    /// Statistics of the last frame, as the plan gets them.
    pub stats: SceneStats,
    /// Time of planning a frame of a steady scene, ns: to take a plan again, and a share of what a look and a
    /// new plan take. Each is the shortest seen.
    pub plan_ns: u64,
    pub ways: Vec<TimedWay>,
}

/// Measures every engine with these encodings and numbers of threads, but for those of [`HOPELESS`] predictions.
pub fn measure_case(
    case: Case,
    encodings: &[Encoding],
    threads: &[usize],
    pools: &Pools,
    isa: AvailableIsa,
) -> Result<CaseTimes> {
    let mut scene = Scene::new(case.scene, case.n, SEED);
    let mut stats = SceneStats::glance(scene.boxes(), None);
    let calibration = Calibration::built_in(isa.get());
    let predicted_ns =
        |engine: EngineName| calibration.cull_ns(engine, Encoding::Sparse, &stats).unwrap_or(0.0);
    let least = EngineName::CPU.into_iter().map(predicted_ns).fold(f64::INFINITY, f64::min);
    let hopeless_ns = (HOPELESS * least).max(HOPELESS_NS);
    let mut ways: Vec<TimedWay> = Vec::new();
    for engine in EngineName::CPU.into_iter().filter(|name| predicted_ns(*name) <= hopeless_ns) {
        for &encoding in encodings {
            for &threads in threads {
                ways.push(TimedWay {
                    way: Way { engine, encoding, threads },
                    engine_ns: Vec::new(),
                    decode_ns: Vec::new(),
                    pair_count: 0,
                    engine: cpu_engine(engine, isa.get())?,
                    isa,
                    reply: HeapReply::new(),
                    pool: pools.get(&threads).cloned(),
                });
            }
        }
    }
    let capabilities =
        Capabilities { threads: threads.iter().max().copied().unwrap_or(1), gpu: None };
    let (mut anew_ns, mut again_ns) = (u64::MAX, u64::MAX);
    for frame in frames(WARM_UP) {
        // Each frame starts with another way, so that each way runs first equally often: the first
        // finds the caches as the last frame left them.
        let count = ways.len();
        for turn in 0..count {
            ways[(turn + frame) % count].frame(scene.boxes(), frame >= WARM_UP)?;
        }
        let pairs = ways.first().map(|timed| timed.pair_count);
        if let Some(other) = ways.iter().find(|timed| Some(timed.pair_count) != pairs) {
            let (Case { scene, n }, pairs) = (case, pairs.unwrap_or(0));
            let (first, second, other) = (ways[0].way.engine, other.way.engine, other.pair_count);
            return Err(format!(
                "{first} finds {pairs} pairs in {n} boxes of {scene} and {second} {other}: please report this"
            )
            .into());
        }
        let mut plans = PlanMemory::default();
        let options = CullOptions { last_pairs: pairs, ..CullOptions::default() };
        let planning = Instant::now();
        stats = SceneStats::glance(scene.boxes(), pairs);
        plans.keep(&plan(&stats, &capabilities, &calibration, &options), &capabilities);
        anew_ns = anew_ns.min(nanoseconds_since(planning));
        let planning = Instant::now();
        black_box(plans.again(stats.n, &capabilities, &options));
        again_ns = again_ns.min(nanoseconds_since(planning));
        scene.step();
    }
    let plan_ns = again_ns.saturating_add(anew_ns / u64::from(PlanMemory::FRAMES));
    Ok(CaseTimes { case, stats, plan_ns, ways })
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Way {
    pub engine: EngineName,
    pub encoding: Encoding,
    pub threads: usize,
}

pub struct TimedWay {
    pub way: Way,
    /// From the boxes in memory to the mask, every frame.
    pub engine_ns: Vec<u64>,
    /// From the mask to the last pair on one thread, every frame.
    decode_ns: Vec<u64>,
    pair_count: u64,
    engine: Box<dyn Engine>,
    isa: AvailableIsa,
    reply: HeapReply,
    /// Where the engine runs; `None` is the calling thread.
    pool: Option<Arc<ThreadPool>>,
}

impl TimedWay {
    pub fn least_ns(&self) -> u64 {
        let frames = self.engine_ns.iter().zip(&self.decode_ns);
        frames.map(|(engine, decode)| engine + decode).min().unwrap_or(0)
    }

    fn frame(&mut self, boxes: &[Aabb], is_noted: bool) -> Result<()> {
        let (engine, reply) = (&mut self.engine, &mut self.reply);
        let mut cull = || -> Result<_, CullError> {
            let start = Instant::now();
            let report = engine.cull(
                &CullInput::boxes(boxes).encoding(self.way.encoding).threads(self.way.threads),
                reply,
            )?;
            Ok((report, nanoseconds_since(start)))
        };
        let (report, engine_ns) = match &self.pool {
            Some(pool) => pool.install(cull),
            None => cull(),
        }?;
        let n = BoxCount::new(boxes.len() as u32);
        let start = Instant::now();
        let mask = MaskView::new(n, &report.shape, self.reply.words())?.with_isa(self.isa);
        let (mut decoded, mut indices) = (0u64, 0);
        mask.for_each(|a, b| {
            decoded += 1;
            indices ^= a ^ b;
        });
        black_box(indices);
        let decode_ns = nanoseconds_since(start);
        if decoded != report.pair_count {
            let (engine, counted) = (self.way.engine, report.pair_count);
            return Err(format!(
                "{engine} counted {counted} pairs and its mask holds {decoded}: please report this"
            )
            .into());
        }
        self.pair_count = decoded;
        if is_noted {
            self.engine_ns.push(engine_ns);
            self.decode_ns.push(decode_ns);
        }
        Ok(())
    }
}

/// The numbers in order, each once.
pub fn distinct(mut numbers: Vec<usize>) -> Vec<usize> {
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

/// 1, 2, 4 … and the most.
pub fn thread_counts(most: usize) -> Vec<usize> {
    let doubled = std::iter::successors(Some(1), |n| Some(2 * n)).take_while(|n| *n < most);
    doubled.chain([most]).collect()
}

pub fn core_count() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// A pool for each number of threads above 1; one thread is the calling one.
pub type Pools = BTreeMap<usize, Arc<ThreadPool>>;

pub fn pools(threads: &[usize]) -> Result<Pools> {
    let more = threads.iter().filter(|threads| **threads > 1);
    let pool = |n: &usize| Ok((*n, Arc::new(ThreadPoolBuilder::new().num_threads(*n).build()?)));
    more.map(pool).collect()
}
