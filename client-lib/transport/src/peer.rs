//! A client as its daemon has it: its memory, its board, the daemon's own board and memory for answers.

use std::ops::Range;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use pairmask_core::cancel::Wanted;
use pairmask_wire::board::{Entry, PLACES, Placed};
use pairmask_wire::{Page, RequestHeader, ResponseHeader};

use crate::board::{OwnBoard, TheirBoard};
use crate::budget::{Charge, Memory, OverBudget, Share};
use crate::counters::ClientSlot;
use crate::error::{OpenError, TransportError};
use crate::locked::lock;
use crate::pool::{Chunk, Pool};
use crate::room::PopulateError;
use crate::segment::Segment;
use crate::socket::{Bell, Door, PeerProcess, Welcome, send};

/// Pages of the smallest pool of answers, which each client has: most answers fit, and eight of them are 8 MiB of
/// address space on either side.
const SMALLEST_PAGES: usize = 256;

/// Segments that a client may send: one that doubles its memory from 65,536 boxes on has had less.
const MOST_SEGMENTS: usize = 16;

/// Bytes that the segments of a client may have together, most of them holes: so many that a frame of a billion boxes has
/// room, and so few that a hundred clients leave the worker more than half of its address space.
const MOST_BYTES: usize = 1 << 39;

/// Payload that is read until it is looked again how much memory a client's segments take: who names holes in them has
/// the daemon fill them. A look at each small request would cost as much as some of them.
const LOOK_BYTES: u64 = 1 << 20;

/// Who sends a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sender {
    /// Number of the session. It is never used again.
    pub session: u64,
    /// Id of the session's process, by the kernel; 0 where that is in another PID namespace.
    pub process: u32,
}

/// What the daemon knows of a place.
#[derive(Debug, Default)]
struct Place {
    /// Number of its last request.
    number: u64,
    /// Whether a request of it is being served.
    is_held: bool,
    /// The memory of the last answer.
    answer: Option<Chunk>,
}

/// Whether the client waits for the answer to the last request of a place.
#[derive(Debug)]
struct Awaited {
    theirs: Arc<TheirBoard>,
    is_gone: Arc<AtomicBool>,
    place: usize,
    number: AtomicU64,
}

impl Wanted for Awaited {
    fn is_wanted(&self) -> bool {
        let number = self.number.load(Ordering::Relaxed);
        // In this order: a client that closes its session lets go of the request, then of the board, which reads as zeros
        // from then on. What was let go of once is not waited for again.
        let is_let_go = self.theirs.released(self.place) == number;
        let is_there = self.theirs.sent(self.place) == number;
        !is_let_go && is_there && !self.is_gone.load(Ordering::Acquire)
    }
}

/// The memory of a client that it sends requests in.
#[derive(Debug)]
struct Segments {
    all: Vec<Arc<Segment>>,
    /// Bytes that were sent since the last look.
    sent: u64,
    /// What it takes, also where that is more than it may.
    charge: Charge,
    over: Option<OverBudget>,
}

impl Segments {
    /// Notes that so many bytes are read.
    fn note(&mut self, bytes: u64) -> Result<(), OverBudget> {
        self.sent = self.sent.saturating_add(bytes);
        if self.sent > LOOK_BYTES || self.over.is_some() {
            self.look();
        }
        self.over.map_or(Ok(()), Err)
    }

    /// Notes what they take now.
    fn look(&mut self) {
        self.sent = 0;
        let present = self.all.iter().map(|segment| segment.present()).sum();
        if present > self.charge.bytes() || self.over.is_some() {
            // As a whole: what it has without leave counts as if it were asked for now.
            self.charge.set(0);
            self.over = self.charge.grow_to(present).err();
        }
        self.charge.set(present);
    }
}

/// A connected client.
#[derive(Debug)]
pub struct Peer {
    sender: Sender,
    socket: OwnedFd,
    bell: Bell,
    own: OwnBoard,
    theirs: Arc<TheirBoard>,
    share: Share,
    counts: Arc<ClientSlot>,
    segments: Mutex<Segments>,
    /// By the size of their pieces. A number in this list is the segment's on the wire.
    pools: Mutex<Vec<Pool>>,
    places: Mutex<[Place; PLACES]>,
    /// Number of the request that is taken next: they are taken in the order in which they were sent.
    next: AtomicU64,
    is_gone: Arc<AtomicBool>,
    /// For who works on a request: one a place, so that none is made for each request.
    awaited: [Arc<Awaited>; PLACES],
    /// With which files of its memory begin, until they have no name.
    prefix: String,
}

