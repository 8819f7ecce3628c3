//! The process that the user starts. It holds the instance and keeps a worker running.
//!
//! A worker that is stopped (SIGSTOP) keeps its memory and its clients' frames, and never answers: it is
//! killed and replaced. It counts as stopped where the kernel says so and its heartbeat has stood still
//! for a while of this process's own looks. One that is starved, waits for pages or is traced by a debugger
//! is not stopped by that account, and is left alone; so is one that was suspended with the whole machine.
//! One that hangs ends itself (`heartbeat`), and one that serves badly is found out by the supervisor's own frames
//! (`probe`).
//!
//! A worker that dies is replaced as soon as the kernel has closed its files. Its process ends later: a
//! driver may need 90 ms to take down what the process had on a GPU, and its end is reported to the parent then.
//!
//! A worker that was killed is started again at once, so that its clients miss a few frames. A request
//! that kills every worker must not make a busy loop: restarts beyond a burst are spread over time.

use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use pairmask_transport::{DaemonWatch, InstanceLock, Stillness, raise_file_limit};
use pairmask_wire::InstanceError;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{
    Pid, PidfdFlags, Signal, WaitId, WaitIdOptions, kill_process, pidfd_open, waitid,
};
use signal_hook::low_level::pipe;

use super::probe::Probing;
use super::service_manager::{ServiceManager, without_manager};
use super::signals::stop_signals;
use super::{ServeError, ServeSettings, fences};
use crate::execute::gpu::GpuChoices;
use crate::recording::RecordSettings;

/// How long to wait for the lock of a supervisor that has exited. One that lives is not waited for.
const PREDECESSOR_LETS_GO: Duration = Duration::from_secs(1);
const PREDECESSOR_LOOK: Duration = Duration::from_millis(5);
/// A worker that was asked to stop has this long: more than its longest sleep and one frame.
const STOP_WITHIN: Duration = Duration::from_secs(5);

const LOOK_INTERVAL: Duration = Duration::from_millis(50);
/// A worker that is stopped for this long is replaced: within a second it serves again. Ctrl-Z stops the
/// supervisor too, which looks at nothing meanwhile.
const STOPPED_FOR: Duration = Duration::from_millis(400);

/// A worker that does not serve after this long, in this process's own looks, is replaced. It takes 20 to 200
/// ms, GPUs join later; the transport waits without end for files that a killed predecessor had just begun.
const STARTS_WITHIN: Duration = Duration::from_secs(10);
/// With `--gpu all` it lists the GPUs first, which takes seconds for each that sleeps.
const LISTS_WITHIN: Duration = Duration::from_secs(60);

/// Open files of a worker without clients: pipes, ports, devices and engines, and the supervisor's own connection.
pub const OWN_FILES: u64 = 128;
/// Open files of a worker for each client: its socket, what wakes either side, segments that grow, and what the
/// transport needs for the answers' memory.
pub const FILES_PER_CLIENT: u64 = 16;

/// Serves an instance until a signal asks it to stop. A worker that crashes is no error.
pub fn supervise(settings: &ServeSettings) -> Result<(), ServeError> {
    check_file_limit(settings.daemon.limits.max_clients)?;
    let _lock = acquire(settings)?;
    let result = keep_working(settings);
    settings.dir.remove_record(&settings.instance);
    result
}

/// Raises the limit of open files as far as this process may, and checks that it is enough.
fn check_file_limit(clients: usize) -> Result<(), ServeError> {
    let Some(limit) = raise_file_limit() else { return Ok(()) };
    let needed = OWN_FILES + FILES_PER_CLIENT * clients as u64;
    if needed <= limit {
        return Ok(());
    }
    let fit = limit.saturating_sub(OWN_FILES) / FILES_PER_CLIENT;
    Err(ServeError::Files { clients, needed, limit, fit })
}

/// Takes the right to serve. A predecessor that was killed while it started a worker holds it through
/// that worker, until the worker has its own program: a moment that is waited for, unless a worker serves.
fn acquire(settings: &ServeSettings) -> Result<InstanceLock, InstanceError> {
    let give_up_at = Instant::now() + PREDECESSOR_LETS_GO;
    loop {
        match InstanceLock::acquire(&settings.dir, &settings.instance) {
            Err(InstanceError::AlreadyServed { .. })
                if !settings.dir.is_served(&settings.instance) && Instant::now() < give_up_at =>
            {
                std::thread::sleep(PREDECESSOR_LOOK);
            }
            done => return done,
        }
    }
}

