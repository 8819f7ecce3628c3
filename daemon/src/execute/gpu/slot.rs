//! The place of the GPU in the daemon: being opened, there, lost, or being rebuilt.
//!
//! A thread that has used NVIDIA's driver (580.159.04) must not end while another one destroys a device: each
//! then waits for a lock of the driver that the other holds, and the next callers of the driver wait with them.
//! So what is done with a driver now and then is done by one thread, which ends with its owner.

use std::io;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::{Gpu, GpuError, OpenError};

/// What opens a device and makes what is made on it. Runs on a thread of its own, the same one each time.
pub type Opener<T> = Arc<dyn Fn() -> Result<T, OpenError> + Send + Sync>;

/// Pause between tries to open a lost device again: a driver that resets needs about as long.
const RETRY_AFTER: Duration = Duration::from_secs(1);

/// What becomes of a slot whose first device cannot be opened.
#[derive(Clone)]
pub enum IfMissing {
    /// It stays empty.
    DoWithout,
    /// It stays empty, and somebody learns why.
    Report(Arc<dyn Fn(OpenError) + Send + Sync>),
    /// The device is opened as one that was lost.
    TryAgain,
}

/// A GPU with what is made on it, which may go and come back. The owner asks before each frame ([`GpuSlot::ready`])
/// and never waits: while there is no device, CPU engines serve.
///
/// Dropping it waits for a device that is being opened.
pub struct GpuSlot<T> {
    state: SlotState,
    if_missing: IfMissing,
    open: Opener<T>,
    lost_at: Instant,
    retry_at: Instant,
    // Ended before the device is destroyed: fields drop in this order.
    opening: Option<DriverThread<Result<T, OpenError>>>,
    opened: Option<T>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlotState {
    Opening,
    /// There is no device, and none will come.
    Missing,
    Ready,
    /// No device; the next try comes soon.
    Lost,
    /// The device that follows a lost one is being opened.
    Rebuilding,
}

impl<T: AsRef<Gpu> + Send + 'static> GpuSlot<T> {
    pub fn opening(open: Opener<T>, if_missing: IfMissing) -> Self {
        let (state, now) = (SlotState::Opening, Instant::now());
        let (lost_at, retry_at, opening, opened) = (now, now, None, None);
        let mut slot = Self { state, if_missing, open, lost_at, retry_at, opening, opened };
        slot.begin(SlotState::Opening, now);
        slot
    }

    /// What is opened, if the device is healthy. A lost one is noticed here and dropped, and its rebuild begun.
    pub fn ready(&mut self) -> Option<&mut T> {
        let now = Instant::now();
        self.take_in(now);
        if let Some(lost) = self.opened.take_if(|it| (*it).as_ref().health().is_lost()) {
            log::warn!(
                "the GPU {} is lost; CPU engines serve meanwhile",
                lost.as_ref().info().name
            );
            // The first try comes at once.
            (self.state, self.lost_at, self.retry_at) = (SlotState::Lost, now, now);
        }
        if self.state == SlotState::Lost && now >= self.retry_at {
            self.begin(SlotState::Rebuilding, now);
            self.take_in(now);
        }
        self.opened.as_mut()
    }

    /// What was opened last, whether the device is healthy or not.
    pub const fn opened(&self) -> Option<&T> {
        self.opened.as_ref()
    }

    pub const fn opened_mut(&mut self) -> Option<&mut T> {
        self.opened.as_mut()
    }

    pub const fn state(&self) -> SlotState {
        self.state
    }

    fn begin(&mut self, state: SlotState, now: Instant) {
        self.state = state;
        if self.opening.as_ref().is_some_and(DriverThread::ask) {
            return;
        }
        let open = Arc::clone(&self.open);
        match DriverThread::start("gpu-rebuild", move || open()) {
            Ok(thread) => self.opening = Some(thread),
            Err(error) => {
                log::error!("no thread to open the GPU on: {error}");
                self.try_again(now);
            }
        }
    }

    fn try_again(&mut self, now: Instant) {
        (self.state, self.retry_at) = (SlotState::Lost, now + RETRY_AFTER);
    }

