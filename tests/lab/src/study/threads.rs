//! Speed-up by threads of the papers' two stages: boxes from transforms, and pairs from boxes.
//!
//! Source: Q. Avril, V. Gouranton, B. Arnaldi, "Collision detection: broad phase adaptation from
//! multi-core to multi-GPU architecture", 2014, §4, and their paper of 2009.

use std::hint::black_box;
use std::time::Instant;

use glam::{Quat, Vec3};
use pairmask_core::dispatch::nanoseconds_since;
use pairmask_core::engine::AvailableIsa;
use pairmask_core::update::{Placement, Transformed};
use pairmask_core::write::{par_write_boxes, write_boxes};
use pairmask_core::{Aabb, Encoding, EngineName};
use pairmaskd::cli::machine::Machine;
use pairmaskd::scene::{Random, Scene, SceneName};

use super::harness::{Fields, Part, Report, Table, row};
use super::papers::figure;
use super::ways::{Case, Pools, core_count, distinct, frames, measure_case, pools, thread_counts};
use crate::Result;

pub const SIZES: [u32; 2] = [10_000, 100_000];
pub const SCENES: [SceneName; 3] = [SceneName::Uniform, SceneName::Torus, SceneName::Letters];

pub fn papers_cases() -> impl Iterator<Item = Case> {
    let cases =
        [(SceneName::Cubes, 20_000), (SceneName::Balls, 10_000), (SceneName::Skittles, 3_500)];
    cases.into_iter().map(|(scene, n)| Case { scene, n })
}

/// The paper's time, ns, and speed-up over one core for a stage of a scene (Figures 5 and 7), at the paper's size.
fn papers_figures(table: &str, scene: SceneName, threads: usize) -> Option<(u64, f64)> {
    let ms = |threads: usize| figure(&format!("{table}[scene={scene}].{threads}"));
    let here = ms(threads)?;
    Some(((here * 1e6) as u64, ms(1)? / here))
}

/// The papers' two stages, and the tables of their times in `papers.toml`.
const UPDATE: (&str, &str) = ("update-aabbs", "update");
const PAIRS: (&str, &str) = ("overlapping-pairs", "pairs");

/// Measures both stages of every case; `threads` empty means 1, 2, 4 … all cores. `watch` is called after each case.
pub fn measure(cases: &[Case], threads: &[usize], watch: impl Fn()) -> Result<Report> {
    let machine = Machine::this();
    let all: &[usize] = if threads.is_empty() { &thread_counts(core_count()) } else { threads };
    // Speed-ups are over one thread.
    let threads = distinct([&[1][..], all].concat());
    let pools = pools(&threads)?;
    let (mut rows, isa) = (Vec::new(), AvailableIsa::best());
    for case in cases {
        let updates = update_times(case.scene, case.n, &threads, &pools);
        rows.extend(series(UPDATE, *case, None, updates));
        let measured = measure_case(*case, &[Encoding::Sparse], &threads, &[], &pools, isa)?;
        for engine in EngineName::ALL {
            let ways = measured.ways.iter().filter(|timed| timed.way.engine == engine);
            let times = ways.map(|timed| (timed.way.threads, timed.engine_ns.clone())).collect();
            rows.extend(series(PAIRS, *case, Some(engine), times));
        }
        watch();
    }
    let parts = vec![
        Part::heading(1, "Speed-up by threads"),
        Part::text(machine.to_string()),
        Part::text(format!("`{}`", machine.command)),
        Part::text("The paper's machine: two Xeon X5482."),
        Part::Table(Table::of(&rows)),
    ];
    let mut report = Report::new("threads", parts);
    report.value("machine", &machine);
    report.list("rows", &rows);
    Ok(report)
}

fn update_times(
    scene: SceneName,
    n: usize,
    threads: &[usize],
    pools: &Pools,
) -> Vec<(usize, Vec<u64>)> {
    let scene = Scene::new(scene, n, 1);
    let mut random = Random::new(2);
    // Objects whose world boxes are about those of the scene, and their placements.
    let object = |world: &Aabb| {
        let (min, max) = (Vec3::from_array(world.min), Vec3::from_array(world.max));
        let half = (max - min) * 0.5;
        let axis = Vec3::from_array(random.direction());
        let turn = Quat::from_axis_angle(axis.normalize_or(Vec3::X), random.range(0.0, 6.0));
        (Aabb::new(-half, half), Placement::rigid(min + half, turn))
    };
    let (locals, placements): (Vec<Aabb>, Vec<Placement>) =
        scene.boxes().iter().map(object).unzip();
    let mut out = vec![Aabb::EMPTY; n];
    let mut times: Vec<(usize, Vec<u64>)> = threads.iter().map(|t| (*t, Vec::new())).collect();
    for _ in frames(0) {
        for (threads, times) in &mut times {
            let source = Transformed::new(black_box(&locals), black_box(&placements));
            let mut timed = |write: fn(&_, &mut [Aabb])| {
                let start = Instant::now();
                write(&source, &mut out);
                nanoseconds_since(start)
            };
            times.push(match pools.get(threads) {
                None => timed(write_boxes),
                Some(pool) => pool.install(|| timed(par_write_boxes)),
            });
        }
    }
    black_box(&out);
    times
}

fn series(
    (stage, table): (&str, &str),
    case: Case,
    engine: Option<EngineName>,
    series: Vec<(usize, Vec<u64>)>,
) -> Vec<Fields> {
    let least = |times: &[u64]| times.iter().min().copied().unwrap_or(0);
    let one = series.iter().find(|(threads, _)| *threads == 1);
    let one_ns = one.map_or(0, |(_, times)| least(times));
    let of = |(threads, mut times): (usize, Vec<u64>)| {
        times.sort_unstable();
        let least_ns = least(&times);
        let paper = papers_figures(table, case.scene, threads);
        row!(
            stage,
            scene: case.scene.as_str(),
            n: case.n,
            engine: engine.map(EngineName::as_str),
            threads,
            frames: times.len(),
            least_ns,
            median_ns: times.get(times.len() / 2).copied().unwrap_or(0),
            speed_up: one_ns as f64 / least_ns.max(1) as f64,
            paper_ns: paper.map(|(ns, _)| ns),
            paper_speed_up: paper.map(|(_, speed_up)| speed_up),
        )
    };
    series.into_iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_figures_are_those_of_its_scenes_and_cores() {
        let both = |threads| {
            let ns =
                |table| papers_figures(table, SceneName::Cubes, threads).map_or(0, |(ns, _)| ns);
            (ns(UPDATE.1) + ns(PAIRS.1)) as f64
        };
        // Figure 9 says 5.1.
        assert!((4.5..5.2).contains(&(both(1) / both(8))));
        let update = |threads| papers_figures(UPDATE.1, SceneName::Balls, threads);
        let (ns, speed_up) = update(8).expect("the paper has it");
        assert!(ns == 740_000 && (speed_up - 6.01).abs() < 0.01, "{speed_up}");
        assert_eq!(update(3), None);
        assert_eq!(papers_figures(PAIRS.1, SceneName::Uniform, 2), None);
        let cases: Vec<_> = papers_cases().collect();
        for case in cases {
            let scene = case.scene;
            assert_eq!(figure(&format!("update[scene={scene}].n")), Some(case.n as f64));
        }
    }
}