fn keep_working(settings: &ServeSettings) -> Result<(), ServeError> {
    let signals =
        StopSignals::install().map_err(ServeError::system("installing signal handlers"))?;
    let mut delay = RestartDelay::default();
    let mut served_before = false;
    let mut dying = Vec::new();
    let mut probing = Probing::new(settings.daemon.probe_interval);
    let mut manager = ServiceManager::from_env();
    loop {
        settings.dir.remove_record(&settings.instance);
        let mut worker = spawn_worker(settings, served_before)?;
        let end = watch(&mut worker, &mut dying, settings, &signals, &mut probing, &mut manager)?;
        probing.end();
        served_before |= settings.dir.read_record(&settings.instance).is_some();
        settings.dir.remove_record(&settings.instance);
        match end {
            End::Asked => {
                manager.stops();
                stop(&mut worker, STOP_WITHIN)
                    .map_err(ServeError::system("stopping the worker"))?;
                return Ok(());
            }
            End::Status(status) => match status.code() {
                Some(0) => return Ok(()),
                Some(code) if !served_before => return Err(ServeError::Worker { code }),
                _ => log_death(settings, status),
            },
            End::FilesClosed => {
                // It is dying; one that closed its files by itself would live on beside the next.
                worker.kill().map_err(ServeError::system("killing the worker"))?;
                dying.push(worker);
            }
        }
        if signals.wait(None, delay.of_death(Instant::now())) == Waited::Signal {
            return Ok(());
        }
    }
}

/// Drops workers that died and whose processes have ended now, and logs how.
fn reap(dying: &mut Vec<Child>, settings: &ServeSettings) {
    dying.retain_mut(|worker| match worker.try_wait() {
        Ok(None) => true,
        Ok(Some(status)) => {
            log_death(settings, status);
            false
        }
        Err(_) => false,
    });
}

fn log_death(settings: &ServeSettings, status: ExitStatus) {
    log::error!("the worker of '{}' died ({status}); another takes its place", settings.instance);
}

/// The end of a pipe that becomes readable by a signal to stop, and stays so.
struct StopSignals(UnixStream);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Waited {
    Signal,
    Event,
    Nothing,
}

impl StopSignals {
    fn install() -> std::io::Result<Self> {
        let (reported, teller) = UnixStream::pair()?;
        for signal in stop_signals() {
            pipe::register(signal, teller.try_clone()?)?;
        }
        Ok(Self(reported))
    }

    /// Waits for a signal, or for an event of `worker` (a process, or a pipe to it), for so long at most.
    fn wait(&self, worker: Option<BorrowedFd<'_>>, time: Duration) -> Waited {
        let until = Instant::now() + time;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let left =
                Timespec { tv_sec: left.as_secs() as i64, tv_nsec: left.subsec_nanos().into() };
            let mut fds = vec![PollFd::new(&self.0, PollFlags::IN)];
            fds.extend(worker.map(|worker| PollFd::from_borrowed_fd(worker, PollFlags::IN)));
            let done = poll(&mut fds, Some(&left));
            match fds.iter().position(|fd| !fd.revents().is_empty()) {
                Some(0) => return Waited::Signal,
                Some(_) => return Waited::Event,
                // A signal interrupts the wait before its byte is seen.
                None if done.is_ok() => return Waited::Nothing,
                None => {}
            }
        }
    }
}

fn spawn_worker(settings: &ServeSettings, restarted: bool) -> Result<Child, ServeError> {
    let binary =
        std::env::current_exe().map_err(ServeError::system("finding the daemon's binary"))?;
    let mut command = Command::new(binary);
    without_manager(&mut command);
    command
        .args(["serve", "--worker", &std::process::id().to_string()])
        .args(["--instance", settings.instance.as_str()])
        .args(settings.daemon.flags())
        .args(settings.dir.group().map(|group| format!("--allow-group={group}")))
        .args(settings.record.iter().flat_map(RecordSettings::flags))
        .args(restarted.then_some("--restarted"))
        .env("PAIRMASK_RUNTIME_DIR", settings.dir.path())
        // Mesa's layer that sorts adapters asks the user's display which one it runs on. A daemon
        // has no display to ask, and its user chooses by --gpu.
        .env("NODEVICE_SELECT", "1")
        .envs(fences::driver_caches())
        // Nothing is written: the pipe shows when the worker's files are closed.
        .stdin(Stdio::piped())
        .spawn()
        .map_err(ServeError::system("starting the worker"))
}

