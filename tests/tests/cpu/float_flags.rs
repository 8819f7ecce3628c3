//! Floating-point flags of threads: games and audio programs flush subnormals, others round downward, and a thread
//! inherits the flags of the one that starts it. The answer does not depend on the flags of the threads that call,
//! cull and write boxes.

use std::collections::BTreeSet;

use glam::{Affine3A, DVec3, Mat4, Quat, Vec3, Vec3A};
use pairmask_core::dispatch::SphereEngines;
use pairmask_core::oracle::modes;
use pairmask_core::plan::SceneStats;
use pairmask_core::precision::{BoxF16, ExpandScratch, Margin, Quantizer};
use pairmask_core::scene::Scene as PersistentScene;
use pairmask_core::update::{Placement, ToWorld, Transformed, world_box};
use pairmask_core::write::{CenterHalf, par_write_boxes, write_boxes};
use pairmask_lab::stress::{FloatFlags, MixedFlags, Rounding};
use pairmask_tests::conformance::mixed_flags;
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::Received;
use pairmask_tests::spheres;
use pairmaskd::scene::{Random, Scene, SceneName};
use rayon::ThreadPool;

/// Enough boxes for every CPU engine to use several tasks, and for a second thread to take part:
/// with few, the caller finishes before the other wakes, and no flags are mixed.
const BOXES: usize = 20_000;

/// A session in process that culls every frame.
fn fresh_answers() -> SessionBuilder {
    Session::builder().backend(Backend::InProcess).answer_repeats(false)
}

/// Boxes with edges of up to a fiftieth of `extent` in a cube of that extent.
fn boxes_within(extent: f32, n: usize, seed: u64) -> Vec<Aabb> {
    let mut random = Random::new(seed);
    let one = |_| {
        let min: [f32; 3] = std::array::from_fn(|_| extent * random.unit());
        let edges: [f32; 3] = std::array::from_fn(|_| 0.02 * extent * random.unit());
        Aabb { min, max: std::array::from_fn(|axis| min[axis] + edges[axis]) }
    };
    (0..n).map(one).collect()
}

/// Extents at which coordinates and edges are subnormal, or edges of boxes and of cells are about the
/// smallest normal number (there a thread that flushes has other cells next to the origin), or none.
const EXTENTS: [f32; 6] = [1e-42, 3e-38, 3e-37, 6e-37, 100.0, 1e30];

/// Culls with every CPU engine, with callers and pools of `flags`.
fn check(boxes: &[Aabb], flags: &[MixedFlags], pool: &ThreadPool) {
    let truth = oracle::truth(boxes);
    assert!(truth.pairs.len() > 1_000, "{} pairs", truth.pairs.len());
    let input = CullInput::boxes(boxes).threads(pool.current_num_threads());
    let mut reply = HeapReply::new();
    for mut engine in cpu_engines() {
        for flags in flags {
            flags
                .install(pool, || check_frame(engine.as_mut(), &input, &truth, &mut reply))
                .unwrap_or_else(|wrong| panic!("{}, {flags}: {wrong}", engine.name()));
        }
    }
}

/// A caller with one kind of flags and a pool with another.
fn mixed(caller: FloatFlags, pool: FloatFlags) -> MixedFlags {
    MixedFlags { caller, pool: [pool; 2], ..MixedFlags::default() }
}

#[test]
fn callers_and_pools_of_other_flags_lose_no_pair() {
    let (flushing, default) = (FloatFlags::FLUSHING, FloatFlags::DEFAULT);
    let flags = [mixed(flushing, default), mixed(default, flushing)];
    for extent in EXTENTS {
        check(&boxes_within(extent, BOXES, 1), &flags, &pool(2));
    }
    let all = Rounding::ALL.map(FloatFlags::rounding);
    let flags: Vec<_> =
        all.iter().flat_map(|&caller| all.map(|pool| mixed(caller, pool))).collect();
    check(&boxes_within(1000.0, BOXES, 2), &flags, &pool(2));
    let step = if tier::is_nightly() { 1 } else { 4 };
    let flags: Vec<_> = mixed_flags().into_iter().step_by(step).collect();
    check(Scene::new(SceneName::Mixed, BOXES, 3).boxes(), &flags, &pool(2));
}

