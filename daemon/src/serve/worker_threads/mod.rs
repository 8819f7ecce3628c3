//! Worker threads, that serve requests side by side.
//!
//! Every one does all of a frame: the thread that receives a request culls and answers it, so that a lone
//! client's frame is handed to no other thread. One idle thread at a time **leads**: it looks for requests,
//! and gives the lead up as soon as it has one to serve. Others that are awake **follow**: they spin
//! until the lead is free. All others rest. What they agree on (whose turn it is, who does what) stands
//! in the scheduler, under one lock that is held for a fraction of a microsecond.
//!
//! There is one thread more than cores, and the last one that is not away with a long frame begins none: requests that
//! are served soon never wait for the end of long ones.
//!
//! Worker thread 0 is the first thread of the engines' pool: large frames of a lone client start there without a
//! hand-over. When all is quiet it alone sleeps until a client wakes it; others rest until a thread
//! wakes them. Beside them the tidier, a thread of its own, frees what dead clients leave.
//!
//! ```text
//! workers    what each thread does, and who listens     (pure)
//! sleeper    the leader's sleep, and frames that others leave with a GPU meanwhile
//! scheduler  whose turn it is, with how many threads, and how long they spin  (pure)
//! mod        the threads
//! ```

mod scheduler;
mod sleeper;
mod workers;

use std::sync::atomic::{self, AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};
use std::thread::Thread;
use std::time::{Duration, Instant};

use pairmask_core::spinner::Spinner;
use pairmask_transport::{ClientSlot, GpuCounts, Sender};

use self::scheduler::{Arrived, LONGEST_SLEEP, Rest, Scheduler, Task};
use self::sleeper::Sleeper;
use self::workers::Workers;
use super::status_writer::StatusWriter;
use super::{ServeError, ServeSettings, TIDY_INTERVAL};
use crate::clients::{Client, FrameWork, GpuNeed, RequestKind};
use crate::execute::CpuTimer;
use crate::ingest::{Incoming, Intake, RequestQueue};
use crate::locked;
use crate::requests::{EndWithPanic, Responder, Served};

/// A worker thread that stands by while others serve long frames looks for requests this often: 1 % of a core, and
/// a client that begins to send meanwhile waits for it once.
const STAND_BY_NAP: Duration = Duration::from_micros(500);

const SCHEDULER_LOOK: Duration = Duration::from_micros(10);

/// While requests are served, a thread that rests looks up this often whether one takes much longer than expected:
/// 0.02 % of a core. Others wait for it so long at most.
const RELIEF_LOOK: Duration = Duration::from_millis(20);

/// Between two looks whether a GPU that is being opened is there: so much later it joins at the most.
const OPENING_LOOK: Duration = Duration::from_millis(20);

pub(super) struct WorkerThreads<'a> {
    responder: Responder,
    lead: Mutex<Lead>,
    /// Whether a thread leads, as the scheduler has it.
    is_led: AtomicBool,
    /// Worker thread 0, where it leads.
    sleeper: Sleeper,
    scheduler: Mutex<Scheduler>,
    threads: Vec<OnceLock<Thread>>,
    writer: &'a StatusWriter,
    stop: &'a AtomicBool,
}

struct Lead {
    intake: Intake,
    arrived: Vec<Incoming>,
    tidy_at: Instant,
}

/// What is noted of a request when it was served.
#[derive(Clone)]
struct Asked {
    sender: Sender,
    counts: Arc<ClientSlot>,
    kind: RequestKind,
    objects: u32,
}

impl Asked {
    fn of(incoming: &Incoming) -> Self {
        let header = incoming.request.header();
        let kind = RequestKind::of(header);
        let counts = Arc::clone(incoming.request.counts());
        Self { sender: incoming.sender, counts, kind, objects: header.box_count }
    }
}

#[allow(clippy::large_enum_variant)] // A box would be an allocation.
enum Led {
    Task(Task),
    /// Another worker thread may be about to lead, and this one looks again later.
    StandBy,
    Rest,
    Stop,
}

