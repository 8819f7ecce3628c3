//! A reply limit bounds the memory of engines, and refuses no mask that fits.

use pairmask_core::dispatch::SphereEngines;
use pairmask_core::sphere::SphereAllPairs;
use pairmask_tests::gpu::{self, open};
use pairmask_tests::mask_writer::all_pairs;
use pairmask_tests::prelude::*;
use pairmask_tests::spheres;
use pairmaskd::execute::gpu::{AllPairs, EngineOptions, Grid as GpuGrid, HostImport};
use pairmaskd::execute::{Executor, Owner};

/// A reply that records its reservations.
#[derive(Default)]
struct Witness {
    inner: HeapReply,
    /// Words of the largest reservation that was granted.
    granted: u64,
}

impl Witness {
    fn with_limit(words: u64) -> Self {
        Self { inner: HeapReply::with_limit_bytes(4 * words), granted: 0 }
    }

    fn pairs(&self, shape: &MaskShape, n: usize) -> Vec<Pair> {
        let mut pairs = naive_decoder::decode(self.inner.words(), shape, n as u32).unwrap();
        pairs.sort_unstable();
        pairs
    }
}

impl ReplyBuffer for Witness {
    fn limit_words(&self) -> u64 {
        self.inner.limit_words()
    }

    fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError> {
        let memory = self.inner.reserve(words)?;
        self.granted = self.granted.max(words);
        Ok(memory)
    }
}

type Cull<'a> = &'a mut dyn FnMut(&mut Witness) -> Result<CullReport, CullError>;

/// Whether a mask was refused for its size, with true numbers in the error.
fn is_refused(result: &Result<CullReport, CullError>, limit_words: u64, need_words: u64) -> bool {
    match result {
        Err(CullError::Reserve(ReserveError::TooLarge { at_least_bytes, limit_bytes })) => {
            *limit_bytes == 4 * limit_words
                && (4 * limit_words + 1..=4 * need_words).contains(at_least_bytes)
        }
        _ => false,
    }
}

/// Checks a way to cull at several limits. With room for the `need` words of its mask it finds
/// `pairs`. With less room it refuses, reserves nothing beyond the limit, and finds the pairs the
/// next time.
fn check_limits(what: &str, n: usize, need: u64, limits: &[u64], pairs: &[Pair], cull: Cull<'_>) {
    for &limit in limits {
        assert!(limit < need, "{what}: the scene is too small to be refused");
        let mut reply = Witness::with_limit(limit);
        let result = cull(&mut reply);
        assert!(is_refused(&result, limit, need), "{what}, {limit} of {need}: {result:?}");
        assert!(reply.granted <= limit, "{what}, {limit} of {need}");
        let mut reply = Witness::with_limit(need);
        let report = cull(&mut reply).unwrap_or_else(|e| panic!("{what}, {need} words: {e}"));
        assert!(reply.pairs(&report.shape, n) == pairs, "{what}, {need} words, after {limit}");
    }
}

/// Checks a way to cull below the words of a reply that it takes without a limit.
fn check_below(what: &str, n: usize, pairs: &[Pair], cull: Cull<'_>) {
    let mut reply = Witness::default();
    cull(&mut reply).unwrap();
    check_limits(what, n, reply.granted, &below(reply.granted), pairs, cull);
}

/// Limits below a need: near it and far from it.
fn below(need: u64) -> [u64; 5] {
    [need - 1, need - need / 8, need / 2, need / 16, 1]
}

#[test]
fn every_cpu_engine_takes_what_fits_and_no_word_more() {
    for (scene, n) in [("identical", 1_234), ("clustered", 2_500), ("sizes over 20 octaves", 2_100)]
    {
        let boxes = stress_scenes::named(scene).boxes(n, 5);
        let pairs = oracle::truth(&boxes).pairs;
        for mut engine in cpu_engines() {
            for encoding in Encoding::ALL {
                for threads in [1, 3] {
                    let pool = pool(threads);
                    let what = format!("{scene}, {}, {encoding}, {threads}", engine.name());
                    let input = CullInput::boxes(&boxes).encoding(encoding).threads(threads);
                    let mut cull =
                        |reply: &mut Witness| pool.install(|| engine.cull(&input, reply));
                    check_below(&what, boxes.len(), &pairs, &mut cull);
                }
            }
        }
    }
}

