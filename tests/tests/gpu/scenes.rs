//! Scenes in video memory, held to the model, and to scenes of the core where those are large or hard.

use std::sync::Arc;
use std::time::Duration;

use pairmask::cast::{Hits, Ray, Shapes};
use pairmask_core::scene::{Cast, EditError, Indices};
use pairmask_tests::gpu::{self, scene_tools, shared_tools};
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::{
    Bare, BesideCore, CoreScene, Kind, Received, Subject, Turn, hold_without_rules, options,
};
use pairmaskd::execute::gpu::{Awake, Checks, EngineOptions, GpuScene, HostImport, SceneTools};

fn tools() -> Arc<SceneTools> {
    scene_tools(0, &EngineOptions::default())
}

fn hold_bare(tools: &[Arc<SceneTools>], seed: u64, kinds: [(Kind, usize); 3]) {
    for (kind, edits) in kinds {
        hold_without_rules(kind, seed, edits, |script| {
            Bare::of(GpuScene::shared(tools, options(script)))
        });
    }
}

#[test]
fn scenes_of_one_gpu_and_of_several_are_those_of_the_model() {
    let tools = [tools()];
    hold_bare(&tools, 120_000, [(Kind::Small, 600), (Kind::Crowd, 20), (Kind::Large, 30)]);
    for gpus in [2, 4] {
        let tools = shared_tools(gpus);
        hold_bare(&tools, 121_000, [(Kind::Small, 100), (Kind::Crowd, 8), (Kind::Large, 12)]);
    }
}

#[test]
fn answers_are_the_same_with_checked_stages_and_poisoned_memory() {
    let poisoned = |word| EngineOptions { poison: Some(word), ..EngineOptions::default() };
    let checked = EngineOptions { checks: Checks::On, ..EngineOptions::default() };
    for options in [checked, poisoned(0xa5a5_a5a5), poisoned(u32::MAX)] {
        let tools = [scene_tools(0, &options)];
        hold_bare(&tools, 122_000, [(Kind::Small, 100), (Kind::Crowd, 8), (Kind::Large, 8)]);
    }
}

/// A scene on a GPU that is often made anew of what a scene of the cores keeps.
struct Moving<'t> {
    tools: &'t [Arc<SceneTools>],
    core: CoreScene,
    gpu: Bare<GpuScene>,
    edits: usize,
}

impl Subject for Moving<'_> {
    fn tick(&mut self, turns: &[Turn]) -> Result<Vec<(u64, Option<Received>)>, String> {
        self.core.tick(turns)?;
        let reported = self.gpu.tick(turns)?;
        self.edits += 1;
        if self.edits.is_multiple_of(5)
            && let Some(snapshot) = self.core.scene.snapshot()
        {
            let made = GpuScene::from_snapshot(self.tools, SceneOptions::default(), &snapshot);
            self.gpu = Bare::of(made.map_err(|error| error.to_string())?);
        }
        Ok(reported)
    }

    fn invalidate(&mut self) {
        self.core.invalidate();
        self.gpu.invalidate();
    }
}

#[test]
fn scenes_that_move_to_a_gpu_go_on() {
    let tools = [tools()];
    for (kind, edits) in [(Kind::Small, 300), (Kind::Large, 12)] {
        hold_without_rules(kind, 123_000, edits, |script| {
            let gpu = Bare::of(GpuScene::shared(&tools, SceneOptions::default()));
            Moving { tools: &tools, core: CoreScene::new(script, 1), gpu, edits: 0 }
        });
    }
}

/// All boxes of each scene are set, moved a little, moved far, and removed.
#[test]
fn every_hard_scene_is_reported_as_the_core_reports_it() {
    let tools = [tools()];
    let sizes = if tier::is_nightly() { &[0, 23, 46, 69, 345, 1_234][..] } else { &[69, 1_234] };
    check_hard_scenes(&tools, sizes);
}

/// Boxes on borders of shares, across them, that end there, giants and empty ones: cells go to GPUs in stretches,
/// so most scenes have some of each.
#[test]
#[ignore = "slow: the nightly tier runs it"]
fn every_hard_scene_is_reported_by_several_gpus_as_by_the_core() {
    check_hard_scenes(&shared_tools(3), &[2, 70, 1_234]);
}

fn check_hard_scenes(tools: &[Arc<SceneTools>], sizes: &[u32]) {
    for scene in stress_scenes::ALL {
        for &n in sizes {
            let boxes = scene.boxes(n, 21);
            let n = boxes.len() as u32;
            let other = scene.boxes(n, 22);
            let mut both = BesideCore::new(tools);
            let few: Vec<u32> = (0..n).filter(|i| i % 37 == 5).collect();
            let few_boxes: Vec<Aabb> = few.iter().map(|i| other[*i as usize]).collect();
            let steps = [
                sets(0..n, &boxes),
                sets(&few, &few_boxes),
                sets(0..n, &other),
                sets(0..n, &boxes),
                Step::Remove((&few).into()),
                Step::Enable((0..0).into(), true),
            ];
            for (number, step) in steps.into_iter().enumerate() {
                for report in [Report::Changes, Report::All, Report::Moved] {
                    let steps = if report == Report::Changes { &[step][..] } else { &[] };
                    both.edit(steps, report, &format!("{scene:?}, {n} boxes, edit {number}"));
                    both.acknowledge();
                }
            }
        }
    }
}

