//! Lanes: threads that serve requests side by side.
//!
//! Every lane does all of a frame: the lane that receives a request culls and answers it, so that a lone
//! client's frame is handed to no other thread. One idle lane at a time **leads**: it looks for requests,
//! and gives the lead up as soon as it has one to serve. Other lanes that are awake **follow**: they spin
//! until the lead is free. All others rest. What lanes agree on (whose turn it is, who is awake) stands
//! on the desk, under one lock that is held for a fraction of a microsecond.
//!
//! Lane 0 is the first thread of the engines' pool: large frames of a lone client start there without a
//! hand-over. When all is quiet it alone sleeps until a client wakes it; other lanes rest until a lane
//! wakes them. Beside them the tidier, a thread of its own, frees what dead clients leave.
//!
//! ```text
//! crew      how many lanes are awake                   (pure)
//! patience  how long they spin for the next request    (pure)
//! desk      whose turn it is, with how many threads    (pure)
//! mod       the lanes
//! ```

mod crew;
mod desk;
mod patience;

use std::sync::atomic::{AtomicBool, Ordering, fence};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, TryLockError};
use std::thread::Thread;
use std::time::{Duration, Instant};

use pairmask_core::spinner::Spinner;
use pairmask_transport::{
    GpuCounts, JANITOR_INTERVAL, Sender, StatusFile, WakeDaemon, sleep_until,
};

use self::crew::Crew;
use self::desk::{Arrived, Desk, Task};
use self::patience::{LONGEST_SLEEP, Rest};

use super::janitor::Janitor;
use super::placement::{Placement, Seat};
use super::{ServeError, ServeSettings};
use crate::clients::{FrameWork, RequestKind};
use crate::execute::EnginePool;
use crate::ingest::{Inbox, Incoming, Intake};
use crate::requests::{Responder, Served};

/// A lane that stands by while others serve long frames looks for requests this often: 1 % of a core, and
/// a client that begins to send meanwhile waits for it once.
const STAND_BY_NAP: Duration = Duration::from_micros(500);

/// Between two looks of a spinning lane at the desk.
const DESK_LOOK: Duration = Duration::from_micros(10);

/// Threads that are kept awake for a frame that is due, the one that waits for it included, however many
/// its engine uses: a frame begins with these, and they wake the others. All of 16 took a tenth of a core
/// at 60 Hz.
const MOST_ENGINES_AWAKE: usize = 4;

/// Between two looks whether a GPU that is being opened is there: so much later it joins at the most.
const OPENING_LOOK: Duration = Duration::from_millis(20);

/// What the lanes share.
pub(super) struct Lanes<'a> {
    // Engines before the port whose memory they write to: fields drop in this order.
    responder: Responder,
    lead: Mutex<Lead>,
    /// Whether a lane leads. A hint: the lock decides.
    is_led: AtomicBool,
    /// Whether lane 0 leads and sleeps.
    is_asleep: AtomicBool,
    desk: Mutex<Desk>,
    threads: Vec<OnceLock<Thread>>,
    placement: Placement,
    pool: Arc<EnginePool>,
    janitor: &'a Janitor,
    stop: &'a AtomicBool,
}

/// What the lane that leads uses.
struct Lead {
    intake: Intake,
    wake: WakeDaemon,
    /// Requests on their way to the desk.
    arrived: Vec<Incoming>,
    tidy_at: Instant,
}

/// What is noted of a request when it was served.
#[derive(Clone, Copy)]
struct Asked {
    sender: Sender,
    kind: RequestKind,
    objects: u32,
}

impl Asked {
    fn of(incoming: &Incoming) -> Self {
        let header = incoming.request.header();
        let kind = RequestKind::of(header);
        Self { sender: incoming.sender, kind, objects: header.box_count }
    }
}

/// Why a lane gives the lead up.
#[allow(clippy::large_enum_variant)] // A box would be an allocation.
enum Led {
    /// It has a request to serve.
    Task(Task),
    /// Another lane may want to lead, and this one looks again later.
    StandBy,
    /// It goes to rest.
    Rest,
    /// The daemon stops.
    Stop,
}

