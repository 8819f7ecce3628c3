//! A client's end of the connection to a daemon: its memory, its board, and what the daemon has sent.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::ErrorKind;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use pairmask_core::pacing::{Answered, Estimate, Expected};
use pairmask_core::precision::BoxForm;
use pairmask_core::units::BoxCount;
use pairmask_wire::board::{BOARD_PAGES, PLACES};
use pairmask_wire::{CachedRules, InstanceError, InstanceName, PAGE_BYTES, Version, page_count};

use crate::board::{OwnBoard, TheirBoard};
use crate::error::{OpenError, TransportError};
use crate::foreign::foreign_owner;
use crate::fork::Maker;
use crate::instance::RuntimeDir;
use crate::limits::FRAMES_AT_A_TIME;
use crate::link_error::LinkError;
use crate::liveness::DaemonWatch;
use crate::locked::lock;
use crate::pool::{Chunk, Pool};
use crate::room::PopulateError;
use crate::segment::Segment;
use crate::socket::{self, Bell, Door, Hello, Received, Welcome, connect_to};
use crate::vigil::{LeftDaemon, Watched};
use crate::waiting::Waits;

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
    /// The daemon does not let this client in, or there is no memory.
    Open(OpenError),
}

/// Pieces of memory for requests: of those that are under way, of frames that are being filled, and the board.
const PIECES: usize = PLACES + FRAMES_AT_A_TIME + 1;

/// Segments that a daemon may have for a client: it doubles them, from a megabyte on.
const MOST_SEGMENTS: usize = 32;

/// Memory for requests.
#[derive(Debug)]
struct Memory {
    pool: Pool,
    /// Number of its segment on the wire.
    segment: u64,
    /// Number of the last segment that was sent: there is one more where the daemon was not heard of afterwards.
    last_sent: u64,
}

/// What the daemon has sent over the socket.
#[derive(Debug, Default)]
struct Inbox {
    /// Its segments.
    segments: Vec<Option<Arc<Segment>>>,
    /// Segments of this side that it has mapped.
    mapped: u64,
}

/// What this side knows of a place.
#[derive(Debug, Default)]
pub(super) enum Place {
    #[default]
    Free,
    Taken,
    /// Its request was dropped, and the daemon may still read its memory.
    Left {
        number: u64,
        chunk: Chunk,
    },
}

/// A connection to one daemon process.
pub struct Link {
    token: u64,
    maker: Maker,
    memory: Mutex<Memory>,
    pub(super) own: OwnBoard,
    pub(super) theirs: TheirBoard,
    pub(super) socket: OwnedFd,
    pub(super) bell: Bell,
    inbox: Mutex<Inbox>,
    pub(super) places: Mutex<[Place; PLACES]>,
    /// Number of the next request.
    pub(super) next: AtomicU64,
    /// Threads that sleep until an answer comes.
    pub(super) sleepers: Mutex<u32>,
    /// With which files of its memory begin, until they have no name.
    prefix: String,
    daemon: Arc<DaemonWatch>,
    /// Whether the session goes on without a daemon that does not run.
    leaves_silent: bool,
    /// Whether the daemon has answered a request.
    pub(super) has_answered: AtomicBool,
    estimate: Mutex<Estimate>,
    /// Cores that this process may use.
    pub(super) cores: usize,
    frames: AtomicUsize,
    cached_rules: CachedRules,
    /// Whether the client has refused a response.
    has_refused: AtomicBool,
    /// Whether the daemon has refused a request because this client has too much memory.
    pub(super) is_over_budget: AtomicBool,
}