#[test]
fn spheres_take_what_fits_and_no_word_more() {
    let same = vec![Sphere::new([1.0; 3], 1.0); 1_234];
    let all = all_pairs(BoxCount::new(1_234));
    let (many, truth) = spheres::whole_scene(2_500, 24, 7);
    let scenes: [(&str, Vec<Sphere>, Vec<Pair>); 2] =
        [("identical", same, all), ("many", many, truth.pairs)];
    for (scene, spheres, pairs) in &scenes {
        for encoding in Encoding::ALL {
            for threads in [1, 3] {
                let pool = pool(threads);
                let mut all_pairs = SphereAllPairs::new();
                let input = CullInput::spheres(spheres).encoding(encoding).threads(threads);
                let mut cull = |reply: &mut Witness| pool.install(|| all_pairs.cull(&input, reply));
                let what = format!("{scene}, all pairs, {encoding}, {threads}");
                check_below(&what, spheres.len(), pairs, &mut cull);
                for engine in EngineName::CPU {
                    let options =
                        CullOptions { threads: Some(threads), ..culled(engine, encoding) };
                    let mut engines = SphereEngines::new();
                    let mut cull = |reply: &mut Witness| {
                        pool.install(|| Ok(engines.cull(spheres, &options, reply)?.report))
                    };
                    let what = format!("{scene}, {engine}, {encoding}, {threads}");
                    check_below(&what, spheres.len(), pairs, &mut cull);
                }
            }
        }
    }
}

/// Large spheres whose bounds overlap at the corners, where many small spheres lie that no large one
/// touches.
fn corners() -> Vec<Sphere> {
    let large = (0..400).map(|i| Sphere::new([i as f32 / 1e4, 0.0, 0.0], 10.0));
    let small = (0..4_000).map(|i| {
        let [x, y, z] = [i % 16, i / 16 % 16, i / 256].map(|x| 8.0 + x as f32 / 16.0);
        Sphere::new([x, y, z], 0.01)
    });
    large.chain(small).collect()
}

#[test]
fn candidates_that_are_no_pairs_count_for_nothing() {
    let spheres = corners();
    let (n, mut reply) = (spheres.len(), Witness::default());
    let pairs = 400 * 399 / 2;
    let boxes: Vec<Aabb> = spheres.iter().map(Sphere::bounds).collect();
    let candidates =
        best_engine(EngineName::CpuGrid).cull(&CullInput::boxes(&boxes), &mut reply).unwrap();
    assert!(candidates.pair_count > 15 * pairs, "{}", candidates.pair_count);
    for engine in [EngineName::CpuSap, EngineName::CpuGrid] {
        let options = CullOptions { threads: Some(1), ..culled(engine, Encoding::Sparse) };
        // The words of 400 spheres that follow each other in the order, and the order.
        let room = 3 * (400 * 400 / 32) + n as u64;
        let mut reply = Witness::with_limit(room);
        let answer = SphereEngines::new().cull(&spheres, &options, &mut reply);
        let report = answer.unwrap_or_else(|e| panic!("{engine}: {e}")).report;
        assert_eq!(report.pair_count, pairs, "{engine}");
        assert_eq!(reply.pairs(&report.shape, n).len() as u64, pairs, "{engine}");
    }
}

fn forms() -> [Precision; 4] {
    let bounds = Bounds::new([-2048.0; 3], [2048.0; 3]).unwrap();
    [Precision::Exact, Precision::Q16(bounds), Precision::Q8(bounds), Precision::F16]
}

