//! A scene of a session that a daemon keeps in video memory, whose device is lost between edits and during
//! them: what the client was told adds up to the pairs of now, and it sends nothing again itself.
//!
//! The daemon's worker is a thread of this process, because only a process that has a device can lose it.

use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use pairmask::scene::{Edit, SceneOptions, Want};
use pairmask::{
    Aabb, Backend, EngineChoice, EngineId, EngineName, Scene, SceneEdit, ServedBy, Session,
    WaitError,
};
use pairmask_core::engine::AvailableIsa;
use pairmask_core::scene as core_scene;
use pairmask_tests::daemon::eventually;
use pairmask_tests::scene_edits::EditMaker;
use pairmask_tests::{KnownPairs, gpu, oracle, stress_scenes};
use pairmask_transport::{Limits, RuntimeDir, clean_if_abandoned};
use pairmask_wire::{ENGINE_IS_OPENING, InstanceName, ReplyError, StatusCode};
use pairmaskd::audit::AuditRate;
use pairmaskd::execute::WatchDevice;
use pairmaskd::execute::gpu::Gpu;
use pairmaskd::scene::Random;
use pairmaskd::serve::{ServeError, ServeSettings, work};
use pairmaskd::spawn::is_opening_gpus;
use rustix::process::{Signal, getpid, kill_process};

const MOST_BOXES: usize = 400;

/// The device that was opened last, until it is taken to be lost.
static OPENED: Mutex<Option<Arc<Gpu>>> = Mutex::new(None);

fn note_device(gpu: &Arc<Gpu>) {
    *OPENED.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(gpu));
}

/// Whether devices may be opened.
static GATE: (Mutex<bool>, Condvar) = (Mutex::new(false), Condvar::new());

/// Keeps a device from being open.
fn wait_at_gate(_: &Arc<Gpu>) {
    let is_open = GATE.0.lock().unwrap_or_else(PoisonError::into_inner);
    drop(GATE.1.wait_while(is_open, |is_open| !*is_open));
}

fn open_gate() {
    *GATE.0.lock().unwrap_or_else(PoisonError::into_inner) = true;
    GATE.1.notify_all();
}

fn newest_device() -> Option<Arc<Gpu>> {
    OPENED.lock().unwrap_or_else(PoisonError::into_inner).take()
}

/// A worker in a thread of this process.
struct Worker {
    dir: tempfile::TempDir,
    thread: std::thread::JoinHandle<Result<(), ServeError>>,
}

impl Worker {
    fn start() -> Self {
        let worker = Self::start_watched(note_device);
        eventually("the GPU joins", || (!worker.is_opening()).then_some(()));
        worker
    }

    /// One that serves, whether its GPU has joined or not.
    fn start_watched(watch: WatchDevice) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let settings = ServeSettings {
            audit: AuditRate::Off,
            alter_answers: None,
            watch_devices: Some(watch),
            restarted: false,
            instance: InstanceName::default(),
            dir: RuntimeDir::at(dir.path()),
            limits: Limits::default(),
            spin: Duration::from_micros(50),
            gpu: gpu::choice().into(),
            gpu_awake: Duration::ZERO,
            isa: AvailableIsa::best(),
        };
        let thread = std::thread::spawn(move || {
            let parent = rustix::process::getppid().expect("a parent").as_raw_nonzero().get();
            work(&settings, parent as u32)
        });
        let worker = Self { dir, thread };
        eventually("the daemon serves", || worker.dir().read_record(&InstanceName::default()));
        worker
    }

    fn is_opening(&self) -> bool {
        is_opening_gpus(&self.dir(), &InstanceName::default())
    }

    fn dir(&self) -> RuntimeDir {
        RuntimeDir::at(self.dir.path())
    }

    fn stop(self) {
        kill_process(getpid(), Signal::TERM).unwrap();
        let dir = self.dir();
        self.thread.join().unwrap().unwrap();
        clean_if_abandoned(&dir, &InstanceName::default()).unwrap();
    }
}

/// A scene of a session, what its client knows, and what has to come of it.
struct Client {
    scene: Scene,
    source: EditMaker,
    truth: core_scene::Scene,
    known: KnownPairs,
}

impl Client {
    fn new(session: &mut Session, seed: u64) -> Self {
        let options = SceneOptions::default();
        Self {
            scene: session.scene(options),
            source: EditMaker::new(seed, MOST_BOXES),
            truth: core_scene::Scene::new(options),
            known: KnownPairs::default(),
        }
    }