    fn take_in(&mut self, now: Instant) {
        let Some(opening) = &self.opening else { return };
        if !matches!(self.state, SlotState::Opening | SlotState::Rebuilding) {
            return;
        }
        let opened = match opening.progress() {
            Err(TryRecvError::Empty) => return,
            Ok(opened) => opened,
            // A driver that panics has no device.
            Err(TryRecvError::Disconnected) => Err(GpuError::Lost.into()),
        };
        let is_first = self.state == SlotState::Opening;
        match (opened, &self.if_missing) {
            (Ok(opened), _) => {
                let name = &opened.as_ref().info().name;
                if is_first {
                    log::info!("GPU: {name}");
                } else {
                    log::info!("the GPU {name} is back after {:?}", now - self.lost_at);
                }
                (self.state, self.opened) = (SlotState::Ready, Some(opened));
            }
            (Err(error), IfMissing::DoWithout) if is_first => {
                log::info!("serving without a GPU: {error}");
                self.state = SlotState::Missing;
            }
            (Err(error), IfMissing::Report(report)) if is_first => {
                report(error);
                self.state = SlotState::Missing;
            }
            (Err(error), _) => {
                log::warn!("the GPU is not back yet: {error}");
                self.try_again(now);
            }
        }
    }
}

/// A thread that does one work whenever it is asked.
struct DriverThread<T> {
    /// `None` once the thread is to end.
    ask: Option<SyncSender<()>>,
    done: Receiver<T>,
    thread: Option<JoinHandle<()>>,
}

impl<T: Send + 'static> DriverThread<T> {
    /// A thread that begins with its work at once.
    fn start(name: &str, mut work: impl FnMut() -> T + Send + 'static) -> io::Result<Self> {
        let (ask, asked) = sync_channel(1);
        let (report, done) = sync_channel(1);
        let thread = std::thread::Builder::new().name(name.into()).spawn(move || {
            // Dropped last: where its other end sees a panic, asking already fails.
            let report = report;
            let asked = asked;
            loop {
                if report.send(work()).is_err() || asked.recv().is_err() {
                    return;
                }
            }
        })?;
        Ok(Self { ask: Some(ask), done, thread: Some(thread) })
    }

    /// Asks for the work once more, after it was [done](Self::progress). `false` where the thread has ended.
    fn ask(&self) -> bool {
        self.ask.as_ref().is_some_and(|ask| ask.try_send(()).is_ok())
    }

    /// What has come of the work since it was asked for; reported once. [`TryRecvError::Empty`] while it is under way;
    /// [`TryRecvError::Disconnected`] where it panicked, and the thread has ended.
    fn progress(&self) -> Result<T, TryRecvError> {
        self.done.try_recv()
    }
}

impl<T> Drop for DriverThread<T> {
    /// Waits for the end of the thread, and so for work that is under way: a process that ends while a thread
    /// uses the driver would unload it under that thread.
    fn drop(&mut self) {
        self.ask = None;
        if let Some(thread) = self.thread.take() {
            // The panic message of the thread was printed already.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use pairmask_tests::prelude::eventually;

    use super::*;

    #[test]
    fn one_thread_does_all_of_the_work() {
        let mut count = 0;
        let work = move || {
            count += 1;
            (count, std::thread::current().id())
        };
        let thread = DriverThread::start("test", work).expect("a thread");
        let wait = || eventually("the work ends", || thread.progress().ok());
        let (_, first) = wait();
        for expected in 2..5 {
            assert!(thread.ask());
            assert_eq!(wait(), (expected, first));
        }
        assert_eq!(thread.progress(), Err(TryRecvError::Empty), "reported once");
    }

    #[test]
    fn dropping_it_waits_for_work_that_is_under_way() {
        let done = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(false));
        let sets = std::sync::Arc::clone(&done);
        let work = move || {
            std::thread::sleep(Duration::from_millis(50));
            sets.store(true, std::sync::atomic::Ordering::Release);
        };
        drop(DriverThread::start("test", work).expect("a thread"));
        assert!(done.load(std::sync::atomic::Ordering::Acquire));
    }
}