impl<'a> Lanes<'a> {
    /// As many lanes as cores, two at the least: one listens while another is away.
    pub(super) fn new(
        intake: Intake,
        wake: WakeDaemon,
        responder: Responder,
        pool: Arc<EnginePool>,
        settings: &ServeSettings,
        janitor: &'a Janitor,
        stop: &'a AtomicBool,
    ) -> Self {
        let cores = pool.threads();
        let lanes = cores.max(2);
        let crew = Crew::new(lanes, cores);
        let inbox = Inbox::new(settings.limits.max_clients).with_gpus(responder.gpus());
        let desk = Desk::new(inbox, crew, settings.spin, cores);
        let arrived = Vec::with_capacity(desk.room());
        Self {
            responder,
            lead: Mutex::new(Lead { intake, wake, arrived, tidy_at: Instant::now() }),
            is_led: AtomicBool::new(false),
            is_asleep: AtomicBool::new(false),
            desk: Mutex::new(desk),
            threads: (0..lanes).map(|_| OnceLock::new()).collect(),
            placement: Placement::of_this_process(),
            pool,
            janitor,
            stop,
        }
    }

    /// Serves until told to stop. This thread is lane 0.
    ///
    /// # Errors
    /// The system starts no thread.
    pub(super) fn run(&self) -> Result<(), ServeError> {
        std::thread::scope(|scope| {
            let mut others = Vec::with_capacity(self.threads.len());
            for lane in 1..self.threads.len() {
                let other = std::thread::Builder::new()
                    .name(format!("lane-{lane}"))
                    .spawn_scoped(scope, move || self.serve_in(lane))
                    .inspect_err(|_| self.stop.store(true, Ordering::Relaxed))
                    .map_err(ServeError::system("starting a lane"))?;
                others.push(other);
            }
            let tidier = std::thread::Builder::new()
                .name("tidier".into())
                .spawn_scoped(scope, || self.tidy_until_stopped())
                .inspect_err(|_| self.stop.store(true, Ordering::Relaxed))
                .map_err(ServeError::system("starting the tidier"))?;
            self.serve_in(0);
            tidier.thread().unpark();
            others.push(tidier);
            for thread in others {
                // The scope waits for their work alone. To destroy a device while a thread ends that has used it may
                // take for ever: see `gpu::driver_thread`. One that panicked has ended the process.
                let _ = thread.join();
            }
            Ok(())
        })
    }

    /// Gives up what belonged to clients that are gone, now and then, and leaves those that are there their cores. On a
    /// thread of its own: to free a large scene, or to take the boxes of a dead writer out of one, takes a while.
    fn tidy_until_stopped(&self) {
        let _end = EndWithPanic;
        let mut looked_at = 0;
        let mut gpus = GpuCounts::default();
        while !self.stop.load(Ordering::Relaxed) {
            self.responder.tidy();
            let now = self.responder.gpu_counts();
            if now != gpus {
                gpus = now;
                self.placement.put_beside(&self.responder.gpu_addresses());
                self.janitor.post(&self.status());
            }
            // Idle clients are in nobody's way, and a look at many takes a while.
            let frames = self.responder.status().frames;
            if frames != looked_at {
                looked_at = frames;
                self.placement.look(&self.responder.client_processes());
            }
            let pause = if gpus.opening > 0 { OPENING_LOOK } else { JANITOR_INTERVAL };
            std::thread::park_timeout(pause);
        }
    }

    /// What the daemon's status file is to say.
    fn status(&self) -> StatusFile {
        let Self { responder, .. } = self;
        StatusFile::now(responder.status(), responder.skips(), responder.gpu_counts())
    }

    fn serve_in(&self, lane: usize) {
        let _end = EndWithPanic;
        // Nothing else sets it.
        let _ = self.threads[lane].set(std::thread::current());
        let mut seat = Seat::of_this_thread();
        while !self.stop.load(Ordering::Relaxed) {
            self.placement.take(&mut seat);
            match self.lead.try_lock() {
                Ok(mut lead) => {
                    self.is_led.store(true, Ordering::Relaxed);
                    let led = self.lead(lane, &mut lead);
                    self.is_led.store(false, Ordering::Relaxed);
                    drop(lead);
                    match led {
                        Led::Task(task) => self.serve(lane, task),
                        Led::StandBy => std::thread::park_timeout(STAND_BY_NAP),
                        Led::Rest => self.rest(lane),
                        Led::Stop => {}
                    }
                }
                Err(TryLockError::WouldBlock) => match self.next_task() {
                    Some(task) => self.serve(lane, task),
                    None => self.follow(lane),
                },
                // A lane has panicked: the process ends.
                Err(TryLockError::Poisoned(_)) => return,
            }
        }
        self.threads.iter().filter_map(OnceLock::get).for_each(Thread::unpark);
    }

