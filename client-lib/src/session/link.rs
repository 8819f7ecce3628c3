//! A client's end of the connection to a daemon: ports, memory of frames, and the wait for answers. One file,
//! because a frame's memory keeps the link alive, and the link grows and takes that memory back.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::ErrorKind;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::service::ipc_threadsafe;
use pairmask_core::precision::BoxForm;
use pairmask_core::rhythm::{Answered, Estimate, Expected};
use pairmask_core::spinner::Spinner;
use pairmask_core::units::BoxCount;
use pairmask_wire::{
    InstanceError, PAGE_BYTES, Page, ReplyError, RequestHeader, ResponseHeader, Version, page_count,
};

use super::error::{ConnectError, Error, Loss};
use super::kept_rules::KeptRules;
use super::settings::{Backend, Settings};
use super::spares::lock;
use crate::transport::{
    CheckedResponse, Client, ClientPort, DaemonWatch, FRAMES_AT_A_TIME, LeftDaemon, OpenError,
    OwnRequest, PopulateError, Populated, ResponseSample, Seen, Segment, SegmentFiles, SentRequest,
    Services, TransportError, Vigil, WAIT_SLICE, Watched, foreign_owner, quiet_transport_log,
};

/// Boxes that a frame of the first segment has address space for, where the session names no capacity. Pages
/// cost when frames use them; larger frames make a larger segment.
const RESERVED_BOXES: BoxCount = BoxCount::new(65_536);

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
pub(super) struct Link {
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
    kept_rules: KeptRules,
    /// Whether the log says that responses of this daemon are refused.
    reported_refused: AtomicBool,
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
pub(super) struct Slot {
    link: Arc<Link>,
}

impl Slot {
    fn take(link: &Arc<Link>) -> Option<Self> {
        let taken = |frames| (frames < FRAMES_AT_A_TIME).then_some(frames + 1);
        link.frames.fetch_update(Ordering::Relaxed, Ordering::Relaxed, taken).ok()?;
        Some(Self { link: Arc::clone(link) })
    }

