//! A search for scenes that collapse our speed: the oddities that are known, the worst of an earlier search, then scenes
//! at random and mutations of the worst so far (hill climbing). Ours is the plan's engine in process, once it had frames
//! to learn from, the peer is the faster one of parry3d refitted and optimised; both have the same boxes, which move a
//! little from frame to frame.

use std::collections::BTreeSet;
use std::io::{Write as _, stdout};
use std::time::{Duration, Instant};

use pairmask_core::scene::{QueryFilterData, Scene};
use pairmask_tests::measure::percentile;
use pairmask_tests::peers::contender::{Contender, Tally, sorted};
use pairmask_tests::prelude::*;
use pairmaskd::scene::Random;
use rayon::ThreadPoolBuilder;

use crate::parry::{Parry, Upkeep};
use crate::recipe::Recipe;

/// Frames of ours before: the plan learns from them, as it does in the first second of a game.
const LEARNED_FRAMES: usize = 50;
/// Frames of each contender, of which the median counts.
const FRAMES: usize = 5;
/// A contender that has taken so long gets no further frame of a scene.
const ENOUGH: Duration = Duration::from_millis(1_500);
/// Scenes that are kept, mutated and shown.
const WORST: usize = 10;
/// Boxes of a scene that it is asked for.
const QUERIES: usize = 200;
/// More pairs a box are no broad phase any more, and take any engine as long as they are many.
const PAIRS_A_BOX: u64 = 100;

/// Scenes that users of broad phases have reported, by what is odd about them.
fn known() -> Vec<(&'static str, Recipe)> {
    let uniform = Recipe::UNIFORM;
    let flung = |flung_share, flung| Recipe { flung_share, flung, ..uniform };
    let long = |long_share, aspect, turns| Recipe { long_share, aspect, turns, ..uniform };
    let sites = |sites, apart| Recipe { sites, apart, ..uniform };
    vec![
        ("uniform", uniform),
        ("a finite giant", Recipe { has_giant: true, ..uniform }),
        ("2 % flung to 1e6", flung(0.02, 1e6)),
        ("2 % flung to 1e30", flung(0.02, 1e30)),
        ("200 places over 1e7", sites(200, 1e7)),
        ("1,000 places over 1e9", sites(1_000, 1e9)),
        (
            "woven",
            Recipe { has_layers: true, axes: 2, density: 0.01, ..long(1.0, [1e4, 0.1, 0.1], 2) },
        ),
        ("rods on three axes", Recipe { density: 5e-4, ..long(1.0, [200.0, 0.2, 0.2], 3) }),
        ("1 % straps", long(0.01, [30.0, 1.0, 1.0], 3)),
        ("sizes over 5 decades", Recipe { decades: 5.0, density: 3.0, ..uniform }),
    ]
}

/// The worst of searches on two cores, 2026-11-28 and 2026-11-30: what is mended later stays mended.
fn golden() -> Vec<Recipe> {
    let of = |density, axes, decades| Recipe { density, axes, decades, ..Recipe::UNIFORM };
    let long = |recipe, long_share, aspect, turns| Recipe { long_share, aspect, turns, ..recipe };
    let at = |recipe, sites, apart| Recipe { sites, apart, ..recipe };
    let flung = |recipe, flung_share, flung| Recipe { flung_share, flung, ..recipe };
    let giant = |recipe| Recipe { has_giant: true, ..recipe };
    let flat = of(0.1, 2, 2.0);
    vec![
        giant(flung(of(1.0, 3, 3.0), 0.3, 1e9)),
        at(of(1.0, 3, 5.0), 3, 1e5),
        Recipe {
            has_layers: true,
            ..giant(flung(long(of(0.1, 3, 2.0), 0.1, [1.0; 3], 2), 0.1, 1e30))
        },
        giant(flung(long(of(3.0, 3, 0.3), 0.01, [10.0, 10.0, 1.0], 2), 0.3, 1e30)),
        flung(at(long(flat, 0.1, [1e3, 100.0, 1e-3], 2), 50, 1e5), 0.1, 1e3),
        flung(at(of(1.0, 3, 1.0), 50, 1e7), 0.02, 1e6),
        flung(at(long(flat, 0.1, [1.0; 3], 3), 50, 1e5), 0.1, 1e3),
        flung(at(flat, 50, 1e5), 0.1, 1e3),
        flung(at(long(flat, 0.1, [100.0, 1.0, 0.1], 3), 50, 1e5), 0.1, 1e3),
        at(of(1.0, 2, 5.0), 3, 1e5),
        flung(at(of(1.0, 3, 5.0), 1, 1e7), 0.1, 1e3),
        flung(at(long(flat, 0.1, [100.0, 1.0, 0.1], 3), 1, 1e5), 0.1, 1e3),
        flung(at(long(of(1.0, 1, 2.0), 0.01, [1e3, 10.0, 1e-3], 1), 3, 1e3), 0.001, 1e6),
        giant(flung(at(of(0.1, 1, 2.0), 1, 1e9), 0.001, 1e9)),
        at(long(of(0.1, 1, 0.0), 1.0, [10.0, 100.0, 1e-3], 2), 50, 1e5),
    ]
}

