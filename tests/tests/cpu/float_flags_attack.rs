//! Thousands of small scenes under mixed floating-point flags: caller × pool × writers, all CPU
//! engines, all precision modes, spheres, the update stage. No pair is missed, and no extra pair is
//! farther apart than its mode states.
//!
//! `stress` does the same with harder scenes and on GPUs. Here no thread waits for another to wake, so
//! that a minute has hundreds of thousands of answers. The test runs for [`attack_time`] and prints their
//! number.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use glam::{DVec3, Quat, Vec3};
use pairmask_core::dispatch::{CullOptions, SphereEngines};
use pairmask_core::engine::{
    BruteForce, CullInput, CullReport, Engine, EngineChoice, Grid, HeapReply, SweepAndPrune,
};
use pairmask_core::oracle::modes::Allowed;
use pairmask_core::oracle::naive_decoder::decode;
use pairmask_core::oracle::{Faces, Pair, modes};
use pairmask_core::precision::{Margin, Widening};
use pairmask_core::sphere::Sphere;
use pairmask_core::update::{Placement, update_boxes, world_box};
use pairmask_core::{Aabb, Bounds, Encoding, EngineName, Precision, oracle};
use pairmask_lab::stress::{MixedFlags, compare};
use pairmask_tests::{attack_time, spheres};
use pairmaskd::precision::as_sent;
use pairmaskd::scene::Random;
use rayon::prelude::*;

/// Scenes between two changes of the pool's flags.
const ROUND: u64 = 512;

/// One scene in this many has rows for several threads, which take tasks from each other.
const LARGE_ONE_IN: u64 = 128;

/// The engines of one thread.
struct Engines {
    boxes: [Box<dyn Engine>; 3],
    spheres: SphereEngines,
    reply: HeapReply,
}

impl Engines {
    fn new() -> Self {
        Self {
            boxes: [
                Box::new(BruteForce::new()),
                Box::new(SweepAndPrune::new()),
                Box::new(Grid::new()),
            ],
            spheres: SphereEngines::new(),
            reply: HeapReply::new(),
        }
    }

    fn pairs(&mut self, engine: usize, boxes: &[Aabb], encoding: Encoding) -> Vec<Pair> {
        let report = self.boxes[engine]
            .cull(&CullInput::boxes(boxes).encoding(encoding).threads(3), &mut self.reply)
            .unwrap();
        self.decoded(&report, boxes.len())
    }

    fn decoded(&self, report: &CullReport, n: usize) -> Vec<Pair> {
        let pairs = decode(self.reply.words(), &report.shape, n as u32).unwrap();
        assert_eq!(report.pair_count, pairs.len() as u64);
        pairs
    }
}

/// A scene of any magnitude, at which edges, coordinates or cells may be subnormal.
fn scene(random: &mut Random) -> Vec<Aabb> {
    let n = match random.below(LARGE_ONE_IN) {
        0 => 2_050 + random.below(700),
        _ => 2 + random.below(64),
    };
    let extent = [1e-42, 1e-39, 3e-38, 4e-37, 1e-3, 100.0, 3e5, 1e30][random.below(8) as usize];
    let share = if n > 1_000 { 0.1 } else { 0.4 };
    let far = [0.0, 0.0, 50.0 * extent, -1e3 * extent][random.below(4) as usize];
    let one = |_| {
        let min: [f32; 3] = std::array::from_fn(|_| far + extent * (random.unit() - 0.5));
        let max = min.map(|x| x + share * extent * random.unit());
        Aabb { min, max }
    };
    (0..n).map(one).collect()
}

/// Checks all answers to a scene; returns their number.
fn attack(engines: &mut Engines, seed: u64) -> u64 {
    let random = &mut Random::new(seed);
    // The scene is made with the default flags, so that it depends only on its seed.
    let boxes = pairmask_core::floats::with_default(|| scene(random));
    let flags = MixedFlags::of_seed(seed);
    let encoding = Encoding::ALL[random.below(3) as usize];
    let truth = flags.caller.run(|| oracle::truth(&boxes)).pairs;
    for engine in 0..3 {
        let got = flags.caller.run(|| engines.pairs(engine, &boxes, encoding));
        let found = compare(&got, &truth, &truth);
        assert_eq!(found, Ok(()), "seed {seed}, {flags}, {}", engines.boxes[engine].name());
    }
    let small = &boxes[..boxes.len().min(300)];
    let modes = modes_of(engines, seed, small, &flags, random);
    spheres_of(engines, seed, &flags, random);
    updates_of(seed, small, &flags, random);
    3 + modes + 2 + 1
}