impl Peer {
    /// Lets a client in that sends a descriptor of its memory and the place of its board in it.
    pub(super) fn admit(
        socket: OwnedFd,
        (session, peer): (u64, PeerProcess),
        (segment, board): (OwnedFd, u64),
        (prefix, share, counts): (&str, Share, ClientSlot),
    ) -> Result<Arc<Self>, OpenError> {
        let system = |e: std::io::Error| TransportError::new("letting a client in", &e);
        let segment = Arc::new(Segment::map(segment, MOST_BYTES).map_err(system)?);
        let theirs = TheirBoard::at(Arc::clone(&segment), board).ok_or(OpenError::Incompatible)?;
        let (theirs, is_gone) = (Arc::new(theirs), Arc::new(AtomicBool::new(false)));
        let pool = Pool::new(prefix, SMALLEST_PAGES, PLACES + 1, Some(&share))?;
        let own = OwnBoard::new(&pool).map_err(|_| OpenError::OutOfMemory)?;
        // Nobody looks at its board yet.
        own.falls_asleep();
        let (bell, their_end) = Bell::pair().map_err(system)?;
        let files = [pool.file().as_fd(), their_end.as_fd()];
        send(socket.as_fd(), &Welcome::new(Door::Open, own.offset()), &files).map_err(system)?;
        let awaited = std::array::from_fn(|place| {
            let (theirs, is_gone) = (Arc::clone(&theirs), Arc::clone(&is_gone));
            Arc::new(Awaited { theirs, is_gone, place, number: AtomicU64::new(0) })
        });
        Ok(Arc::new(Self {
            sender: Sender { session, process: peer.process },
            socket,
            bell,
            own,
            theirs,
            segments: Mutex::new(Segments {
                all: vec![segment],
                // The first request is looked at.
                sent: LOOK_BYTES,
                charge: share.nothing(Memory::Shared),
                over: None,
            }),
            share,
            counts: Arc::new(counts),
            pools: Mutex::new(vec![pool]),
            places: Mutex::default(),
            next: AtomicU64::new(1),
            awaited,
            is_gone,
            prefix: prefix.to_owned(),
        }))
    }

    /// Who it is.
    pub const fn sender(&self) -> Sender {
        self.sender
    }

    pub(super) const fn socket(&self) -> &OwnedFd {
        &self.socket
    }

    /// What either side wakes the other by.
    pub(super) const fn bell(&self) -> &Bell {
        &self.bell
    }

    /// Its process has ended, or closed the session.
    pub(super) fn leave(&self) {
        self.is_gone.store(true, Ordering::Release);
        self.share.end();
        self.counts.end();
    }

    /// Adds a further segment of the client's. Whether it may have one more.
    pub(super) fn add_segment(&self, file: OwnedFd) -> bool {
        let mapped: usize = lock(&self.segments).all.iter().map(|segment| segment.bytes()).sum();
        let Ok(segment) = Segment::map(file, MOST_BYTES.saturating_sub(mapped)) else {
            return false;
        };
        let mut segments = lock(&self.segments);
        let may = segments.all.len() < MOST_SEGMENTS;
        if may {
            segments.all.push(Arc::new(segment));
        }
        drop(segments);
        may && send(self.socket.as_fd(), &Welcome::new(Door::Mapped, 0), &[]).is_ok()
    }

    /// Numbers of its segments.
    pub fn segments(&self) -> Vec<u64> {
        lock(&self.segments).all.iter().map(|segment| segment.id()).collect()
    }

    /// Says that the daemon sleeps: a request that is not seen by a look after this wakes it.
    pub(super) fn falls_asleep(&self) {
        self.own.falls_asleep();
    }

    /// Says that the daemon looks for requests.
    pub fn wakes_up(&self) {
        self.own.wakes_up();
    }

