//! A scene in video memory whose device is lost between edits and during them: a typed error, and a scene
//! that is made again from a copy, with the right pairs. Where several devices keep it, it goes on without the one
//! that is lost, and no answer is.

use std::cell::RefCell;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::scene::{Scene, SceneCopy};
use pairmask_tests::gpu::{self, shared_tools};
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::{
    Edits, Fate, Grouped, Heard, Kind, Subject, Turn, hold, options,
};
use pairmaskd::execute::gpu::GpuScene;
use pairmaskd::execute::{Executor, SceneKeeper};
use pairmaskd::scene::Random;

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
            match scene.edit(Edit { steps: &whole.steps() }, Report::Nothing) {
                Ok(()) => {
                    scene.resync();
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

/// Losses of the device, by a thread that destroys it at some time.
struct Losses {
    executor: Executor,
    random: Random,
    destroyer: Option<std::thread::JoinHandle<()>>,
    count: usize,
}

/// A scene on a device that is lost, made again from a copy then.
struct Surviving<'l> {
    losses: &'l RefCell<Losses>,
    copy: SceneCopy,
    scene: SceneKeeper,
}

impl Surviving<'_> {
    /// What is told; nothing where only boxes that a lost scene knew were asked for.
    fn edit(&mut self, edit: Edit<'_>, report: Report) -> Result<Option<Heard>, SceneError> {
        let mut losses = self.losses.borrow_mut();
        if losses.destroyer.is_none()
            && let Some(gpu) = losses.executor.gpu().and_then(|mut gpu| gpu.device())
        {
            let wait = Duration::from_micros(losses.random.below(60_000));
            losses.destroyer = Some(std::thread::spawn(move || {
                std::thread::sleep(wait);
                gpu.destroy();
            }));
        }
        self.copy.check(edit)?;
        self.copy.apply(edit);
        match self.scene.edit(edit, report) {
            Err(SceneError::Cull(CullError::DeviceLost { .. })) => {
                losses.count += 1;
                losses.destroyer.take().map(std::thread::JoinHandle::join).transpose().unwrap();
                // The copy has the edit: what follows is all pairs.
                self.scene = begin(&losses.executor, &self.copy);
                self.scene.edit(Edit::NONE, report)?;
                Ok((report != Report::Moved).then(|| Heard::from(self.scene.reported())))
            }
            edited => edited.map(|()| Some(Heard::from(self.scene.reported()))),
        }
    }
}

impl Subject for Surviving<'_> {
    fn tick(&mut self, turns: &[Turn]) -> Result<Vec<(u64, Option<Heard>)>, String> {
        let mut reported = Vec::new();
        for turn in turns {
            let grouped = Grouped::of(&turn.ops);
            let heard = self.edit(Edit { steps: &grouped.steps() }, turn.mode);
            reported.push((0, heard.map_err(|error| error.to_string())?));
            if turn.fate == Fate::Acknowledged {
                self.scene.acknowledge();
            }
        }
        Ok(reported)
    }

    fn reading_acknowledges(&self) -> bool {
        false
    }

    fn invalidate(&mut self) {
        self.scene.resync();
    }

    fn may_resync(&self) -> bool {
        true
    }
}

fn outlive(most_losses: usize) {
    let executor = gpu::executor(1);
    let losses = Losses { executor, random: Random::new(5), destroyer: None, count: 0 };
    let losses = RefCell::new(losses);
    let mut seed = 110_000;
    while losses.borrow().count < most_losses {
        seed += 100;
        hold(Kind::Small, seed, 40, |script| {
            let copy = SceneCopy::new(options(script).most_boxes);
            let scene = begin(&losses.borrow().executor, &copy);
            // A device that was lost between two scenes is another one by now: no edit would notice.
            let ended = losses.borrow_mut().destroyer.take_if(|destroyer| destroyer.is_finished());
            ended.map(std::thread::JoinHandle::join).transpose().expect("destroyed");
            Surviving { losses: &losses, copy, scene }
        });
    }
    let destroyer = losses.borrow_mut().destroyer.take();
    destroyer.map(std::thread::JoinHandle::join).transpose().expect("destroyed");
}

/// Rounds in which one of the devices of a scene is destroyed while edits and queries go on: all that it answers is
/// compared with a scene of the core.
fn goes_on_without_one_of_its_devices(rounds: u64) {
    let mut random = Random::new(11);
    for round in 0..rounds {
        let tools = shared_tools(2 + (round % 2) as usize);
        let lost = Arc::clone(tools[random.below(tools.len() as u64) as usize].gpu());
        let mut source = Edits::new(round, 500).without_rules();
        let mut core = Scene::new(SceneOptions::default());
        let mut scene = GpuScene::shared(&tools, SceneOptions::default());
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
            let edit = Edit { steps: &grouped.steps() };
            core.edit(edit, Report::Changes).map(drop).expect("a right edit");
            scene.edit(edit, Report::Changes).map(drop).expect("another device has it");
            assert!(Heard::from(scene.reported()) == Heard::from(core.reported()), "round {round}");
            core.acknowledge();
            scene.acknowledge();
            if random.below(3) == 0 {
                core.query(&queries, QueryTags::None, &mut expected).expect("an answer");
                scene.query(&queries, QueryTags::None, &mut found).expect("another device has it");
                assert_eq!(found, expected, "round {round}");
            }
        }
        destroyer.join().expect("destroyed");
        assert_eq!(scene.gpu_count(), tools.len() - 1, "round {round}");
    }
}

#[test]
fn a_shared_scene_goes_on_without_one_of_its_devices() {
    goes_on_without_one_of_its_devices(4);
}

#[test]
#[ignore = "minutes: the nightly tier runs it"]
fn a_shared_scene_goes_on_without_one_of_its_devices_a_hundred_times() {
    goes_on_without_one_of_its_devices(100);
}

#[test]
fn a_shared_scene_ends_with_the_last_of_its_devices() {
    let tools = shared_tools(2);
    let mut scene = GpuScene::shared(&tools, SceneOptions::default());
    let boxes = stress_scenes::named("uniform").boxes(50, 1);
    let steps = [Step::Set(Sets { indices: (0..50).into(), boxes: &boxes })];
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
fn a_keeper_shares_large_scenes() {
    let executor = gpu::executor(2);
    for (n, gpus) in [(1_000u32, 1), (1_000_000, 2)] {
        let boxes = stress_scenes::named("uniform").boxes(n, 5);
        let engine = EngineChoice::Only(EngineName::GpuGrid);
        let (options, share) = (SceneOptions::default(), executor.gpus().for_scene());
        let mut scene = SceneKeeper::new(options, CpuEngines::new(), share, engine).expect("a GPU");
        let mut core = Scene::new(options);
        let all = [Step::Set(Sets { indices: (0..n).into(), boxes: &boxes })];
        let few = [Step::Set(Sets {
            indices: (5..n / 100).into(),
            boxes: &boxes[10..n as usize / 100 + 5],
        })];
        for (steps, report) in [(&all, Report::Nothing), (&few, Report::Moved)] {
            scene.edit(Edit { steps }, report).expect("an answer");
            core.edit(Edit { steps }, report).map(drop).expect("an answer");
        }
        assert_eq!(scene.gpu_count(), gpus, "{n} boxes");
        let (got, expected) = (scene.reported().pairs(), core.reported().pairs());
        assert!(got == expected && !got.is_empty(), "{n} boxes, {} pairs", got.len());
    }
}