/// A scene and what it took, ms.
#[derive(Clone, Copy)]
struct Measured {
    recipe: Recipe,
    engine: EngineName,
    pairs: u64,
    frame: f64,
    peer: f64,
    /// An edit of one box in a hundred, with its changes.
    edit: f64,
    /// Queries by [`QUERIES`] of the boxes.
    queries: f64,
}

impl Measured {
    fn ratio(&self) -> f64 {
        self.frame / self.peer
    }

    fn print(&self, name: &str) {
        let Self { engine, pairs, frame, peer, edit, queries, .. } = self;
        let (ratio, engine) = (self.ratio(), engine.as_str());
        println!(
            "{name:24} {frame:9.2} {peer:9.2} {ratio:7.2} {edit:9.2} {queries:11.2} {pairs:10}  {engine}"
        );
        let _ = stdout().flush();
    }
}

/// Measures the known scenes, then searches for so long. Whether a set of pairs was wrong is an error.
pub fn search(n: usize, threads: usize, seed: u64, seconds: u64) -> Result<(), String> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().map_err(|e| e.to_string())?;
    pool.install(|| {
        println!("{n} boxes, {threads} threads, ms\n");
        println!(
            "{:24} {:>9} {:>9} {:>7} {:>9} {:>11} {:>10}",
            "scene", "ours", "parry3d", "ratio", "1 % edit", "200 queries", "pairs"
        );
        let golden = golden().into_iter().map(|recipe| ("once among the worst", recipe));
        for (name, recipe) in known().into_iter().chain(golden) {
            if let Some(measured) = measure(&recipe, n, threads, seed)? {
                measured.print(name);
            }
        }
        let end = Instant::now() + Duration::from_secs(seconds);
        let mut random = Random::new(seed);
        let mut worst: Vec<Measured> = Vec::new();
        let (mut count, mut slower) = (0, 0);
        while Instant::now() < end {
            let recipe = match random.below(2) {
                0 if !worst.is_empty() => {
                    worst[random.below(worst.len() as u64) as usize].recipe.mutated(&mut random)
                }
                _ => Recipe::random(&mut random),
            };
            let Some(measured) = measure(&recipe, n, threads, seed)? else { continue };
            count += 1;
            slower += usize::from(measured.ratio() > 1.0);
            worst.push(measured);
            worst.sort_by(|a, b| b.ratio().total_cmp(&a.ratio()));
            worst.dedup_by(|a, b| a.recipe == b.recipe);
            worst.truncate(WORST);
        }
        if count > 0 {
            println!("\n{count} scenes were searched, {slower} take us longer; the worst:");
            for measured in &worst {
                measured.print("");
                println!("    {:?}", measured.recipe);
            }
        }
        Ok(())
    })
}