impl<'a> WorkerThreads<'a> {
    /// One thread more than cores: one listens while all others are away.
    pub(super) fn new(
        intake: Intake,
        responder: Responder,
        cores: usize,
        settings: &ServeSettings,
        writer: &'a StatusWriter,
        stop: &'a AtomicBool,
    ) -> Self {
        let worker_count = cores + 1;
        let workers = Workers::new(worker_count, cores);
        let gpus = responder.culls.gpus().iter().count();
        let queue = RequestQueue::new(settings.daemon.limits.max_clients, gpus);
        let scheduler = Scheduler::new(queue, workers, settings.daemon.spin, cores);
        let arrived = Vec::with_capacity(scheduler.queue.room());
        Self {
            responder,
            lead: Mutex::new(Lead { intake, arrived, tidy_at: Instant::now() }),
            is_led: AtomicBool::new(false),
            sleeper: Sleeper::default(),
            scheduler: Mutex::new(scheduler),
            threads: (0..worker_count).map(|_| OnceLock::new()).collect(),
            writer,
            stop,
        }
    }

    /// Serves until asked to stop. This thread is worker thread 0.
    pub(super) fn run(&self) -> Result<(), ServeError> {
        std::thread::scope(|scope| {
            let mut others = Vec::with_capacity(self.threads.len());
            for worker in 1..self.threads.len() {
                let other = std::thread::Builder::new()
                    .name(format!("worker-{worker}"))
                    .spawn_scoped(scope, move || self.serve_in(worker))
                    .inspect_err(|_| self.stop.store(true, Ordering::Relaxed))
                    .map_err(ServeError::system("starting a worker thread"))?;
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
                // take for ever: see `gpu::slot`. One that panicked has ended the process.
                let _ = thread.join();
            }
            Ok(())
        })
    }

    /// On a thread of its own: to free a large scene, or take a dead writer's boxes out, takes a while.
    fn tidy_until_stopped(&self) {
        let _end = EndWithPanic;
        let mut gpus = GpuCounts::default();
        while !self.stop.load(Ordering::Relaxed) {
            self.responder.tidy();
            let now = self.gpu_counts();
            if now != gpus {
                gpus = now;
                let names = self.responder.culls.gpus().names();
                self.responder.outbox.counters().note_gpus(names.iter().map(String::as_str));
                self.writer.post(&self.responder.outbox.status_file(gpus));
            }
            let pause = if gpus.opening > 0 { OPENING_LOOK } else { TIDY_INTERVAL };
            std::thread::park_timeout(pause);
        }
    }

    fn gpu_counts(&self) -> GpuCounts {
        self.responder.culls.gpus().counts()
    }

    fn serve_in(&self, worker: usize) {
        let _end = EndWithPanic;
        // Nothing else sets it.
        let _ = self.threads[worker].set(std::thread::current());
        while !self.stop.load(Ordering::Relaxed) {
            if !self.takes_lead(worker) {
                match self.next_task(worker) {
                    Some(task) => self.serve(worker, task),
                    None => self.follow(worker),
                }
                continue;
            }
            // Who led before gives it back in a moment.
            let mut lead = locked(&self.lead);
            let led = self.lead(worker, &mut lead);
            drop(lead);
            match led {
                Led::Task(task) => self.serve(worker, task),
                Led::StandBy => std::thread::park_timeout(STAND_BY_NAP),
                Led::Rest => self.rest(worker),
                Led::Stop => {}
            }
        }
        self.threads.iter().filter_map(OnceLock::get).for_each(Thread::unpark);
    }

    /// An idle thread leads from now on, unless another one does. Whether it does.
    fn takes_lead(&self, worker: usize) -> bool {
        let mut scheduler = locked(&self.scheduler);
        let leads = scheduler.workers.lead(worker);
        self.note_lead(&scheduler);
        leads
    }

    /// Informs those who spin whether a thread leads. To be called after each change, under the scheduler's lock.
    fn note_lead(&self, scheduler: &Scheduler) {
        self.is_led.store(scheduler.workers.is_led(), Ordering::Release);
    }

