//! Casts into a scene beside other libraries: median ms of a batch of rays (the closest box of each), and of points (the
//! 8 nearest boxes of each), everything from the caller's rays to the last hit looked at.
//!
//! Trees are built before; what that takes stands in a row of its own. All contenders have two threads or as many as
//! `--threads` says, and take turns. Those that find other hits than the session in process are marked: parry decides in
//! f32.

use std::error::Error;
use std::hint::black_box;
use std::thread;
use std::time::{Duration, Instant};

use clap::Parser;
use pairmask::cast::{Hits, Ray};
use pairmask::{HitAnswer, SceneOptions};
use pairmask_tests::measure::{self, percentile};
use pairmask_tests::prelude::*;
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::scene::{Random, Scene, SceneName};
use pairmaskd::spawn::PrivateDaemon;
use parry3d::bounding_volume::Aabb as ParryBox;
use parry3d::math::Vector;
use parry3d::partitioning::{Bvh, BvhBuildStrategy};
use parry3d::query::RayCast;
use rayon::ThreadPool;
use rayon::prelude::*;
use rstar::RTree;
use rstar::primitives::{GeomWithData, Rectangle};
use serde_json::json;

const WARM_UP: usize = 2;
/// Rays that a thread of another library has at a time.
const CHUNK: usize = 64;
const NEAREST: u32 = 8;
/// Between two turns: the threads of a pool that was at work look for more of it for a while, on all cores. A daemon's
/// threads that share those with them took up to a ms longer.
const PAUSE: Duration = Duration::from_millis(3);

/// Casts into a scene beside other libraries.
#[derive(Parser)]
struct Options {
    #[arg(long, value_delimiter = ',', default_value = "uniform,pile")]
    scene: Vec<SceneName>,
    #[arg(long, default_value_t = 1_000_000)]
    n: usize,
    #[arg(long, default_value_t = 10_000)]
    queries: usize,
    #[arg(long, default_value_t = 11)]
    rounds: usize,
    #[arg(long, default_value_t = 2)]
    threads: usize,
    /// Percent of the boxes that a session sets before each batch, to where they are: the scene looks for them anew
    #[arg(long, default_value_t = 0)]
    set: usize,
    /// A GPU whose video memory keeps the scene of one more contender
    #[arg(long, default_value_t = GpuChoice::None)]
    gpu: GpuChoice,
    #[arg(long)]
    json: bool,
    /// What cargo passes to every bench
    #[arg(long, hide = true)]
    bench: bool,
}

/// Answers a batch: how many ms that took, and how many hits there are.
type Run<'a> = Box<dyn FnMut() -> Result<(f64, usize), Box<dyn Error>> + 'a>;

fn timed(
    run: impl FnOnce() -> Result<usize, Box<dyn Error>>,
) -> Result<(f64, usize), Box<dyn Error>> {
    let begin = Instant::now();
    let hits = run()?;
    Ok((millis(begin), hits))
}

