//! What is done with a request: validated once, then given to the file of its operation.
//!
//! An operation is a file here and an arm in `Responder::open`. Threads take requests side by side,
//! of one session one at a time.

mod asked;
mod cull;
mod filtered;
mod gpu_lines;
mod scene;
mod shared;

pub use crate::clients::GpuNeed;

use std::sync::Arc;
use std::time::Duration;

use pairmask_core::engine::CullError;
use pairmask_transport::{Door, ProcessNote};
use pairmask_wire::{CullRequest, PAGE_BYTES, Request, StatusBody, response_status};
use rustix::time::ClockId;

use self::asked::Asked;
use self::cull::Culls;
use self::scene::{SceneEdits, SceneTools};
use self::shared::SharedScenes;
use crate::audit::Auditor;
use crate::clients::{Clients, SceneTotals};
use crate::execute::{EnginePool, Executor, used_by};
use crate::ingest::Incoming;
use crate::publish::{OpenRequest, Outbox};
use crate::recording::Recorder;
use crate::serve::{ServeError, ServeSettings};

/// Memory of answers that none of this time needed is given back: longer than a game's menus or a level that loads,
/// as with the engines' scratch. That of a disconnected client is given back at once.
const IDLE: Duration = Duration::from_secs(10);

/// Bytes of a pair of indices.
const PAIR_BYTES: u64 = size_of::<[u32; 2]>() as u64;

const _: () = assert!(size_of::<StatusBody>() <= PAGE_BYTES, "a status fits one page");

/// Ends the process where a thread that serves panics: the supervisor starts another one.
pub struct EndWithPanic;

impl Drop for EndWithPanic {
    fn drop(&mut self) {
        if std::thread::panicking() {
            std::process::abort();
        }
    }
}

pub struct Responder {
    pub(crate) culls: Culls,
    scenes: SceneEdits,
    shared: SharedScenes,
    pub(crate) outbox: Arc<Outbox>,
    door: Arc<Door>,
    recorder: Option<Arc<Recorder>>,
    /// Of an answer.
    limit_bytes: u64,
}

/// Threads of so many that a request may have, where its client asks for some.
fn threads_of(asked: Option<usize>, threads: usize) -> usize {
    asked.map_or(threads, |asked| asked.min(threads)).max(1)
}

#[derive(Clone, Copy, Debug)]
pub struct Served {
    pub threads: usize,
    /// What it was predicted to take on one core, where several threads took part.
    pub on_one_core: Option<Duration>,
    /// Whether a GPU answered: the thread that served it has waited then.
    pub on_gpu: bool,
    /// Whether it went to the GPU and would have taken a core much longer.
    pub gpu: GpuNeed,
    /// Whether it was a frame, by which the next is judged.
    pub is_frame: bool,
}

impl Served {
    /// A frame that was begun or refused by one thread.
    pub(crate) const BEGUN: Self =
        Self { threads: 1, on_one_core: None, on_gpu: false, gpu: GpuNeed::None, is_frame: true };
    const OTHER: Self = Self { is_frame: false, ..Self::BEGUN };
}

impl Responder {
    /// Sessions get engines like `executor`; large frames are culled in `pool`.
    pub fn new(
        door: Arc<Door>,
        settings: &ServeSettings,
        executor: Executor,
        pool: Arc<EnginePool>,
        auditor: Auditor,
        recorder: Option<Arc<Recorder>>,
    ) -> Result<Self, ServeError> {
        let limits = &settings.daemon.limits;
        // One more is the supervisor.
        let clients = Clients::new(limits.max_clients + 1);
        let totals = SceneTotals::default();
        let auditor = Arc::new(auditor);
        let alter = settings.alter_answers;
        let outbox =
            Outbox::new(Arc::clone(&door), clients, Arc::clone(&auditor), totals.clone(), alter);
        let outbox = Arc::new(outbox);
        let (isa, calibration) = executor.cpu_settings();
        let tools = SceneTools {
            isa,
            calibration,
            gpus: executor.gpus().clone(),
            totals,
            pool: Arc::clone(&pool),
            counters: Arc::clone(door.counters()),
            auditor,
        };
        Ok(Self {
            shared: SharedScenes::new(tools.clone(), Arc::clone(&outbox))?,
            scenes: SceneEdits { tools, outbox: Arc::clone(&outbox) },
            culls: Culls::new(executor, pool, Arc::clone(&outbox)),
            outbox,
            door,
            recorder,
            limit_bytes: limits.max_reply_bytes,
        })
    }

