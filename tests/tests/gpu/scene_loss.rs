//! Scenes in video memory that several devices keep, of which one is lost between edits and during them: they go on
//! without it, and no answer is lost. What a session receives whose daemon loses its only device is in `isolated`.

use std::sync::Arc;
use std::time::Duration;

use pairmask_core::scene::Scene;
use pairmask_tests::gpu::{self, shared_tools};
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::{BesideCore, Edits, Grouped};
use pairmaskd::execute::SceneHost;
use pairmaskd::execute::gpu::GpuScene;
use pairmaskd::scene::Random;

/// Rounds in which one of the devices of a scene is destroyed while edits and queries go on: all that it answers is
/// compared with a scene of the core.
#[test]
fn a_shared_scene_goes_on_without_one_of_its_devices() {
    let mut random = Random::new(11);
    for round in 0..tier::nightly_or(100, 4) {
        let tools = shared_tools(2 + (round % 2) as usize);
        let lost = Arc::clone(tools[random.below(tools.len() as u64) as usize].gpu());
        let mut source = Edits::new(round, 500).without_rules();
        let mut both = BesideCore::new(&tools);
        let queries = stress_scenes::named("uniform").boxes(40, round);
        let (mut found, mut expected) = (Vec::new(), Vec::new());
        let wait = Duration::from_micros(random.below(60_000));
        let destroyer = std::thread::spawn(move || {
            std::thread::sleep(wait);
            lost.destroy();
        });
        let mut after = 0;
        while after < 5 {
            after += usize::from(destroyer.is_finished());
            let ops = source.next_edit();
            let grouped = Grouped::of(&ops);
            both.edit(&grouped.steps(), Report::Changes, "another device has it");
            both.acknowledge();
            if random.below(3) == 0 {
                let BesideCore { core, gpu } = &mut both;
                core.query(&queries, QueryFilterData::None, &mut expected).expect("an answer");
                gpu.query(&queries, QueryFilterData::None, &mut found)
                    .expect("another device has it");
                assert_eq!(found, expected, "round {round}");
            }
        }
        destroyer.join().expect("destroyed");
        assert_eq!(both.gpu.gpu_count(), tools.len() - 1, "round {round}");
    }
}

#[test]
fn a_shared_scene_ends_with_the_last_of_its_devices() {
    let tools = shared_tools(2);
    let mut scene = GpuScene::shared(&tools, SceneOptions::default());
    let boxes = stress_scenes::named("uniform").boxes(50, 1);
    let steps = [sets(0..50, &boxes)];
    scene.edit(Edit { steps: &steps }, Report::All).map(drop).expect("an answer");
    for tools in &tools {
        tools.gpu().destroy();
    }
    let lost = scene.edit(Edit { steps: &steps }, Report::All).map(drop);
    assert!(matches!(lost, Err(SceneError::Cull(CullError::DeviceLost { .. }))), "{lost:?}");
}

/// Large scenes are on all GPUs of a daemon, small ones on one.
#[test]
#[ignore = "slow: the nightly tier runs it"]
fn a_scene_host_shares_large_scenes() {
    let executor = gpu::executor(2);
    for (n, gpus) in [(1_000u32, 1), (1_000_000, 2)] {
        let boxes = stress_scenes::named("uniform").boxes(n, 5);
        let engine = EngineChoice::Only(EngineName::GpuGrid);
        let (options, share) = (SceneOptions::default(), executor.gpus().for_scene());
        let mut scene = SceneHost::new(options, CpuEngines::new(), share, engine).expect("a GPU");
        let mut core = Scene::new(options);
        let all = [sets(0..n, &boxes)];
        let few = [sets(5..n / 100, &boxes[10..n as usize / 100 + 5])];
        for (steps, report) in [(&all, Report::Nothing), (&few, Report::Moved)] {
            scene.edit(Edit { steps }, report).expect("an answer");
            core.edit(Edit { steps }, report).map(drop).expect("an answer");
        }
        assert_eq!(scene.gpu_count(), gpus, "{n} boxes");
        let (got, expected) = (scene.reported().pairs(), core.reported().pairs());
        assert!(got == expected && !got.is_empty(), "{n} boxes, {} pairs", got.len());
    }
}