fn millis(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

fn looked_at(answer: &HitAnswer) -> usize {
    for hit in answer.hits() {
        black_box(hit.distance);
    }
    answer.hits().len()
}

/// Each contender's batches, in turns.
fn take_turns(
    title: &[(&str, String)],
    contenders: Vec<(&str, Run<'_>)>,
    options: &Options,
) -> Result<(), Box<dyn Error>> {
    let (names, mut runs): (Vec<_>, Vec<_>) = contenders.into_iter().unzip();
    let mut times = vec![Vec::new(); names.len()];
    let mut counts = vec![0; names.len()];
    for round in 0..WARM_UP + options.rounds {
        for turn in 0..runs.len() {
            let who = (round + turn) % runs.len();
            thread::sleep(PAUSE);
            let (ms, hits) = runs[who]()?;
            counts[who] = hits;
            if round >= WARM_UP {
                times[who].push(ms);
            }
        }
    }
    let of = |who: usize, share: f64| percentile(&times[who], share);
    let is_peer = |who: &usize| !names[*who].starts_with("pairmask");
    let best = (0..names.len()).filter(is_peer).map(|who| of(who, 0.5)).fold(f64::MAX, f64::min);
    for who in 0..names.len() {
        let mut row = json!({
            "contender": names[who], "n": options.n, "queries": options.queries,
            "ms": of(who, 0.5), "least_ms": of(who, 0.0), "most_ms": of(who, 1.0),
            "to_best_peer": of(who, 0.5) / best, "hits": counts[who],
            "same_hits": counts[who] == counts[0],
        });
        for (name, value) in title {
            row[*name] = value.as_str().into();
        }
        if options.json {
            println!("{row}");
        } else {
            let [what, scene] = [0, 1].map(|at| title[at].1.as_str());
            println!(
                "{what:8} {scene:10} {:22} {:8.2} [{:.2} {:.2}] ms, {:.2} x the best peer, {} hits{}",
                names[who],
                of(who, 0.5),
                of(who, 0.0),
                of(who, 1.0),
                of(who, 0.5) / best,
                counts[who],
                if counts[who] == counts[0] { "" } else { " (other ones)" },
            );
        }
    }
    Ok(())
}

fn note_build(what: &str, scene: SceneName, begin: Instant, options: &Options) {
    if options.json {
        println!(
            "{}",
            json!({"what": "build", "scene": scene.to_string(), "contender": what, "ms": millis(begin)})
        );
    } else {
        println!("build    {scene:10} {what:22} {:8.2} ms", millis(begin));
    }
}

/// A session's scene, whose tree is built.
fn scene_of(
    daemon: &PrivateDaemon,
    backend: Backend,
    engine: EngineChoice,
    boxes: &[Aabb],
    options: &Options,
) -> Result<pairmask::Scene, Box<dyn Error>> {
    let builder = daemon.session().backend(backend).engine(engine).threads(options.threads);
    let mut session = builder.connect()?;
    let mut scene = session.scene(SceneOptions::default())?;
    let set = scene.edit().set_all(0..boxes.len() as u32, boxes);
    drop(set.commit(Report::Nothing)?);
    scene.cast(&[Ray::default(); CHUNK], Hits::Any)?;
    Ok(scene)
}

/// Sets some boxes to where they are.
fn set_some(
    scene: &mut pairmask::Scene,
    boxes: &[Aabb],
    options: &Options,
) -> Result<(), Box<dyn Error>> {
    let count = boxes.len() * options.set / 100;
    if count > 0 {
        let edit = scene.edit().set_all(0..count as u32, &boxes[..count]);
        drop(edit.commit(Report::Nothing)?);
    }
    Ok(())
}

fn compare(
    daemon: &PrivateDaemon,
    pool: &ThreadPool,
    name: SceneName,
    options: &Options,
) -> Result<(), Box<dyn Error>> {
    let boxes = Scene::new(name, options.n, 1).boxes().to_vec();
    // Points of the same place: corners of a scene as large.
    let others = Scene::new(name, options.n, 2).boxes().to_vec();
    let step = (others.len() / options.queries).max(1);
    let points: Vec<[f32; 3]> =
        others.iter().step_by(step).take(options.queries).map(|b| b.min).collect();
    let mut random = Random::new(3);
    let mut ray = |at: &[f32; 3]| Ray::new(*at, [(); 3].map(|()| 2.0 * random.unit() - 1.0));
    let rays: Vec<Ray> = points.iter().map(&mut ray).collect();
    let spheres: Vec<Sphere> = points.iter().map(|at| Sphere::new(*at, f32::INFINITY)).collect();

    let begin = Instant::now();
    let mut here = scene_of(daemon, Backend::InProcess, EngineChoice::Auto, &boxes, options)?;
    note_build("pairmask-in-process", name, begin, options);
    let cores = EngineChoice::Only(EngineName::CpuGrid);
    let mut there = scene_of(daemon, Backend::Daemon, cores, &boxes, options)?;
    let video = EngineChoice::Only(EngineName::GpuGrid);
    let has_gpu = options.gpu != GpuChoice::None;
    let in_video = || scene_of(daemon, Backend::Daemon, video, &boxes, options);
    let mut in_video = has_gpu.then(in_video).transpose()?;

    let of_parry = |b: &Aabb| {
        let [min, max] = [b.min, b.max].map(|[x, y, z]| Vector::new(x, y, z));
        ParryBox::new(min, max)
    };
    let parry_boxes: Vec<_> = boxes.iter().map(of_parry).collect();
    let begin = Instant::now();
    let leaves = parry_boxes.iter().copied().enumerate();
    let parry_tree = Bvh::from_iter(BvhBuildStrategy::Binned, leaves);
    note_build("parry", name, begin, options);
    let parry_hit = |ray: &Ray| {
        let [origin, direction] = [ray.origin, ray.direction].map(|[x, y, z]| Vector::new(x, y, z));
        let ray = parry3d::query::Ray::new(origin, direction);
        let cast = |at: u32, best| parry_boxes[at as usize].cast_local_ray(&ray, best, true);
        usize::from(parry_tree.cast_ray(&ray, f32::MAX, cast).is_some())
    };
    let batch = |hit: &(dyn Fn(&Ray) -> usize + Sync)| {
        let of_chunk = |rays: &[Ray]| rays.iter().map(hit).sum::<usize>();
        timed(|| Ok(pool.install(|| rays.par_chunks(CHUNK).map(of_chunk).sum())))
    };
    let cast = |scene: &mut pairmask::Scene| {
        set_some(scene, &boxes, options)?;
        timed(|| Ok(looked_at(&scene.cast(&rays, Hits::Closest(1))?)))
    };
    let title = [("what", "rays".to_owned()), ("scene", name.to_string())];
    let mut contenders: Vec<(&str, Run<'_>)> = vec![
        ("pairmask-in-process", Box::new(|| cast(&mut here))),
        ("pairmask-daemon", Box::new(|| cast(&mut there))),
        ("parry", Box::new(|| batch(&parry_hit))),
    ];
    if let Some(scene) = &mut in_video {
        contenders.push(("pairmask-video-memory", Box::new(|| cast(scene))));
    }
    take_turns(&title, contenders, options)?;

    let entry =
        |(b, index): (&Aabb, u32)| GeomWithData::new(Rectangle::from_corners(b.min, b.max), index);
    let entries: Vec<_> = boxes.iter().zip(0..).map(entry).collect();
    let begin = Instant::now();
    let rstar_tree = RTree::bulk_load(entries);
    note_build("rstar", name, begin, options);
    let rstar = || {
        let of_chunk = |points: &[[f32; 3]]| {
            let near = |at: &[f32; 3]| {
                rstar_tree.nearest_neighbor_iter(*at).take(NEAREST as usize).count()
            };
            points.iter().map(near).sum::<usize>()
        };
        timed(|| Ok(pool.install(|| points.par_chunks(CHUNK).map(of_chunk).sum())))
    };
    let title = [("what", "nearest".to_owned()), ("scene", name.to_string())];
    let nearest = |scene: &mut pairmask::Scene| {
        set_some(scene, &boxes, options)?;
        timed(|| Ok(looked_at(&scene.nearest(&spheres, Hits::Closest(NEAREST))?)))
    };
    let mut contenders: Vec<(&str, Run<'_>)> = vec![
        ("pairmask-in-process", Box::new(|| nearest(&mut here))),
        ("pairmask-daemon", Box::new(|| nearest(&mut there))),
        ("rstar", Box::new(rstar)),
    ];
    if let Some(scene) = &mut in_video {
        contenders.push(("pairmask-video-memory", Box::new(|| nearest(scene))));
    }
    take_turns(&title, contenders, options)
}

fn main() -> Result<(), Box<dyn Error>> {
    let options = Options::parse();
    let daemon = measure::daemon(options.gpu.clone())?;
    let pool = pool(options.threads);
    for name in &options.scene {
        compare(&daemon, &pool, *name, &options)?;
    }
    Ok(())
}
