//! Scenes in video memory beside scenes of the core: every answer, edit by edit.

use std::sync::Arc;

use pairmask_core::Aabb;
use pairmask_core::engine::CullError;
use pairmask_core::scene::{
    Edit, EditError, Indices, KeptHistory, Scene, SceneError, SceneOptions, Sets, Step, Told, Want,
};
use pairmask_tests::gpu::open_at;
use pairmask_tests::scene_edits::{EditMaker, EditedScenes, a_seed_of_edits, same_told};
use pairmask_tests::{stress_scenes, tier};
use pairmaskd::execute::gpu::{Checks, GpuScene, GridOptions, HostImport, SceneTools};

fn tools(options: &GridOptions) -> Arc<SceneTools> {
    tools_at(0, options)
}

fn tools_at(place: usize, options: &GridOptions) -> Arc<SceneTools> {
    SceneTools::new(&open_at(place, HostImport::IfPossible), options)
        .unwrap_or_else(|error| panic!("{error}"))
}

/// So many devices that share every search.
fn shared_tools(gpus: usize) -> Vec<Arc<SceneTools>> {
    (0..gpus)
        .map(|at| tools_at(at, &GridOptions { shares_always: true, ..GridOptions::default() }))
        .collect()
}

const WANTS: [Want; 6] =
    [Want::Changes, Want::Changes, Want::Changes, Want::Moved, Want::All, Want::Nothing];

/// A scene of each kind, and what makes their edits.
struct Both<'t> {
    tools: &'t [Arc<SceneTools>],
    seed: u64,
    maker: EditMaker,
    core: Scene,
    gpu: GpuScene,
    edits: usize,
}

impl<'t> Both<'t> {
    fn new(tools: &'t [Arc<SceneTools>], seed: u64, largest: usize) -> Self {
        let options = SceneOptions::default();
        Self {
            tools,
            seed,
            maker: EditMaker::new(seed, largest),
            core: Scene::new(options),
            gpu: GpuScene::shared(tools, options),
            edits: 0,
        }
    }
}

impl EditedScenes for Both<'_> {
    fn maker(&mut self) -> &mut EditMaker {
        &mut self.maker
    }

    fn step(&mut self) {
        let Self { tools, seed, maker, core, gpu, edits } = self;
        let what = format!("seed {seed}, edit {edits}");
        *edits += 1;
        let edit = maker.next_edit();
        let want = WANTS[maker.below(WANTS.len())];
        let way = maker.below(3);
        if maker.one_in(100) {
            core.lose();
            gpu.lose();
        }
        edit.with(way, |edit| {
            let expected = core.edit(edit, want).map(|_| ());
            let got = gpu.edit(edit, want).map(|_| ());
            assert_eq!(got, expected, "{what}");
        });
        same_told(gpu.told(), core.told())
            .unwrap_or_else(|e| panic!("{what}, {want:?}, {} boxes: {e}", core.len()));
        assert_eq!((gpu.len(), gpu.is_empty()), (core.len(), core.is_empty()), "{what}");
        check_skips(gpu.told());
        if !maker.one_in(4) {
            core.take();
            gpu.take();
        }
        // To another keeper and on.
        if maker.one_in(50)
            && let Some(kept) = core.kept()
        {
            *gpu = GpuScene::from_kept(tools, SceneOptions::default(), &kept)
                .unwrap_or_else(|e| panic!("{what}: {e}"));
        }
    }
}

/// Runs random edits on a scene of each kind and compares all that they tell.
fn run(tools: &[Arc<SceneTools>], seed: u64, edits: usize, largest: usize) {
    let mut both = Both::new(tools, seed, largest);
    for _ in 0..edits {
        both.step();
    }
}

/// Twenty seeds of small scenes, each of which grows to a hundred thousand boxes and back once.
#[test]
#[ignore = "hours on a software driver, eight minutes on an H200: the nightly tier runs it"]
fn a_million_edits_over_twenty_seeds() {
    let tools = [tools(&GridOptions::default())];
    let mut all = 0;
    for seed in 1..=20 {
        for (seed, edits, largest) in a_seed_of_edits(seed) {
            run(&tools, seed, edits, largest);
            all += edits;
        }
        let mut both = Both::new(&tools, seed, 100_000);
        all += both.grow_and_shrink(100_000);
        println!("seed {seed}: {all} edits");
    }
    assert!(all >= 1_000_000, "{all} edits");
}