enum End {
    Asked,
    Status(ExitStatus),
    /// It served and is dying. One that stops by itself takes its record away first, and its status is
    /// waited for.
    FilesClosed,
}

/// Waits for a worker's end or a signal. Kills one that is stopped, does not begin to serve, or fails its tests.
fn watch(
    worker: &mut Child,
    dying: &mut Vec<Child>,
    settings: &ServeSettings,
    signals: &StopSignals,
    probing: &mut Probing,
    manager: &mut ServiceManager,
) -> Result<End, ServeError> {
    let failed = ServeError::system;
    let pid = i32::try_from(worker.id()).ok().and_then(Pid::from_raw);
    let process = pid.and_then(|pid| pidfd_open(pid, PidfdFlags::empty()).ok());
    let mut pipe = worker.stdin.take();
    let mut heart = HeartWatch::new();
    let starts_within =
        if settings.daemon.gpu == GpuChoices::All { LISTS_WITHIN } else { STARTS_WITHIN };
    // Until it has served: for how long it has not. One that was killed is waited for alone.
    let mut start = Some(Stillness::new(Some(0), Instant::now(), 2 * LOOK_INTERVAL));
    let mut is_killed = false;
    loop {
        reap(dying, settings);
        if let Some(status) = worker.try_wait().map_err(failed("watching the worker"))? {
            return Ok(End::Status(status));
        }
        let watched = pipe.as_ref().map(AsFd::as_fd).or(process.as_ref().map(AsFd::as_fd));
        match signals.wait(watched, LOOK_INTERVAL) {
            Waited::Signal => return Ok(End::Asked),
            Waited::Event if pipe.take().is_some() => {
                if is_killed || settings.dir.read_record(&settings.instance).is_some() {
                    return Ok(End::FilesClosed);
                }
            }
            Waited::Event | Waited::Nothing => {}
        }
        if is_killed {
            continue;
        }
        if start.is_some() && settings.dir.read_record(&settings.instance).is_some() {
            start = None;
            probing.begin(settings, worker.id());
        }
        let now = Instant::now();
        let begins_late =
            start.as_mut().is_some_and(|start| start.look(Some(0), now) > starts_within);
        let beats = heart.beats(settings);
        let why = if heart.stands_still(beats, pid.is_some_and(is_stopped), now) {
            "is stopped and answers nobody"
        } else if begins_late {
            "does not begin to serve"
        } else if let Some(fault) = probing.fault() {
            fault
        } else {
            if start.is_none() {
                manager.serves(beats, now);
            }
            continue;
        };
        log::error!("the worker of '{}' {why}: it is killed", settings.instance);
        worker.kill().map_err(failed("killing the worker"))?;
        is_killed = true;
    }
}

struct HeartWatch {
    heart: Option<DaemonWatch>,
    still: Stillness,
}

impl HeartWatch {
    fn new() -> Self {
        Self { heart: None, still: Stillness::new(None, Instant::now(), 2 * LOOK_INTERVAL) }
    }

    fn beats(&mut self, settings: &ServeSettings) -> Option<u64> {
        if self.heart.is_none() {
            // The predecessor's file no longer exists: what is there is this worker's.
            self.heart = settings.dir.watch(&settings.instance, None).ok().flatten();
        }
        self.heart.as_ref()?.beats()
    }

    /// Whether the worker has been stopped for long enough, by looks at it.
    fn stands_still(&mut self, beats: Option<u64>, is_stopped: bool, now: Instant) -> bool {
        // A worker that is stopped before its first beat beats no more than one after it.
        let seen = is_stopped.then(|| beats.unwrap_or(0));
        self.still.look(seen, now) >= STOPPED_FOR
    }
}

/// Whether a child is stopped by a signal, as the kernel informs its parent. A debugger's stops are not reported.
fn is_stopped(child: Pid) -> bool {
    let options = WaitIdOptions::STOPPED | WaitIdOptions::NOHANG | WaitIdOptions::NOWAIT;
    matches!(waitid(WaitId::Pid(child), options), Ok(Some(_)))
}

