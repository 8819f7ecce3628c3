//! Spheres on the GPU: exact against rational arithmetic, and byte by byte against the mirror.
//!
//! lavapipe ends all loops of a thread after 65,535 rounds together, so that scenes with many near pairs are for
//! a real GPU (daemon/GPU.md, "Spheres"), and ignored here:
//! `PAIRMASK_TEST_GPU=auto cargo test -p pairmask-tests --test gpu -- --ignored real_gpu`.

use std::time::Instant;

use pairmask_core::dispatch::SphereEngines;
use pairmask_core::objects::Objects;
use pairmask_core::oracle::Truth;
use pairmask_core::sphere::SphereAllPairs;
use pairmask_lab::study::spheres::oracle::overlap;
use pairmask_shaders::mirror::sphere_filter::{Arithmetic, LESS, Verdict, verdict};
use pairmask_shaders::mirror::{self, Mirrored, sphere_bounds, sphere_exact};
use pairmask_tests::gpu::{self, open};
use pairmask_tests::naive_decoder::sections;
use pairmask_tests::prelude::*;
use pairmask_tests::spheres::{
    check_mask, cull, hard_pairs, hard_scene, plain_scene, truth, whole_scene,
};
use pairmaskd::execute::gpu::{
    AllPairs, Checks, EngineOptions, Grid, HostImport, Tuning, grid_layout,
};

use crate::grid::check_mirrored;

/// Most spheres that the daemon gives to a software adapter.
const SOFTWARE_SPHERES: usize = 16;

struct Both {
    all_pairs: AllPairs,
    grid: Grid,
}

impl Both {
    fn new(checks: Checks) -> Self {
        let gpu = open(HostImport::IfPossible);
        let all_pairs = EngineOptions { checks, ..EngineOptions::default() };
        // What no stage wrote must not show.
        let grid = EngineOptions { checks, poison: Some(0xa5a5_a5a5), ..EngineOptions::default() };
        Self {
            all_pairs: AllPairs::new(&gpu, all_pairs).unwrap(),
            grid: Grid::new(&gpu, &grid).unwrap(),
        }
    }

    fn cull(
        &mut self,
        engine: EngineName,
        spheres: &[Sphere],
        encoding: Encoding,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        match engine {
            EngineName::GpuGrid => {
                self.grid.cull_objects(Objects::Spheres(spheres), encoding, reply)
            }
            _ => self.all_pairs.cull_objects(Objects::Spheres(spheres), encoding, reply),
        }
    }

    /// Every engine in every encoding, twice, the same bytes each time.
    fn check(&mut self, spheres: &[Sphere], truth: &Truth, what: &str) {
        for (engine, encoding) in WAYS {
            let words = [(); 2].map(|()| {
                let cull = |reply: &mut HeapReply| self.cull(engine, spheres, encoding, reply);
                check_answer(cull, spheres.len(), encoding, truth, &format!("{what}, {engine}"))
            });
            assert!(words[0] == words[1], "{what}, {engine}, {encoding}: other bytes");
        }
    }
}

/// Checks an answer. Returns its sections.
fn check_answer(
    cull: impl FnOnce(&mut HeapReply) -> Result<CullReport, CullError>,
    n: usize,
    encoding: Encoding,
    truth: &Truth,
    what: &str,
) -> Vec<u32> {
    let mut reply = HeapReply::new();
    let report = cull(&mut reply).unwrap();
    let checked = check_reply(reply.words(), &report, n as u32, encoding, truth);
    assert_eq!(checked, Ok(()), "{what}, {n} spheres, {encoding}");
    sections(reply.words(), &report.shape).unwrap()
}

/// All pairs in every encoding.
fn check_all_pairs(engine: &mut AllPairs, spheres: &[Sphere], truth: &Truth, what: &str) {
    for encoding in Encoding::ALL {
        let objects = Objects::Spheres(spheres);
        let cull = |reply: &mut HeapReply| engine.cull_objects(objects, encoding, reply);
        check_answer(cull, spheres.len(), encoding, truth, what);
    }
}

const WAYS: [(EngineName, Encoding); 5] = [
    (EngineName::GpuBrute, Encoding::Dense),
    (EngineName::GpuBrute, Encoding::Sparse),
    (EngineName::GpuBrute, Encoding::List),
    (EngineName::GpuGrid, Encoding::Sparse),
    (EngineName::GpuGrid, Encoding::List),
];

