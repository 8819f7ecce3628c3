//! A client's end of the connection to a daemon: ports, memory of frames, and the wait for answers. One file,
//! because a frame's memory keeps the link alive, and the link grows and takes that memory back.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::ErrorKind;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::service::ipc_threadsafe;
use pairmask_core::pacing::{Answered, Estimate, Expected};
use pairmask_core::precision::BoxForm;
use pairmask_core::spinner::Spinner;
use pairmask_core::units::BoxCount;
use pairmask_wire::{
    CachedRules, InstanceError, InstanceName, PAGE_BYTES, Page, ReplyError, RequestHeader,
    ResponseHeader, Version, page_count,
};

use crate::foreign::foreign_owner;
use crate::instance::RuntimeDir;
use crate::liveness::DaemonWatch;
use crate::memory::Populated;
use crate::message::CheckedResponse;
use crate::own_request::{OwnRequest, SentRequest};
use crate::process_limits::LimitError;
use crate::room::PopulateError;
use crate::segment::{Segment, SegmentFiles};
use crate::services::{
    Client, ClientPort, FRAMES_AT_A_TIME, OpenError, ResponseSample, Services, TransportError,
};
use crate::vigil::{LeftDaemon, Seen, Vigil, WAIT_SLICE, Watched};

/// Boxes that a frame of the first segment has address space for, where the session names no capacity. Pages
/// cost when frames use them; larger frames make a larger segment.
const RESERVED_BOXES: BoxCount = BoxCount::new(65_536);

/// What a client asks of its connection.
#[derive(Clone, Copy, Debug)]
pub struct LinkOptions<'a> {
    /// Where instances are.
    pub dir: &'a RuntimeDir,
    /// The instance.
    pub instance: &'a InstanceName,
    /// Boxes of its largest frame, whose memory is there before the first one.
    pub capacity: Option<BoxCount>,
    /// Whether the client goes on without a daemon that does not run.
    pub leaves_silent: bool,
}

/// Why there is no connection.
#[derive(Debug)]
pub enum ConnectFailure {
    /// No daemon serves the instance.
    NoDaemon,
    /// The instance is this other user's.
    OtherUser {
        /// The user's id.
        uid: u32,
    },
    /// The daemon speaks this other version of the wire contract.
    OtherVersion(Version),
    /// The instance's directory cannot be used.
    Instance(InstanceError),
    /// The services cannot be opened.
    Open(OpenError),
}