    /// Where the next request is, if it has come and its place is free.
    pub(super) fn has_sent(&self) -> Option<usize> {
        let next = self.next.load(Ordering::Relaxed);
        let place = (0..PLACES).find(|place| self.theirs.sent(*place) == next)?;
        // A client that does not wait until its place is free waits now, and nobody looks for it all the time.
        (!lock(&self.places)[place].is_held).then_some(place)
    }

    /// Takes the requests that have come. One thread does so at a time.
    pub fn receive(self: &Arc<Self>, mut each: impl FnMut(CheckedRequest)) {
        // No more than there may be: others are looked at too.
        for _ in 0..PLACES {
            let Some(place) = self.has_sent() else { return };
            let number = self.next.fetch_add(1, Ordering::Relaxed);
            self.awaited[place].number.store(number, Ordering::Relaxed);
            if let Some(request) = self.take(place, number) {
                each(request);
            }
        }
    }

    fn take(self: &Arc<Self>, place: usize, number: u64) -> Option<CheckedRequest> {
        let is_wanted = self.theirs.released(place) != number;
        // A client that uses a place again has let go of the answer that was in it.
        let taken = Place { number, is_held: is_wanted, answer: None };
        let answer = std::mem::replace(&mut lock(&self.places)[place], taken);
        drop(answer);
        if !is_wanted {
            self.own.release(place, number);
            return None;
        }
        let Entry { placed, header } = self.theirs.entry(place);
        let segments = lock(&self.segments);
        let named = usize::try_from(placed.segment).ok().and_then(|at| segments.all.get(at));
        // One that names no memory of its client's has no payload.
        let (segment, placed) = match named {
            Some(named) => (named, placed),
            None => (&segments.all[0], Placed::default()),
        };
        let segment = Arc::clone(segment);
        drop(segments);
        let sent_at = self.theirs.sent_at(place);
        let peer = Arc::clone(self);
        Some(CheckedRequest { peer, place, number, sent_at, header, segment, placed })
    }

    /// Memory for an answer, of a pool whose pieces are large enough.
    fn lend(&self, pages: usize, is_wanted: impl Fn() -> bool) -> Result<Chunk, PopulateError> {
        let full = PopulateError { bytes: (pages * pairmask_wire::PAGE_BYTES) as u64 };
        let mut pools = lock(&self.pools);
        if pools.last().is_none_or(|largest| largest.pages() < pages) {
            let pages = pages.next_power_of_two();
            let pool = Pool::new(&self.prefix, pages, PLACES, Some(&self.share));
            let pool = pool.map_err(|_| full)?;
            let notice = Welcome::new(Door::Open, 0);
            send(self.socket.as_fd(), &notice, &[pool.file().as_fd()]).map_err(|_| full)?;
            pools.push(pool);
        }
        let fits = pools.iter().find(|pool| pool.pages() >= pages).cloned();
        drop(pools);
        fits.ok_or(full)?.lend_while(pages, is_wanted)
    }

    fn answer(&self, place: usize, number: u64, header: &ResponseHeader, chunk: Chunk) {
        let segment = lock(&self.pools).iter().position(|pool| chunk.is_of(pool));
        let placed = Placed {
            // It is of one of them.
            segment: segment.unwrap_or(0) as u64,
            offset: chunk.offset(),
            pages: chunk.pages().len() as u64,
        };
        let mut places = lock(&self.places);
        places[place].answer = Some(chunk);
        self.own.send(place, number, Entry { placed, header: *header });
        drop(places);
        if self.theirs.sleeps() {
            self.bell.ring();
        }
    }

    /// Lets go of a request.
    fn release(&self, place: usize, number: u64) {
        lock(&self.places)[place].is_held = false;
        self.own.release(place, number);
    }

    /// Gives memory of answers back that nobody reads any more, and that none needed for so long. `release` has others
    /// let go of a range of addresses, and says whether they did.
    pub fn tidy(&self, idle: Duration, mut release: impl FnMut(&Range<usize>) -> bool) {
        for (place, known) in lock(&self.places).iter_mut().enumerate() {
            if self.theirs.released(place) == known.number {
                known.answer = None;
            }
        }
        for pool in self.pools() {
            pool.tidy(idle, &mut release);
        }
        lock(&self.segments).look();
    }

