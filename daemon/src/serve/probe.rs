//! The client by which a supervisor tests its worker. One that lives and beats may be poisoned all the same: its door
//! hangs, its socket is gone, its answers are wrong.
//!
//! A thread sends a frame whose pairs are known, every few seconds, as any client of the library does. A wrong answer is
//! the worker's end. One that does not come is so the second time in a row, and only where all threads of the worker
//! sleep meanwhile: one that works, pages, or is traced by a debugger is left alone, as by the heartbeat. What a lack of
//! memory or files explains says nothing of the worker.
//!
//! The connection is kept, since a new one costs more than ten frames; every [`FRAMES_A_SESSION`]th frame goes
//! over a new one, which shows that new clients are let in. The worker knows its supervisor by the kernel's word: it
//! takes no client's place, and neither it nor its frames are counted.
//!
//! The supervisor reads what the worker writes, as all clients do: nothing of it is trusted (`pairmask`).

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use pairmask::{Aabb, Backend, ConnectError, Error, Session};
use pairmask_transport::{RuntimeDir, survive_cut_memory};
use pairmask_wire::{ReplyError, StatusCode};

use super::heartbeat::threads_sleep;
use super::{ServeSettings, StoppedThread};

/// Time between two frames: a poisoned worker is replaced within seconds, and an idle machine is woken once in this
/// time, for some 0.2 ms of a core.
pub(super) const DEFAULT_INTERVAL: Duration = Duration::from_secs(3);
/// Of workers that fail one after the other, each is tested half as often as the one before: the machine, and not
/// the worker, may be at fault, and each replacement costs all clients some frames.
const LONGEST_INTERVAL: Duration = Duration::from_secs(600);

/// A frame that is not answered within this time counts as not answered. Two of them take less time than the heartbeat
/// gives a worker whose threads all hang: one that serves nobody else is replaced as soon.
const ANSWERS_WITHIN: Duration = Duration::from_secs(4);
/// A supervisor that is asked to stop waits no longer than this for its thread, or a second where it connects.
const SLICE: Duration = Duration::from_millis(50);
/// Frames without an answer, one after the other, after which a worker is replaced.
const MOST_FAILURES: u32 = 2;

/// Frames over one connection: a door that hangs is noticed within half a minute, and most of the cost of connections
/// is saved.
const FRAMES_A_SESSION: u32 = 10;
/// Boxes of a frame: few enough for a core to take 2 µs, and for no plan to wake a GPU.
const BOXES: u32 = 64;

/// Tests of one worker after the other.
pub(super) struct Probing {
    usual: Duration,
    interval: Duration,
    running: Option<(Arc<Found>, StoppedThread)>,
}

#[derive(Debug, Default)]
struct Found {
    right_frames: AtomicU32,
    fault: OnceLock<&'static str>,
}

/// Why a frame has no right answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Miss {
    Wrong,
    /// What the worker does not do.
    Fails(&'static str),
    /// Something that says nothing of the worker.
    Excused,
}

impl Probing {
    /// One test in this time; none at all where it is zero.
    pub(super) const fn new(usual: Duration) -> Self {
        Self { usual, interval: usual, running: None }
    }

    /// Tests the worker of this process id from now on.
    pub(super) fn begin(&mut self, settings: &ServeSettings, worker: u32) {
        if self.usual.is_zero() {
            return;
        }
        let found = Arc::new(Found::default());
        let (shared, settings, interval) = (Arc::clone(&found), settings.clone(), self.interval);
        let work = move |stop: &AtomicBool| test(&settings, worker, interval, stop, &shared);
        match StoppedThread::start("probe", "starting a thread", work) {
            Ok(thread) => self.running = Some((found, thread)),
            Err(error) => log::warn!("the worker is not tested: {error}"),
        }
    }

    /// What is wrong with the worker.
    pub(super) fn fault(&self) -> Option<&'static str> {
        self.running.as_ref()?.0.fault.get().copied()
    }

    /// The worker has ended.
    pub(super) fn end(&mut self) {
        let Some((found, _)) = self.running.take() else { return };
        if found.right_frames.load(Ordering::Relaxed) >= FRAMES_A_SESSION {
            self.interval = self.usual;
        } else if found.fault.get().is_some() {
            self.interval = (2 * self.interval).min(LONGEST_INTERVAL).max(self.usual);
        }
    }
}

fn test(
    settings: &ServeSettings,
    worker: u32,
    interval: Duration,
    stop: &AtomicBool,
    found: &Found,
) {
    let (instance, dir) = (&settings.instance, RuntimeDir::at(settings.dir.path()));
    if let Err(error) = survive_cut_memory() {
        return log::warn!("the worker of '{instance}' is not tested: {error}");
    }
    let (mut session, mut failures) = (None, 0);
    for number in 0.. {
        std::thread::park_timeout(interval);
        if stop.load(Ordering::Relaxed) {
            return;
        }
        if number % FRAMES_A_SESSION == 0 {
            session = None;
        }
        let Err(miss) = send(&mut session, settings, number, stop) else {
            found.right_frames.fetch_add(1, Ordering::Relaxed);
            failures = 0;
            continue;
        };
        // One that stops in order has taken its files away, and another would have the same directory.
        let hangs = || {
            let tasks = format!("/proc/{worker}/task");
            dir.check().is_ok() && dir.is_served(instance) && threads_sleep(tasks, "")
        };
        if let Some(fault) = judge(miss, hangs, &mut failures) {
            let _ = found.fault.set(fault);
            return;
        }
        // Not before: its end wakes the worker.
        session = None;
    }
}

