//! Scenes in video memory, held to the model, and to scenes of the core where those are large or hard.

use std::sync::Arc;

use pairmask_core::scene::{EditError, Indices, Scene};
use pairmask_tests::gpu::{scene_tools, shared_tools};
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::{
    Bare, CoreScene, Heard, Kind, Subject, Turn, hold_without_rules, options,
};
use pairmaskd::execute::gpu::{Checks, GpuScene, GridOptions, SceneTools};

fn hold_bare(tools: &[Arc<SceneTools>], seed: u64, kinds: [(Kind, usize); 3]) {
    for (kind, edits) in kinds {
        hold_without_rules(kind, seed, edits, |script| {
            Bare::of(GpuScene::shared(tools, options(script)))
        });
    }
}

#[test]
fn scenes_of_one_gpu_and_of_several_are_those_of_the_model() {
    let tools = [scene_tools(0, &GridOptions::default())];
    hold_bare(&tools, 120_000, [(Kind::Small, 600), (Kind::Crowd, 20), (Kind::Large, 30)]);
    for gpus in [2, 4] {
        let tools = shared_tools(gpus);
        hold_bare(&tools, 121_000, [(Kind::Small, 100), (Kind::Crowd, 8), (Kind::Large, 12)]);
    }
}

#[test]
fn answers_are_the_same_with_checked_stages_and_poisoned_memory() {
    let poisoned = |word| GridOptions { poison: Some(word), ..GridOptions::default() };
    let checked = GridOptions { checks: Checks::On, ..GridOptions::default() };
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
    fn tick(&mut self, turns: &[Turn]) -> Result<Vec<(u64, Option<Heard>)>, String> {
        self.core.tick(turns)?;
        let reported = self.gpu.tick(turns)?;
        self.edits += 1;
        if self.edits.is_multiple_of(5)
            && let Some(kept) = self.core.scene.kept()
        {
            let made = GpuScene::from_kept(self.tools, SceneOptions::default(), &kept);
            self.gpu = Bare::of(made.map_err(|error| error.to_string())?);
        }
        Ok(reported)
    }

    fn reading_acknowledges(&self) -> bool {
        false
    }

    fn invalidate(&mut self) {
        self.core.invalidate();
        self.gpu.invalidate();
    }
}

#[test]
fn scenes_that_move_to_a_gpu_go_on() {
    let tools = [scene_tools(0, &GridOptions::default())];
    for (kind, edits) in [(Kind::Small, 300), (Kind::Large, 12)] {
        hold_without_rules(kind, 123_000, edits, |script| {
            let gpu = Bare::of(GpuScene::shared(&tools, SceneOptions::default()));
            Moving { tools: &tools, core: CoreScene::new(script, 1), gpu, edits: 0 }
        });
    }
}

/// Makes an edit of a scene of each kind, and compares what they tell.
fn edit_both(core: &mut Scene, gpu: &mut GpuScene, steps: &[Step<'_>], report: Report, what: &str) {
    core.edit(Edit { steps }, report).expect("an answer");
    let got = gpu.edit(Edit { steps }, report).map(Heard::from);
    let got = got.unwrap_or_else(|error| panic!("{what}, {report:?}: {error}"));
    // Not `assert_eq`, which would print thousands of pairs.
    assert!(got == Heard::from(core.reported()), "{what}, {report:?}");
}

/// All boxes of each scene are set, moved a little, moved far, and removed.
#[test]
fn every_hard_scene_is_reported_as_the_core_reports_it() {
    let tools = [scene_tools(0, &GridOptions::default())];
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
            let mut core = Scene::new(SceneOptions::default());
            let mut gpu = GpuScene::shared(tools, SceneOptions::default());
            let few: Vec<u32> = (0..n).filter(|i| i % 37 == 5).collect();
            let few_boxes: Vec<Aabb> = few.iter().map(|i| other[*i as usize]).collect();
            let set = |indices, boxes| [Step::Set(Sets { indices, boxes })];
            let steps = [
                set(Indices::from(0..n), &boxes),
                set((&few).into(), &few_boxes),
                set(Indices::from(0..n), &other),
                set(Indices::from(0..n), &boxes),
                [Step::Remove((&few).into())],
                [Step::Switch((0..0).into(), true)],
            ];
            for (number, steps) in steps.iter().enumerate() {
                for report in [Report::Changes, Report::All, Report::Moved] {
                    let steps = if report == Report::Changes { &steps[..] } else { &[] };
                    let what = format!("{scene:?}, {n} boxes, edit {number}");
                    edit_both(&mut core, &mut gpu, steps, report, &what);
                    core.acknowledge();
                    gpu.acknowledge();
                }
            }
        }
    }
}