#[test]
fn a_pool_that_a_flagged_thread_started_serves_plain_callers() {
    for extent in EXTENTS {
        let boxes = boxes_within(extent, BOXES, 4);
        let truth = oracle::truth(&boxes);
        for flags in [FloatFlags::FLUSHING, FloatFlags::rounding(Rounding::Down)] {
            // The first thread of the pool inherits the flags of this thread; the others too.
            let pool = flags.run(|| pool(2));
            let mut session = fresh_answers().threads(2).connect().unwrap();
            for engine in EngineName::CPU {
                let (options, mut reply) = (culled_by(engine), HeapReply::new());
                let asked = || CpuEngines::new().cull(&boxes, &options, &mut reply).unwrap();
                let answer = pool.install(|| FloatFlags::DEFAULT.run(asked));
                assert_eq!(answer.report.pair_count, truth.pairs.len() as u64, "{engine}, {flags}");
            }
            let mask = pool.install(|| FloatFlags::DEFAULT.run(|| session.answer(&boxes)));
            assert_eq!(mask.sorted(), truth.pairs, "{flags}");
        }
    }
}

#[test]
fn spheres_are_found_through_the_boxes_of_any_thread() {
    let (whole, truth) = spheres::whole_scene(3_000, 60, 5);
    let pool = pool(2);
    // Whole numbers times a power of two have the same pairs: at 2^-140 all of them are subnormal, at
    // 2^-127 the smaller ones.
    for exponent in [-140i32, -127, -126, 0, 90] {
        let unit = 2.0f64.powi(exponent);
        let scaled = |x: f32| (f64::from(x) * unit) as f32;
        let scene: Vec<Sphere> =
            whole.iter().map(|s| Sphere::new(s.center.map(scaled), scaled(s.radius))).collect();
        for engine in [EngineName::CpuGrid, EngineName::CpuSap] {
            let mut engines = SphereEngines::new();
            let mut reply = HeapReply::new();
            let options = CullOptions { threads: Some(2), ..culled_by(engine) };
            for flags in mixed_flags() {
                let answer = flags.install(&pool, || engines.cull(&scene, &options, &mut reply));
                let count = answer.unwrap().report.pair_count;
                assert_eq!(count, truth.pairs.len() as u64, "{engine}, {exponent}, {flags}");
            }
        }
        let mut session = fresh_answers().connect().unwrap();
        for flags in mixed_flags().iter().step_by(5) {
            let mask = flags.install(&pool, || {
                let mut frame = session.sphere_frame(scene.len()).unwrap();
                for (i, slot) in frame.spheres_mut().iter_mut().enumerate() {
                    flags.writers[i % flags.writers.len()].run(|| *slot = scene[i]);
                }
                frame.submit().unwrap().wait().unwrap()
            });
            let checked = spheres::check_mask(&mask, mask.encoding(), &truth);
            assert_eq!(checked, Ok(()), "{exponent}, {flags}");
        }
    }
}

fn hard_boxes() -> Vec<Aabb> {
    let mut random = Random::new(6);
    let mut boxes: Vec<Aabb> = EXTENTS.iter().flat_map(|e| boxes_within(*e, 60, 7)).collect();
    for sign in [1.0, -1.0] {
        for x in [0.0, 1e-45, 5e-39, f32::MIN_POSITIVE, 1e6 + 0.25, 65_504.0, f32::MAX] {
            let min = [sign * x, 1e-39, -3e-40];
            boxes.push(Aabb { min, max: min.map(|x| x + 1e-40 * (1.0 + random.unit())) });
        }
    }
    boxes.push(Aabb::EMPTY);
    boxes.push(Aabb { min: [3e-45; 3], max: [1e-45; 3] });
    boxes.push(Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] });
    boxes.push(Aabb { min: [f32::NAN; 3], max: [1.0; 3] });
    boxes
}