fn check_mirror(grid: &mut Grid, spheres: &[Sphere], mirrored: &Mirrored, what: &str) {
    check_mirrored(spheres.len(), mirrored, what, |encoding| {
        let mut reply = HeapReply::new();
        (grid.cull_objects(Objects::Spheres(spheres), encoding, &mut reply).unwrap(), reply)
    });
}

/// Whether f32 ever contradicts the truth, and how many of the pairs it leaves to the integers.
fn judged(less: f32) -> (u64, u64) {
    let (mut wrong, mut near) = (0, 0);
    for (a, b) in hard_pairs(2_000, 11) {
        let is_pair = overlap(&a, &b);
        assert_eq!(sphere_exact::meet(&a, &b), is_pair, "{a:?} {b:?}");
        for arithmetic in Arithmetic::ALL {
            match verdict(&a, &b, arithmetic, less) {
                Verdict::Near => near += 1,
                said => wrong += u64::from((said == Verdict::Together) != is_pair),
            }
        }
    }
    (wrong, near)
}

#[test]
fn what_f32_says_is_true_however_it_is_computed() {
    let (wrong, near) = judged(LESS);
    assert_eq!(wrong, 0);
    assert!(near > 1_000, "{near} near pairs: integers decided next to nothing");
}

#[test]
fn a_narrower_band_would_be_wrong() {
    assert!(judged(1.0).0 > 0, "no pair is hard");
}

#[test]
fn boxes_around_spheres_lose_no_pair() {
    for (a, b) in hard_pairs(5_000, 13) {
        let [p, q] = [&a, &b].map(|sphere| sphere_bounds::classify(sphere).0);
        // Below 2^-60 the grid takes numbers as 0, and so do its boxes' proofs.
        let is_tiny = [&a, &b]
            .iter()
            .any(|s| s.center.iter().chain([&s.radius]).all(|x| x.abs() < 2.0f32.powi(-60)));
        assert!(is_tiny || !overlap(&a, &b) || p.overlaps(&q), "{a:?} {b:?}");
    }
}

/// Scenes in which no pair is near: what f32 says decides, so that their size does not matter to lavapipe.
#[test]
fn scenes_without_near_pairs_are_exact_and_have_the_bytes_of_the_mirror() {
    let mut both = Both::new(Checks::On);
    for n in [0, 1, 2, 31, 32, 33, 64, 70, 345, 1_234] {
        let spheres = plain_scene(n, 17);
        let is_near = |(a, b): (&Sphere, &Sphere)| {
            Arithmetic::ALL.iter().any(|how| verdict(a, b, *how, LESS) == Verdict::Near)
        };
        let mut pairs = (0..n).flat_map(|a| (0..a).map(move |b| [a, b]));
        assert!(!pairs.any(|[a, b]| is_near((&spheres[a], &spheres[b]))), "{n} spheres");
        both.check(&spheres, &truth(&spheres), "plain");
        if n > 1 {
            let mirrored = mirror::sphere_frame(&grid_layout(&spheres[..]), &spheres);
            check_mirror(&mut both.grid, &spheres, &mirrored, &format!("plain, {n}"));
        }
    }
}

/// As many as the daemon gives to a software adapter, however hard.
#[test]
fn a_few_hard_spheres_are_exact_by_all_pairs() {
    for checks in [Checks::Off, Checks::On] {
        let mut engine = gpu::engine(EngineOptions { checks, ..EngineOptions::default() });
        for (n, seed) in (0..=SOFTWARE_SPHERES).flat_map(|n| (0..4).map(move |seed| (n, seed))) {
            let spheres = hard_scene(n, seed);
            check_all_pairs(&mut engine, &spheres, &truth(&spheres), &format!("seed {seed}"));
        }
    }
}