/// Records grow past 4,096 indices, and shrink, with all that was told and what has not been.
#[test]
fn a_scene_grows_and_shrinks() {
    let tools = [scene_tools(0, &GridOptions::default())];
    let mut core = Scene::new(SceneOptions::default());
    let mut gpu = GpuScene::shared(&tools, SceneOptions::default());
    let uniform = stress_scenes::named("uniform");
    let mut held = 0;
    for target in [1u32, 10, 700, 7_000, 20_000, 6_500, 64, 1, 0, 30] {
        for round in 0..3 {
            let boxes = uniform.boxes(target, u64::from(target + round));
            let steps = [
                Step::Remove((target.min(held)..held).into()),
                Step::Set(Sets { indices: (0..target).into(), boxes: &boxes }),
            ];
            let report = if round == 1 { Report::Moved } else { Report::Changes };
            edit_both(&mut core, &mut gpu, &steps, report, &format!("{target} boxes"));
            // What a size was reached by is told together with what follows.
            if round > 0 {
                core.acknowledge();
                gpu.acknowledge();
            }
            held = target;
        }
    }
    assert!(gpu.video_bytes() > 0 && gpu.allocated_bytes() < 16 << 20);
}

/// Records that are made anew have no names of boxes: an edit that asks for moved pairs finds them all the same.
#[test]
fn moved_pairs_are_reported_where_records_are_made_anew() {
    let uniform = stress_scenes::named("uniform");
    for tools in [vec![scene_tools(0, &GridOptions::default())], shared_tools(3)] {
        let mut core = Scene::new(SceneOptions::default());
        let mut gpu = GpuScene::shared(&tools, SceneOptions::default());
        // Room for 4,096 records, for some more, for 140,000, and for few again.
        for (round, n) in [100u32, 5_000, 90, 140_000, 60, 70].into_iter().enumerate() {
            let boxes = uniform.boxes(n, round as u64);
            let steps = [
                Step::Remove((n.min(core.len() as u32)..core.len() as u32).into()),
                Step::Set(Sets { indices: (0..n).into(), boxes: &boxes }),
            ];
            edit_both(&mut core, &mut gpu, &steps, Report::Moved, &format!("{n} boxes"));
            assert!(n < 1_000 || core.reported().pairs().len() > 1_000);
        }
    }
}

/// Lists of indices below and above 1 MiB lie in different blocks where video memory is mapped: a recording that
/// binds one of them serves no edit whose list lies in the other. So large a search zeroes so much that all these
/// edits take as many workgroups.
#[test]
#[ignore = "half a minute on a software driver: the nightly tier runs it"]
fn long_and_short_lists_take_turns() {
    let tools = scene_tools(0, &GridOptions::default());
    let uniform = stress_scenes::named("uniform");
    let n = 900_000u32;
    let mut core = Scene::new(SceneOptions::default());
    let mut gpu = GpuScene::new(&tools, SceneOptions::default());
    let mut check = |steps: &[Step<'_>], count: u32| {
        edit_both(&mut core, &mut gpu, steps, Report::All, &format!("{count} boxes"));
    };
    check(&[Step::Set(Sets { indices: (0..n).into(), boxes: &uniform.boxes(n, 1) })], n);
    for (round, count) in [100_000u32, 300_000, 100_000, 300_000].into_iter().enumerate() {
        let indices: Vec<u32> = (0..count).map(|i| n - 1 - 2 * i).rev().collect();
        let boxes = uniform.boxes(n, 2 + round as u64);
        let sets = Sets { indices: (&indices).into(), boxes: &boxes[..count as usize] };
        check(&[Step::Set(sets)], count);
    }
}

/// A scene without boxes is offered to other GPUs: those that have it already are no others.
#[test]
fn a_scene_is_on_each_gpu_once() {
    let tools = shared_tools(2);
    let boxes = stress_scenes::named("uniform").boxes(3_000, 6);
    let mut core = Scene::new(SceneOptions::default());
    let mut gpu = GpuScene::new(&tools[0], SceneOptions::default());
    for _ in 0..3 {
        assert!(gpu.is_new());
        gpu.share(&tools);
        assert_eq!(gpu.gpu_count(), 2);
        assert!(tools.iter().all(|tools| gpu.is_on(tools.gpu())));
        let set = [Step::Set(Sets { indices: (0..3_000).into(), boxes: &boxes })];
        let remove = [Step::Remove((0..3_000).into())];
        for steps in [&set[..], &remove, &[]] {
            edit_both(&mut core, &mut gpu, steps, Report::Changes, "on each GPU once");
            core.acknowledge();
            gpu.acknowledge();
        }
    }
}