#[test]
fn a_scene_grows_by_random_edits_and_shrinks_again() {
    let tools = [tools(&GridOptions::default())];
    let mut both = Both::new(&tools, 3, 8_000);
    assert!(both.grow_and_shrink(8_000) > 2);
}

/// No pair is counted twice.
fn check_skips(told: &Told) {
    let skips = told.skipped();
    let all = skips.static_pairs + skips.unmoved_pairs + skips.cell_pairs;
    assert!(all <= u64::from(u32::MAX) * u64::from(u32::MAX) / 2, "{skips:?}");
}

#[test]
fn answers_are_those_of_the_core() {
    let tools = [tools(&GridOptions::default())];
    for seed in 0..6 {
        run(&tools, seed, 250, 300);
    }
}

#[test]
fn answers_of_larger_scenes_are_those_of_the_core() {
    let tools = [tools(&GridOptions::default())];
    for seed in 20..22 {
        run(&tools, seed, 80, 20_000);
    }
}

#[test]
fn answers_are_the_same_with_checked_stages_and_poisoned_memory() {
    run(&[tools(&GridOptions { checks: Checks::On, ..GridOptions::default() })], 40, 150, 400);
    for word in [0xa5a5_a5a5, u32::MAX] {
        run(&[tools(&GridOptions { poison: Some(word), ..GridOptions::default() })], 41, 150, 400);
    }
}

/// All boxes of each scene are set, moved a little, moved far, and removed.
#[test]
fn every_hard_scene_is_told_as_the_core_tells_it() {
    let tools = [tools(&GridOptions::default())];
    check_hard_scenes(&tools, &[0, 23, 46, 69, 345, 1_234]);
}

/// Boxes on borders of shares, across them, that end there, giants and empty ones: cells go to GPUs in stretches,
/// so most scenes have some of each.
#[test]
#[ignore = "slow: the nightly tier runs it"]
fn every_hard_scene_is_told_by_several_gpus_as_by_the_core() {
    check_hard_scenes(&shared_tools(3), &[2, 70, 1_234]);
}

#[test]
fn answers_of_several_gpus_are_those_of_the_core() {
    for gpus in [2, 4] {
        let tools = shared_tools(gpus);
        run(&tools, 50 + gpus as u64, 150, 400);
        run(&tools, 60 + gpus as u64, 20, 20_000);
    }
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
                for want in [Want::Changes, Want::All, Want::Moved] {
                    let steps = if want == Want::Changes { &steps[..] } else { &[] };
                    core.edit(Edit { steps }, want).expect("an answer");
                    let got = gpu.edit(Edit { steps }, want).map(|_| ());
                    let what = format!("{scene:?}, {n} boxes, edit {number}, {want:?}");
                    got.unwrap_or_else(|e| panic!("{what}: {e}"));
                    same_told(gpu.told(), core.told()).unwrap_or_else(|e| panic!("{what}: {e}"));
                    core.take();
                    gpu.take();
                }
            }
        }
    }
}

#[test]
fn a_scene_grows_and_shrinks() {
    let tools = tools(&GridOptions::default());
    let mut core = Scene::new(SceneOptions::default());
    let mut gpu = GpuScene::new(&tools, SceneOptions::default());
    let uniform = stress_scenes::named("uniform");
    let mut held = 0;
    for target in [1u32, 10, 700, 7_000, 20_000, 6_500, 64, 1, 0, 30] {
        for round in 0..3 {
            let boxes = uniform.boxes(target, u64::from(target + round));
            let steps = [
                Step::Remove((target.min(held)..held).into()),
                Step::Set(Sets { indices: (0..target).into(), boxes: &boxes }),
            ];
            let want = if round == 1 { Want::Moved } else { Want::Changes };
            core.edit(Edit { steps: &steps }, want).expect("an answer");
            gpu.edit(Edit { steps: &steps }, want).expect("an answer");
            same_told(gpu.told(), core.told()).unwrap_or_else(|e| panic!("{target} boxes: {e}"));
            core.take();
            gpu.take();
            held = target;
        }
    }
    assert!(gpu.video_bytes() > 0 && gpu.allocated_bytes() < 16 << 20);
}