/// A software adapter decides a few spheres by all pairs, and no engine of it answers for others; a GPU takes
/// all. A client that leaves the choice to the daemon is always answered.
#[test]
fn a_software_adapter_gets_what_it_decides() {
    let name = gpu::name();
    let is_software = open(HostImport::Never).is_software();
    let daemon = TestDaemon::start(&["--gpu", &name]);
    for n in [SOFTWARE_SPHERES, SOFTWARE_SPHERES + 1, 200] {
        let spheres = hard_scene(n, 31);
        let truth = truth(&spheres);
        for engine in [EngineName::GpuGrid, EngineName::GpuBrute] {
            let answer = daemon.connect_to(engine).ask_spheres(&spheres).wait();
            let decides = engine == EngineName::GpuBrute && n <= SOFTWARE_SPHERES;
            match answer {
                Ok(mask) => {
                    assert!(!is_software || decides, "{n} spheres, {engine}");
                    let by = mask.info().engine;
                    assert!(by == EngineName::GpuBrute || by == EngineName::GpuGrid, "{n}: {by}");
                    assert_eq!(check_mask(&mask, mask.encoding(), &truth), Ok(()), "{n}, {engine}");
                }
                Err(error) => assert!(is_software && !decides, "{n}, {engine}: {error}"),
            }
        }
        let mask = cull(&mut daemon.connect(), &spheres);
        assert_eq!(check_mask(&mask, mask.encoding(), &truth), Ok(()), "{n} spheres");
    }
}

mod real_gpu {
    use super::*;

    #[test]
    #[ignore = "for a real GPU: near pairs take more rounds than lavapipe allows, see the head of this file"]
    fn small_and_odd_scenes_are_exact() {
        for checks in [Checks::Off, Checks::On] {
            let mut both = Both::new(checks);
            for n in (0..70).chain([255, 257, 345]) {
                let spheres = hard_scene(n, 5);
                both.check(&spheres, &truth(&spheres), "hard");
            }
        }
    }

    #[test]
    #[ignore = "for a real GPU: near pairs take more rounds than lavapipe allows, see the head of this file"]
    fn scenes_in_which_many_touch_are_exact_at_every_scale() {
        let mut both = Both::new(Checks::Off);
        for (n, side) in [(1_234, 20), (4_097, 40)] {
            let (spheres, truth) = whole_scene(n, side, 3);
            both.check(&spheres, &truth, "whole");
        }
        // From subnormal numbers to the largest.
        for exponent in [-149, -140, -126, -100, -64, -45, -38, -20, 30, 34, 36, 60, 100, 120] {
            let scale = 2.0f64.powi(exponent);
            let (spheres, truth) = whole_scene(345, 12, 7);
            let scaled = |s: &Sphere| {
                Sphere::new(
                    s.center.map(|x| (f64::from(x) * scale) as f32),
                    (f64::from(s.radius) * scale) as f32,
                )
            };
            let spheres: Vec<Sphere> = spheres.iter().map(scaled).collect();
            both.check(&spheres, &truth, &format!("2^{exponent}"));
        }
    }

    #[test]
    #[ignore = "for a real GPU: near pairs take more rounds than lavapipe allows, see the head of this file"]
    fn every_tile_shape_is_exact() {
        let spheres = hard_scene(333, 9);
        let truth = truth(&spheres);
        for tuning in Tuning::all() {
            let options = EngineOptions { tuning: Some(tuning), ..EngineOptions::default() };
            let mut engine = gpu::engine(options);
            check_all_pairs(&mut engine, &spheres, &truth, &format!("{tuning:?}"));
        }
    }

    /// The CPU is exact; here every pair of a larger hard scene is held to it.
    #[test]
    #[ignore = "for a real GPU: near pairs take more rounds than lavapipe allows, see the head of this file"]
    fn large_hard_scenes_have_the_pairs_of_the_cpu() {
        let mut gpu = gpu::engine(EngineOptions::default());
        let mut cpu = SphereAllPairs::new();
        let spheres = hard_scene(3_001, 77);
        let mut reply = HeapReply::new();
        let input = CullInput::spheres(&spheres).encoding(Encoding::Dense);
        let expected = cpu.cull(&input, &mut reply).unwrap();
        let expected_words = sections(reply.words(), &expected.shape);
        let report =
            gpu.cull_objects(Objects::Spheres(&spheres), Encoding::Dense, &mut reply).unwrap();
        assert_eq!((report.pair_count, report.census), (expected.pair_count, expected.census));
        assert!(sections(reply.words(), &report.shape) == expected_words);
    }