#[test]
fn a_dropped_scene_gives_its_memory_back() {
    let tools = scene_tools(0, &GridOptions::default());
    let holders = Arc::strong_count(tools.gpu());
    let mut gpu = GpuScene::new(&tools, SceneOptions::default());
    let boxes = stress_scenes::named("uniform").boxes(1_000, 3);
    let steps = [Step::Set(Sets { indices: (0..1_000).into(), boxes: &boxes })];
    for report in [Report::Changes, Report::Moved, Report::All] {
        gpu.edit(Edit { steps: &steps }, report).expect("an answer");
    }
    assert!(Arc::strong_count(tools.gpu()) > holders, "blocks and frames hold the device");
    drop(gpu);
    assert_eq!(Arc::strong_count(tools.gpu()), holders);
}

#[test]
fn a_lost_device_and_memory_that_is_not_to_be_had_are_errors() {
    let tools = scene_tools(0, &GridOptions::default());
    let mut gpu = GpuScene::new(&tools, SceneOptions::default().with_most_boxes(1 << 29));
    let slots = tools.gpu().limits().storage_binding_bytes / 32 + 1;
    if let Ok(index) = u32::try_from(slots)
        && index < 1 << 26
    {
        let indices = [index];
        let steps = [Step::Set(Sets { indices: (&indices).into(), boxes: &[Aabb::EMPTY] })];
        let refused = gpu.edit(Edit { steps: &steps }, Report::Changes).map(|_| ());
        assert!(
            matches!(refused, Err(SceneError::Cull(CullError::DeviceMemory { .. }))),
            "{refused:?}"
        );
    }
    let mut gpu = GpuScene::new(&tools, SceneOptions::default());
    tools.gpu().destroy();
    let steps = [Step::Set(Sets { indices: (0..1).into(), boxes: &[Aabb::EMPTY] })];
    let lost = gpu.edit(Edit { steps: &steps }, Report::Changes).map(|_| ());
    assert!(matches!(lost, Err(SceneError::Cull(CullError::DeviceLost { .. }))), "{lost:?}");
}

/// A scene of each kind with three boxes in a row, each touching the next.
fn rows(tools: &Arc<SceneTools>) -> (Scene, GpuScene) {
    let options = SceneOptions::default().with_most_boxes(100);
    let (mut core, mut gpu) = (Scene::new(options), GpuScene::new(tools, options));
    let boxes = [0.0f32, 0.8, 1.6].map(|x| Aabb::from([x, 0.0, 0.0, x + 1.0, 1.0, 1.0]));
    let steps = [Step::Set(Sets { indices: (0..3).into(), boxes: &boxes })];
    core.edit(Edit { steps: &steps }, Report::Changes).expect("an answer");
    gpu.edit(Edit { steps: &steps }, Report::Changes).expect("an answer");
    (core, gpu)
}

#[test]
fn wrong_edits_are_refused_as_by_the_core_and_change_nothing() {
    let (mut core, mut gpu) = rows(&scene_tools(0, &GridOptions::default()));
    let set = |indices, boxes| Step::Set(Sets { indices, boxes });
    let (one, two) = ([Aabb::EMPTY], [Aabb::EMPTY; 2]);
    let cases: [&[Step<'_>]; 13] = [
        &[set((&[100]).into(), &one)],
        &[Step::Remove((&[u32::MAX]).into())],
        &[set(Indices::Range { first: u32::MAX, count: 2 }, &two)],
        &[set((&[0, 1]).into(), &one)],
        &[set((0..1).into(), &two)],
        &[set((&[1, 1]).into(), &two)],
        &[set((&[1]).into(), &one), set((1..2).into(), &one)],
        &[Step::Remove((&[3]).into())],
        &[Step::Remove((&[1, 1]).into())],
        &[Step::Remove((&[1]).into()), Step::Switch((&[1]).into(), false)],
        &[set((&[0]).into(), &one), Step::Static((&[50]).into(), true)],
        &[set((&[9]).into(), &one), Step::Static((&[8]).into(), true)],
        &[Step::Remove((&[7, 8, 0]).into())],
    ];
    for (number, steps) in cases.into_iter().enumerate() {
        let expected = core.edit(Edit { steps }, Report::Changes).map(|_| ());
        assert!(matches!(expected, Err(SceneError::Edit(_))), "case {number}");
        assert_eq!(
            gpu.edit(Edit { steps }, Report::Changes).map(|_| ()),
            expected,
            "case {number}"
        );
        assert_eq!(gpu.len(), 3);
        assert_eq!(
            Heard::from(gpu.reported()),
            Heard::from(core.reported()),
            "the last answer stays"
        );
    }
    // A refused edit leaves the last answer to be taken.
    core.acknowledge();
    gpu.acknowledge();
    for report in [Report::Changes, Report::All] {
        edit_both(&mut core, &mut gpu, &[], report, "after refused edits");
    }
    assert_eq!(gpu.reported().pairs(), [[0, 1], [1, 2]]);
    let twice = gpu.edit(Edit { steps: cases[5] }, Report::All).map(|_| ());
    assert_eq!(twice, Err(SceneError::Edit(EditError::SetTwice { index: 1 })));
}