/// Records that are made anew have no names of boxes: an edit that asks for moved pairs finds them all the same.
#[test]
fn moved_pairs_are_told_where_records_are_made_anew() {
    let uniform = stress_scenes::named("uniform");
    for tools in [vec![tools(&GridOptions::default())], shared_tools(3)] {
        let mut core = Scene::new(SceneOptions::default());
        let mut gpu = GpuScene::shared(&tools, SceneOptions::default());
        // Room for 4,096 records, for some more, for 140,000, and for few again.
        for (round, n) in [100u32, 5_000, 90, 140_000, 60, 70].into_iter().enumerate() {
            let boxes = uniform.boxes(n, round as u64);
            let steps = [
                Step::Remove((n.min(core.len() as u32)..core.len() as u32).into()),
                Step::Set(Sets { indices: (0..n).into(), boxes: &boxes }),
            ];
            core.edit(Edit { steps: &steps }, Want::Moved).expect("an answer");
            gpu.edit(Edit { steps: &steps }, Want::Moved).expect("an answer");
            same_told(gpu.told(), core.told()).unwrap_or_else(|e| panic!("{n} boxes: {e}"));
            assert!(n < 1_000 || core.told().pairs().len() > 1_000);
        }
    }
}

/// Lists of indices below and above 1 MiB lie in different blocks where video memory is mapped: a recording that
/// binds one of them serves no edit whose list lies in the other. So large a search zeroes so much that all these
/// edits take as many workgroups.
#[test]
#[ignore = "half a minute on a software driver: the nightly tier runs it"]
fn long_and_short_lists_take_turns() {
    let tools = tools(&GridOptions::default());
    let uniform = stress_scenes::named("uniform");
    let n = 900_000u32;
    let mut core = Scene::new(SceneOptions::default());
    let mut gpu = GpuScene::new(&tools, SceneOptions::default());
    let mut check = |steps: &[Step<'_>], what: u32| {
        core.edit(Edit { steps }, Want::All).expect("an answer");
        gpu.edit(Edit { steps }, Want::All).expect("an answer");
        same_told(gpu.told(), core.told()).unwrap_or_else(|e| panic!("{what} boxes: {e}"));
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
            core.edit(Edit { steps }, Want::Changes).expect("an answer");
            gpu.edit(Edit { steps }, Want::Changes).expect("an answer");
            same_told(gpu.told(), core.told()).unwrap_or_else(|e| panic!("{e}"));
            core.take();
            gpu.take();
        }
    }
}

#[test]
fn scenes_of_every_small_size_are_told_and_ended() {
    let tools = tools(&GridOptions::default());
    for n in tier::small_sizes() {
        let boxes: Vec<Aabb> = (0..n)
            .map(|i| {
                let [x, y] = [i % 7, i / 7].map(|x| 0.9 * x as f32);
                Aabb::from([x, y, 0.0, x + 1.0, y + 1.0, 1.0])
            })
            .collect();
        let moved: Vec<Aabb> = boxes
            .iter()
            .map(|b| Aabb { min: b.min.map(|x| 1.1 * x), max: b.max.map(|x| 1.1 * x) })
            .collect();
        let mut core = Scene::new(SceneOptions::default());
        let mut gpu = GpuScene::new(&tools, SceneOptions::default());
        for steps in [
            [Step::Set(Sets { indices: (0..n).into(), boxes: &boxes })],
            [Step::Set(Sets { indices: (0..n).into(), boxes: &moved })],
            [Step::Remove((0..n / 2).into())],
            [Step::Set(Sets { indices: (0..n).into(), boxes: &boxes })],
            [Step::Static((0..n).into(), true)],
            [Step::Switch((0..n / 3).into(), false)],
            [Step::Remove((0..n).into())],
        ] {
            core.edit(Edit { steps: &steps }, Want::Changes).expect("an answer");
            gpu.edit(Edit { steps: &steps }, Want::Changes).expect("an answer");
            same_told(gpu.told(), core.told()).unwrap_or_else(|e| panic!("{n} boxes: {e}"));
            core.take();
            gpu.take();
        }
    }
}