/// Records grow past 4,096 indices, and shrink, with all that was reported and what has not been.
#[test]
fn a_scene_grows_and_shrinks() {
    let mut both = BesideCore::new(&[tools()]);
    let uniform = stress_scenes::named("uniform");
    for target in [1u32, 10, 700, 7_000, 20_000, 6_500, 64, 1, 0, 30] {
        for round in 0..3 {
            let boxes = uniform.boxes(target, u64::from(target + round));
            let report = if round == 1 { Report::Moved } else { Report::Changes };
            both.become_boxes(&boxes, report, &format!("{target} boxes"));
            // What a size was reached by is reported together with what follows.
            if round > 0 {
                both.acknowledge();
            }
        }
    }
    assert!(both.gpu.video_bytes() > 0 && both.gpu.allocated_bytes() < 16 << 20);
}

/// Records that are made anew have no names of boxes: an edit that asks for moved pairs finds them all the same.
#[test]
fn moved_pairs_are_reported_where_records_are_made_anew() {
    let uniform = stress_scenes::named("uniform");
    for tools in [vec![tools()], shared_tools(3)] {
        let mut both = BesideCore::new(&tools);
        // Room for 4,096 records, for some more, for 140,000, and for few again.
        for (round, n) in [100u32, 5_000, 90, 140_000, 60, 70].into_iter().enumerate() {
            let boxes = uniform.boxes(n, round as u64);
            both.become_boxes(&boxes, Report::Moved, &format!("{n} boxes"));
            assert!(n < 1_000 || both.core.reported().pairs().len() > 1_000);
        }
    }
}

/// Lists of indices below and above 1 MiB lie in different blocks where video memory is mapped: a recording that
/// binds one of them serves no edit whose list lies in the other. So large a search zeroes so much that all these
/// edits take as many workgroups.
#[test]
#[ignore = "half a minute on a software driver: the nightly tier runs it"]
fn long_and_short_lists_take_turns() {
    let uniform = stress_scenes::named("uniform");
    let n = 900_000u32;
    let mut both = BesideCore::new(&[tools()]);
    both.edit(&sets_all(&uniform.boxes(n, 1)), Report::All, "all boxes");
    for (round, count) in [100_000u32, 300_000, 100_000, 300_000].into_iter().enumerate() {
        let indices: Vec<u32> = (0..count).map(|i| n - 1 - 2 * i).rev().collect();
        let boxes = uniform.boxes(n, 2 + round as u64);
        let step = sets(&indices, &boxes[..count as usize]);
        both.edit(&[step], Report::All, &format!("{count} boxes"));
    }
}

/// A scene without boxes is offered to other GPUs: those that have it already are no others.
#[test]
fn a_scene_is_on_each_gpu_once() {
    let tools = shared_tools(2);
    let boxes = stress_scenes::named("uniform").boxes(3_000, 6);
    let mut both = BesideCore::new(&tools[..1]);
    for _ in 0..3 {
        assert!(both.gpu.is_new());
        both.gpu.share(&tools);
        assert_eq!(both.gpu.gpu_count(), 2);
        assert!(tools.iter().all(|tools| both.gpu.is_on(tools.gpu())));
        let remove = [Step::Remove((0..3_000).into())];
        for steps in [&sets_all(&boxes)[..], &remove, &[]] {
            both.edit(steps, Report::Changes, "on each GPU once");
            both.acknowledge();
        }
    }
}

#[test]
fn a_dropped_scene_gives_its_memory_back() {
    let tools = tools();
    let holders = Arc::strong_count(tools.gpu());
    let mut gpu = GpuScene::new(&tools, SceneOptions::default());
    let boxes = stress_scenes::named("uniform").boxes(1_000, 3);
    let steps = [sets(0..1_000, &boxes)];
    for report in [Report::Changes, Report::Moved, Report::All] {
        gpu.edit(Edit { steps: &steps }, report).expect("an answer");
    }
    assert!(Arc::strong_count(tools.gpu()) > holders, "blocks and frames hold the device");
    drop(gpu);
    assert_eq!(Arc::strong_count(tools.gpu()), holders);
}

