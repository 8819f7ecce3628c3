//! A scene in video memory whose device is lost between edits and during them: a typed error, and a scene
//! that is made again from a copy, with the right pairs.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::dispatch::CpuEngines;
use pairmask_core::engine::{CullError, EngineChoice, EngineName};
use pairmask_core::scene::{Edit, PairScene, Scene, SceneCopy, SceneError, SceneOptions, Want};
use pairmask_tests::KnownPairs;
use pairmask_tests::scene_edits::{EditMaker, SKIPPED};
use pairmaskd::execute::gpu::GpuChoice;
use pairmaskd::execute::{Executor, GpuService, SceneKeeper};
use pairmaskd::scene::Random;

const MOST_BOXES: usize = 500;
/// A watchdog, no measure of speed: opening a software device takes under a second.
const GIVE_UP: Duration = Duration::from_secs(60);

/// A scene on the device of now, made from a copy, as soon as there is a device.
fn begin(executor: &Executor, copy: &SceneCopy) -> SceneKeeper {
    let deadline = Instant::now() + GIVE_UP;
    loop {
        let engine = EngineChoice::Only(EngineName::GpuGrid);
        let (options, share) = (SceneOptions::default(), executor.gpus().for_scene());
        let scene = SceneKeeper::new(options, CpuEngines::new(), share, engine);
        let made = scene.and_then(|mut scene| {
            let whole = copy.whole();
            match scene.edit(Edit { steps: &whole.steps() }, Want::Nothing) {
                Ok(()) => {
                    scene.lose();
                    Ok(scene)
                }
                Err(SceneError::Cull(error)) => Err(error),
                Err(error) => panic!("{error}"),
            }
        });
        match made {
            Ok(scene) => return scene,
            Err(CullError::DeviceLost { .. } | CullError::Unavailable { .. }) => {}
            Err(error) => panic!("{error}"),
        }
        assert!(Instant::now() < deadline, "the device did not come back");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn a_scene_outlives_the_loss_of_its_device() {
    outlive(4);
}

#[test]
#[ignore = "minutes: the nightly tier runs it"]
fn a_scene_outlives_a_hundred_losses_of_its_device() {
    outlive(100);
}

fn outlive(most_losses: usize) {
    let service = GpuService::open(&GpuChoice::Software, Duration::ZERO).expect("a GPU");
    let executor = Executor::new(Some(service));
    let device = || executor.gpu().and_then(|mut gpu| gpu.device());
    let mut random = Random::new(5);
    let (mut source, mut known) = (EditMaker::new(9, MOST_BOXES), KnownPairs::default());
    let mut truth = Scene::new(SceneOptions::default());
    let mut copy = SceneCopy::new(MOST_BOXES as u32 + SKIPPED);
    let mut scene = begin(&executor, &copy);
    let mut losses = 0;
    let mut destroyer = None;
    while losses < most_losses {
        if destroyer.is_none() {
            let gpu = device().expect("a device");
            let wait = Duration::from_micros(random.below(60_000));
            destroyer = Some(std::thread::spawn(move || {
                std::thread::sleep(wait);
                Arc::clone(&gpu).destroy();
            }));
        }
        let owned = source.next_edit();
        let arrays = owned.arrays(source.below(3));
        let steps = arrays.steps();
        let edit = Edit { steps: &steps };
        copy.check(edit).expect("a right edit");
        copy.apply(edit);
        match scene.edit(edit, Want::Changes).map(drop) {
            Ok(()) => {}
            Err(SceneError::Cull(CullError::DeviceLost { .. })) => {
                losses += 1;
                destroyer.take().map(std::thread::JoinHandle::join).expect("one").expect("done");
                // The copy has the edit: what follows is all pairs.
                scene = begin(&executor, &copy);
                scene.edit(Edit::NONE, Want::Changes).map(drop).expect("a new device");
            }
            Err(error) => panic!("{error}"),
        }
        let told = scene.told();
        if told.is_resync() {
            known.resync(told.pairs().iter().copied());
        } else {
            let changed = known.change(told.begun().iter().copied(), told.ended().iter().copied());
            changed.expect("each change once");
        }
        scene.take();
        let all = truth.edit(edit, Want::All).expect("a right edit");
        known.compare(all.pairs()).expect("what was told adds up");
    }
}