    /// Answers a request, or leaves it under way. A CPU engine may use so many threads.
    pub fn take(&self, incoming: Incoming, threads: usize) -> Served {
        match self.open(incoming, threads) {
            Ok((open, request)) => self.culls.take(open, &request, threads),
            Err(served) => served,
        }
    }

    /// As [`Self::take`]; small frames for the GPU share a submission.
    pub fn take_bundle(
        &self,
        requests: impl IntoIterator<Item = Incoming>,
        threads: usize,
    ) -> Vec<Served> {
        let opened = requests.into_iter().map(|incoming| self.open(incoming, threads));
        self.culls.take_bundle(opened, threads)
    }

    /// A request for pairs; any other one is served, and an error.
    fn open(
        &self,
        incoming: Incoming,
        threads: usize,
    ) -> Result<(OpenRequest, CullRequest), Served> {
        let mut open = OpenRequest::new(incoming, self.limit_bytes);
        if !open.is_wanted() {
            return Err(Served::OTHER);
        }
        let request = open.parse();
        // What gives memory back, or asks how things are, is never too much.
        let takes_none =
            matches!(request, Ok(Request::EndScene(_) | Request::LeaveShared(_) | Request::Status));
        if !takes_none && let Err(over) = open.charge_payload() {
            return Err(self.outbox.refuse_and_close(open, over.into()));
        }
        if let (Ok(request), Some(recorder)) = (&request, &self.recorder)
            && !matches!(request, Request::Status)
            && !self.door.is_supervisor(open.sender.process)
        {
            open.record(recorder, request);
        }
        match request {
            Ok(Request::Cull(request)) => return Ok((open, request)),
            Ok(Request::EditScene(request)) => {
                return Err(self.scenes.take(open, &request, threads));
            }
            Ok(Request::QueryScene(request)) => {
                return Err(self.ask(open, Asked::Query(&request), threads));
            }
            Ok(Request::CastScene(request)) => {
                return Err(self.ask(open, Asked::Cast(&request), threads));
            }
            Ok(Request::CommitShared(request)) => {
                return Err(self.shared.commit(open, &request));
            }
            Ok(Request::JoinShared(request)) => {
                self.shared.join(open, &request);
                return Err(Served::OTHER);
            }
            Ok(Request::LeaseShared(request)) => {
                self.shared.lease(open, &request);
                return Err(Served::OTHER);
            }
            Ok(Request::ObserveShared(request)) => {
                self.shared.observe(open, &request);
                return Err(Served::OTHER);
            }
            Ok(Request::LeaveShared(scene)) => self.shared.leave(&mut open, scene),
            Ok(Request::EndScene(scene)) => self.scenes.end(&mut open, scene),
            Ok(Request::Status) => match open.put(bytemuck::bytes_of(&self.outbox.status())) {
                Ok(()) => {
                    let header = response_status(&open.fields);
                    open.send(&header);
                }
                Err(error) => self.outbox.refuse(&mut open, &CullError::from(error).into()),
            },
            Err(reject) => self.outbox.refuse(&mut open, &reject.into()),
        }
        drop(open);
        Err(Served::OTHER)
    }

    fn ask(&self, open: OpenRequest, asked: Asked<'_>, threads: usize) -> Served {
        match asked.revision() {
            Some(revision) => self.scenes.ask(open, asked, revision, threads),
            None => self.shared.ask(open, asked, threads),
        }
    }

    pub fn tidy(&self) {
        if let Some(recorder) = &self.recorder {
            recorder.note_sessions(&self.door.sessions());
        }
        self.culls.tidy(&self.door.segments());
        self.outbox.clients.tidy(|| self.outbox.sessions());
        self.shared.tidy();
        self.door.tidy(IDLE, |range| self.culls.release_reply(range));
        self.note_process();
    }

    /// Has the counters show the worker's memory and CPU time.
    fn note_process(&self) {
        let budget = self.door.budget();
        budget.note_process();
        let (memory_bytes, memory_limit_bytes) = budget.used();
        let cpu_ns = used_by(ClockId::ProcessCPUTime).as_nanos() as u64;
        self.door.counters().note_process(ProcessNote { memory_bytes, memory_limit_bytes, cpu_ns });
    }
}
