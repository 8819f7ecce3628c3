//! Spheres on the GPU: exact against rational arithmetic, and byte by byte against the mirror.
//!
//! Those that are ignored are for a real GPU, until the daemon uses these stages (daemon/GPU.md, "Spheres"):
//! `PAIRMASK_TEST_GPU=auto cargo test -p pairmask-tests --test gpu_spheres -- --ignored`.
#![allow(clippy::unwrap_used)]

use pairmask_core::dispatch::{CullOptions, SphereEngines};
use pairmask_core::engine::{CullError, CullReport, HeapReply, ReplyBuffer};
use pairmask_core::mask::MaskShape;
use pairmask_core::oracle::Truth;
use pairmask_core::oracle::check::check_reply;
use pairmask_core::sphere::SphereAllPairs;
use pairmask_core::{
    BoxCount, Encoding, EncodingChoice, EngineChoice, EngineName, Sphere, engine::CullInput,
};
use pairmask_lab::study::spheres::oracle::overlap;
use pairmask_shaders::mirror::sphere_filter::{Arithmetic, LESS, Verdict, verdict};
use pairmask_shaders::mirror::{self, Mirrored, sphere_bounds, sphere_exact};
use pairmask_tests::daemon::TestDaemon;
use pairmask_tests::gpu::{self, open};
use pairmask_tests::spheres::{check_mask, cull, hard_pairs, hard_scene, truth, whole_scene};
use pairmaskd::execute::gpu::{
    AllPairs, AllPairsOptions, Checks, Grid, GridOptions, HostImport, Tuning, grid_layout,
};

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");

/// Both engines, as one.
struct Both {
    all_pairs: AllPairs,
    grid: Grid,
}

impl Both {
    fn new(checks: Checks) -> Self {
        let gpu = open(HostImport::IfPossible);
        let all_pairs = AllPairsOptions { checks, ..AllPairsOptions::default() };
        // What no stage wrote must not show.
        let grid = GridOptions { checks, poison: Some(0xa5a5_a5a5), ..GridOptions::default() };
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
            EngineName::GpuGrid => self.grid.cull_spheres(spheres, encoding, reply),
            _ => self.all_pairs.cull_spheres(spheres, encoding, reply),
        }
    }

    /// Every engine in every encoding, twice, the same bytes each time.
    fn check(&mut self, spheres: &[Sphere], truth: &Truth, what: &str) {
        for (engine, encoding) in WAYS {
            let what = format!("{what}, {} spheres, {engine}, {encoding}", spheres.len());
            let mut words = Vec::new();
            for _ in 0..2 {
                let mut reply = HeapReply::new();
                let report = self.cull(engine, spheres, encoding, &mut reply).unwrap();
                let n = spheres.len() as u32;
                let checked = check_reply(reply.words(), &report, n, encoding, truth);
                assert_eq!(checked, Ok(()), "{what}");
                words.push(sections(&report.shape, &reply));
            }
            assert!(words[0] == words[1], "{what}: other bytes");
        }
    }
}

const WAYS: [(EngineName, Encoding); 5] = [
    (EngineName::GpuBrute, Encoding::Dense),
    (EngineName::GpuBrute, Encoding::Sparse),
    (EngineName::GpuBrute, Encoding::List),
    (EngineName::GpuGrid, Encoding::Sparse),
    (EngineName::GpuGrid, Encoding::List),
];

/// The words of a mask, without what lies between its sections.
fn sections(shape: &MaskShape, reply: &HeapReply) -> Vec<u32> {
    let words = |span: pairmask_core::mask::Span| span.of(reply.words()).unwrap().to_vec();
    shape.spans().flat_map(words).collect()
}

#[test]
#[ignore = "right on an H200, not on lavapipe: the daemon culls spheres on cores (GPU.md)"]
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
#[ignore = "right on an H200, not on lavapipe: the daemon culls spheres on cores (GPU.md)"]
fn larger_scenes_in_which_many_touch_are_exact() {
    let mut both = Both::new(Checks::Off);
    for (n, side) in [(1_234, 20), (4_097, 40)] {
        let (spheres, truth) = whole_scene(n, side, 3);
        both.check(&spheres, &truth, "whole");
    }
}