/// The pairs of boxes in the form that a GPU reads.
fn pairs_of(memory: &NarrowMemory) -> Vec<Pair> {
    let boxes = memory.boxes();
    let expanded: Vec<Aabb> = (0..boxes.len()).filter_map(|i| boxes.get(i)).collect();
    oracle::truth(&expanded).pairs
}

/// Words of the three arrays of a GPU's sparse mask, each of whole strides.
fn strides(report: &CullReport) -> u64 {
    match report.shape {
        MaskShape::Sparse { bits, .. } => bits.len.next_multiple_of(16),
        _ => panic!("not sparse"),
    }
}

#[test]
fn all_pairs_on_a_gpu_takes_what_fits() {
    let gpu = open(HostImport::IfPossible);
    let mut engine = AllPairs::new(&gpu, EngineOptions::default()).unwrap();
    let boxes = stress_scenes::named("clustered").boxes(2_500, 5);
    for precision in forms() {
        let memory = NarrowMemory::write(&precision, &boxes);
        let pairs = pairs_of(&memory);
        for encoding in Encoding::ALL {
            let mut cull = |reply: &mut Witness| {
                engine.cull(&CullInput::boxes(memory.boxes()).encoding(encoding), reply)
            };
            let report = cull(&mut Witness::default()).unwrap();
            let need = match report.shape {
                MaskShape::Sparse { bits, .. } => 2 * strides(&report) + bits.len,
                _ => report.shape.extent_words(),
            };
            let what = format!("{precision:?}, {encoding}");
            check_limits(&what, boxes.len(), need, &below(need), &pairs, &mut cull);
        }
    }
}

#[test]
fn the_grid_on_a_gpu_takes_what_fits() {
    let gpu = open(HostImport::IfPossible);
    let mut engine = GpuGrid::new(&gpu, &EngineOptions::default()).unwrap();
    let boxes = same(1_234);
    let order_words = 1_248;
    for precision in forms() {
        let memory = NarrowMemory::write(&precision, &boxes);
        let pairs = pairs_of(&memory);
        let mut list = |reply: &mut Witness| {
            engine.cull(&CullInput::boxes(memory.boxes()).encoding(Encoding::List), reply)
        };
        let need = 2 * pairs.len() as u64;
        // The last ones without room for one pair.
        let limits = [need - 1, need - need / 8, need / 2, 2, 1];
        let what = format!("{precision:?}, list");
        check_limits(&what, boxes.len(), need, &limits, &pairs, &mut list);
        let mut cull = |reply: &mut Witness| engine.cull(&CullInput::boxes(memory.boxes()), reply);
        let report = cull(&mut Witness::default()).unwrap();
        let need = order_words + 3 * strides(&report);
        let limits = [need - 1, need - need / 8, need / 2, order_words + 48];
        check_limits(&format!("{precision:?}"), boxes.len(), need, &limits, &pairs, &mut cull);
        let crowded = cull(&mut Witness::with_limit(order_words));
        assert!(matches!(crowded, Err(CullError::TooCrowded { .. })), "{crowded:?}");
    }
}

/// Identical boxes: their sparse mask is three times as large as the dense one.
fn same(n: usize) -> Vec<Aabb> {
    vec![Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]); n]
}