/// Why a request is not sent, or has no answer.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// All slots for frames are held.
    #[error("all slots for frames are held")]
    TooManyFrames,
    /// /dev/shm is full.
    #[error(transparent)]
    OutOfMemory(#[from] PopulateError),
    /// A limit of this process.
    #[error(transparent)]
    Limit(#[from] LimitError),
    /// The transport gave no memory for the request.
    #[error(transparent)]
    NotSent(TransportError),
    /// The transport failed.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// The daemon died.
    #[error("the daemon died")]
    Died,
    /// The daemon has no file left to connect to this client.
    #[error("the daemon can open no more files")]
    Full,
    /// There was no answer within this time.
    #[error("no answer within {waited:?}")]
    Timeout {
        /// How long it was waited for.
        waited: Duration,
    },
    /// The response is malformed.
    #[error(transparent)]
    Reply(#[from] ReplyError),
}

/// A request for which there is no room is sent again this often: a daemon that is not culling receives
/// within a few µs.
const ROOM_INTERVAL: Duration = Duration::from_micros(50);
/// A daemon that makes no room for this long is silent. It culls its largest frames in less, and receives
/// between two frames.
const ROOM_WITHIN: Duration = Duration::from_secs(1);

/// A port and the size of the chunks that it lends.
#[derive(Debug)]
struct SizedPort {
    port: Arc<ClientPort>,
    pages: usize,
}

/// A connection to one daemon process.
pub struct Link {
    token: u64,
    // Ports before the services that they belong to: fields drop in this order.
    sized: Mutex<SizedPort>,
    notifier: Notifier<ipc_threadsafe::Service>,
    listener: Listener<ipc_threadsafe::Service>,
    services: Services,
    daemon: Arc<DaemonWatch>,
    /// Whether the session goes on without a daemon that does not run.
    leaves_silent: bool,
    /// Whether the daemon has answered a request.
    has_answered: AtomicBool,
    populated: Mutex<Populated>,
    estimate: Mutex<Estimate>,
    /// Cores that this process may use.
    cores: usize,
    frames: AtomicUsize,
    cached_rules: CachedRules,
    /// Whether the client has refused a response.
    has_refused: AtomicBool,
    files: SegmentFiles,
    /// The daemon's segment, known from the first response on.
    segment: Mutex<Option<(u128, Segment)>>,
}

impl std::fmt::Debug for Link {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Link").field("token", &self.token).finish_non_exhaustive()
    }
}

/// One of the frames that a client may have at a time. It is taken with the loan and given back
/// with the mask.
pub struct Slot {
    link: Arc<Link>,
}

impl Slot {
    fn take(link: &Arc<Link>) -> Option<Self> {
        let taken = |frames| (frames < FRAMES_AT_A_TIME).then_some(frames + 1);
        link.frames.fetch_update(Ordering::Relaxed, Ordering::Relaxed, taken).ok()?;
        Some(Self { link: Arc::clone(link) })
    }

    /// The connection.
    pub const fn link(&self) -> &Arc<Link> {
        &self.link
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        self.link.frames.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Shared memory for a request, and the port that it belongs to.
pub struct SharedFrame {
    /// Its memory.
    pub loan: OwnRequest,
    port: Arc<ClientPort>,
    /// The slot that it holds.
    pub slot: Slot,
}

fn pages_of(bytes: u64) -> usize {
    page_count(bytes) as usize
}

impl Link {
    /// Connects to the daemon that serves the instance now.
    ///
    /// # Errors
    /// [`ConnectFailure`].
    pub fn open(options: &LinkOptions<'_>) -> Result<Self, ConnectFailure> {
        let &LinkOptions { dir, instance, capacity, leaves_silent } = options;
        let dir = dir.serving(instance);
        let no_daemon = || match foreign_owner(instance) {
            Some(uid) => ConnectFailure::OtherUser { uid },
            None => ConnectFailure::NoDaemon,
        };
        // Another user's files are not opened: their owner could stall this process, or truncate
        // memory that it has mapped.
        let not_ours = |error| match error {
            InstanceError::Foreign { path, owner } if path.starts_with(dir.path()) => {
                ConnectFailure::OtherUser { uid: owner }
            }
            InstanceError::Io { source, .. } if source.kind() == ErrorKind::NotFound => no_daemon(),
            error => ConnectFailure::Instance(error),
        };
        dir.check().map_err(not_ours)?;
        let record = dir.record(instance).map_err(not_ours)?.ok_or_else(no_daemon)?;
        let watch = dir.watch(instance, Some(&record)).map_err(not_ours)?;
        let daemon = Arc::new(watch.ok_or_else(no_daemon)?);
        let mismatch = ConnectFailure::OtherVersion(record.version);
        if !record.version.serves_this_build() {
            return Err(mismatch);
        }
        let open = |error| match error {
            OpenError::NotServed => no_daemon(),
            OpenError::Incompatible => mismatch,
            error => ConnectFailure::Open(error),
        };
        dir.check_transport(instance).map_err(not_ours)?;
        let token = RandomState::new().build_hasher().finish();
        let pages = pages_of(BoxForm::F32.bytes(capacity.unwrap_or(RESERVED_BOXES)));
        let connected = Services::connect(&dir, instance)
            .and_then(|services| Ok((services.client(token, pages)?, services)));
        let (Client { port, notifier, listener }, services) = connected.map_err(open)?;
        // The connection has created files of its own since the first check.
        dir.check_shared_files(instance).map_err(not_ours)?;
        if !daemon.is_alive() {
            // What was connected to may be another worker's by now, which nobody here would watch.
            return Err(no_daemon());
        }
        let link = Self {
            token,
            sized: Mutex::new(SizedPort { port: Arc::new(port), pages }),
            notifier,
            listener,
            services,
            daemon,
            leaves_silent,
            has_answered: AtomicBool::new(false),
            populated: Mutex::default(),
            estimate: Mutex::default(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            frames: AtomicUsize::new(0),
            cached_rules: CachedRules::default(),
            has_refused: AtomicBool::new(false),
            files: SegmentFiles::new(&dir, instance),
            segment: Mutex::default(),
        };
        if capacity.is_some() {
            link.touch_chunks(pages);
        }
        Ok(link)
    }

    /// Populates the chunks that frames will use, before the first frame is timed.
    fn touch_chunks(&self, pages: usize) {
        let port = &lock(&self.sized).port;
        let loans: Vec<_> =
            (0..FRAMES_AT_A_TIME).map_while(|_| OwnRequest::lend(port, pages).ok()).collect();
        for mut loan in loans {
            // Missing memory is an error of the frame that needs it, not of the connection.
            let _ = lock(&self.populated).ensure(loan.pages_mut());
        }
    }

    /// What this client calls itself in requests.
    pub const fn token(&self) -> u64 {
        self.token
    }

    /// Whether its daemon lives.
    pub fn is_alive(&self) -> bool {
        self.daemon.is_alive()
    }

    /// Whether a response was valid enough to be looked at.
    pub fn has_answered(&self) -> bool {
        self.has_answered.load(Ordering::Relaxed)
    }

    /// The daemon of a session that leaves it, because it does not answer.
    pub fn left(&self) -> LeftDaemon {
        LeftDaemon::new(&self.daemon)
    }

    /// The daemon, for who waits for it.
    fn watched(&self) -> Watched<'_> {
        Watched {
            daemon: &self.daemon,
            has_answered: self.has_answered(),
            leaves_silent: self.leaves_silent,
        }
    }

    /// The rules that the daemon keeps.
    pub const fn cached_rules(&self) -> &CachedRules {
        &self.cached_rules
    }

    /// Notes that the client refuses a response, because it is an error or malformed. Whether that is the first one.
    pub fn refuse(&self) -> bool {
        !self.has_refused.swap(true, Ordering::Relaxed)
    }

    /// Memory for `bytes` bytes of objects, populated.
    ///
    /// # Errors
    /// [`LinkError`].
    pub fn loan(self: &Arc<Self>, bytes: u64) -> Result<SharedFrame, LinkError> {
        SharedFrame::lend(Slot::take(self).ok_or(LinkError::TooManyFrames)?, bytes)
    }

    /// Populated pages of a port.
    fn lend(&self, port: &ClientPort, pages: usize) -> Result<OwnRequest, LinkError> {
        let mut loan = OwnRequest::lend(port, pages).map_err(LinkError::NotSent)?;
        lock(&self.populated).ensure(loan.pages_mut())?;
        Ok(loan)
    }

    fn port_for(&self, pages: usize) -> Result<Arc<ClientPort>, LinkError> {
        let mut sized = lock(&self.sized);
        if sized.pages < pages {
            // Doubling: a scene that grows box by box makes few segments.
            let enlarged = pages.next_power_of_two();
            let port = self.services.client_port(enlarged).map_err(|e| match e {
                OpenError::Transport(e) => LinkError::NotSent(e),
                OpenError::OutOfMemory => {
                    PopulateError { bytes: (enlarged * PAGE_BYTES) as u64 }.into()
                }
                OpenError::Limit(limit) => LinkError::Limit(limit),
                other => LinkError::NotSent(TransportError::new("making a larger segment", &other)),
            })?;
            *sized = SizedPort { port: Arc::new(port), pages: enlarged };
            // The new port's chunks are new memory, perhaps at addresses that were populated
            // before.
            *lock(&self.populated) = Populated::default();
        }
        Ok(Arc::clone(&sized.port))
    }

    /// Checks a response against the daemon's segment, and copies its header; `None` where it does not
    /// lie in there.
    pub fn check(&self, sample: ResponseSample) -> Option<(ResponseHeader, CheckedResponse)> {
        let (port, address) = (sample.origin().value(), CheckedResponse::address(&sample));
        let mut known = lock(&self.segment);
        let is_there =
            known.as_ref().is_some_and(|(of, segment)| *of == port && segment.holds(address, 1));
        if !is_there {
            *known = self.files.find(port, address).map(|segment| (port, segment));
        }
        let (_, segment) = known.as_ref()?;
        let checked = CheckedResponse::new(sample, segment)?;
        self.has_answered.store(true, Ordering::Relaxed);
        Some(checked)
    }

    /// Updates the estimate by an answered frame.
    pub fn note_frame(&self, frame: Answered) {
        lock(&self.estimate).note(frame);
    }

    /// What is expected of a frame of `n` boxes.
    pub fn expect(&self, n: u32) -> Expected {
        lock(&self.estimate).expect(n)
    }

    /// Waits for the response to `pending` until `deadline`; `None` if it has not come.
    ///
    /// Naps through most of a request that is expected to be long, spins until `spin` after its
    /// expected end, then sleeps until woken.
    ///
    /// # Errors
    /// [`LinkError`]: there will be none.
    pub fn receive(
        &self,
        pending: &mut SentRequest,
        sent: Instant,
        expected: Expected,
        spin: Duration,
        deadline: Instant,
        vigil: &mut Vigil,
    ) -> Result<Option<ResponseSample>, LinkError> {
        if let Some(sample) = pending.receive()? {
            return Ok(Some(sample));
        }
        let Expected { nap, round_trip, threads } = expected;
        // The daemon may have answered before it died: the response is looked for after the daemon.
        let look = |pending: &mut SentRequest, seen: Seen| match (pending.receive()?, seen) {
            (Some(sample), _) => Ok(Some(sample)),
            (None, Seen::Running) => Ok(None),
            (None, Seen::Dead) => Err(LinkError::Died),
            (None, Seen::Silent) => Err(LinkError::Timeout { waited: sent.elapsed() }),
            (None, Seen::Full) => Err(LinkError::Full),
        };
        if !spin.is_zero() {
            // The nap goes by the system's fine clock. The listener's wait ends with a tick of the
            // coarse clock (1 to 10 ms): a client that naps by it is woken by the answer, 50 µs
            // late.
            let wake_at = (sent + nap).min(deadline);
            loop {
                let left = wake_at.saturating_duration_since(Instant::now());
                if left.is_zero() {
                    break;
                }
                std::thread::sleep(left.min(WAIT_SLICE));
                if let Some(sample) = look(pending, vigil.look_at_times(&self.watched()))? {
                    return Ok(Some(sample));
                }
            }
            // Near its expected end a frame is worth a core: a client that falls asleep just before
            // the answer costs a wake-up on each side, frame after frame.
            let spin_until = (Instant::now().max(sent + round_trip) + spin).min(deadline);
            let mut spinner = Spinner::default();
            while Instant::now() < spin_until {
                if let Some(sample) = look(pending, vigil.look_at_times(&self.watched()))? {
                    return Ok(Some(sample));
                }
                if threads < self.cores {
                    spinner.turn();
                } else {
                    // The engine needs the core that this thread spins on.
                    spinner.offer();
                }
            }
        }
        loop {
            let seen = vigil.look(&self.watched(), Instant::now());
            if let Some(sample) = look(pending, seen)? {
                return Ok(Some(sample));
            }
            if Instant::now() >= deadline {
                return Ok(None);
            }
            self.sleep(deadline)?;
        }
    }

    /// Sleeps until woken, at most a slice and not past `until`.
    fn sleep(&self, until: Instant) -> Result<(), TransportError> {
        let left = until.saturating_duration_since(Instant::now()).min(WAIT_SLICE);
        self.listener
            .timed_wait(|_| {}, left)
            .map(|_| ())
            .map_err(|e| TransportError::new("waiting to be woken", &e))
    }
}

/// A request that could not be sent.
pub struct Unsent {
    error: LinkError,
    /// Its memory, where that is kept.
    memory: Option<UnsentMemory>,
}

enum UnsentMemory {
    /// The daemon receives nothing.
    Undelivered {
        sent: SentRequest,
        _slot: Slot,
    },
    Kept(SharedFrame),
}

impl Unsent {
    /// Why it was not sent.
    pub const fn error(&self) -> &LinkError {
        &self.error
    }

    /// The pages of the request, where they are kept.
    pub fn pages(&self) -> Option<&[Page]> {
        Some(match self.memory.as_ref()? {
            UnsentMemory::Undelivered { sent, .. } => sent.pages(),
            UnsentMemory::Kept(shared) => shared.loan.pages(),
        })
    }

    /// Why it was not sent.
    pub fn into_error(self) -> LinkError {
        self.error
    }
}

impl SharedFrame {
    /// Memory for `bytes` bytes, in the place of a frame.
    ///
    /// # Errors
    /// [`LinkError`].
    pub fn lend(slot: Slot, bytes: u64) -> Result<Self, LinkError> {
        let pages = pages_of(bytes);
        let port = slot.link.port_for(pages)?;
        let loan = slot.link.lend(&port, pages)?;
        Ok(Self { loan, port, slot })
    }

    /// The frame in memory of so many bytes, with a copy of the first `used` bytes, where it has fewer.
    /// The error holds the frame where its memory is kept, for a caller that goes on with it.
    ///
    /// # Errors
    /// [`LinkError`].
    #[allow(clippy::result_large_err)]
    pub fn enlarged(self, bytes: u64, used: u64) -> Result<Self, (LinkError, Option<Self>)> {
        let (pages, used) = (pages_of(bytes), pages_of(used));
        if pages <= self.loan.pages().len() {
            return Ok(self);
        }
        let port = match self.slot.link.port_for(pages) {
            Ok(port) => port,
            Err(error) => return Err((error, Some(self))),
        };
        if let Ok(mut loan) = self.slot.link.lend(&port, pages) {
            loan.pages_mut()[..used].copy_from_slice(&self.loan.pages()[..used]);
            return Ok(Self { loan, port, slot: self.slot });
        }
        // All memory of the port is lent: this frame's goes back first.
        let Self { loan, slot, .. } = self;
        let own = loan.pages()[..used].to_vec();
        drop(loan);
        let mut loan = slot.link.lend(&port, pages).map_err(|error| (error, None))?;
        loan.pages_mut()[..used].copy_from_slice(&own);
        Ok(Self { loan, port, slot })
    }

    /// Sends the frame and wakes the daemon. Waits for room where the daemon has not yet received what
    /// the session sent, and dropped, before.
    ///
    /// # Errors
    /// [`Unsent`].
    #[allow(clippy::result_large_err)] // As above.
    pub fn send(self, header: &RequestHeader) -> Result<(SentRequest, Slot), Unsent> {
        // `send` drops the memory when it fails, and it fails where the daemon has exited or is new. The
        // connection is updated first, while the session still owns the boxes.
        if self.port.update_connections().is_err() || !self.slot.link.is_alive() {
            let memory = Some(UnsentMemory::Kept(self));
            return Err(Unsent { error: LinkError::Died, memory });
        }
        let lost = |error: TransportError| Unsent { error: error.into(), memory: None };
        let Self { loan, port, slot } = self;
        let link = &slot.link;
        let mut sent = loan.send(header).map_err(lost)?;
        // A spinning daemon needs no wake-up, but the client cannot see whether it spins. A
        // notification costs 50 ns while the daemon is awake. If it fails, the daemon still looks
        // for requests at intervals.
        let _ = link.notifier.notify();
        if !sent.is_delivered() {
            let since = Instant::now();
            let mut vigil = Vigil::default();
            while !sent.is_delivered()
                && matches!(vigil.look_at_times(&link.watched()), Seen::Running)
                && since.elapsed() < ROOM_WITHIN
            {
                std::thread::sleep(ROOM_INTERVAL);
                // The transport sends no memory twice.
                if let Ok(mut again) = link.lend(&port, sent.pages().len()) {
                    again.pages_mut().copy_from_slice(sent.pages());
                    // It counts as one under way.
                    drop(sent);
                    sent = again.send(header).map_err(lost)?;
                }
                let _ = link.notifier.notify();
            }
            if !sent.is_delivered() {
                let waited = since.elapsed();
                let is_alive = link.is_alive();
                let error = if is_alive { LinkError::Timeout { waited } } else { LinkError::Died };
                let memory = Some(UnsentMemory::Undelivered { sent, _slot: slot });
                return Err(Unsent { error, memory });
            }
        }
        Ok((sent, slot))
    }
}

const _: () = assert!(PAGE_BYTES.is_multiple_of(64), "boxes start on a cache line");

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