    /// An edit, its answer taken into what is known, and what is known compared with all pairs. Whether the
    /// daemon's GPU answered.
    fn step(&mut self, between: impl FnOnce()) -> bool {
        let Self { scene, source, truth, known } = self;
        let owned = source.next_edit();
        let arrays = owned.arrays(source.below(3));
        let steps = arrays.steps();
        let edit = steps.iter().copied().fold(scene.edit(), SceneEdit::step);
        let pending = edit.submit(Want::Changes).unwrap();
        between();
        let answer = pending.wait().unwrap().take();
        known.tell(&answer).unwrap();
        let all = truth.edit(Edit { steps: &steps }, Want::All).unwrap();
        known.compare(all.pairs()).unwrap();
        answer.served_by() == ServedBy::Daemon && answer.engine() == EngineName::GpuGrid
    }
}

fn outlive(losses: u64, seed: u64) {
    let _alone = crate::alone();
    let worker = Worker::start();
    let mut session = Session::builder()
        .runtime_dir(worker.dir())
        .backend(Backend::Auto)
        .engine(EngineChoice::Only(EngineName::GpuGrid))
        .connect()
        .unwrap();
    let mut client = Client::new(&mut session, seed);
    let mut random = Random::new(seed);
    let mut by_gpu = 0;
    for loss in 0..losses {
        // One in four is lost as soon as it is there, whether the scene has come back or not.
        if loss % 4 != 3 {
            eventually("the scene comes back to the GPU", || {
                let is_there = client.step(|| {});
                std::thread::sleep(Duration::from_millis(2));
                is_there.then_some(())
            });
        }
        let gpu = eventually("a device", || {
            by_gpu += u64::from(client.step(|| {}));
            newest_device()
        });
        for _ in 0..random.below(6) {
            by_gpu += u64::from(client.step(|| {}));
        }
        let wait = Duration::from_micros(random.below(6_000));
        match loss % 3 {
            0 => {
                // While the daemon has an edit.
                client.step(|| {
                    std::thread::sleep(wait);
                    gpu.destroy();
                });
            }
            1 => {
                // While edits come one after the other.
                let destroyer = std::thread::spawn(move || {
                    std::thread::sleep(10 * wait);
                    gpu.destroy();
                });
                let start = Instant::now();
                while start.elapsed() <= 10 * wait || !destroyer.is_finished() {
                    client.step(|| {});
                }
                destroyer.join().unwrap();
            }
            _ => {
                gpu.destroy();
                client.step(|| {});
            }
        }
    }
    assert!(by_gpu >= losses / 2, "{by_gpu} edits by the GPU for {losses} losses");
    drop((client, session));
    worker.stop();
}

#[test]
fn a_session_outlives_losses_of_the_daemons_device() {
    outlive(4, 1);
}

#[test]
#[ignore = "minutes: the nightly tier runs it"]
fn a_session_outlives_a_hundred_losses_of_the_daemons_device() {
    outlive(100, 2);
}

/// Frames of a session, by whatever engine the daemon has for it.
fn frame(session: &mut Session, boxes: &[Aabb]) -> Result<EngineId, WaitError> {
    let mut frame = session.frame(boxes.len()).unwrap();
    frame.boxes_mut().copy_from_slice(boxes);
    let mask = frame.submit().unwrap().wait()?;
    assert_eq!(mask.info().served_by, ServedBy::Daemon);
    assert_eq!(mask.count(), oracle::truth(boxes).pairs.len() as u64);
    Ok(mask.info().engine)
}

#[test]
fn cores_serve_while_the_gpu_is_being_opened() {
    let _alone = crate::alone();
    let worker = Worker::start_watched(wait_at_gate);
    let builder = Session::builder().runtime_dir(worker.dir()).backend(Backend::Daemon);
    let gpu = EngineName::GpuBrute;
    let boxes = stress_scenes::named("uniform").boxes(700, 3);
    let mut any = builder.clone().answer_repeats(false).connect().unwrap();
    let mut only = builder.engine(EngineChoice::Only(gpu)).connect().unwrap();
    for _ in 0..3 {
        let by = frame(&mut any, &boxes).unwrap();
        assert!(matches!(by, EngineId::Known(name) if !name.is_gpu()), "{by:?}");
        let refused = frame(&mut only, &boxes).unwrap_err();
        let WaitError::Reply(ReplyError::Status { status, detail }) = refused else {
            panic!("{refused}");
        };
        assert_eq!((status, detail[1]), (StatusCode::EngineUnavailable, ENGINE_IS_OPENING));
        assert!(refused.to_string().contains("being opened"), "{refused}");
        let mut scene = only.scene(SceneOptions::default());
        let refused = scene.edit().set(0, boxes[0]).commit(Want::All).map(drop).unwrap_err();
        assert!(refused.to_string().contains("being opened"), "{refused}");
        assert!(worker.is_opening());
    }
    open_gate();
    let by = eventually("the GPU joins", || frame(&mut only, &boxes).ok());
    assert_eq!(by, EngineId::Known(gpu));
    eventually("the status says so", || (!worker.is_opening()).then_some(()));
    drop((any, only));
    worker.stop();
}