    /// Looks for requests until there is one to serve, or nothing to look for.
    fn lead(&self, lane: usize, lead: &mut Lead) -> Led {
        let mut spinner = Spinner::default();
        let mut is_first = true;
        let (mut look_at, mut sleep_at) = (Instant::now(), Instant::now());
        while !self.stop.load(Ordering::Relaxed) {
            let has_arrived = self.receive(lead);
            // Requests that came together with one that another lane serves wait on the desk.
            if (has_arrived || std::mem::take(&mut is_first))
                && let Some(task) = self.next_task()
            {
                return Led::Task(task);
            }
            let published = self.responder.publish_ended();
            let now = Instant::now();
            if now >= lead.tidy_at {
                lead.intake.tidy();
                self.janitor.post(&self.status());
                lead.tidy_at = now + JANITOR_INTERVAL;
            }
            if published || now >= look_at {
                let mut desk = self.desk();
                if published {
                    desk.note_answer(now);
                }
                sleep_at = desk.sleep_at();
                look_at = now + DESK_LOOK;
                if lane > 0 && desk.crew.is_too_large(now) {
                    return self.leave(lane, desk);
                }
                if lane > 0 && !desk.is_awaiting(now) {
                    // Whoever is active is being served: nothing to spin for.
                    sleep_at = now;
                }
            }
            if self.responder.is_busy() {
                self.responder.rest();
            } else if now < sleep_at {
                spinner.turn();
            } else if lane > 0 {
                return self.stand_by(lane);
            } else if self.pause(&lead.wake, now) {
                spinner.turn();
            }
        }
        Led::Stop
    }

    /// Lane 0 sleeps until a request comes, at most until shortly before one is due. Returns at once, with
    /// `true`, where one is due now.
    fn pause(&self, wake: &WakeDaemon, now: Instant) -> bool {
        let mut desk = self.desk();
        let (rest, last_threads) = (desk.rest(now), desk.last_threads());
        drop(desk);
        match rest {
            Rest::Spin => true,
            Rest::Expect { until, is_near } => {
                if is_near {
                    let most_awake = self.most_awake().min(MOST_ENGINES_AWAKE);
                    self.pool.keep_until(last_threads.min(most_awake), until);
                }
                true
            }
            Rest::Sleep { until } => {
                self.is_asleep.store(true, Ordering::Relaxed);
                // A lane that leaves a frame with a GPU now is seen here, or sees that this one sleeps.
                fence(Ordering::SeqCst);
                let is_busy = self.responder.is_busy();
                // A request that came between the last look and the sleep has left its wake-up: it is
                // not lost, the sleep ends at once.
                if !is_busy && let Err(error) = sleep_until(wake, until) {
                    log::debug!("waiting for requests: {error:?}");
                }
                self.is_asleep.store(false, Ordering::Relaxed);
                is_busy
            }
        }
    }

    /// Threads of the pool that may be awake between frames: the client has a frame to look at, or to
    /// make, and one core is left to it.
    fn most_awake(&self) -> usize {
        self.pool.threads().saturating_sub(1).max(1)
    }

    /// A lane beside lane 0 leaves the lead to it and goes to rest.
    fn leave(&self, lane: usize, mut desk: MutexGuard<'_, Desk>) -> Led {
        desk.crew.rest(lane);
        let was_resting = desk.crew.wake_lane(0);
        drop(desk);
        if was_resting {
            self.unpark(0);
        }
        Led::Rest
    }

    /// What a lane beside lane 0 does instead of sleeping: while lane 0 is away, it looks now and then.
    fn stand_by(&self, lane: usize) -> Led {
        let desk = self.desk();
        if desk.crew.is_resting(0) { self.leave(lane, desk) } else { Led::StandBy }
    }