/// Sends boxes in every mode, written by threads of different flags.
fn modes_of(
    engines: &mut Engines,
    seed: u64,
    boxes: &[Aabb],
    flags: &MixedFlags,
    random: &mut Random,
) -> u64 {
    let exact = |b: &Aabb| [b.min, b.max].map(|side| side.map(f64::from));
    let faces: Vec<Faces> =
        pairmask_core::floats::with_default(|| boxes.iter().map(exact).collect());
    let around = flags.caller.run(|| Bounds::around(boxes));
    let narrow = [Precision::Q16(around), Precision::Q8(around), Precision::F16];
    for precision in narrow {
        let sent = flags.written(boxes.len(), |i| as_sent(&precision, &boxes[i..=i])[0]);
        let allowed = flags.caller.run(|| modes::allowed(boxes, &precision));
        let widening = precision.widening();
        let stated = |axis, ends, starts| widening.gap_limit(axis, ends, starts);
        check_mode(engines, seed, &faces, &sent, &allowed, flags, &stated);
    }
    let margin = boxes[0].max[0].to_bits().saturating_sub(boxes[0].min[0].to_bits()) & 0x7f_ffff;
    let margin = [0.0, f32::from_bits(margin), 0.01][random.below(3) as usize];
    let margin = Margin::new(margin).unwrap();
    let sent = flags.written(boxes.len(), |i| margin.inflate(&boxes[i]));
    let allowed = flags.caller.run(|| modes::allowed_by_margin(boxes, margin.get()));
    let stated = |axis, ends, starts| margin.gap_limit(&Widening::None, axis, ends, starts);
    check_mode(engines, seed, &faces, &sent, &allowed, flags, &stated);

    let far = [0.0, 1e9, 1e-20][random.below(3) as usize];
    let origin = [far, -far, 0.0];
    let away = |b: &Faces| b.map(|side| std::array::from_fn(|axis| side[axis] + origin[axis]));
    let world: Vec<Faces> =
        pairmask_core::floats::with_default(|| faces.iter().map(away).collect());
    let sent = flags.written(world.len(), |i| {
        let [min, max] = world[i].map(DVec3::from_array);
        Aabb::outward_from_f64(min, max, DVec3::from_array(origin))
    });
    let allowed = flags.caller.run(|| modes::allowed_around_origin(&world, origin));
    let widening = Widening::Origin(origin);
    let stated = |axis, ends, starts| widening.gap_limit(axis, ends, starts);
    check_mode(engines, seed, &world, &sent, &allowed, flags, &stated);
    5
}

fn check_mode(
    engines: &mut Engines,
    seed: u64,
    faces: &[Faces],
    sent: &[Aabb],
    allowed: &Allowed,
    flags: &MixedFlags,
    stated: &dyn Fn(usize, f64, f64) -> f64,
) {
    let engine = (seed % 3) as usize;
    let got = flags.caller.run(|| engines.pairs(engine, sent, Encoding::Sparse));
    let must = &allowed.must.pairs;
    assert_eq!(compare(&got, must, &allowed.may), Ok(()), "seed {seed}, {flags}");
    pairmask_core::floats::with_default(|| {
        for (i, j) in got.iter().filter(|pair| must.binary_search(pair).is_err()) {
            let (a, b) = (&faces[*i as usize], &faces[*j as usize]);
            for axis in 0..3 {
                let (ends, starts) = (a[1][axis].min(b[1][axis]), a[0][axis].max(b[0][axis]));
                let limit = stated(axis, ends, starts);
                let is_within = starts - ends <= limit;
                assert!(is_within, "seed {seed}: {a:?} and {b:?}, {limit:e} stated");
            }
        }
    });
}

/// Whole spheres times a power of two, by all pairs and through a box engine.
fn spheres_of(engines: &mut Engines, seed: u64, flags: &MixedFlags, random: &mut Random) {
    let exponent = [-140, -130, -127, 0, 90][random.below(5) as usize];
    let (scene, truth) = pairmask_core::floats::with_default(|| {
        let (whole, truth) = spheres::whole_scene(30 + random.below(30) as usize, 14, seed);
        let scaled = |x: f32| (f64::from(x) * 2.0f64.powi(exponent)) as f32;
        let scaled = |s: &Sphere| Sphere::new(s.center.map(scaled), scaled(s.radius));
        (whole.iter().map(scaled).collect::<Vec<Sphere>>(), truth)
    });
    let through = [EngineName::CpuSap, EngineName::CpuGrid][random.below(2) as usize];
    for engine in [EngineName::CpuBrute, through] {
        let options = CullOptions { engine: EngineChoice::Only(engine), ..CullOptions::default() };
        let answer =
            flags.caller.run(|| engines.spheres.cull(&scene, &options, &mut engines.reply));
        let got = engines.decoded(&answer.unwrap().report, scene.len());
        let found = compare(&got, &truth.pairs, &truth.pairs);
        assert_eq!(found, Ok(()), "seed {seed}, {flags}, spheres by {engine}");
    }
}

/// World boxes by threads of all flags against those of a thread of default flags.
fn updates_of(seed: u64, locals: &[Aabb], flags: &MixedFlags, random: &mut Random) {
    let (placements, expected) = pairmask_core::floats::with_default(|| {
        let axis = Vec3::from_array(random.direction());
        let turn = Quat::from_axis_angle(axis, random.range(-3.0, 3.0));
        let by = |b: &Aabb| Placement::rigid(Vec3::from_array(b.max) * 0.3, turn);
        let placements: Vec<Placement> = locals.iter().map(by).collect();
        let mut expected = vec![Aabb::EMPTY; locals.len()];
        update_boxes(locals, &placements, &mut expected).unwrap();
        (placements, expected)
    });
    let alone = flags.written(locals.len(), |i| world_box(&locals[i], &placements[i]));
    let bytes = bytemuck::cast_slice::<Aabb, u8>;
    assert!(bytes(&alone) == bytes(&expected), "seed {seed}, {flags}: world boxes");
}

#[test]
fn small_scenes_under_mixed_flags_have_all_their_pairs() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    let (start, time) = (Instant::now(), attack_time());
    let (answers, mut first) = (AtomicU64::new(0), 0);
    loop {
        let of_pool = MixedFlags::of_seed(first ^ 0xff);
        pool.broadcast(|thread| of_pool.writers[thread.index()].set());
        pool.install(|| {
            (first..first + ROUND).into_par_iter().for_each_init(Engines::new, |engines, seed| {
                answers.fetch_add(attack(engines, seed), Ordering::Relaxed);
            });
        });
        first += ROUND;
        if start.elapsed() >= time {
            break;
        }
    }
    println!("{} answers to {first} scenes, none wrong", answers.into_inner());
}