/// Boxes that crowd one place, that cover all of it, and that have no end.
#[test]
fn crowds_are_told_as_the_core_tells_them() {
    let tools = tools(&GridOptions::default());
    let all = Aabb { min: [f32::NEG_INFINITY; 3], max: [f32::INFINITY; 3] };
    let one = Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]);
    let far = Aabb::from([7.0, 7.0, 7.0, 8.0, 8.0, 8.0]);
    let n = 1_500u32;
    for crowd in [one, all, Aabb::from([-3e38, 0.0, 0.0, 3e38, 1.0, 1.0])] {
        let mut core = Scene::new(SceneOptions::default());
        let mut gpu = GpuScene::new(&tools, SceneOptions::default());
        let (crowds, few) = (vec![crowd; n as usize], [3u32, 4, 700, 1_499]);
        for steps in [
            [Step::Set(Sets { indices: (0..n).into(), boxes: &crowds })],
            [Step::Set(Sets { indices: (&few).into(), boxes: &[far; 4] })],
            [Step::Set(Sets { indices: (&few).into(), boxes: &[one, all, one, all] })],
            [Step::Remove((&few).into())],
        ] {
            for want in [Want::Changes, Want::Moved] {
                core.edit(Edit { steps: &steps }, want).expect("an answer");
                gpu.edit(Edit { steps: &steps }, want).expect("an answer");
                same_told(gpu.told(), core.told()).unwrap_or_else(|e| panic!("{crowd:?}: {e}"));
                core.take();
                gpu.take();
                if matches!(steps, [Step::Remove(_)]) {
                    break;
                }
            }
        }
    }
}

#[test]
fn a_dropped_scene_gives_its_memory_back() {
    let tools = tools(&GridOptions::default());
    let holders = Arc::strong_count(tools.gpu());
    let mut gpu = GpuScene::new(&tools, SceneOptions::default());
    let boxes = stress_scenes::named("uniform").boxes(1_000, 3);
    let steps = [Step::Set(Sets { indices: (0..1_000).into(), boxes: &boxes })];
    for want in [Want::Changes, Want::Moved, Want::All] {
        gpu.edit(Edit { steps: &steps }, want).expect("an answer");
    }
    assert!(Arc::strong_count(tools.gpu()) > holders, "blocks and frames hold the device");
    drop(gpu);
    assert_eq!(Arc::strong_count(tools.gpu()), holders);
}

#[test]
fn a_scene_that_has_told_nothing_goes_on_on_the_gpu() {
    let tools = tools(&GridOptions::default());
    let boxes = stress_scenes::named("uniform").boxes(500, 4);
    let all = [Step::Set(Sets { indices: (0..500).into(), boxes: &boxes })];
    let mut core = Scene::new(SceneOptions::default());
    core.edit(Edit { steps: &all }, Want::Nothing).expect("an answer");
    let some = [Step::Remove((10..60).into()), Step::Static((100..200).into(), true)];
    core.edit(Edit { steps: &some }, Want::Nothing).expect("an answer");
    let kept = core.kept().expect("nothing was told");
    assert_eq!(kept.history(), KeptHistory::Untold);
    let mut gpu = GpuScene::from_kept(&[tools], SceneOptions::default(), &kept).expect("a scene");
    let told = gpu.edit(Edit::NONE, Want::Changes).expect("an answer");
    same_told(told, core.edit(Edit::NONE, Want::Changes).expect("an answer")).expect("the same");
    // Its pairs may be taken by now: another keeper would tell them again.
    assert!(told.begun().len() > 10 && core.kept().is_none());
    core.take();
    let kept = core.kept().expect("it was taken");
    assert_eq!(kept.history(), KeptHistory::Told(told.begun().len() as u64));
}