/// Scenes at every scale, from subnormal numbers to the largest, with touching spheres.
#[test]
#[ignore = "right on an H200, not on lavapipe: the daemon culls spheres on cores (GPU.md)"]
fn scenes_of_every_scale_are_exact() {
    let mut both = Both::new(Checks::Off);
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
#[ignore = "right on an H200, not on lavapipe: the daemon culls spheres on cores (GPU.md)"]
fn every_tile_shape_is_exact() {
    let spheres = hard_scene(333, 9);
    let truth = truth(&spheres);
    for tuning in Tuning::all() {
        let options = AllPairsOptions { tuning: Some(tuning), ..AllPairsOptions::default() };
        let mut engine = gpu::engine(options);
        for encoding in [Encoding::Dense, Encoding::Sparse] {
            let mut reply = HeapReply::new();
            let report = engine.cull_spheres(&spheres, encoding, &mut reply).unwrap();
            let checked = check_reply(reply.words(), &report, 333, encoding, &truth);
            assert_eq!(checked, Ok(()), "{tuning:?}, {encoding}");
        }
    }
}

/// The CPU is exact; here every pair of a larger hard scene is held to it.
#[test]
#[ignore = "right on an H200, not on lavapipe: the daemon culls spheres on cores (GPU.md)"]
fn large_hard_scenes_have_the_pairs_of_the_cpu() {
    let mut gpu = gpu::engine(AllPairsOptions::default());
    let mut cpu = SphereAllPairs::new();
    let spheres = hard_scene(3_001, 77);
    let mut reply = HeapReply::new();
    let input = CullInput::spheres(&spheres).encoding(Encoding::Dense);
    let expected = cpu.cull(&input, &mut reply).unwrap();
    let expected_words = sections(&expected.shape, &reply);
    let report = gpu.cull_spheres(&spheres, Encoding::Dense, &mut reply).unwrap();
    assert_eq!((report.pair_count, report.census), (expected.pair_count, expected.census));
    assert!(sections(&report.shape, &reply) == expected_words);
}

fn check_mirror(grid: &mut Grid, spheres: &[Sphere], mirrored: &Mirrored, what: &str) {
    let mut reply = HeapReply::new();
    let report = grid.cull_spheres(spheres, Encoding::Sparse, &mut reply).unwrap();
    let MaskShape::Sparse { rows, blocks, bits, order } = report.shape else { panic!("{what}") };
    assert!(order.unwrap().of(reply.words()) == Some(&mirrored.order[..]), "{what}: order");
    for (section, place) in [rows, blocks, bits].into_iter().zip(0..) {
        let expected: Vec<u32> = mirrored.words.iter().map(|word| word[place]).collect();
        assert!(section.of(reply.words()) == Some(&expected[..]), "{what}: section {place}");
    }
    let n = BoxCount::new(spheres.len() as u32);
    assert_eq!(n.pair_count() - report.skipped.pairs, mirrored.compared, "{what}: tests");
    let report = grid.cull_spheres(spheres, Encoding::List, &mut reply).unwrap();
    let MaskShape::List { pairs } = report.shape else { panic!("{what}: no list") };
    assert!(pairs.of(reply.words()) == Some(mirrored.pairs.as_flattened()), "{what}: pairs");
}

#[test]
#[ignore = "right on an H200, not on lavapipe: the daemon culls spheres on cores (GPU.md)"]
fn the_grid_has_the_bytes_of_its_mirror() {
    let mut both = Both::new(Checks::Off);
    for n in [2, 33, 345, 1_234] {
        for (name, spheres) in [("hard", hard_scene(n, 21)), ("whole", whole_scene(n, 18, 2).0)] {
            let mirrored = mirror::sphere_frame(&grid_layout(&spheres[..]), &spheres);
            check_mirror(&mut both.grid, &spheres, &mirrored, &format!("{name}, {n}"));
        }
    }
}

#[test]
#[ignore = "right on an H200, not on lavapipe: the daemon culls spheres on cores (GPU.md)"]
#[should_panic(expected = "section 2")]
fn the_mirror_notices_one_bit() {
    let mut both = Both::new(Checks::Off);
    let (spheres, _) = whole_scene(345, 12, 2);
    let mut mirrored = mirror::sphere_frame(&grid_layout(&spheres[..]), &spheres);
    mirrored.words.last_mut().unwrap()[2] ^= 1;
    check_mirror(&mut both.grid, &spheres, &mirrored, "one bit");
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

#[test]
#[ignore = "right on an H200, not on lavapipe: the daemon culls spheres on cores (GPU.md)"]
fn sessions_have_spheres_culled_by_a_gpu() {
    let name = gpu::name();
    let daemon = TestDaemon::start(DAEMON, &["--gpu", &name]);
    let (spheres, truth) = whole_scene(1_000, 20, 4);
    for engine in [EngineName::GpuGrid, EngineName::GpuBrute] {
        for encoding in [Encoding::Sparse, Encoding::List] {
            let builder = daemon.session().engine(EngineChoice::Only(engine));
            let mut session = builder.encoding(EncodingChoice::Only(encoding)).connect().unwrap();
            for _ in 0..3 {
                let mask = cull(&mut session, &spheres);
                assert_eq!(mask.info().engine, engine);
                assert_eq!(check_mask(&mask, encoding, &truth), Ok(()), "{engine}, {encoding}");
            }
        }
    }
    let mut session = daemon.session().connect().unwrap();
    let mask = cull(&mut session, &spheres);
    assert_eq!(check_mask(&mask, mask.encoding(), &truth), Ok(()));
}

/// All spheres at one place: too crowded for the grid, so that all pairs answers.
#[test]
#[ignore = "right on an H200, not on lavapipe: the daemon culls spheres on cores (GPU.md)"]
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