/// `None` where the scene has so many pairs that it shows nothing.
fn measure(
    recipe: &Recipe,
    n: usize,
    threads: usize,
    seed: u64,
) -> Result<Option<Measured>, String> {
    let mut boxes = recipe.boxes(n, seed);
    let count = BoxCount::of_len(n).ok_or("too many boxes")?;
    let limit = 8 * PAIRS_A_BOX * n as u64;
    let mut engines = CpuEngines::new();
    let mut options = CullOptions { threads: Some(threads), ..CullOptions::default() };
    if engines.cull(&boxes, &options, &mut HeapReply::with_limit_bytes(limit)).is_err() {
        return Ok(None);
    }
    let mut reply = HeapReply::new();
    let start = Instant::now();
    for turn in 0..LEARNED_FRAMES {
        jitter(&mut boxes, turn);
        let answer = engines.cull(&boxes, &options, &mut reply).map_err(|e| e.to_string())?;
        options.last_pairs = Some(answer.report.pair_count);
        if start.elapsed() > ENOUGH {
            break;
        }
    }
    let mut peers = [Upkeep::Refit, Upkeep::OptimizeRefit]
        .map(|upkeep| (Parry::new(&boxes, upkeep, threads), Vec::new()));
    let (mut ours, mut engine, mut tally) = (Vec::new(), EngineName::CpuGrid, Tally::default());
    for turn in 0..FRAMES {
        jitter(&mut boxes, turn);
        if !is_enough(&ours) {
            let start = Instant::now();
            let answer = engines.cull(&boxes, &options, &mut reply).map_err(|e| e.to_string())?;
            let mask = MaskView::new(count, &answer.report.shape, reply.words());
            tally = Tally::default();
            mask.map_err(|e| e.to_string())?.for_each(|a, b| tally.iterate(a, b));
            ours.push(start.elapsed().as_nanos() as u64);
            engine = answer.engine;
            options.last_pairs = Some(tally.count);
        }
        for (peer, times) in &mut peers {
            if !is_enough(times) {
                let start = Instant::now();
                peer.find(&boxes).map_err(|e| e.to_string())?;
                times.push(start.elapsed().as_nanos() as u64);
            }
        }
    }
    // The last frame of both, pair by pair.
    let answer = engines.cull(&boxes, &options, &mut reply).map_err(|e| e.to_string())?;
    let mask = MaskView::new(count, &answer.report.shape, reply.words());
    let mut pairs = mask.map_err(|e| e.to_string())?.to_vec();
    pairs.sort_unstable();
    peers[0].0.find(&boxes).map_err(|e| e.to_string())?;
    let mut theirs = sorted(peers[0].0.pairs(&boxes).map_err(|e| e.to_string())?);
    // A tree of finite bounds may report pairs that do not overlap.
    theirs.retain(|[a, b]| boxes[*a as usize].overlaps(&boxes[*b as usize]));
    if pairs != theirs {
        return Err(format!("{} pairs, parry3d has {}: {recipe:?}", pairs.len(), theirs.len()));
    }
    let [first, second] = peers.map(|(_, times)| percentile(&times, 0.5));
    let ms = |ns: u64| ns as f64 / 1e6;
    let [edit, queries] = scene(&mut boxes, threads)?;
    Ok(Some(Measured {
        recipe: *recipe,
        engine,
        pairs: tally.count,
        frame: ms(percentile(&ours, 0.5)),
        peer: ms(first.min(second)),
        edit: ms(edit),
        queries: ms(queries),
    }))
}

fn is_enough(times: &[u64]) -> bool {
    times.iter().map(|ns| Duration::from_nanos(*ns)).sum::<Duration>() > ENOUGH
}

/// Moves each box by a fiftieth of its shortest edge, or by what its coordinates distinguish where that is more, to and
/// fro from turn to turn: boxes at rest would cost a tree that is refitted nothing, and a session neither.
fn jitter(boxes: &mut [Aabb], turn: usize) {
    for (i, b) in boxes.iter_mut().enumerate() {
        let edges = [0, 1, 2].map(|axis| b.max[axis] - b.min[axis]);
        let shortest = edges.iter().fold(f32::INFINITY, |a, e| a.min(*e));
        let axis = i % 3;
        let farthest = b.min[axis].abs().max(b.max[axis].abs());
        let step = (shortest / 50.0).max(2.0 * f32::EPSILON * farthest);
        let step = if (i + turn).is_multiple_of(2) { step } else { -step };
        (b.min[axis], b.max[axis]) = (b.min[axis] + step, b.max[axis] + step);
    }
}

/// Medians of what a scene in process takes: an edit that sets one box in a hundred and reports the changes, and queries by
/// some of its boxes after it, ns.
fn scene(boxes: &mut [Aabb], threads: usize) -> Result<[u64; 2], String> {
    let mut scene = Scene::new(SceneOptions::default().with_threads(threads));
    let n = boxes.len() as u32;
    let (mut edits, mut queries, mut found) = (Vec::new(), Vec::new(), Vec::new());
    for turn in 0..FRAMES as u32 + 2 {
        let moved: BTreeSet<u32> = (0..n).filter(|i| turn == 0 || i % 100 == turn).collect();
        // All the same way: a box that came back would be no change.
        jitter(boxes, 0);
        let indices: Vec<u32> = moved.into_iter().collect();
        let set: Vec<Aabb> = indices.iter().map(|index| boxes[*index as usize]).collect();
        let steps = [sets(&indices, &set)];
        let start = Instant::now();
        scene.edit(Edit { steps: &steps }, Report::Changes).map_err(|e| e.to_string())?;
        scene.acknowledge();
        let edit = start.elapsed().as_nanos() as u64;
        let some: Vec<Aabb> =
            boxes.iter().step_by(boxes.len().div_ceil(QUERIES)).copied().collect();
        let start = Instant::now();
        scene.query(&some, QueryFilterData::None, &mut found).map_err(|e| e.to_string())?;
        let query = start.elapsed().as_nanos() as u64;
        // The first sets all boxes, the second may build cells.
        if turn > 1 {
            edits.push(edit);
            queries.push(query);
        }
        if is_enough(&edits) {
            break;
        }
    }
    Ok([edits, queries].map(|times| percentile(&times, 0.5)))
}