#[test]
fn an_open_encoding_is_one_that_fits() {
    let n = 3_000;
    let boxes = same(n);
    let balls = vec![Sphere::new([0.0; 3], 1.0); n];
    let dense = BoxCount::new(n as u32).dense_words();
    let mut executors = [("no GPU", Executor::new(None)), ("GPU", gpu::executor(1))];
    let named = EngineName::ALL.map(EngineChoice::Only);
    for engine in [EngineChoice::Auto].into_iter().chain(named) {
        let is_gpu = matches!(engine, EngineChoice::Only(engine) if engine.is_gpu());
        // After a frame without pairs, the plan expects a small sparse mask.
        for last_pairs in [None, Some(0)] {
            let options =
                CullOptions { engine, last_pairs, threads: Some(1), ..CullOptions::default() };
            let check = |what: &str, cull: Cull<'_>| {
                let what = format!("{what}, {engine}, {last_pairs:?}");
                let mut reply = Witness::with_limit(dense);
                let report = cull(&mut reply).unwrap_or_else(|e| panic!("{what}: {e}"));
                assert_eq!(report.shape, MaskShape::dense(BoxCount::new(n as u32)), "{what}");
                assert_eq!(report.pair_count, (n * (n - 1) / 2) as u64, "{what}");
                assert_eq!(reply.pairs(&report.shape, n).len(), n * (n - 1) / 2, "{what}");
                let refused = cull(&mut Witness::with_limit(dense - 1));
                assert!(is_refused(&refused, dense - 1, u64::MAX / 4), "{what}: {refused:?}");
            };
            for (name, executor) in &mut executors {
                if *name == "GPU" || !is_gpu {
                    let boxes = BoxSlice::from(&boxes);
                    check(name, &mut |reply| {
                        Ok(executor.cull(boxes, Owner::Daemon, &options, reply)?.report)
                    });
                }
            }
            if !is_gpu {
                let (mut cpu, mut ways) = (CpuEngines::new(), SphereEngines::new());
                check("boxes", &mut |reply| Ok(cpu.cull(&boxes, &options, reply)?.report));
                check("spheres", &mut |reply| Ok(ways.cull(&balls, &options, reply)?.report));
            }
        }
    }
}

#[test]
fn another_mask_is_found_where_a_dense_one_does_not_fit() {
    // 300 boxes far apart: the plan would take the dense mask of so few.
    let boxes: Vec<Aabb> = (0..300)
        .map(|i| Aabb::from([3.0 * i as f32, 0.0, 0.0, 3.0 * i as f32 + 1.0, 1.0, 1.0]))
        .collect();
    let balls: Vec<Sphere> = boxes.iter().map(|b| Sphere::new(b.min, 1.0)).collect();
    let options = CullOptions { threads: Some(1), ..CullOptions::default() };
    let limit = BoxCount::new(300).dense_words() - 1;
    let check = |what: &str, cull: Cull<'_>| {
        let report =
            cull(&mut Witness::with_limit(limit)).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert_ne!(report.shape.encoding(), Encoding::Dense, "{what}");
        assert_eq!(report.pair_count, 0, "{what}");
    };
    let mut executor = Executor::new(None);
    check("executor", &mut |reply| {
        Ok(executor.cull(boxes.as_slice().into(), Owner::Daemon, &options, reply)?.report)
    });
    check("spheres", &mut |reply| Ok(SphereEngines::new().cull(&balls, &options, reply)?.report));
}

#[test]
fn scratch_that_frames_do_not_need_is_given_back() {
    const MIB: usize = 1 << 20;
    let large = same(6_000);
    let small = same(10);
    for engine in EngineName::CPU {
        let mut engines = CpuEngines::new();
        let options = CullOptions { threads: Some(1), ..culled(engine, Encoding::Sparse) };
        let mut reply = HeapReply::new();
        // 560,000 words.
        engines.cull(&large, &options, &mut reply).unwrap();
        assert!(engines.scratch_bytes() > 6 * MIB, "{engine}: {}", engines.scratch_bytes());
        let mut limited = HeapReply::with_limit_bytes(4 * MIB as u64);
        engines.cull(&large, &options, &mut limited).unwrap_err();
        assert!(engines.scratch_bytes() < 2 * MIB, "{engine}: {}", engines.scratch_bytes());
        engines.cull(&large, &options, &mut reply).unwrap();
        assert!(engines.scratch_bytes() > 6 * MIB, "{engine}: {}", engines.scratch_bytes());
        for _ in 0..2 * 64 {
            engines.cull(&small, &CullOptions::default(), &mut reply).unwrap();
        }
        assert!(engines.scratch_bytes() < MIB, "{engine}: {}", engines.scratch_bytes());
        engines.cull(&large, &options, &mut reply).unwrap();
        engines.give_back();
        assert!(engines.scratch_bytes() < MIB / 8, "{engine}: {}", engines.scratch_bytes());
    }
}

