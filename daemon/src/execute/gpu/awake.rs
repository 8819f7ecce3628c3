//! Keeps the device's clocks up between the frames of a client that is at work: a dispatch of one workgroup is under way
//! as long as frames keep coming (GPU.md, "Clocks").

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use pairmask_shaders::Stage;
use pairmask_shaders::layouts::AwakeParams;

use super::{Block, Checks, Command, Frame, Gpu, GpuError, Home, Part, Pipelines, QueueRole};

/// How long the clocks are kept up after a frame, unless set otherwise: a client of four frames a
/// second finds them up, and one that no longer exists costs nothing a moment later.
pub const DEFAULT_HOLD: Duration = Duration::from_millis(250);

/// Steps of a dispatch: 0.6 ms on an H200. Shorter ones wake their thread more often, longer ones
/// delay its end.
const ROUNDS: u32 = 100_000;
/// How long a dispatch may take before the device counts as hung.
const TIMEOUT: Duration = Duration::from_secs(10);

/// What the serving thread and the one that submits share.
struct Shared {
    start: Instant,
    /// Microseconds after `start` until which dispatches follow each other.
    until_us: AtomicU64,
    dispatches: AtomicU64,
    stop: AtomicBool,
    /// Whether the thread stays, with nothing to do, when it has stopped.
    stays: AtomicBool,
}

impl Shared {
    fn now_us(&self) -> u64 {
        self.start.elapsed().as_micros() as u64
    }
}

pub struct Awake {
    gpu: Arc<Gpu>,
    shared: Arc<Shared>,
    hold_us: u64,
    thread: Option<JoinHandle<()>>,
}

impl Awake {
    /// Starts the thread, asleep. `None` where `hold` is zero, and on devices that have no queue
    /// for it: software adapters, and those whose stages would wait for it.
    pub fn start(gpu: &Arc<Gpu>, hold: Duration) -> Result<Option<Self>, GpuError> {
        let pays = !gpu.is_software() && gpu.has_own_queue(QueueRole::Awake);
        if hold.is_zero() || !pays { Ok(None) } else { Self::launch(gpu, hold).map(Some) }
    }

    /// As [`Self::start`], on any device, where its dispatches may hold up frames. For tests.
    pub fn launch(gpu: &Arc<Gpu>, hold: Duration) -> Result<Self, GpuError> {
        let frame = recorded(gpu)?;
        let shared = Arc::new(Shared {
            start: Instant::now(),
            until_us: AtomicU64::new(0),
            dispatches: AtomicU64::new(0),
            stop: AtomicBool::new(false),
            stays: AtomicBool::new(false),
        });
        let theirs = Arc::clone(&shared);
        let started =
            Builder::new().name("gpu-awake".into()).spawn(move || keep_awake(frame, &theirs));
        let thread = started
            .inspect_err(|error| log::warn!("the GPU's clocks may fall between frames: {error}"))
            .ok();
        Ok(Self { gpu: Arc::clone(gpu), shared, hold_us: hold.as_micros() as u64, thread })
    }

    pub fn dispatches(&self) -> u64 {
        self.shared.dispatches.load(Ordering::Relaxed)
    }

    /// A frame has come or gone: the clocks are worth keeping up for a while.
    pub fn note_frame(&self) {
        let now = self.shared.now_us();
        let was = self.shared.until_us.swap(now + self.hold_us, Ordering::Relaxed);
        // A thread that is at work needs no waking. One that falls asleep at this moment is woken by
        // the next frame.
        if was <= now
            && let Some(thread) = &self.thread
        {
            thread.thread().unpark();
        }
    }
}

impl Drop for Awake {
    fn drop(&mut self) {
        // A dispatch on a device that hangs takes ten seconds to give up, in which frames are to be served: nobody
        // waits for that thread. To end by itself, maybe while the device is destroyed, could lock the driver up (see
        // `slot`): it stays, one for each loss.
        let is_lost = self.gpu.health().is_lost();
        self.shared.stays.store(is_lost, Ordering::Relaxed);
        self.shared.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            if !is_lost && thread.join().is_err() {
                log::error!("the thread that kept the GPU awake has panicked: please report this");
            }
        }
    }
}

fn recorded(gpu: &Arc<Gpu>) -> Result<Frame, GpuError> {
    let sink = Part::whole(&Block::new(gpu, Home::Video, size_of::<u32>() as u64)?);
    let params = AwakeParams { rounds: ROUNDS, written: 0 };
    let mut frame = Frame::of_role(gpu, QueueRole::Awake, false)?;
    let pipeline = Pipelines::new(gpu, Checks::Off, None)?.get(Stage::Awake)?;
    frame.record(vec![Command::stage(pipeline, &[("sink", &sink)], &params, [1, 1])?])?;
    Ok(frame)
}

fn keep_awake(mut frame: Frame, shared: &Shared) {
    let has_stopped = || shared.stop.load(Ordering::Acquire);
    while !has_stopped() {
        if shared.now_us() >= shared.until_us.load(Ordering::Relaxed) {
            std::thread::park();
        } else if let Err(error) = frame.run(TIMEOUT) {
            // A lost device is reported elsewhere; the next one gets a thread of its own.
            log::debug!("the GPU is not kept awake any more: {error}");
            break;
        } else {
            shared.dispatches.fetch_add(1, Ordering::Relaxed);
        }
    }
    // The last one to have a lost device destroys it. That one must not end meanwhile.
    drop(frame);
    while !has_stopped() || shared.stays.load(Ordering::Relaxed) {
        std::thread::park();
    }
}
