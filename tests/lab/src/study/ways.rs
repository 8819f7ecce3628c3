//! Cases, a scene of some size each, that are culled in several ways. The machine may be busy: ways that
//! are compared take turns.

use std::collections::BTreeMap;
use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::dispatch::{CpuEngines, CullOptions, nanoseconds_since};
use pairmask_core::engine::{
    AvailableIsa, CullInput, CullReport, Engine, EngineName, HeapReply, cpu_engine,
};
use pairmask_core::plan::{Calibration, Plan, SceneStats};
use pairmask_core::{Aabb, BoxCount, Encoding, MaskView};
use pairmaskd::scene::{Scene, SceneName};
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::Result;

/// Seed of the scenes: every run has the same boxes and motions.
const SEED: u64 = 1;
/// Frames before the first measured one: they touch memory and settle orders.
const WARM_UP: usize = 2;
/// Frames from which the plan has learned before its choice is judged: less than a second of a game.
const LEARNED_FRAMES: usize = 50;
/// Frames of a way in its turn, of the moving scene, of which the last is measured. A session goes on with one way, on one
/// thread: the first frames of a turn find caches and branch predictors as twenty other ways left them, which takes up
/// to half as long again where frames are of microseconds. Those of large scenes leave nothing in caches anyhow.
const TURN: usize = 8;
const TURN_LARGE: usize = 2;
const LARGE: usize = 32_768;
/// Turns: at least so many, and until this time is over, at most so many.
const LEAST_FRAMES: usize = 15;
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
    pub ways: Vec<TimedWay>,
    pub planned: Vec<Planned>,
}

/// Measures every engine with these encodings and numbers of threads, but for those of [`HOPELESS`] predictions, and
/// what is planned where so many threads may be used.
pub fn measure_case(
    case: Case,
    encodings: &[Encoding],
    threads: &[usize],
    planned: &[usize],
    pools: &Pools,
    isa: AvailableIsa,
) -> Result<CaseTimes> {
    let mut scene = Scene::new(case.scene, case.n, SEED);
    let stats = SceneStats::glance(scene.boxes(), None);
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
                    engine: cpu_engine(engine, isa.get())?,
                    isa,
                    reply: HeapReply::new(),
                    pool: pools.get(&threads).cloned(),
                });
            }
        }
    }
    let learned = planned.iter().map(|threads| Planned::learned(case, *threads, pools, isa));
    let mut planned = learned.collect::<Result<Vec<_>>>()?;
    let turn_frames = if case.n < LARGE { TURN } else { TURN_LARGE };
    for frame in frames(WARM_UP) {
        let step = |_| {
            scene.step();
            scene.boxes().to_vec()
        };
        let steps: Vec<Vec<Aabb>> = (0..turn_frames).map(step).collect();
        // Each time starts with another way, so that each way runs first equally often: the first
        // finds the caches as the last turn left them.
        let count = ways.len() + planned.len();
        let mut first = None;
        for turn in 0..count {
            let turn = (turn + frame) % count;
            let is_noted = frame >= WARM_UP;
            let (engine, pairs) = match turn.checked_sub(ways.len()) {
                None => (ways[turn].way.engine, ways[turn].turn(&steps, is_noted)?),
                Some(turn) => planned[turn].turn(&steps, is_noted)?,
            };
            let (first, expected) = *first.get_or_insert((engine, pairs));
            if pairs != expected {
                let Case { scene, n } = case;
                return Err(format!(
                    "{first} finds {expected} pairs in {n} boxes of {scene} and {engine} {pairs}: please report this"
                )
                .into());
            }
        }
    }
    Ok(CaseTimes { case, ways, planned })
}

/// Engines of which the plan chooses by what it has learned.
pub struct Planned {
    /// Threads that it may use.
    pub threads: usize,
    /// Of the last frame.
    pub plan: Plan,
    /// From the boxes in memory to the last pair on one thread, of each turn, planning counted.
    pub total_ns: Vec<u64>,
    engines: CpuEngines,
    isa: AvailableIsa,
    last_pairs: Option<u64>,
    reply: HeapReply,
    pool: Option<Arc<ThreadPool>>,
}

impl Planned {
    /// Engines that have had [`LEARNED_FRAMES`] of the case.
    fn learned(case: Case, threads: usize, pools: &Pools, isa: AvailableIsa) -> Result<Self> {
        let mut scene = Scene::new(case.scene, case.n, SEED);
        let calibration = Calibration::built_in(isa.get());
        let mut engines = CpuEngines::on(isa, calibration);
        let plan = engines.plan(scene.boxes(), &CullOptions::default(), None);
        let (reply, pool) = (HeapReply::new(), pools.get(&threads).cloned());
        let (total_ns, last_pairs) = (Vec::new(), None);
        let mut planned = Self { threads, plan, total_ns, engines, isa, last_pairs, reply, pool };
        for _ in 0..LEARNED_FRAMES {
            planned.turn(&[scene.boxes()], false)?;
            scene.step();
        }
        Ok(planned)
    }