    /// Looks for requests until there is one to serve, or nothing to look for.
    fn lead(&self, worker: usize, lead: &mut Lead) -> Led {
        let mut spinner = Spinner::default();
        let mut may_begin = true;
        let (mut look_at, mut sleep_at) = (Instant::now(), Instant::now());
        while !self.stop.load(Ordering::Relaxed) {
            let has_arrived = self.receive(lead);
            // Requests that came together with one that another thread serves wait in the scheduler, or for the pool.
            if (has_arrived || std::mem::take(&mut may_begin))
                && let Some(task) = self.next_task(worker)
            {
                return Led::Task(task);
            }
            let published = self.responder.culls.publish_ended();
            let now = Instant::now();
            if now >= lead.tidy_at {
                self.writer.post(&self.responder.outbox.status_file(self.gpu_counts()));
                lead.tidy_at = now + TIDY_INTERVAL;
            }
            if published || now >= look_at {
                let mut scheduler = locked(&self.scheduler);
                if published {
                    scheduler.note_answer(now);
                }
                sleep_at = scheduler.sleep_at;
                may_begin = scheduler.is_waited();
                look_at = now + SCHEDULER_LOOK;
                if worker > 0 && scheduler.workers.is_too_many(now) {
                    return self.leave(worker, scheduler);
                }
                if worker > 0 && !scheduler.is_awaiting(now) {
                    // A client that is active is being served: nothing to spin for.
                    sleep_at = now;
                }
            }
            if self.responder.culls.is_busy() {
                self.responder.culls.rest();
            } else if now < sleep_at {
                spinner.turn();
            } else if worker > 0 {
                return self.stand_by(worker);
            } else if self.pause(&lead.intake, now) {
                spinner.turn();
            }
        }
        Led::Stop
    }

    /// Worker thread 0 sleeps until a request comes or is due soon. `true`, at once, where one is due now.
    fn pause(&self, intake: &Intake, now: Instant) -> bool {
        let rest = locked(&self.scheduler).rest(now);
        match rest {
            Rest::Spin { .. } => true,
            Rest::Sleep { until } => {
                let is_busy = || self.responder.culls.is_busy();
                self.sleeper.sleep_unless(is_busy, || {
                    // A request that came between the last look and the sleep has left its wake-up: it is
                    // not lost, the sleep ends at once.
                    if let Err(error) = intake.sleep_until(until) {
                        log::debug!("waiting for requests: {error:?}");
                    }
                })
            }
        }
    }

    /// A worker thread beside worker thread 0 gives the lead up, to worker thread 0 where that rests, and rests itself where others listen.
    fn leave(&self, worker: usize, mut scheduler: MutexGuard<'_, Scheduler>) -> Led {
        let was_resting = scheduler.workers.wake(0);
        let rests = scheduler.workers.rest(worker);
        if !rests {
            scheduler.workers.end(worker);
        }
        self.note_lead(&scheduler);
        drop(scheduler);
        if was_resting {
            self.unpark(0);
        }
        if rests { Led::Rest } else { Led::StandBy }
    }

    /// What a worker thread beside worker thread 0 does instead of sleeping: while worker thread 0 is away, it looks now and then.
    fn stand_by(&self, worker: usize) -> Led {
        let mut scheduler = locked(&self.scheduler);
        if scheduler.workers.is_resting(0) {
            return self.leave(worker, scheduler);
        }
        scheduler.workers.end(worker);
        self.note_lead(&scheduler);
        Led::StandBy
    }

    /// Spins until the lead is free, or goes to rest. While worker thread 0 leads asleep, it publishes what a GPU has under
    /// way: worker thread 0 may have gone to sleep before this one left a frame there.
    fn follow(&self, worker: usize) {
        let leader = self.sleeper.watch();
        let mut spinner = Spinner::default();
        let mut look_at = Instant::now();
        while self.is_led.load(Ordering::Acquire) && !self.stop.load(Ordering::Relaxed) {
            if leader.is_asleep() && self.responder.culls.is_busy() {
                if self.responder.culls.publish_ended() {
                    locked(&self.scheduler).note_answer(Instant::now());
                }
                self.responder.culls.rest();
                continue;
            }
            spinner.turn();
            let now = Instant::now();
            if now < look_at {
                continue;
            }
            look_at = now + SCHEDULER_LOOK;
            let mut scheduler = locked(&self.scheduler);
            let (sleep_at, workers) = (scheduler.sleep_at, &mut scheduler.workers);
            let may_rest = now >= sleep_at || worker > 0 && workers.is_too_many(now);
            if may_rest && workers.rest(worker) {
                drop(scheduler);
                return self.rest(worker);
            }
        }
    }