#[test]
fn a_lost_device_and_memory_that_is_not_to_be_had_are_errors() {
    let tools = tools(&GridOptions::default());
    let mut gpu = GpuScene::new(&tools, SceneOptions::default().with_most_boxes(1 << 29));
    let slots = tools.gpu().limits().storage_binding_bytes / 32 + 1;
    if let Ok(index) = u32::try_from(slots)
        && index < 1 << 26
    {
        let indices = [index];
        let steps = [Step::Set(Sets { indices: (&indices).into(), boxes: &[Aabb::EMPTY] })];
        let refused = gpu.edit(Edit { steps: &steps }, Want::Changes).map(|_| ());
        assert!(
            matches!(refused, Err(SceneError::Cull(CullError::DeviceMemory { .. }))),
            "{refused:?}"
        );
    }
    let mut gpu = GpuScene::new(&tools, SceneOptions::default());
    tools.gpu().destroy();
    let steps = [Step::Set(Sets { indices: (0..1).into(), boxes: &[Aabb::EMPTY] })];
    let lost = gpu.edit(Edit { steps: &steps }, Want::Changes).map(|_| ());
    assert!(matches!(lost, Err(SceneError::Cull(CullError::DeviceLost { .. }))), "{lost:?}");
}

/// A scene of each kind with three boxes in a row, each touching the next.
fn rows(tools: &Arc<SceneTools>) -> (Scene, GpuScene) {
    let options = SceneOptions::default().with_most_boxes(100);
    let (mut core, mut gpu) = (Scene::new(options), GpuScene::new(tools, options));
    let boxes = [0.0f32, 0.8, 1.6].map(|x| Aabb::from([x, 0.0, 0.0, x + 1.0, 1.0, 1.0]));
    let steps = [Step::Set(Sets { indices: (0..3).into(), boxes: &boxes })];
    core.edit(Edit { steps: &steps }, Want::Changes).expect("an answer");
    gpu.edit(Edit { steps: &steps }, Want::Changes).expect("an answer");
    (core, gpu)
}

#[test]
fn wrong_edits_are_refused_as_by_the_core_and_change_nothing() {
    let (mut core, mut gpu) = rows(&tools(&GridOptions::default()));
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
        let expected = core.edit(Edit { steps }, Want::Changes).map(|_| ());
        assert!(matches!(expected, Err(SceneError::Edit(_))), "case {number}");
        assert_eq!(gpu.edit(Edit { steps }, Want::Changes).map(|_| ()), expected, "case {number}");
        assert_eq!(gpu.len(), 3);
        same_told(gpu.told(), core.told()).expect("the last answer stays");
    }
    // A refused edit leaves the last answer to be taken.
    core.take();
    gpu.take();
    for want in [Want::Changes, Want::All] {
        core.edit(Edit::NONE, want).expect("an answer");
        gpu.edit(Edit::NONE, want).expect("an answer");
        same_told(gpu.told(), core.told()).expect("the same");
    }
    assert_eq!(gpu.told().pairs(), [[0, 1], [1, 2]]);
    let twice = gpu.edit(Edit { steps: cases[5] }, Want::All).map(|_| ());
    assert_eq!(twice, Err(SceneError::Edit(EditError::SetTwice { index: 1 })));
}

#[test]
fn the_comparator_notices_what_differs() {
    let (mut core, mut gpu) = rows(&tools(&GridOptions::default()));
    same_told(gpu.told(), core.told()).expect("the same");
    gpu.take();
    gpu.edit(Edit::NONE, Want::Changes).expect("an answer");
    assert!(same_told(gpu.told(), core.told()).is_err(), "two pairs are missing");
    let off = [Step::Switch((&[2]).into(), false)];
    core.take();
    core.edit(Edit { steps: &off }, Want::Changes).expect("an answer");
    assert!(same_told(gpu.told(), core.told()).is_err(), "an end is missing");
    let gone = [Step::Remove((&[2]).into())];
    gpu.edit(Edit { steps: &gone }, Want::Changes).expect("an answer");
    assert_eq!(gpu.told().ended().len(), core.told().ended().len());
    assert!(same_told(gpu.told(), core.told()).is_err(), "another reason");
    gpu.edit(Edit::NONE, Want::All).expect("an answer");
    assert!(same_told(gpu.told(), core.told()).is_err(), "another answer");
}
