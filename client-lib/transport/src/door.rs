//! The daemon's end of the socket: it lets clients in, notices at once when one is gone, and sleeps until one sends.

use std::mem::MaybeUninit;
use std::os::fd::{AsFd, AsRawFd, OwnedFd};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use pairmask_wire::{InstanceError, InstanceName};
use rustix::event::epoll::{self, EventData, EventFlags};
use rustix::event::{EventfdFlags, Timespec, eventfd};
use rustix::io::Errno;
use rustix::net::{SocketFlags, accept_with};
use rustix::process::getppid;

use crate::budget::Budget;
use crate::counters::Counters;
use crate::error::{OpenError, TransportError};
use crate::instance::RuntimeDir;
use crate::locked::lock;
use crate::peer::Peer;
use crate::socket::{Door as Answer, Hello, PeerProcess, Received, Welcome, listen_at, peer_of};
use crate::socket::{is_in_group, receive, send};

/// Who has connected says what it wants within this time; a client does so at once.
const SAYS_WITHIN: Duration = Duration::from_secs(1);
/// Connections that have not said so yet, at most: those of a thousand that knock without a word do not hold up
/// others for longer than it takes to drop them.
const MOST_SILENT: usize = 64;

/// Data of events that belong to no client: somebody knocks, and the end.
const LISTENER: u64 = u64::MAX;
const END: u64 = u64::MAX - 1;

/// Events that are taken at a time.
const EVENTS: usize = 32;

fn timespec(time: Duration) -> Timespec {
    Timespec {
        tv_sec: i64::try_from(time.as_secs()).unwrap_or(i64::MAX),
        tv_nsec: time.subsec_nanos().into(),
    }
}

/// A connection that has not said yet what it wants.
#[derive(Debug)]
struct Knocking {
    socket: OwnedFd,
    peer: PeerProcess,
    until: Instant,
}

/// The clients of an instance.
#[derive(Debug)]
pub struct Door {
    listener: OwnedFd,
    prefix: String,
    max_clients: usize,
    budget: Budget,
    counters: Arc<Counters>,
    /// Whose members are let in, beside processes of this user.
    group: Option<u32>,
    /// The parent of this process, which tests it: it takes no client's place, and is not counted.
    supervisor: u32,
    /// Sockets: the listener's and those of clients.
    sockets: OwnedFd,
    /// What clients wake the daemon by.
    wakes: OwnedFd,
    peers: Mutex<Vec<Arc<Peer>>>,
    /// Counts changes of that list.
    changes: AtomicU64,
    /// Clients that are gone, until nobody uses their memory.
    ended: Mutex<Vec<Arc<Peer>>>,
    /// Is signalled when nobody is to be let in any more.
    end: OwnedFd,
    /// A file that is closed where one is needed to tell a client that no more can be opened.
    spare: Mutex<Option<OwnedFd>>,
}

fn spare() -> Option<OwnedFd> {
    eventfd(0, EventfdFlags::CLOEXEC).ok()
}