    /// Whether others have let go of all of its memory for answers, as far as `release` says so of a range.
    pub fn is_released(&self, mut release: impl FnMut(&Range<usize>) -> bool) -> bool {
        // Each is asked: one that is used still does not keep the others.
        self.pools().iter().filter(|pool| !release(&pool.range())).count() == 0
    }

    /// The pools as they are now: who waits for others while it goes through them would hold those up that lend.
    fn pools(&self) -> Vec<Pool> {
        lock(&self.pools).clone()
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        // A daemon that ends leaves answers that its clients still read as they are.
        for (at, known) in std::mem::take(&mut *lock(&self.places)).into_iter().enumerate() {
            if let Some(answer) = known.answer
                && self.theirs.released(at) != known.number
            {
                answer.leave();
            }
        }
    }
}

/// A request that was copied and checked. Its header and the place of its payload are fixed, regardless of what its
/// sender writes later. Its memory is the client's again when it is dropped. Dropped without an answer, it leaves its
/// client to its deadline.
#[derive(Debug)]
pub struct CheckedRequest {
    peer: Arc<Peer>,
    place: usize,
    number: u64,
    sent_at: u64,
    header: RequestHeader,
    segment: Arc<Segment>,
    placed: Placed,
}

impl CheckedRequest {
    /// The copied header.
    pub const fn header(&self) -> &RequestHeader {
        &self.header
    }

    /// The payload; none where it does not lie in the sender's memory.
    pub fn pages(&self) -> &[Page] {
        self.segment.pages(self.placed.offset, self.placed.pages)
    }

    /// When it was sent, nanoseconds of the system's clock, as its client says; 0 where that does not.
    pub const fn sent_at(&self) -> u64 {
        self.sent_at
    }

    /// The memory of its client.
    pub fn share(&self) -> &Share {
        &self.peer.share
    }

    /// What its client takes, counted.
    pub fn counts(&self) -> &Arc<ClientSlot> {
        &self.peer.counts
    }

    /// Makes sure, before the payload is read, that its client's memory stays what it may be: what lies in holes of a file
    /// is there as soon as somebody reads it. The charge is to be held while the payload is read.
    ///
    /// # Errors
    /// [`OverBudget`].
    pub fn charge_payload(&self) -> Result<Option<Charge>, OverBudget> {
        let bytes = size_of_val(self.pages()) as u64;
        lock(&self.peer.segments).note(bytes)?;
        if bytes <= LOOK_BYTES {
            // The next look finds it.
            return Ok(None);
        }
        match self.share().charge(Memory::Shared, bytes) {
            Ok(charge) => Ok(Some(charge)),
            // Payload that is there is charged already.
            Err(_) if self.segment.is_whole(self.placed.offset, bytes) => Ok(None),
            Err(over) => Err(over),
        }
    }

    /// Who sent it.
    pub fn sender(&self) -> Sender {
        self.peer.sender
    }

    /// Number of the segment that it lies in.
    pub fn segment(&self) -> u64 {
        self.segment.id()
    }

    /// Whether its client still waits for an answer. Some reads of memory: ask as often as you like.
    pub fn is_wanted(&self) -> bool {
        self.peer.awaited[self.place].is_wanted()
    }

    /// What says so to those who work on it.
    pub fn wanted(&self) -> Arc<dyn Wanted> {
        Arc::<Awaited>::clone(&self.peer.awaited[self.place])
    }

    /// Memory for an answer.
    ///
    /// # Errors
    /// [`PopulateError`].
    pub fn lend(&self, pages: usize) -> Result<Chunk, PopulateError> {
        self.peer.lend(pages, || self.is_wanted())
    }

    /// Sends the answer and wakes the client, where that still waits for it.
    pub fn answer(&self, header: &ResponseHeader, chunk: Chunk) {
        if self.is_wanted() {
            self.peer.answer(self.place, self.number, header, chunk);
        }
    }
}

impl Drop for CheckedRequest {
    fn drop(&mut self) {
        self.peer.release(self.place, self.number);
    }
}