    /// The engine that answered the last frame of a turn, and its pairs.
    fn turn<Boxes: AsRef<[Aabb]> + Sync>(
        &mut self,
        steps: &[Boxes],
        is_noted: bool,
    ) -> Result<(EngineName, u64)> {
        let pool = self.pool.clone();
        let (engine, pairs, total_ns) =
            on(pool.as_ref(), || last(steps, |boxes| self.frame(boxes)))?;
        if is_noted {
            self.total_ns.push(total_ns);
        }
        Ok((engine, pairs))
    }

    /// The engine that answered, its pairs, and what they took.
    fn frame(&mut self, boxes: &[Aabb]) -> Result<(EngineName, u64, u64)> {
        let threads = Some(self.threads);
        let options =
            CullOptions { last_pairs: self.last_pairs, threads, ..CullOptions::default() };
        let start = Instant::now();
        self.plan = self.engines.plan(boxes, &options, None);
        let (engine, report) = self.engines.run_plan(&self.plan, boxes.into(), &mut self.reply)?;
        let pairs = decode(engine, boxes.len(), &report, self.reply.words(), self.isa)?;
        let total_ns = nanoseconds_since(start);
        self.last_pairs = Some(pairs);
        Ok((engine, pairs, total_ns))
    }
}

/// What the last frame of a turn gives. Errors may cross threads.
fn last<Boxes: AsRef<[Aabb]>, T>(
    steps: &[Boxes],
    mut frame: impl FnMut(&[Aabb]) -> Result<T>,
) -> std::result::Result<T, String> {
    let (last, before) = steps.split_last().ok_or("a turn has frames")?;
    let mut run = |boxes: &Boxes| frame(boxes.as_ref()).map_err(|err| err.to_string());
    before.iter().try_for_each(|boxes| run(boxes).map(|_| ()))?;
    run(last)
}

/// Iterates over the pairs of a mask on this thread, and counts them.
fn decode(
    engine: EngineName,
    n: usize,
    report: &CullReport,
    words: &[u32],
    isa: AvailableIsa,
) -> Result<u64> {
    let mask = MaskView::new(BoxCount::new(n as u32), &report.shape, words)?.with_isa(isa);
    let (mut decoded, mut indices) = (0u64, 0);
    mask.for_each(|a, b| {
        decoded += 1;
        indices ^= a ^ b;
    });
    black_box(indices);
    if decoded != report.pair_count {
        let counted = report.pair_count;
        return Err(format!(
            "{engine} counted {counted} pairs and its mask holds {decoded}: please report this"
        )
        .into());
    }
    Ok(decoded)
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Way {
    pub engine: EngineName,
    pub encoding: Encoding,
    pub threads: usize,
}

pub struct TimedWay {
    pub way: Way,
    /// From the boxes in memory to the mask, of each turn.
    pub engine_ns: Vec<u64>,
    /// From the mask to the last pair on one thread, of each turn.
    decode_ns: Vec<u64>,
    engine: Box<dyn Engine>,
    isa: AvailableIsa,
    reply: HeapReply,
    /// Where the engine runs; `None` is the calling thread.
    pool: Option<Arc<ThreadPool>>,
}

impl TimedWay {
    /// Both, of each turn.
    pub fn total_ns(&self) -> Vec<u64> {
        let frames = self.engine_ns.iter().zip(&self.decode_ns);
        frames.map(|(engine, decode)| engine + decode).collect()
    }

    /// The pairs of the last frame of a turn.
    fn turn(&mut self, steps: &[Vec<Aabb>], is_noted: bool) -> Result<u64> {
        let pool = self.pool.clone();
        let (pairs, [engine_ns, decode_ns]) =
            on(pool.as_ref(), || last(steps, |boxes| self.frame(boxes)))?;
        if is_noted {
            self.engine_ns.push(engine_ns);
            self.decode_ns.push(decode_ns);
        }
        Ok(pairs)
    }

    /// The pairs, and what engine and decoder took.
    fn frame(&mut self, boxes: &[Aabb]) -> Result<(u64, [u64; 2])> {
        let Way { engine, encoding, threads } = self.way;
        let input = CullInput::boxes(boxes).encoding(encoding).threads(threads);
        let start = Instant::now();
        let report = self.engine.cull(&input, &mut self.reply)?;
        let engine_ns = nanoseconds_since(start);
        let start = Instant::now();
        let pairs = decode(engine, boxes.len(), &report, self.reply.words(), self.isa)?;
        Ok((pairs, [engine_ns, nanoseconds_since(start)]))
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

/// Runs work in a pool, or on the calling thread.
fn on<R: Send>(pool: Option<&Arc<ThreadPool>>, work: impl FnOnce() -> R + Send) -> R {
    match pool {
        Some(pool) => pool.install(work),
        None => work(),
    }
}

pub fn pools(threads: &[usize]) -> Result<Pools> {
    let more = threads.iter().filter(|threads| **threads > 1);
    let pool = |n: &usize| Ok((*n, Arc::new(ThreadPoolBuilder::new().num_threads(*n).build()?)));
    more.map(pool).collect()
}
