//! The CPU engines against each other, pair by pair: every scene, every thread count.
//!
//! The oracle compares all boxes with all and is too slow for large scenes. There the engines, which
//! share hardly any code, are compared with each other. The small sizes run with every `cargo test`,
//! the large ones, in minutes, by
//!
//! ```text
//! cargo test --release -p pairmask-tests --test cpu -- --ignored engines_agree
//! ```

use std::thread;
use std::time::Duration;

use pairmask_tests::golden;
use pairmask_tests::oracle::pair_set_hash;
use pairmask_tests::prelude::*;
use pairmaskd::scene::{Scene, SceneName};
use rayon::{ThreadPool, ThreadPoolBuilder};

fn pools() -> Vec<ThreadPool> {
    [1, 2, 4].map(pool).into()
}

/// The pairs by the pool that the calling thread is in.
fn pairs(engine: &mut dyn Engine, boxes: &[Aabb]) -> Vec<Pair> {
    let mut reply = HeapReply::new();
    let report = engine
        .cull(&CullInput::boxes(boxes).threads(rayon::current_num_threads()), &mut reply)
        .expect("memory");
    let n = BoxCount::of_len(boxes.len()).expect("indices are u32");
    let mask = MaskView::new(n, &report.shape, reply.words()).expect("a good mask");
    mask.verify().expect("a good mask");
    let mut pairs = mask.to_vec();
    assert_eq!(report.pair_count, pairs.len() as u64);
    pairs.sort_unstable();
    pairs
}

/// Asserts that all engines find one set of pairs on all thread counts; returns it.
fn agreed(
    name: SceneName,
    boxes: &[Aabb],
    engines: &mut [Box<dyn Engine>],
    pools: &[ThreadPool],
) -> Vec<Pair> {
    let mut expected: Option<Vec<Pair>> = None;
    for engine in engines {
        for pool in pools {
            let got = pool.install(|| pairs(engine.as_mut(), boxes));
            let expected = expected.get_or_insert_with(|| got.clone());
            check_pairs(&got, expected).unwrap_or_else(|e| {
                let (threads, n) = (pool.current_num_threads(), boxes.len());
                panic!("{name}, {n} boxes, {}, {threads} threads: {e}", engine.name())
            });
        }
    }
    expected.expect("an engine and a thread count")
}

#[test]
fn pair_sets_have_their_golden_hashes_on_every_engine_and_thread_count() {
    let (mut engines, pools) = (cpu_engines(), pools());
    let mut moved = 0u64;
    for (name, mut scene, golden) in golden::scenes() {
        let mut hash =
            |scene: &Scene| pair_set_hash(&agreed(name, scene.boxes(), &mut engines, &pools));
        let found = hash(&scene);
        assert_eq!(found, golden, "{name}: {found:#018x}");
        scene.step();
        moved = moved.rotate_left(7) ^ hash(&scene);
    }
    assert_eq!(moved, 0x8a40_3bb3_4f0d_40b3, "all scenes after a step: {moved:#018x}");
}

/// Frame after frame in one pool, whose threads sleep, or still look for work, when the next one begins.
#[test]
fn frames_of_a_team_after_pauses_have_the_golden_pairs() {
    let golden = golden::scenes();
    let work = move || {
        let mut engines = cpu_engines();
        for frame in 0..golden.len() * engines.len() {
            let (name, scene, hash) = &golden[frame / engines.len()];
            let slot = frame % engines.len();
            let engine = engines[slot].as_mut();
            let found = pair_set_hash(&pairs(engine, scene.boxes()));
            assert_eq!(found, *hash, "{name}, frame {frame}");
            thread::sleep(Duration::from_micros(frame as u64 % 3 * 60));
        }
    };
    let member = move || {
        let pool = ThreadPoolBuilder::new().num_threads(4).use_current_thread().build();
        let _pool = pool.expect("a pool");
        work();
    };
    thread::spawn(member).join().expect("the golden pairs");
}

/// Scenes of a size, those with quadratic numbers of pairs smaller.
fn agree(engines: &mut [Box<dyn Engine>], n: usize, quadratic: usize) {
    for name in SceneName::ALL {
        let n = if name.is_quadratic() { quadratic } else { n };
        let mut scene = Scene::new(name, n, 5);
        for _ in 0..2 {
            agreed(name, scene.boxes(), engines, &pools());
            scene.step();
        }
    }
}

#[test]
fn engines_agree_on_ten_thousand_boxes() {
    agree(&mut cpu_engines(), 10_000, 1_000);
}

#[test]
#[ignore = "minutes: run in release, see the head of this file"]
fn engines_agree_on_a_hundred_thousand_and_a_million_boxes() {
    agree(&mut cpu_engines(), 100_000, 1_000);
    // A million boxes have 5·10^11 pairs: `cpu-brute` runs only up to a hundred thousand boxes.
    let mut engines =
        [EngineName::CpuGrid, EngineName::CpuSap, EngineName::CpuTree].map(best_engine);
    agree(&mut engines, 1_000_000, 1_000);
}

/// Bytes a box that an engine may keep beside the boxes and the reply.
const SCRATCH_BYTES_A_BOX: usize = 100;

#[test]
fn the_grid_keeps_at_most_100_bytes_a_box() {
    let n = 100_000;
    // More threads have more tasks, each with some KiB that do not grow with the boxes.
    let pools = &pools()[..2];
    for name in SceneName::ALL.into_iter().filter(|name| !name.is_quadratic()) {
        let mut grid = best_engine(EngineName::CpuGrid);
        let mut scene = Scene::new(name, n, 5);
        for pool in pools.iter().flat_map(|pool| [pool; 3]) {
            pool.install(|| pairs(grid.as_mut(), scene.boxes()));
            scene.step();
        }
        let bytes = grid.scratch_bytes();
        println!("{name}: {:.1} bytes a box", bytes as f64 / n as f64);
        assert!(bytes >= 60 * n, "{name}: keys, records and order alone are more than {bytes}");
        assert!(bytes <= SCRATCH_BYTES_A_BOX * n, "{name}: {bytes} bytes for {n} boxes");
    }
}