impl Door {
    /// Makes the socket of an instance, in place of a predecessor's. Clients draw from this budget, and are counted here.
    ///
    /// # Errors
    /// [`InstanceError`].
    pub fn open(
        dir: &RuntimeDir,
        name: &InstanceName,
        max_clients: usize,
        budget: Budget,
        counters: Arc<Counters>,
    ) -> Result<Self, InstanceError> {
        let path = dir.socket_file(name);
        let listener = listen_at(&path, if dir.group().is_some() { 0o660 } else { 0o600 })?;
        let failed = |e: Errno| crate::trust::io_error(&path)(e.into());
        let epoll = || epoll::create(epoll::CreateFlags::CLOEXEC);
        let (sockets, wakes) = (epoll().map_err(failed)?, epoll().map_err(failed)?);
        let end = eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK).map_err(failed)?;
        for (file, data) in [(&listener, LISTENER), (&end, END)] {
            epoll::add(&sockets, file, EventData::new_u64(data), EventFlags::IN).map_err(failed)?;
        }
        Ok(Self {
            listener,
            prefix: dir.shm_prefix(name),
            max_clients,
            budget,
            counters,
            group: dir.group(),
            supervisor: getppid().map_or(0, |pid| pid.as_raw_nonzero().get().unsigned_abs()),
            sockets,
            wakes,
            peers: Mutex::default(),
            changes: AtomicU64::new(0),
            ended: Mutex::default(),
            end,
            spare: Mutex::new(spare()),
        })
    }

    /// The clients that are connected.
    pub fn peers(&self) -> Vec<Arc<Peer>> {
        lock(&self.peers).clone()
    }

    /// Counts the clients that came and went: a list of [`peers`](Self::peers) is that of its time.
    pub fn changes(&self) -> u64 {
        self.changes.load(Ordering::Acquire)
    }

    /// What clients may take.
    pub const fn budget(&self) -> &Budget {
        &self.budget
    }

    /// What clients take, counted.
    pub const fn counters(&self) -> &Arc<Counters> {
        &self.counters
    }

    /// Number of clients.
    pub fn client_count(&self) -> usize {
        lock(&self.peers).iter().filter(|peer| !self.is_supervisor(peer.sender().process)).count()
    }

    /// Whether a process is the supervisor of this one.
    pub const fn is_supervisor(&self, process: u32) -> bool {
        process == self.supervisor && process != 0
    }

    /// Their sessions.
    pub fn sessions(&self) -> Vec<u64> {
        lock(&self.peers).iter().map(|peer| peer.sender().session).collect()
    }

    /// Lets clients in and out until the [end](Self::end). On a thread of its own: whether a client is gone is known
    /// while all others work.
    ///
    /// # Errors
    /// [`TransportError`] where the system refuses to wait.
    pub fn attend(&self) -> Result<(), TransportError> {
        let mut knocking: Vec<Knocking> = Vec::new();
        let mut sessions = 0;
        let mut events = Vec::with_capacity(EVENTS);
        loop {
            events.clear();
            let look = knocking.first().map(|_| timespec(SAYS_WITHIN));
            let room = rustix::buffer::spare_capacity(&mut events);
            match epoll::wait(&self.sockets, room, look.as_ref()) {
                Ok(_) | Err(Errno::INTR) => {}
                Err(error) => return Err(TransportError::new("waiting for clients", &error)),
            }
            for event in &events {
                match event.data.u64() {
                    END => return Ok(()),
                    LISTENER => self.accept(&mut knocking),
                    of if knocking.iter().any(|k| k.socket.as_raw_fd() as u64 == of) => {
                        self.answer(&mut knocking, of, &mut sessions);
                    }
                    of => self.attend_to(of),
                }
            }
            let now = Instant::now();
            knocking.retain(|k| now < k.until);
        }
    }

    /// Ends [`attend`](Self::attend).
    pub fn end(&self) {
        let _ = rustix::io::write(&self.end, &1_u64.to_ne_bytes());
    }

    /// Accepts a connection of this user's, or of a member of the group that is let in.
    fn accept(&self, knocking: &mut Vec<Knocking>) {
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let socket = match accept_with(&self.listener, flags) {
            Ok(socket) => socket,
            Err(Errno::MFILE | Errno::NFILE) => {
                // One file is kept for this: without an answer a client would wait for nothing.
                drop(lock(&self.spare).take());
                if let Ok(socket) = accept_with(&self.listener, flags) {
                    refuse(&socket, Answer::NoMemory);
                }
                *lock(&self.spare) = spare();
                return;
            }
            Err(_) => return,
        };
        let Ok(peer) = peer_of(socket.as_fd()) else { return };
        let is_member = |group| is_in_group(socket.as_fd(), &peer, group);
        if peer.user != rustix::process::geteuid().as_raw() && !self.group.is_some_and(is_member) {
            return;
        }
        if knocking.len() >= MOST_SILENT {
            // The one that has been silent for longest.
            knocking.remove(0);
        }
        let data = EventData::new_u64(socket.as_raw_fd() as u64);
        if epoll::add(&self.sockets, &socket, data, EventFlags::IN | EventFlags::RDHUP).is_ok() {
            knocking.push(Knocking { socket, peer, until: Instant::now() + SAYS_WITHIN });
        }
    }

    /// Takes what a connection asks for, and lets it in.
    fn answer(&self, knocking: &mut Vec<Knocking>, of: u64, sessions: &mut u64) {
        let Some(at) = knocking.iter().position(|k| k.socket.as_raw_fd() as u64 == of) else {
            return;
        };
        let received = receive::<Hello>(knocking[at].socket.as_fd());
        if matches!(received, Received::Nothing) {
            return;
        }
        let Knocking { socket, peer, .. } = knocking.swap_remove(at);
        let _ = epoll::delete(&self.sockets, &socket);
        let Received::Message(hello, files) = received else { return };
        // A descriptor for which this process has no room does not come.
        let Some(file) = files.into_iter().next() else {
            return refuse(&socket, Answer::NoMemory);
        };
        if hello.version_major != pairmask_wire::VERSION_MAJOR {
            return refuse(&socket, Answer::Refused);
        }
        if self.client_count() >= self.max_clients && !self.is_supervisor(peer.process) {
            return refuse(&socket, Answer::Full);
        }
        *sessions += 1;
        let Ok(refused) = socket.try_clone() else { return refuse(&socket, Answer::NoMemory) };
        let share = self.budget.share();
        // The supervisor's frames are nobody's.
        let is_test = self.is_supervisor(peer.process);
        let counters = if is_test { Counters::unseen(0) } else { Arc::clone(&self.counters) };
        let counts = counters.client(*sessions, peer.process, peer.user);
        let memory = (self.prefix.as_str(), share, counts);
        match Peer::admit(socket, (*sessions, peer), (file, hello.board), memory) {
            Ok(peer) if self.watch(&peer).is_ok() => {
                lock(&self.peers).push(peer);
                self.changes.fetch_add(1, Ordering::Release);
            }
            Err(OpenError::Incompatible) => refuse(&refused, Answer::Refused),
            Ok(_) => refuse(&refused, Answer::NoMemory),
            Err(error) => {
                log::error!("a client is not let in: {error}");
                refuse(&refused, Answer::NoMemory);
            }
        }
    }

    fn watch(&self, peer: &Peer) -> rustix::io::Result<()> {
        let data = EventData::new_u64(peer.socket().as_raw_fd() as u64);
        epoll::add(&self.wakes, peer.bell(), data, EventFlags::IN)?;
        epoll::add(&self.sockets, peer.socket(), data, EventFlags::IN | EventFlags::RDHUP)
    }

    /// Takes what a client says: that it has made a further segment, or that it is gone.
    fn attend_to(&self, of: u64) {
        let mut peers = lock(&self.peers);
        let Some(at) = peers.iter().position(|peer| peer.socket().as_raw_fd() as u64 == of) else {
            return;
        };
        let goes_on = match receive::<Hello>(peers[at].socket().as_fd()) {
            Received::Nothing => true,
            Received::Message(_, files) => {
                files.into_iter().next().is_some_and(|file| peers[at].add_segment(file))
            }
            Received::End => false,
        };
        if goes_on {
            return;
        }
        let peer = peers.swap_remove(at);
        self.changes.fetch_add(1, Ordering::Release);
        drop(peers);
        peer.leave();
        let _ = epoll::delete(&self.sockets, peer.socket());
        let _ = epoll::delete(&self.wakes, peer.bell());
        lock(&self.ended).push(peer);
    }

    /// Sleeps until a client of this list wakes the daemon, or until then; not at all where a request is there. One
    /// thread does so at a time.
    ///
    /// # Errors
    /// [`TransportError`] where the system refuses to wait.
    pub fn sleep_until(&self, peers: &[Arc<Peer>], until: Instant) -> Result<(), TransportError> {
        for peer in peers {
            peer.falls_asleep();
        }
        let slept = if peers.iter().any(|peer| peer.has_sent().is_some()) {
            Ok(())
        } else {
            self.wait(peers, until)
        };
        for peer in peers {
            peer.wakes_up();
        }
        slept
    }

    fn wait(&self, peers: &[Arc<Peer>], until: Instant) -> Result<(), TransportError> {
        let left = timespec(until.saturating_duration_since(Instant::now()));
        let mut room = [MaybeUninit::uninit(); EVENTS];
        let events = match epoll::wait(&self.wakes, &mut room, Some(&left)) {
            Ok((events, _)) => events,
            Err(Errno::INTR) => return Ok(()),
            Err(error) => return Err(TransportError::new("waiting to be woken", &error)),
        };
        for peer in peers {
            let its = |event: &epoll::Event| event.data.u64() == peer.socket().as_raw_fd() as u64;
            if events.iter().any(its) && !peer.bell().take() {
                // It has closed its end, and is looked at now and then.
                let _ = epoll::delete(&self.wakes, peer.bell());
            }
        }
        Ok(())
    }

    /// Gives memory back: of answers that nobody needs, and of clients that are gone. `release` has others let go of a
    /// range of addresses, and says whether they did.
    pub fn tidy(&self, idle: Duration, mut release: impl FnMut(&std::ops::Range<usize>) -> bool) {
        for peer in self.peers() {
            peer.tidy(idle, &mut release);
        }
        // Out of the lock: it may take until a GPU is free, and the door would wait for that.
        let mut ended = std::mem::take(&mut *lock(&self.ended));
        // Requests under way hold their client.
        ended.retain(|peer| Arc::strong_count(peer) > 1 || !peer.is_released(&mut release));
        lock(&self.ended).append(&mut ended);
    }

    /// Numbers of all segments of clients that are mapped.
    pub fn segments(&self) -> Vec<u64> {
        let peers = self.peers();
        let ended = lock(&self.ended).clone();
        peers.iter().chain(&ended).flat_map(|peer| peer.segments()).collect()
    }
}

fn refuse(socket: &OwnedFd, why: Answer) {
    // One that is gone needs no answer.
    let _ = send(socket.as_fd(), &Welcome::new(why, 0), &[]);
}