impl Drop for Link {
    fn drop(&mut self) {
        // A child's copies of them are its parent's.
        if !self.is_own() {
            return;
        }
        for (at, place) in std::mem::take(&mut *lock(&self.places)).into_iter().enumerate() {
            match place {
                Place::Left { number, chunk } if !self.is_done(at, number) => chunk.leave(),
                _ => {}
            }
        }
    }
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
    pub(super) fn take(link: &Arc<Link>) -> Option<Self> {
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
            InstanceError::Io { source, .. }
                if matches!(source.kind(), ErrorKind::NotFound | ErrorKind::ConnectionRefused) =>
            {
                no_daemon()
            }
            error => ConnectFailure::Instance(error),
        };
        dir.check().map_err(not_ours)?;
        let record = dir.record(instance).map_err(not_ours)?.ok_or_else(no_daemon)?;
        let watch = dir.watch(instance, Some(&record)).map_err(not_ours)?;
        let daemon = Arc::new(watch.ok_or_else(no_daemon)?);
        if !record.version.serves_this_build() {
            return Err(ConnectFailure::OtherVersion(record.version));
        }
        let open = |error| match error {
            OpenError::NotServed => no_daemon(),
            OpenError::Incompatible => ConnectFailure::OtherVersion(record.version),
            error => ConnectFailure::Open(error),
        };
        let pages = page_count(BoxForm::F32.bytes(capacity.unwrap_or(RESERVED_BOXES))) as usize;
        let prefix = dir.shm_prefix(instance);
        let memory = || {
            let pool = Pool::new(&prefix, pages.max(BOARD_PAGES), PIECES, None)?;
            let own = OwnBoard::new(&pool).map_err(|_| OpenError::OutOfMemory)?;
            Ok((pool, own))
        };
        // Before the daemon is asked, which waits for no client that is not ready.
        let (pool, own) = memory().map_err(open)?;
        let socket = connect_to(&dir.socket_file(instance)).map_err(not_ours)?;
        let waits = Waits { socket: socket.as_fd(), daemon: &daemon, leaves_silent };
        let (segment, theirs, bell) = waits.be_let_in(&pool, own.offset()).map_err(open)?;
        let link = Self {
            token: RandomState::new().build_hasher().finish(),
            maker: Maker::here(),
            memory: Mutex::new(Memory { pool, segment: 0, last_sent: 0 }),
            own,
            theirs,
            socket,
            bell,
            inbox: Mutex::new(Inbox { segments: vec![Some(segment)], mapped: 1 }),
            places: Mutex::default(),
            next: AtomicU64::new(1),
            sleepers: Mutex::default(),
            prefix,
            daemon,
            leaves_silent,
            has_answered: AtomicBool::new(false),
            estimate: Mutex::default(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            frames: AtomicUsize::new(0),
            cached_rules: CachedRules::default(),
            has_refused: AtomicBool::new(false),
            is_over_budget: AtomicBool::new(false),
        };
        if capacity.is_some() {
            link.touch_memory(pages);
        }
        Ok(link)
    }

    /// Populates the memory that frames will use, before the first frame is timed.
    fn touch_memory(&self, pages: usize) {
        let memory = lock(&self.memory);
        // Missing memory is an error of the frame that needs it, not of the connection.
        let _touched: Vec<_> =
            (0..FRAMES_AT_A_TIME).map_while(|_| memory.pool.lend(pages).ok()).collect();
    }

    /// What this client calls itself in requests.
    pub const fn token(&self) -> u64 {
        self.token
    }

    /// Whether its daemon lives. A forked child has none: the connection is its parent's.
    pub fn is_alive(&self) -> bool {
        self.is_own() && self.daemon.is_alive()
    }

    /// Whether this process has made it, and not a parent of it.
    pub(super) fn is_own(&self) -> bool {
        self.maker.is_here()
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
    pub(super) fn watched(&self) -> Watched<'_> {
        Watched { daemon: &self.daemon, leaves_silent: self.leaves_silent }
    }

    /// The rules that the daemon keeps.
    pub const fn cached_rules(&self) -> &CachedRules {
        &self.cached_rules
    }

    /// Notes that the client refuses a response, because it is an error or malformed. Whether that is the first one.
    pub fn refuse(&self) -> bool {
        !self.has_refused.swap(true, Ordering::Relaxed)
    }