    /// Spins until the lead is free, or goes to rest. While lane 0 leads asleep, it publishes what a GPU has under
    /// way: lane 0 may have gone to sleep before this one left a frame there.
    fn follow(&self, lane: usize) {
        // As in `pause`.
        fence(Ordering::SeqCst);
        let mut spinner = Spinner::default();
        let mut look_at = Instant::now();
        while self.is_led.load(Ordering::Relaxed) && !self.stop.load(Ordering::Relaxed) {
            if self.is_asleep.load(Ordering::Relaxed) && self.responder.is_busy() {
                if self.responder.publish_ended() {
                    self.desk().note_answer(Instant::now());
                }
                self.responder.rest();
                continue;
            }
            spinner.turn();
            let now = Instant::now();
            if now < look_at {
                continue;
            }
            look_at = now + DESK_LOOK;
            let mut desk = self.desk();
            let may_rest = now >= desk.sleep_at() || lane > 0 && desk.crew.is_too_large(now);
            // The one that leads may have gone to rest just now: then this one is to lead.
            if may_rest && desk.crew.awake() > 1 {
                desk.crew.rest(lane);
                drop(desk);
                return self.rest(lane);
            }
        }
    }

    /// Sleeps until another lane says that this one is wanted. Nobody leads, for a moment, when lanes
    /// rest at the same time: so lane 0 looks now and then.
    fn rest(&self, lane: usize) {
        while !self.stop.load(Ordering::Relaxed) {
            std::thread::park_timeout(LONGEST_SLEEP);
            let mut desk = self.desk();
            let is_alone = lane == 0 && !self.is_led.load(Ordering::Relaxed);
            if is_alone {
                desk.crew.wake_lane(lane);
            }
            if !desk.crew.is_resting(lane) {
                return;
            }
        }
    }

    /// Takes in what has arrived. Whether something had.
    fn receive(&self, lead: &mut Lead) -> bool {
        let Lead { intake, arrived, .. } = lead;
        intake.receive(arrived.capacity(), |incoming| arrived.push(incoming));
        if arrived.is_empty() {
            return false;
        }
        let now = Instant::now();
        for incoming in arrived.drain(..) {
            let Asked { sender, kind, objects } = Asked::of(&incoming);
            let expected = self.responder.clients().expected_work(sender.session, kind, objects);
            self.desk().put(Arrived { incoming, expected }, now);
        }
        true
    }

    fn next_task(&self) -> Option<Task> {
        let task = self.desk().next(Instant::now())?;
        if let Some(lane) = task.wake {
            self.unpark(lane);
        }
        Some(task)
    }

    fn serve(&self, lane: usize, task: Task) {
        let Task { incoming, beside, threads, length, .. } = task;
        let (first, start) = (Asked::of(&incoming), Instant::now());
        let threads = if beside.is_empty() {
            let served = self.responder.take(incoming, threads);
            self.note(&first, &served, start.elapsed());
            served.threads
        } else {
            let asked: Vec<_> =
                std::iter::once(first).chain(beside.iter().map(Asked::of)).collect();
            let requests = std::iter::once(incoming).chain(beside);
            let served = self.responder.take_bundle(requests, threads);
            // They share the time of this thread.
            let took = start.elapsed() / asked.len() as u32;
            asked.iter().zip(&served).for_each(|(asked, served)| self.note(asked, served, took));
            served.iter().map(|served| served.threads).max().unwrap_or(1)
        };
        let sleep_at = self.desk().note_served(first.sender, length, Instant::now());
        if lane == 0 {
            self.pool.keep_until(threads.min(self.most_awake()), sleep_at);
        }
    }

    /// Notes what a request took.
    fn note(&self, asked: &Asked, served: &Served, took: Duration) {
        // Several threads take longer together than one would alone.
        let work = served.on_one_core.unwrap_or(took);
        if served.is_frame {
            let work = FrameWork { objects: asked.objects, work, gpu: served.gpu };
            self.responder.clients().note_work(asked.sender.session, asked.kind, work);
        }
        self.desk().note_used(asked.sender, served.threads, took * served.threads as u32);
    }

    fn unpark(&self, lane: usize) {
        // One that has not begun yet does not sleep.
        if let Some(thread) = self.threads[lane].get() {
            thread.unpark();
        }
    }

    fn desk(&self) -> MutexGuard<'_, Desk> {
        self.desk.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Ends the process where a lane panics, as a panic of its only thread would: the supervisor starts
/// another one.
struct EndWithPanic;

impl Drop for EndWithPanic {
    fn drop(&mut self) {
        if std::thread::panicking() {
            std::process::abort();
        }
    }
}