#[test]
fn an_executor_gives_back_what_other_kinds_of_frames_needed() {
    const MIB: usize = 1 << 20;
    let mut executor = Executor::new(None);
    let mut reply = HeapReply::new();
    let boxes = same(10);
    let options = CullOptions { threads: Some(1), ..CullOptions::default() };
    let empty = |executor: &mut Executor, reply: &mut HeapReply| {
        for _ in 0..2 * 64 {
            executor.cull(boxes.as_slice().into(), Owner::Daemon, &options, reply).unwrap();
        }
        assert!(executor.scratch_bytes() < MIB, "{}", executor.scratch_bytes());
    };
    let balls: Vec<Sphere> =
        (0..50_000).map(|i| Sphere::new([3.0 * i as f32, 0.0, 0.0], 1.0)).collect();
    executor.cull_spheres(&balls, Owner::Daemon, &options, &mut reply).unwrap();
    assert!(executor.scratch_bytes() > 2 * MIB, "{}", executor.scratch_bytes());
    empty(&mut executor, &mut reply);
    let apart: Vec<Aabb> = balls.iter().map(Sphere::bounds).collect();
    let narrow = NarrowMemory::write(&Precision::F16, &apart);
    executor.cull(narrow.boxes(), Owner::Daemon, &options, &mut reply).unwrap();
    assert!(executor.scratch_bytes() > MIB, "{}", executor.scratch_bytes());
    empty(&mut executor, &mut reply);
    executor.cull_spheres(&balls, Owner::Daemon, &options, &mut reply).unwrap();
    executor.give_back();
    assert!(executor.scratch_bytes() < MIB / 8, "{}", executor.scratch_bytes());
}

/// The most memory that a process has had at a time, bytes.
fn peak_bytes(pid: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() << 10
}

fn count(session: &mut Session, boxes: &[Aabb]) -> Result<u64, pairmask::Error> {
    Ok(session.ask(boxes).wait()?.count())
}

#[test]
fn a_worker_with_a_limit_stays_within_a_few_times_of_it() {
    const LIMIT: u64 = 64 << 20;
    // Masks of 156,000,000 words, 1.9 GB.
    let n = 100_000;
    let boxes = same(n);
    let balls = vec![Sphere::new([0.0; 3], 1.0); n];
    let named = EngineName::CPU.map(EngineChoice::Only);
    for engine in [EngineChoice::Auto].into_iter().chain(named) {
        // A driver that is loaded meanwhile would count, too.
        let daemon = TestDaemon::start(&["--max-reply-mib", "64", "--gpu", "none"]);
        // What an engine takes for each thread is not of the limit.
        let mut session = daemon.session().engine(engine).threads(2).connect().unwrap();
        assert_eq!(count(&mut session, &boxes[..70]).unwrap(), 70 * 69 / 2);
        let pid = daemon.record().unwrap().worker_pid;
        let before = peak_bytes(pid);
        let error = count(&mut session, &boxes).unwrap_err().to_string();
        assert!(error.contains("reply-too-large"), "{engine}: {error}");
        let error = session.ask_spheres(&balls).wait().unwrap_err().to_string();
        assert!(error.contains("reply-too-large"), "{engine}: {error}");
        assert_eq!(count(&mut session, &boxes[..345]).unwrap(), 345 * 344 / 2);
        // Words up to the limit, arrays that grow by doubling, and 40 MB for so many objects.
        let enlarged = peak_bytes(pid) - before;
        assert!(enlarged < 4 * LIMIT, "{engine}: {} MiB", enlarged >> 20);
        assert_eq!(daemon.record().unwrap().worker_pid, pid, "it is the same worker");
    }
}
