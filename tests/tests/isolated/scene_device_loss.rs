//! A scene of a session that a daemon keeps in video memory, whose device is lost between edits and during
//! them: what the client received adds up to the pairs of now, and it sends nothing again itself.
//!
//! The daemon's worker is a thread of this process, because only a process that has a device can lose it.

use std::cell::{Cell, RefCell};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

use pairmask_core::engine::EngineId;
use pairmask_tests::gpu;
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::{Kind, Moment, SessionScene, hold};
use pairmask_transport::RuntimeDir;
use pairmask_wire::{ENGINE_IS_OPENING, InstanceName, ReplyError, StatusCode};
use pairmaskd::execute::WatchDevice;
use pairmaskd::execute::gpu::Gpu;
use pairmaskd::scene::Random;
use pairmaskd::serve::{ServeError, ServeSettings};
use pairmaskd::spawn::is_opening_gpus;
use rustix::process::{getpid, kill_process};

/// The device that was opened last, until it is taken to be lost.
static OPENED: Mutex<Option<Arc<Gpu>>> = Mutex::new(None);

fn note_device(gpu: &Arc<Gpu>) {
    *OPENED.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(gpu));
}

/// Whether devices may be opened.
static BARRIER: (Mutex<bool>, Condvar) = (Mutex::new(false), Condvar::new());

fn wait_at_barrier(_: &Arc<Gpu>) {
    let is_open = BARRIER.0.lock().unwrap_or_else(PoisonError::into_inner);
    drop(BARRIER.1.wait_while(is_open, |is_open| !*is_open));
}

fn open_barrier() {
    *BARRIER.0.lock().unwrap_or_else(PoisonError::into_inner) = true;
    BARRIER.1.notify_all();
}

fn newest_device() -> Option<Arc<Gpu>> {
    OPENED.lock().unwrap_or_else(PoisonError::into_inner).take()
}

struct Worker {
    dir: tempfile::TempDir,
    thread: std::thread::JoinHandle<Result<(), ServeError>>,
}

impl Worker {
    fn start() -> Self {
        let worker = Self::start_watched(note_device);
        until("the GPU joins", || !worker.is_opening());
        worker
    }

    /// One that serves, whether its GPU has joined or not.
    fn start_watched(watch: WatchDevice) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let mut settings =
            ServeSettings { watch_devices: Some(watch), ..crate::settings(dir.path()) };
        settings.daemon.gpu = gpu::choice().into();
        let thread = std::thread::spawn(move || crate::serve(&settings));
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
        self.thread.join().unwrap().unwrap();
    }
}

#[test]
fn a_session_outlives_losses_of_the_daemons_device() {
    let (losses, mut seed) = (tier::nightly_or(100, 4), 1_000);
    let _alone = crate::alone();
    let worker = Worker::start();
    let mut session = Session::builder()
        .runtime_dir(worker.dir())
        .backend(Backend::Auto)
        .engine(EngineChoice::Only(EngineName::GpuGrid))
        .connect()
        .unwrap();
    let random = RefCell::new(Random::new(1));
    let below = |end| random.borrow_mut().below(end);
    let (lost, by_gpu) = (Cell::new(0), Cell::new(0));
    while lost.get() < losses {
        seed += 100;
        hold(Kind::Small, seed, 100, |script| {
            SessionScene::disturbed(&mut session, script, |moment| {
                let wait = Duration::from_micros(below(6_000));
                let destroy = |wait: Duration| {
                    if let Some(gpu) = newest_device() {
                        lost.set(lost.get() + 1);
                        // While the daemon has an edit, between two, or while edits come one after the other.
                        let later = move || {
                            std::thread::sleep(wait);
                            gpu.destroy();
                        };
                        if below(3) == 0 { drop(std::thread::spawn(later)) } else { later() }
                    }
                };
                match moment {
                    Moment::UnderWay if below(20) == 0 => destroy(wait),
                    Moment::UnderWay => {}
                    Moment::Answered(ServedBy::Daemon, engine) if engine == EngineName::GpuGrid => {
                        by_gpu.set(by_gpu.get() + 1);
                        if below(20) == 0 {
                            destroy(10 * wait);
                        }
                    }
                    Moment::Answered(..) => std::thread::sleep(Duration::from_millis(2)),
                }
            })
        });
    }
    let by_gpu = by_gpu.get();
    assert!(by_gpu >= losses / 2, "{by_gpu} edits by the GPU for {losses} losses");
    drop(session);
    worker.stop();
}

/// Frames of a session, by any engine that the daemon has for it.
fn frame(session: &mut Session, boxes: &[Aabb]) -> Result<EngineId, Error> {
    let mask = session.ask(boxes).wait()?;
    assert_eq!(mask.info().served_by, ServedBy::Daemon);
    assert_eq!(mask.count(), oracle::truth(boxes).pairs.len() as u64);
    Ok(mask.info().engine)
}

#[test]
fn cores_serve_while_the_gpu_is_being_opened() {
    let _alone = crate::alone();
    let worker = Worker::start_watched(wait_at_barrier);
    let builder = Session::builder().runtime_dir(worker.dir()).backend(Backend::Daemon);
    let gpu = EngineName::GpuBrute;
    let boxes = stress_scenes::named("uniform").boxes(700, 3);
    let mut any = builder.clone().answer_repeats(false).connect().unwrap();
    let mut only = builder.engine(EngineChoice::Only(gpu)).connect().unwrap();
    for _ in 0..3 {
        let by = frame(&mut any, &boxes).unwrap();
        assert!(matches!(by, EngineId::Known(name) if !name.is_gpu()), "{by:?}");
        let refused = frame(&mut only, &boxes).unwrap_err();
        let Error::Reply(ReplyError::Status { status, detail }) = refused else {
            panic!("{refused}");
        };
        assert_eq!((status, detail[1]), (StatusCode::EngineUnavailable, ENGINE_IS_OPENING));
        assert!(refused.to_string().contains("being opened"), "{refused}");
        let mut scene = only.scene(pairmask::SceneOptions::default()).unwrap();
        let refused = scene.edit().set(0, boxes[0]).commit(Report::All).map(drop).unwrap_err();
        assert!(refused.to_string().contains("being opened"), "{refused}");
        assert!(worker.is_opening());
    }
    open_barrier();
    let by = eventually("the GPU joins", || frame(&mut only, &boxes).ok());
    assert_eq!(by, EngineId::Known(gpu));
    until("the status says so", || !worker.is_opening());
    drop((any, only));
    worker.stop();
}