    #[test]
    #[ignore = "for a real GPU: near pairs take more rounds than lavapipe allows, see the head of this file"]
    fn the_grid_has_the_bytes_of_its_mirror() {
        let mut both = Both::new(Checks::Off);
        for n in [2, 33, 345, 1_234] {
            for (name, spheres) in [("hard", hard_scene(n, 21)), ("whole", whole_scene(n, 18, 2).0)]
            {
                let mirrored = mirror::sphere_frame(&grid_layout(&spheres[..]), &spheres);
                check_mirror(&mut both.grid, &spheres, &mirrored, &format!("{name}, {n}"));
            }
        }
    }

    #[test]
    #[ignore = "for a real GPU: near pairs take more rounds than lavapipe allows, see the head of this file"]
    #[should_panic(expected = "section 2")]
    fn the_mirror_notices_one_bit() {
        let mut both = Both::new(Checks::Off);
        let (spheres, _) = whole_scene(345, 12, 2);
        let mut mirrored = mirror::sphere_frame(&grid_layout(&spheres[..]), &spheres);
        mirrored.words.last_mut().unwrap()[2] ^= 1;
        check_mirror(&mut both.grid, &spheres, &mirrored, "one bit");
    }

    #[test]
    #[ignore = "for a real GPU: near pairs take more rounds than lavapipe allows, see the head of this file"]
    fn sessions_have_spheres_culled_by_a_gpu() {
        let name = gpu::name();
        let daemon = TestDaemon::start(&["--gpu", &name]);
        let (spheres, truth) = whole_scene(1_000, 20, 4);
        for engine in [EngineName::GpuGrid, EngineName::GpuBrute] {
            for encoding in [Encoding::Sparse, Encoding::List] {
                let builder = daemon.session().engine(EngineChoice::Only(engine));
                let mut session =
                    builder.encoding(EncodingChoice::Only(encoding)).connect().unwrap();
                for _ in 0..3 {
                    let mask = cull(&mut session, &spheres);
                    assert_eq!(mask.info().engine, engine);
                    assert_eq!(check_mask(&mask, encoding, &truth), Ok(()), "{engine}, {encoding}");
                }
            }
        }
        let mut session = daemon.connect();
        let mask = cull(&mut session, &spheres);
        assert_eq!(check_mask(&mask, mask.encoding(), &truth), Ok(()));
    }

    /// All spheres at one place: too crowded for the grid, so that all pairs answers.
    #[test]
    #[ignore = "for a real GPU: near pairs take more rounds than lavapipe allows, see the head of this file"]
    fn a_crowd_is_refused_by_the_grid_and_answered_by_the_cpu_alike() {
        let spheres: Vec<Sphere> = (0..600).map(|_| Sphere::new([1.0, 2.0, 3.0], 0.5)).collect();
        let mut reply = HeapReply::new();
        let expected =
            SphereEngines::new().cull(&spheres, &CullOptions::default(), &mut reply).unwrap();
        let mut both = Both::new(Checks::Off);
        for (engine, encoding) in WAYS {
            let report = both.cull(engine, &spheres, encoding, &mut reply).unwrap();
            assert_eq!(report.pair_count, expected.report.pair_count, "{engine}, {encoding}");
        }
    }

    /// A frame made to be slow: every pair is near, and takes all digits. The device has to outlive it.
    #[test]
    #[ignore = "for a real GPU: near pairs take more rounds than lavapipe allows, see the head of this file"]
    fn frames_of_near_pairs_alone_are_exact_and_leave_the_device() {
        const SPHERES: usize = 32_768;
        let mut engine = gpu::engine(EngineOptions::default());
        let (tiny, large) = (f32::from_bits(1), 2.0f32.powi(120));
        let hostile = [
            ("points in one place", Sphere::new([1.0, 2.0, 3.0], 0.0)),
            ("far from the origin", Sphere::new([2.0f32.powi(40), 0.0, 0.0], 1.0)),
            ("of all digits", Sphere::new([large, tiny, 0.0], large)),
        ];
        for (what, sphere) in hostile {
            let spheres = vec![sphere; SPHERES];
            let mut reply = HeapReply::new();
            // The first frame compiles the stages.
            for _ in 0..2 {
                let begun = Instant::now();
                let report = engine
                    .cull_objects(Objects::Spheres(&spheres), Encoding::Dense, &mut reply)
                    .unwrap();
                eprintln!("{SPHERES} spheres, {what}: {:?}", begun.elapsed());
                assert_eq!(report.pair_count, BoxCount::new(SPHERES as u32).pair_count(), "{what}");
            }
        }
    }
}