/// Asks a child to stop, kills it where it does not in time, and returns how it has ended.
pub(crate) fn stop(child: &mut Child, within: Duration) -> io::Result<ExitStatus> {
    if let Some(pid) = i32::try_from(child.id()).ok().and_then(Pid::from_raw)
        && matches!(child.try_wait(), Ok(None))
    {
        // Sending fails if the process has ended already, which is what is needed.
        let _ = kill_process(pid, Signal::TERM);
    }
    let deadline = Instant::now() + within;
    while Instant::now() < deadline {
        if let Ok(Some(status)) = child.try_wait() {
            return Ok(status);
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill()?;
    child.wait()
}

/// Restarts that may follow each other without a pause: more than an operator, a test or a client that
/// is sent to another machine brings about in a row.
const BURST: u32 = 100;
/// Beyond the burst there is one restart in this time. Workers that are killed less often than that are
/// always replaced at once; one that dies as soon as it starts (30 to 60 ms of a core) costs a fifth of a
/// core at the most.
const INTERVAL: Duration = Duration::from_millis(250);

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RestartDelay {
    /// The time that the restarts so far have used up, at one [`INTERVAL`] each.
    used_until: Option<Instant>,
}

impl RestartDelay {
    /// The pause before the restart of a worker that was seen dead at `now`.
    pub(super) fn of_death(&mut self, now: Instant) -> Duration {
        let used_until = self.used_until.map_or(now, |until| until.max(now)) + INTERVAL;
        self.used_until = Some(used_until);
        (used_until - now).saturating_sub(BURST * INTERVAL)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn a_worker_is_replaced_where_it_is_stopped_and_its_heart_stands_still() {
        let start = Instant::now();
        let killed_at = |seen: &dyn Fn(u32) -> (Option<u64>, bool), tick: Duration| {
            let mut heart = HeartWatch::new();
            (0..1000).find(|i| {
                let (beats, is_stopped) = seen(*i);
                heart.stands_still(beats, is_stopped, start + *i * tick)
            })
        };
        let tick = LOOK_INTERVAL;
        assert_eq!(killed_at(&|_| (Some(7), true), tick), Some(8), "400 ms");
        assert_eq!(killed_at(&|_| (None, true), tick), Some(8), "before its first beat");
        assert_eq!(killed_at(&|_| (Some(7), false), tick), None, "starved, paging or traced");
        assert_eq!(killed_at(&|i| (Some(i.into()), true), tick), None, "it beats");
        assert_eq!(killed_at(&|i| (Some(7), i % 8 != 7), tick), None, "it goes on now and then");
        let suspended = Duration::from_secs(3600);
        assert_eq!(killed_at(&|_| (Some(7), true), suspended), Some(4), "its own looks count");
    }

    /// The pauses of workers that die `apart` after their start.
    fn pauses(apart: Duration, count: usize) -> Vec<Duration> {
        let (mut delay, mut now) = (RestartDelay::default(), Instant::now());
        let mut pause = || {
            now += apart;
            let pause = delay.of_death(now);
            now += pause;
            pause
        };
        std::iter::repeat_with(&mut pause).take(count).collect()
    }

    #[test]
    fn restarts_are_spread_beyond_a_burst() {
        let at_once = |apart, count| pauses(apart, count).iter().all(Duration::is_zero);
        assert!(at_once(Duration::from_millis(50), BURST as usize));
        assert!(at_once(INTERVAL, 1000), "kills with a pause between them are never waited for");
        let pauses = pauses(Duration::ZERO, 1000);
        assert_eq!(pauses.iter().sum::<Duration>(), INTERVAL * (1000 - BURST), "no busy loop");
        assert!(pauses.iter().all(|pause| *pause <= INTERVAL));
    }

    #[test]
    fn a_worker_that_lives_long_makes_the_next_restarts_free_again() {
        let (mut delay, start) = (RestartDelay::default(), Instant::now());
        let late = (0..2 * BURST).map(|_| delay.of_death(start)).last();
        assert_eq!(late, Some(INTERVAL * BURST));
        let later = start + INTERVAL * 4 * BURST;
        assert!((0..BURST).all(|_| delay.of_death(later).is_zero()));
    }
}