/// What is wrong with a worker whose frame has no right answer, after so many `failures` before.
fn judge(miss: Miss, hangs: impl FnOnce() -> bool, failures: &mut u32) -> Option<&'static str> {
    match miss {
        Miss::Wrong => Some("answers wrongly"),
        Miss::Fails(what) if hangs() => {
            *failures += 1;
            (*failures >= MOST_FAILURES).then_some(what)
        }
        Miss::Fails(_) | Miss::Excused => {
            *failures = 0;
            None
        }
    }
}

/// Sends a frame, over a new connection where there is none, and compares the answer.
fn send(
    session: &mut Option<Session>,
    settings: &ServeSettings,
    number: u32,
    stop: &AtomicBool,
) -> Result<(), Miss> {
    let session = match session {
        Some(session) => session,
        None => session.insert(connect(settings)?),
    };
    let mut frame = session.frame(BOXES as usize)?;
    frame.boxes_mut().copy_from_slice(&boxes(number));
    let mut pending = frame.submit()?;
    let until = Instant::now() + ANSWERS_WITHIN;
    let mask = loop {
        match pending.wait_timeout(SLICE) {
            Err(Error::Timeout { .. }) if stop.load(Ordering::Relaxed) => {
                return Err(Miss::Excused);
            }
            Err(Error::Timeout { .. }) if Instant::now() < until => {}
            answer => break answer?,
        }
    };
    let mut found = mask.to_vec();
    found.sort_unstable();
    if found == pairs() { Ok(()) } else { Err(Miss::Wrong) }
}

fn connect(settings: &ServeSettings) -> Result<Session, ConnectError> {
    Session::builder()
        .runtime_dir(settings.dir.path())
        .instance(settings.instance.as_str())
        .backend(Backend::Daemon)
        .isa(settings.daemon.isa)
        // Nobody is in a hurry.
        .spin(Duration::ZERO)
        .connect()
}

/// A row of boxes, of which each overlaps the next two. No frame is equal to the one before, whose answer the worker
/// may have kept.
fn boxes(number: u32) -> [Aabb; BOXES as usize] {
    std::array::from_fn(|i| {
        let mut b = Aabb { min: [0.0; 3], max: [2.25; 3] };
        let (axis, start) = ((number % 3) as usize, (number % 1000) as f32 + i as f32);
        (b.min[axis], b.max[axis]) = (start, start + 2.25);
        b
    })
}

fn pairs() -> Vec<[u32; 2]> {
    (0..BOXES).flat_map(|i| (i + 1..BOXES.min(i + 3)).map(move |j| [i, j])).collect()
}

impl From<ConnectError> for Miss {
    fn from(error: ConnectError) -> Self {
        log::debug!("testing the worker: {error}");
        match error {
            ConnectError::NoDaemon { .. }
            | ConnectError::Silent { .. }
            | ConnectError::OtherUser { .. }
            | ConnectError::VersionMismatch { .. }
            | ConnectError::Instance(_) => Self::Fails("lets nobody in"),
            // No memory or no files, here or there.
            _ => Self::Excused,
        }
    }
}

impl From<Error> for Miss {
    fn from(error: Error) -> Self {
        log::debug!("testing the worker: {error}");
        match error {
            Error::Connect(error) => error.into(),
            Error::Timeout { .. } => Self::Fails("answers nobody"),
            Error::Reply(ReplyError::Status {
                status: StatusCode::OutOfMemory | StatusCode::OverBudget,
                ..
            }) => Self::Excused,
            Error::Reply(_) => Self::Wrong,
            // No memory, or it has died, which the supervisor sees.
            _ => Self::Excused,
        }
    }
}

#[cfg(test)]
mod tests {
    use pairmask_core::oracle;

    use super::*;

    #[test]
    fn the_pairs_are_those_of_the_boxes() {
        for number in [0, 1, 2, 999, 1000, u32::MAX] {
            assert_eq!(oracle::truth(&boxes(number)).pairs, pairs(), "{number}");
            assert_ne!(boxes(number), boxes(number.wrapping_add(1)));
        }
    }

    #[test]
    fn silence_counts_twice_in_a_row_and_a_wrong_answer_once() {
        let fails = Miss::Fails("sleeps");
        // Whether its threads sleep, and what the verdict is.
        for (seen, expected) in [
            (&[(Miss::Wrong, false)][..], Some("answers wrongly")),
            (&[(fails, true)], None),
            (&[(fails, true), (fails, true)], Some("sleeps")),
            (&[(fails, false); 9], None),
            (&[(fails, true), (fails, false), (fails, true)], None),
            (&[(fails, true), (Miss::Excused, true), (fails, true)], None),
            (&[(Miss::Excused, true); 9], None),
        ] {
            let mut failures = 0;
            let verdicts = seen.iter().map(|&(miss, sleeps)| judge(miss, || sleeps, &mut failures));
            assert_eq!(verdicts.last().flatten(), expected, "{seen:?}");
        }
    }
}