    /// Sleeps until another thread says that this one is needed, or serves a frame for much longer than expected.
    fn rest(&self, worker: usize) {
        let (mut served_before, mut until_look) = (0, RELIEF_LOOK);
        while !self.stop.load(Ordering::Relaxed) {
            std::thread::park_timeout(until_look);
            let mut scheduler = locked(&self.scheduler);
            if !scheduler.workers.is_resting(worker)
                || scheduler.workers.relieve(worker, Instant::now())
            {
                return;
            }
            let served = scheduler.tasks;
            // The first of them looks up most often: all of a large machine would cost more than they are worth.
            let turn = 1 + scheduler.workers.resting_before(worker) as u32;
            until_look = if served == served_before {
                LONGEST_SLEEP
            } else {
                LONGEST_SLEEP.min(RELIEF_LOOK * turn)
            };
            served_before = served;
        }
    }

    /// Takes in what has arrived. Whether something had.
    fn receive(&self, lead: &mut Lead) -> bool {
        let Lead { intake, arrived, .. } = lead;
        intake.receive(|incoming| arrived.push(incoming));
        if arrived.is_empty() {
            return false;
        }
        let now = Instant::now();
        for incoming in arrived.drain(..) {
            let header = incoming.request.header();
            let (session, kind) = (incoming.sender.session, RequestKind::of(header));
            let clients = &self.responder.outbox.clients;
            let expected = clients.expected_work(session, kind, header.box_count);
            let mut scheduler = locked(&self.scheduler);
            scheduler.put(Arrived { incoming, expected }, now);
            self.note_queue(&scheduler);
        }
        true
    }

    /// Shows how many requests wait and are served. To be called after each change, under the scheduler's lock.
    fn note_queue(&self, scheduler: &Scheduler) {
        let queue = &scheduler.queue;
        self.responder.outbox.counters().note_queue(queue.waiting(), queue.serving());
    }

    /// A request that this thread serves from now on; it leads no longer then.
    fn next_task(&self, worker: usize) -> Option<Task> {
        let mut scheduler = locked(&self.scheduler);
        let task = scheduler.next(worker, Instant::now())?;
        self.note_lead(&scheduler);
        self.note_queue(&scheduler);
        drop(scheduler);
        if let Some(worker) = task.wake {
            self.unpark(worker);
        }
        Some(task)
    }

    fn serve(&self, worker: usize, task: Task) {
        let Task { incoming, beside, threads, has_turns, .. } = task;
        let (first, sender) = (Asked::of(&incoming), incoming.sender);
        let (start, timer) = (Instant::now(), CpuTimer::start());
        let took = |served: &Served| {
            // A frame has used a GPU while its thread waited for that one.
            let on_gpu = served.on_gpu || served.gpu != GpuNeed::None;
            if on_gpu { start.elapsed() } else { timer.elapsed() }
        };
        if beside.is_empty() {
            let served = self.responder.take(incoming, threads);
            self.note(&first, &served, took(&served));
        } else {
            let asked: Vec<_> =
                std::iter::once(first).chain(beside.iter().map(Asked::of)).collect();
            let requests = std::iter::once(incoming).chain(beside);
            let served = self.responder.take_bundle(requests, threads);
            // They share the time of this thread.
            let share = asked.len() as u32;
            let each = asked.iter().zip(&served);
            each.for_each(|(asked, served)| self.note(asked, served, took(served) / share));
        }
        let mut scheduler = locked(&self.scheduler);
        scheduler.note_served(worker, sender, has_turns, Instant::now());
        self.note_queue(&scheduler);
    }

    /// Notes what a request took of each thread that served it.
    fn note(&self, asked: &Asked, served: &Served, took: Duration) {
        let at_most = |work: Duration| match asked.kind.most_work(asked.objects) {
            Some(most) if !served.on_gpu => work.min(most),
            _ => work,
        };
        let used = at_most(took * served.threads as u32);
        // Several threads take longer together than one would alone.
        let work = at_most(served.on_one_core.unwrap_or(took));
        if served.is_frame {
            let work = FrameWork { objects: asked.objects, work, gpu: served.gpu };
            let note = |client: &mut Client| client.last_work.note(asked.kind, work);
            self.responder.outbox.clients.of(asked.sender.session, note);
        }
        asked.counts.note_used(used.as_nanos() as u64);
        locked(&self.scheduler).queue.note_served(asked.sender, used);
    }

    fn unpark(&self, worker: usize) {
        // One that has not begun yet does not sleep.
        if let Some(thread) = self.threads[worker].get() {
            thread.unpark();
        }
    }
}