    pub(super) const fn link(&self) -> &Arc<Link> {
        &self.link
    }
}

impl Drop for Slot {
    fn drop(&mut self) {
        self.link.frames.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Shared memory for a request, and the port that it belongs to.
pub(super) struct SharedFrame {
    pub loan: OwnRequest,
    port: Arc<ClientPort>,
    pub slot: Slot,
}

fn pages_of(bytes: u64) -> usize {
    page_count(bytes) as usize
}

impl Link {
    /// The backend that a session uses for the one asked for: in a build with a transport, the
    /// same.
    #[allow(clippy::unnecessary_wraps)] // A build without one refuses a backend.
    pub(super) fn backend(asked: Backend) -> Result<Backend, ConnectError> {
        quiet_transport_log();
        Ok(asked)
    }

    /// Connects to the daemon that serves the instance now.
    pub(super) fn open(settings: &Settings) -> Result<Self, ConnectError> {
        let instance = &settings.instance;
        let dir = settings.dir.serving(instance);
        let no_daemon = || match foreign_owner(instance) {
            Some(uid) => ConnectError::OtherUser { instance: instance.clone(), uid },
            None => no_daemon(settings),
        };
        // Another user's files are not opened: their owner could stall this process, or truncate
        // memory that it has mapped.
        let not_ours = |error| match error {
            InstanceError::Foreign { path, owner } if path.starts_with(dir.path()) => {
                ConnectError::OtherUser { instance: instance.clone(), uid: owner }
            }
            InstanceError::Io { source, .. } if source.kind() == ErrorKind::NotFound => no_daemon(),
            error => error.into(),
        };
        dir.check().map_err(not_ours)?;
        let record = dir.record(instance).map_err(not_ours)?.ok_or_else(no_daemon)?;
        let watch = dir.watch(instance, Some(&record)).map_err(not_ours)?;
        let daemon = Arc::new(watch.ok_or_else(no_daemon)?);
        let mismatch =
            ConnectError::VersionMismatch { client: Version::CURRENT, daemon: record.version };
        if !record.version.serves_this_build() {
            return Err(mismatch);
        }
        let open = |e: OpenError| match e {
            OpenError::NotServed => no_daemon(),
            OpenError::Incompatible => mismatch,
            OpenError::TooManyClients => {
                ConnectError::TooManyClients { instance: instance.clone() }
            }
            OpenError::OutOfMemory => ConnectError::OutOfMemory,
            OpenError::Gone => ConnectError::FilesGone { instance: instance.clone() },
            OpenError::Limit(limit) => limit.into(),
            OpenError::Transport(e) => e.into(),
        };
        dir.check_transport(instance).map_err(not_ours)?;
        let token = RandomState::new().build_hasher().finish();
        let capacity = settings.capacity.unwrap_or(RESERVED_BOXES);
        let pages = pages_of(BoxForm::F32.bytes(capacity));
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
            leaves_silent: settings.backend == Backend::Auto,
            has_answered: AtomicBool::new(false),
            populated: Mutex::default(),
            estimate: Mutex::default(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            frames: AtomicUsize::new(0),
            kept_rules: KeptRules::default(),
            reported_refused: AtomicBool::new(false),
            files: SegmentFiles::new(&dir, instance),
            segment: Mutex::default(),
        };
        if settings.capacity.is_some() {
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

    pub(super) const fn token(&self) -> u64 {
        self.token
    }

    pub(super) fn is_alive(&self) -> bool {
        self.daemon.is_alive()
    }

    /// Whether a response was valid enough to be looked at.
    pub(super) fn has_answered(&self) -> bool {
        self.has_answered.load(Ordering::Relaxed)
    }

    /// The daemon of a session that leaves it, because it does not answer.
    pub(super) fn left(&self) -> LeftDaemon {
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
    pub(super) const fn kept_rules(&self) -> &KeptRules {
        &self.kept_rules
    }

    /// Logs once that a frame is answered in process, because the daemon's response is an error or
    /// malformed.
    pub(super) fn say_refused(&self, why: &ReplyError) {
        if !self.reported_refused.swap(true, Ordering::Relaxed) {
            log::warn!("a frame is answered in process, and others may be: {why}");
        }
    }

    /// Memory for `bytes` bytes of objects, populated.
    pub(super) fn loan(self: &Arc<Self>, bytes: u64) -> Result<SharedFrame, Error> {
        SharedFrame::lend(Slot::take(self).ok_or(Error::TooManyFrames)?, bytes)
    }

    /// Populated pages of a port.
    fn lend(&self, port: &ClientPort, pages: usize) -> Result<OwnRequest, Error> {
        let mut loan = OwnRequest::lend(port, pages).map_err(Error::NotSent)?;
        lock(&self.populated).ensure(loan.pages_mut())?;
        Ok(loan)
    }

    fn port_for(&self, pages: usize) -> Result<Arc<ClientPort>, Error> {
        let mut sized = lock(&self.sized);
        if sized.pages < pages {
            // Doubling: a scene that grows box by box makes few segments.
            let grown = pages.next_power_of_two();
            let port = self.services.client_port(grown).map_err(|e| match e {
                OpenError::Transport(e) => Error::NotSent(e),
                OpenError::OutOfMemory => {
                    PopulateError { bytes: (grown * PAGE_BYTES) as u64 }.into()
                }
                OpenError::Limit(limit) => ConnectError::from(limit).into(),
                other => Error::NotSent(TransportError::new("making a larger segment", &other)),
            })?;
            *sized = SizedPort { port: Arc::new(port), pages: grown };
            // The new port's chunks are new memory, perhaps at addresses that were populated
            // before.
            *lock(&self.populated) = Populated::default();
        }
        Ok(Arc::clone(&sized.port))
    }

    /// Checks a response against the daemon's segment, and copies its header; `None` where it does not
    /// lie in there.
    pub(super) fn check(
        &self,
        sample: ResponseSample,
    ) -> Option<(ResponseHeader, CheckedResponse)> {
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
    pub(super) fn note_frame(&self, frame: Answered) {
        lock(&self.estimate).note(frame);
    }

    /// What is expected of a frame of `n` boxes.
    pub(super) fn expect(&self, n: u32) -> Expected {
        lock(&self.estimate).expect(n)
    }

    /// Waits for the response to `pending` until `deadline`; `None` if it has not come.
    ///
    /// Naps through most of a request that is expected to be long, spins until `spin` after its
    /// expected end, then sleeps until woken.
    ///
    /// # Errors
    /// [`Error`]: there will be none.
    pub(super) fn receive(
        &self,
        pending: &mut SentRequest,
        sent: Instant,
        expected: Expected,
        spin: Duration,
        deadline: Instant,
        vigil: &mut Vigil,
    ) -> Result<Option<ResponseSample>, Error> {
        if let Some(sample) = pending.receive()? {
            return Ok(Some(sample));
        }
        let Expected { nap, round_trip, threads } = expected;
        // The daemon may have answered before it died: the response is looked for after the daemon.
        let look = |pending: &mut SentRequest, seen: Seen| match (pending.receive()?, seen) {
            (Some(sample), _) => Ok(Some(sample)),
            (None, Seen::Running) => Ok(None),
            (None, Seen::Dead) => Err(Error::DaemonDied),
            (None, Seen::Silent) => Err(Error::Timeout { waited: sent.elapsed() }),
            (None, Seen::Full) => Err(Error::DaemonFull),
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
                    // The engine wants the core that this thread spins on.
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

/// The error of a session that finds no daemon.
pub(super) fn no_daemon(settings: &Settings) -> ConnectError {
    let looked_in = settings.dir.all().map(|dir| dir.path().to_owned()).collect();
    ConnectError::NoDaemon { instance: settings.instance.clone(), looked_in }
}

/// A request that could not be sent.
pub(super) struct Unsent {
    error: Error,
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
    /// The pages of the request, where they are kept.
    pub(super) fn pages(&self) -> Option<&[Page]> {
        Some(match self.memory.as_ref()? {
            UnsentMemory::Undelivered { sent, .. } => sent.pages(),
            UnsentMemory::Kept(shared) => shared.loan.pages(),
        })
    }

    /// Why it was not sent.
    pub(super) fn into_error(self) -> Error {
        self.error
    }

    /// How the daemon was lost.
    pub(super) fn loss(&self) -> Loss {
        Loss::of(&self.error).unwrap_or(Loss::Died)
    }
}

impl SharedFrame {
    /// Memory for `bytes` bytes, in the place of a frame.
    pub(super) fn lend(slot: Slot, bytes: u64) -> Result<Self, Error> {
        let pages = pages_of(bytes);
        let port = slot.link.port_for(pages)?;
        let loan = slot.link.lend(&port, pages)?;
        Ok(Self { loan, port, slot })
    }

    /// The frame in memory of so many bytes, with a copy of the first `used` bytes, where it has fewer.
    /// The error holds the frame where its memory is kept, for a caller that goes on with it.
    #[allow(clippy::result_large_err)]
    pub(super) fn grown(self, bytes: u64, used: u64) -> Result<Self, (Error, Option<Self>)> {
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
    #[allow(clippy::result_large_err)] // As above.
    pub(super) fn send(self, header: &RequestHeader) -> Result<(SentRequest, Slot), Unsent> {
        // `send` drops the memory when it fails, and it fails where the daemon is gone or new. The
        // connection is updated first, while the session still owns the boxes.
        if self.port.update_connections().is_err() || !self.slot.link.is_alive() {
            let memory = Some(UnsentMemory::Kept(self));
            return Err(Unsent { error: Error::DaemonDied, memory });
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
                let error = if is_alive { Error::Timeout { waited } } else { Error::DaemonDied };
                let memory = Some(UnsentMemory::Undelivered { sent, _slot: slot });
                return Err(Unsent { error, memory });
            }
        }
        Ok((sent, slot))
    }
}

const _: () = assert!(PAGE_BYTES.is_multiple_of(64), "boxes start on a cache line");