#[test]
fn a_lost_device_and_memory_that_is_not_to_be_had_are_errors() {
    let tools = tools();
    let mut gpu = GpuScene::new(&tools, SceneOptions::default().with_most_boxes(1 << 29));
    let slots = tools.gpu().limits().storage_binding_bytes / 32 + 1;
    if let Ok(index) = u32::try_from(slots)
        && index < 1 << 26
    {
        let indices = [index];
        let steps = [sets(&indices, &[Aabb::EMPTY])];
        let refused = gpu.edit(Edit { steps: &steps }, Report::Changes).map(|_| ());
        let is_memory = matches!(refused, Err(SceneError::Cull(CullError::DeviceMemory { .. })));
        assert!(is_memory, "{refused:?}");
    }
    let mut gpu = GpuScene::new(&tools, SceneOptions::default());
    tools.gpu().destroy();
    let steps = [sets(0..1, &[Aabb::EMPTY])];
    let lost = gpu.edit(Edit { steps: &steps }, Report::Changes).map(|_| ());
    assert!(matches!(lost, Err(SceneError::Cull(CullError::DeviceLost { .. }))), "{lost:?}");
}

/// Three boxes in a row, each touching the next, which stay.
#[test]
fn wrong_edits_are_refused_as_by_the_core_and_change_nothing() {
    let options = SceneOptions::default().with_most_boxes(100);
    let mut both = BesideCore::with_options(&[tools()], options);
    both.edit(&sets_all(&[at(0.0), at(0.8), at(1.6)]), Report::Changes, "a row");
    let (one, two) = ([Aabb::EMPTY], [Aabb::EMPTY; 2]);
    let cases: [&[Step<'_>]; 13] = [
        &[sets(&[100], &one)],
        &[Step::Remove((&[u32::MAX]).into())],
        &[sets(Indices::Range { first: u32::MAX, count: 2 }, &two)],
        &[sets(&[0, 1], &one)],
        &[sets(0..1, &two)],
        &[sets(&[1, 1], &two)],
        &[sets(&[1], &one), sets(1..2, &one)],
        &[Step::Remove((&[3]).into())],
        &[Step::Remove((&[1, 1]).into())],
        &[Step::Remove((&[1]).into()), Step::Enable((&[1]).into(), false)],
        &[sets(&[0], &one), Step::Static((&[50]).into(), true)],
        &[sets(&[9], &one), Step::Static((&[8]).into(), true)],
        &[Step::Remove((&[7, 8, 0]).into())],
    ];
    for (number, steps) in cases.into_iter().enumerate() {
        let expected = both.core.edit(Edit { steps }, Report::Changes).map(drop);
        assert!(matches!(expected, Err(SceneError::Edit(_))), "case {number}");
        let refused = both.gpu.edit(Edit { steps }, Report::Changes).map(drop);
        assert_eq!(refused, expected, "case {number}");
        assert_eq!(both.gpu.len(), 3);
        let [ours, theirs] = [both.gpu.reported(), both.core.reported()].map(Received::from);
        assert_eq!(ours, theirs, "the last answer stays");
    }
    // A refused edit leaves the last answer to be taken.
    both.acknowledge();
    for report in [Report::Changes, Report::All] {
        both.edit(&[], report, "after refused edits");
    }
    assert_eq!(both.gpu.reported().pairs(), [[0, 1], [1, 2]]);
    let twice = both.gpu.edit(Edit { steps: cases[5] }, Report::All).map(drop);
    assert_eq!(twice, Err(SceneError::Edit(EditError::SetTwice { index: 1 })));
}

/// What a scene has the GPU do keeps its clocks up: an edit, a query, and casts.
#[test]
fn a_device_is_kept_awake_while_scenes_are_asked() {
    let gpu = gpu::open(HostImport::IfPossible);
    let hold = Duration::from_millis(20);
    let awake = Arc::new(Awake::launch(&gpu, hold).expect("a frame"));
    let options = EngineOptions::default();
    let tools = SceneTools::kept_awake(&gpu, &options, Arc::downgrade(&awake)).expect("stages");
    let boxes = stress_scenes::named("uniform").boxes(200, 6);
    let rays = vec![Ray::new([0.0; 3], [1.0, 0.5, 0.2]); 600];
    let cast = Cast {
        shapes: Shapes::Rays(&rays),
        hits: Hits::Closest(1),
        filter_data: QueryFilterData::None,
        most_hits: 1 << 20,
    };
    let mut scene = GpuScene::new(&tools, SceneOptions::default());
    let mut wakes = |what: &str, ask: &mut dyn FnMut(&mut GpuScene)| {
        let before = eventually("it ends with what was asked", || {
            let before = awake.dispatches();
            std::thread::sleep(Duration::from_millis(300));
            (awake.dispatches() == before).then_some(before)
        });
        ask(&mut scene);
        until(what, || awake.dispatches() > before);
    };
    wakes("an edit wakes it", &mut |scene| {
        let steps = sets_all(&boxes);
        scene.edit(Edit { steps: &steps }, Report::Changes).map(drop).expect("an answer");
    });
    wakes("a query wakes it", &mut |scene| {
        scene.query(&boxes, QueryFilterData::None, &mut Vec::new()).map(drop).expect("an answer");
    });
    wakes("a cast wakes it", &mut |scene| {
        scene.cast(&cast, &mut Vec::new()).map(drop).expect("an answer");
    });
}