    /// Memory of a pool whose pieces are large enough, and the number of its segment.
    pub(super) fn lend(&self, pages: usize) -> Result<(Chunk, u64), LinkError> {
        if !self.is_own() {
            return Err(LinkError::Died);
        }
        self.take_back();
        let mut memory = lock(&self.memory);
        if self.is_over_budget.swap(false, Ordering::Relaxed) {
            // What earlier requests needed counts too.
            memory.pool.tidy(Duration::ZERO, |_| true);
        }
        if memory.pool.pages() < pages {
            // Doubling: a scene that grows box by box makes few segments.
            let enlarged = pages.next_power_of_two();
            let pool = Pool::new(&self.prefix, enlarged, PIECES, None).map_err(|e| match e {
                OpenError::Transport(e) => LinkError::NotSent(e),
                OpenError::Limit(limit) => LinkError::Limit(limit),
                OpenError::OutOfMemory => {
                    PopulateError { bytes: (enlarged * PAGE_BYTES) as u64 }.into()
                }
                other => LinkError::NotSent(TransportError::new("making a larger segment", &other)),
            })?;
            let segment = self.send_segment(&pool, &mut memory.last_sent)?;
            memory.pool.retire();
            (memory.pool, memory.segment) = (pool, segment);
        }
        Ok((memory.pool.lend(pages)?, memory.segment))
    }

    /// Sends a further segment, and waits until the daemon has mapped it. Its number.
    fn send_segment(&self, pool: &Pool, last_sent: &mut u64) -> Result<u64, LinkError> {
        let failed =
            |what: &dyn std::fmt::Debug| TransportError::new("sending a larger segment", &what);
        socket::send(self.socket.as_fd(), &Hello::new(0), &[pool.file().as_fd()])
            .map_err(|e| LinkError::NotSent(failed(&e)))?;
        *last_sent += 1;
        let number = *last_sent;
        self.waits().until(|| {
            let is_open = self.take_messages();
            if lock(&self.inbox).mapped > number {
                return Some(Ok(number));
            }
            (!is_open).then_some(Err(LinkError::Died))
        })?
    }

    fn waits(&self) -> Waits<'_> {
        let (socket, leaves_silent) = (self.socket.as_fd(), self.leaves_silent);
        Waits { socket, daemon: &self.daemon, leaves_silent }
    }

    /// Takes what the daemon has sent over the socket. Whether the socket is open.
    fn take_messages(&self) -> bool {
        let mut inbox = lock(&self.inbox);
        // A daemon sends less at a time than it has segments.
        for _ in 0..MOST_SEGMENTS {
            let (welcome, files) = match socket::receive::<Welcome>(self.socket.as_fd()) {
                Received::Message(welcome, files) => (welcome, files),
                Received::Nothing => return true,
                Received::End => return false,
            };
            match welcome.door() {
                Some(Door::Mapped) => inbox.mapped += 1,
                Some(Door::Open) if inbox.segments.len() < MOST_SEGMENTS => {
                    // One that does not come, or cannot be mapped, keeps its number.
                    let file = files.into_iter().next();
                    let segment = file.and_then(|file| Segment::map(file, usize::MAX).ok());
                    inbox.segments.push(segment.map(Arc::new));
                }
                _ => {}
            }
        }
        true
    }

    /// A segment of the daemon's by its number; `None` where it has sent no such one.
    pub(super) fn segment(&self, number: u64) -> Option<Arc<Segment>> {
        if !self.is_own() {
            return None;
        }
        let at = usize::try_from(number).ok()?;
        if lock(&self.inbox).segments.len() <= at {
            self.take_messages();
        }
        lock(&self.inbox).segments.get(at)?.clone()
    }

    /// Takes the memory of requests back that were dropped, where the daemon no longer reads it.
    fn take_back(&self) {
        for (at, place) in lock(&self.places).iter_mut().enumerate() {
            if matches!(place, Place::Left { number, .. } if self.is_done(at, *number)) {
                *place = Place::Free;
            }
        }
    }

    /// Takes a place for a request; `None` where the daemon still has all of them.
    pub(super) fn take_place(&self) -> Option<usize> {
        self.take_back();
        let mut places = lock(&self.places);
        let free = places.iter().position(|place| matches!(place, Place::Free))?;
        places[free] = Place::Taken;
        Some(free)
    }

    /// Whether the daemon no longer reads the memory of a request.
    pub(super) fn is_done(&self, place: usize, number: u64) -> bool {
        self.theirs.released(place) == number
    }

    /// Updates the estimate by an answered frame.
    pub fn note_frame(&self, frame: Answered) {
        lock(&self.estimate).note(frame);
    }

    /// What is expected of a frame of `n` boxes.
    pub fn expect(&self, n: u32) -> Expected {
        lock(&self.estimate).expect(n)
    }
}