fn bits(boxes: &[Aabb]) -> Vec<u64> {
    bytemuck::cast_slice::<Aabb, u32>(boxes).iter().map(|x| u64::from(*x)).collect()
}

fn placements(boxes: &[Aabb]) -> Vec<Placement> {
    let mut random = Random::new(8);
    let of = |_| {
        let axis = Vec3::from_array(random.direction());
        let scale = [1e-38, 1e-3, 1.0, 1e5][random.below(4) as usize];
        Placement {
            translation: [random.unit(), -random.unit(), 0.3].map(|x| x * scale),
            rotation: Quat::from_axis_angle(axis, random.range(-3.0, 3.0)).to_array(),
            scale: [1.0, random.unit(), 1e-3],
        }
    };
    boxes.iter().map(of).collect()
}

/// A function that computes in floats on the calling thread, with its result as bits.
type EntryPoint = (&'static str, fn(&[Aabb]) -> Vec<u64>);

fn precisions(boxes: &[Aabb]) -> [Precision; 3] {
    let plain = Bounds::new(Vec3::splat(-77.7), Vec3::splat(123.4)).unwrap();
    let tiny = Bounds::around(&boxes[..50]);
    [Precision::Q16(plain), Precision::Q8(tiny), Precision::F16]
}

fn sent(precision: &Precision, boxes: &[Aabb]) -> Vec<u64> {
    let memory = NarrowMemory::write(precision, boxes);
    let mut scratch = ExpandScratch::default();
    bits(memory.boxes().expand(&mut scratch, false).as_f32().expect("of f32"))
}

fn matrices(boxes: &[Aabb]) -> Vec<Affine3A> {
    let of = |p: &Placement| {
        // Written as entries: glam would compute a matrix with this thread's flags.
        let [x, y, z, _] = p.rotation.map(|x| Vec3A::new(x, 0.25 + x, -x));
        Affine3A::from_cols(x, y, z, p.translation.into())
    };
    pairmask_core::floats::with_default(|| placements(boxes).iter().map(of).collect())
}

/// Min, max and origin of boxes in f64, near the origin and a thousand million units away from it, some
/// of them subnormal even there.
fn worlds(boxes: &[Aabb]) -> Vec<[DVec3; 3]> {
    let origins = [DVec3::splat(1e9), DVec3::splat(1e-310), DVec3::splat(-1e-39), DVec3::ZERO];
    let of = |b: &Aabb, origin: DVec3| {
        let by = DVec3::new(1e-17, 3e-312, 1e-46);
        let [min, max] = [b.min, b.max].map(|side| DVec3::from_array(side.map(f64::from)));
        [min + origin - by, max + origin + by, origin]
    };
    boxes.iter().flat_map(|b| origins.map(|origin| of(b, origin))).collect()
}

/// Every function of the library's API that computes in floats for a caller. A new one belongs here.
const ENTRY_POINTS: [EntryPoint; 23] = [
    ("Aabb::class", |boxes| boxes.iter().map(|b| b.class() as u64).collect()),
    ("Aabb::overlaps", |boxes| {
        let with_all = |a: &Aabb| boxes.iter().filter(|b| a.overlaps(b)).count() as u64;
        boxes.iter().map(with_all).collect()
    }),
    ("Bounds::around", |boxes| {
        let [all, few] = [boxes, &boxes[..50]].map(Bounds::around);
        let corners = [all.low(), all.high(), few.low(), few.high()];
        corners.as_flattened().iter().map(|x| u64::from(x.to_bits())).collect()
    }),
    ("Bounds::new", |_| {
        let is_ok = |low: f32, high: f32| Bounds::new(Vec3::splat(low), Vec3::splat(high)).is_ok();
        vec![u64::from(is_ok(1e-45, -1e-45)), u64::from(is_ok(2e-40, 1e-40))]
    }),
    ("Precision::write", |boxes| {
        precisions(boxes).iter().flat_map(|precision| sent(precision, boxes)).collect()
    }),
    ("Quantizer", |boxes| {
        let [Precision::Q16(bounds), ..] = precisions(boxes) else { return Vec::new() };
        let (q16, q8) = (Quantizer::q16_of(&bounds), Quantizer::q8_of(&bounds));
        let cells = |b: &Aabb| {
            let (wide, narrow) = (q16.q16(b), q8.q8(b));
            let wide = [wide.min, wide.max].map(|side| side.map(u64::from)).concat();
            [wide, [narrow.min, narrow.max].map(|side| side.map(u64::from)).concat()].concat()
        };
        let sizes = [q16.cell_size(), q8.cell_size()].concat();
        sizes.iter().map(|size| size.to_bits()).chain(boxes.iter().flat_map(cells)).collect()
    }),
    ("BoxF16", |boxes| {
        let halves = |b: &Aabb| [BoxF16::from(b).min, BoxF16::from(b).max].concat();
        boxes.iter().flat_map(halves).map(u64::from).collect()
    }),
    ("Aabb::outward_from_f64", |boxes| {
        let worlds = pairmask_core::floats::with_default(|| worlds(boxes));
        let outward = worlds.iter().map(|[min, max, o]| Aabb::outward_from_f64(*min, *max, *o));
        bits(&outward.collect::<Vec<Aabb>>())
    }),
    ("Margin::inflate", |boxes| {
        let margins = [0.0, 1e-45, 3e-40, 0.125, 1e30].map(|by| Margin::new(by).unwrap());
        let all = margins.iter().flat_map(|margin| boxes.iter().map(|b| margin.inflate(b)));
        bits(&all.collect::<Vec<Aabb>>())
    }),
    ("Margin::new", |_| {
        [-1e-45, -1e-39, 1e-45].map(|by| u64::from(Margin::new(by).is_ok())).to_vec()
    }),
    ("gap_limit", |boxes| {
        let margin = Margin::new(1e-40).unwrap();
        let widenings = precisions(boxes).map(|precision| precision.widening());
        let all = widenings.iter().chain([&Widening::Origin([1e-3; 3])]);
        let limits = |widening: &Widening| {
            let at = |ends: f64, starts: f64| {
                let own = widening.gap_limit(0, ends, starts);
                [own, margin.gap_limit(widening, 1, ends, starts)]
            };
            [at(1e-40, 3e-40), at(0.1, 0.7), at(1e6, 1e9)].concat()
        };
        all.flat_map(limits).map(f64::to_bits).collect()
    }),
    ("world_box", |boxes| {
        let placements = pairmask_core::floats::with_default(|| placements(boxes));
        let world = boxes.iter().zip(&placements).map(|(b, p)| world_box(b, p));
        bits(&world.collect::<Vec<Aabb>>())
    }),
    ("write_boxes of matrices", |boxes| {
        let matrices = matrices(boxes);
        let mut world = vec![Aabb::EMPTY; boxes.len()];
        write_boxes(&Transformed::new(boxes, &matrices), &mut world);
        bits(&world)
    }),
    ("par_write_boxes of matrices", |boxes| {
        let matrices: Vec<Mat4> = pairmask_core::floats::with_default(|| {
            matrices(boxes).iter().map(|m| (*m).into()).collect()
        });
        let mut world = vec![Aabb::EMPTY; boxes.len()];
        par_write_boxes(&Transformed::new(boxes, &matrices), &mut world);
        bits(&world)
    }),
    ("write_boxes", |boxes| {
        let mut around = vec![Aabb::EMPTY; boxes.len()];
        let columns = [0, 1, 2].map(|axis| boxes.iter().map(|b| b.min[axis]).collect::<Vec<_>>());
        let [x, y, z] = columns.each_ref().map(Vec::as_slice);
        write_boxes(&CenterHalf::columns([x, y, z], [z, x, y]), &mut around);
        bits(&around)
    }),
    ("par_write_boxes", |boxes| {
        let mut around = vec![Aabb::EMPTY; boxes.len()];
        let [min, max] = [|b: &Aabb| b.min, |b: &Aabb| b.max]
            .map(|corner| boxes.iter().map(corner).collect::<Vec<_>>());
        par_write_boxes(&CenterHalf::points(&min, &max), &mut around);
        bits(&around)
    }),
    ("ToWorld::world_matrix", |boxes| {
        /// A matrix that was computed earlier, on a thread of any flags.
        struct StoredMatrix(pairmask_core::update::WorldMatrix);
        impl ToWorld for StoredMatrix {
            fn world_matrix(&self) -> pairmask_core::update::WorldMatrix {
                self.0
            }
        }
        let placements = pairmask_core::floats::with_default(|| placements(boxes));
        let stored: Vec<StoredMatrix> =
            placements.iter().map(|p| StoredMatrix(p.world_matrix())).collect();
        let mut world = vec![Aabb::EMPTY; boxes.len()];
        write_boxes(&Transformed::new(boxes, &stored), &mut world);
        bits(&world)
    }),
    ("Sphere::bounds", |boxes| {
        let of = |b: &Aabb| Sphere::new(b.min, b.max[0]).bounds();
        bits(&boxes.iter().map(of).collect::<Vec<Aabb>>())
    }),
    ("Sphere::class", |boxes| {
        let radii = [-1e-45, -1e-39, -0.0, 0.0, 1e-45, -1.0];
        let of = |b: &Aabb| radii.map(|radius| Sphere::new(b.min, radius).class() as u64);
        boxes.iter().flat_map(of).collect()
    }),
    ("oracle of f64", |_| {
        let numbers = [5e-324, -5e-324, 0.0, -0.0, 1e-310, -1e-310, 1.0];
        let worlds: Vec<oracle::Faces> =
            numbers.iter().flat_map(|x| numbers.map(|y| [[*x; 3], [y; 3]])).collect();
        let truth = oracle::truth_of_faces(&worlds);
        let pairs = truth.pairs.iter().map(|[a, b]| u64::from(*a) << 32 | u64::from(*b));
        pairs.chain([u64::from(truth.census.empty)]).collect()
    }),
    ("Sphere::overlaps", |boxes| {
        let all: Vec<Sphere> = boxes.iter().map(|b| Sphere::new(b.min, b.max[1])).collect();
        let with_all = |a: &Sphere| all.iter().filter(|b| a.overlaps(b)).count() as u64;
        all.iter().map(with_all).collect()
    }),
    ("SceneStats::of", |boxes| {
        let stats = SceneStats::of(boxes, None);
        let floats = [stats.valid_share, stats.median_size, stats.large_size, stats.window_share];
        floats.iter().chain([&stats.elongation]).map(|x| u64::from(x.to_bits())).collect()
    }),
    ("oracle", |boxes| {
        let mut pairs = oracle::truth(boxes).pairs;
        for precision in precisions(boxes) {
            pairs.extend(modes::truth(boxes, &precision).pairs);
        }
        pairs.extend(modes::allowed_by_margin(boxes, 1e-39).may);
        let faces = |side: [f32; 3]| side.map(|x| f64::from_bits(u64::from(x.to_bits())));
        let worlds: Vec<oracle::Faces> = boxes.iter().map(|b| [b.min, b.max].map(faces)).collect();
        pairs.extend(modes::allowed_around_origin(&worlds, [0.0; 3]).may);
        pairs.iter().map(|[a, b]| u64::from(*a) << 32 | u64::from(*b)).collect()
    }),
];

#[test]
fn every_entry_point_gives_the_same_with_any_flags() {
    let boxes = hard_boxes();
    for (name, entry_point) in ENTRY_POINTS {
        let expected = entry_point(&boxes);
        assert!(!expected.is_empty(), "{name}");
        for flags in FloatFlags::all() {
            assert!(flags.run(|| entry_point(&boxes)) == expected, "{name}, {flags}");
        }
    }
    let refused = FloatFlags::FLUSHING.run(|| Margin::new(-1e-45).is_err());
    assert!(refused, "a margin below 0");
}

#[test]
fn replies_are_the_same_bytes_with_any_flags() {
    let pool = pool(2);
    let boxes = [boxes_within(3e-38, 2_100, 9), boxes_within(100.0, 2_100, 10)].concat();
    for mut engine in cpu_engines() {
        let mut expected: Option<Vec<u32>> = None;
        for flags in mixed_flags() {
            let mut reply = HeapReply::new();
            flags
                .install(&pool, || engine.cull(&CullInput::boxes(&boxes).threads(2), &mut reply))
                .unwrap();
            let words = reply.words().to_vec();
            assert!(*expected.get_or_insert_with(|| words.clone()) == words, "{flags}");
        }
    }
}

#[test]
fn threads_of_all_flags_write_one_frame() {
    let pool = pool(2);
    let scenes = [boxes_within(100.0, 700, 11), boxes_within(3e-38, 700, 12), hard_boxes()];
    for boxes in &scenes {
        let must = oracle::truth(boxes).pairs;
        let bounds = Bounds::around(boxes);
        for precision in [Precision::Q16(bounds), Precision::Q8(bounds), Precision::F16] {
            let may = modes::truth(boxes, &precision).pairs;
            for flags in mixed_flags() {
                let mut session = fresh_answers().connect().unwrap();
                let mask = flags.install(&pool, || {
                    let mut frame = session.narrow_frame(boxes.len(), precision).unwrap();
                    for (i, b) in boxes.iter().enumerate() {
                        flags.writers[i % flags.writers.len()].run(|| frame.set(i, b));
                    }
                    frame.submit().unwrap().wait().unwrap()
                });
                let got = mask.sorted();
                assert!(modes::missed(&got, &must).is_empty(), "{precision:?}, {flags}");
                assert!(got == may, "{precision:?}, {flags}");
            }
        }
    }
}

/// Edits under one kind of flags after another, few boxes at a time and many.
#[test]
fn scenes_reported_under_changing_flags_add_up_to_the_truth() {
    let pool = pool(2);
    let flags = mixed_flags();
    for extent in EXTENTS {
        let mut boxes = boxes_within(extent, BOXES / 4, 5);
        let mut scene = PersistentScene::new(SceneOptions::default());
        let mut reported = BTreeSet::new();
        for (frame, flags) in (0u64..).zip(&flags) {
            let share = [1, 97, 3, 61][frame as usize % 4];
            let moved = boxes_within(extent, boxes.len(), 100 + frame);
            let indices: Vec<u32> =
                (0..boxes.len() as u32).filter(|i| frame == 0 || i % share == 0).collect();
            let set: Vec<Aabb> = indices.iter().map(|i| moved[*i as usize]).collect();
            for (index, b) in indices.iter().zip(&set) {
                boxes[*index as usize] = *b;
            }
            let steps = [sets(&indices, &set)];
            flags.install(&pool, || {
                scene.edit(Edit { steps: &steps }, Report::Changes).unwrap();
                scene.acknowledge();
            });
            Received::from(scene.reported()).teach(&mut reported);
        }
        let truth = oracle::truth(&boxes).pairs;
        assert!(truth.len() > 100, "{} pairs", truth.len());
        assert!(reported.iter().copied().eq(truth), "extent {extent:e}");
    }
}
