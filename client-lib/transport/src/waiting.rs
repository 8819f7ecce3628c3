//! Waits of a client: to be let in, for the daemon to map a segment, for an answer.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::pacing::Expected;
use pairmask_core::spinner::Spinner;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::board::TheirBoard;
use crate::link::{Link, LinkError, lock};
use crate::liveness::DaemonWatch;
use crate::pool::Pool;
use crate::segment::Segment;
use crate::sent::SentRequest;
use crate::limits::{OpenError, TransportError};
use crate::socket::{Bell, Door, Hello, Received, Welcome, receive, send};
use crate::vigil::{Seen, Vigil, WAIT_SLICE, Watched};

/// A daemon that says nothing on the socket for this long is silent: it lets a client in within milliseconds.
const SAYS_WITHIN: Duration = Duration::from_secs(1);

/// What goes with being let in: the daemon's segment, its board, and what either side wakes the other by.
pub(super) type LetIn = (Arc<Segment>, TheirBoard, Bell);

/// A client that waits for the daemon to say something on the socket.
#[derive(Clone, Copy, Debug)]
pub(super) struct Waits<'a> {
    pub(super) socket: BorrowedFd<'a>,
    pub(super) daemon: &'a DaemonWatch,
    /// Whether it goes on without a daemon that does not run.
    pub(super) leaves_silent: bool,
}

impl Waits<'_> {
    /// Waits until `said` finds what was waited for.
    pub(super) fn until<T>(self, mut said: impl FnMut() -> Option<T>) -> Result<T, LinkError> {
        let begun = Instant::now();
        let mut vigil = Vigil::default();
        let watched = Watched { daemon: self.daemon, leaves_silent: self.leaves_silent };
        loop {
            if let Some(said) = said() {
                return Ok(said);
            }
            let waited = begun.elapsed();
            match vigil.look(&watched, Instant::now()) {
                Seen::Dead => return Err(LinkError::Died),
                Seen::Running if waited < SAYS_WITHIN => {}
                Seen::Running | Seen::Silent => return Err(LinkError::Timeout { waited }),
            }
            sleep_on(self.socket, WAIT_SLICE)?;
        }
    }

    /// Asks to be let in, with memory and the place of a board in it.
    pub(super) fn be_let_in(self, pool: &Pool, board: u64) -> Result<LetIn, OpenError> {
        let failed = |what: &dyn std::fmt::Debug| TransportError::new("being let in", &what);
        send(self.socket, &Hello::new(board), &[pool.file().as_fd()]).map_err(|e| failed(&e))?;
        let said = self.until(|| match receive::<Welcome>(self.socket) {
            Received::Nothing => None,
            Received::Message(welcome, files) => Some(Some((welcome, files))),
            Received::End => Some(None),
        });
        let said = said.map_err(|error| match error {
            LinkError::Died => OpenError::NotServed,
            LinkError::Timeout { .. } => OpenError::Silent,
            error => failed(&error).into(),
        })?;
        let (welcome, files) = said.ok_or(OpenError::NotServed)?;
        match welcome.door() {
            Some(Door::Open) => {}
            Some(Door::Full) => return Err(OpenError::TooManyClients),
            Some(Door::NoMemory) => return Err(OpenError::DaemonFull),
            Some(Door::Refused) | None => return Err(OpenError::Incompatible),
        }
        let Ok([segment, bell]) = <[OwnedFd; 2]>::try_from(files) else {
            return Err(OpenError::Incompatible);
        };
        let segment = Arc::new(Segment::map(segment).map_err(|e| failed(&e))?);
        let board = TheirBoard::at(Arc::clone(&segment), welcome.board);
        Ok((segment, board.ok_or(OpenError::Incompatible)?, Bell::of(bell)))
    }
}

/// Sleeps until a file can be read, for so long at most. By the system's fine clock.
fn sleep_on(file: BorrowedFd<'_>, most: Duration) -> Result<(), TransportError> {
    let most = Timespec { tv_sec: most.as_secs() as i64, tv_nsec: most.subsec_nanos().into() };
    match poll(&mut [PollFd::from_borrowed_fd(file, PollFlags::IN)], Some(&most)) {
        Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
        Err(error) => Err(TransportError::new("waiting to be woken", &error)),
    }
}

impl Link {
    /// Waits for the response to `pending` until `deadline`. Whether it has come.
    ///
    /// Naps through most of a request that is expected to be long, spins until `spin` after its
    /// expected end, then sleeps until woken.
    ///
    /// # Errors
    /// [`LinkError`]: there will be none.
    pub(super) fn receive(
        &self,
        pending: &SentRequest,
        sent: Instant,
        expected: Expected,
        spin: Duration,
        deadline: Instant,
        vigil: &mut Vigil,
    ) -> Result<bool, LinkError> {
        if pending.is_answered() {
            return Ok(true);
        }
        let Expected { nap, round_trip, threads } = expected;
        // The daemon may have answered before it died: the response is looked for after the daemon.
        let look = |seen: Seen| match (pending.is_answered(), seen) {
            (true, _) => Ok(true),
            (false, Seen::Running) => Ok(false),
            (false, Seen::Dead) => Err(LinkError::Died),
            (false, Seen::Silent) => Err(LinkError::Timeout { waited: sent.elapsed() }),
        };
        if !spin.is_zero() {
            // The nap goes by the clock: a client that naps by the wake-up is woken by the answer, 50 µs late.
            let wake_at = (sent + nap).min(deadline);
            loop {
                let left = wake_at.saturating_duration_since(Instant::now());
                if left.is_zero() {
                    break;
                }
                std::thread::sleep(left.min(WAIT_SLICE));
                if look(vigil.look_at_times(&self.watched()))? {
                    return Ok(true);
                }
            }
            // Near its expected end a frame is worth a core: a client that falls asleep just before
            // the answer costs a wake-up on each side, frame after frame.
            let spin_until = (Instant::now().max(sent + round_trip) + spin).min(deadline);
            let mut spinner = Spinner::default();
            while Instant::now() < spin_until {
                if look(vigil.look_at_times(&self.watched()))? {
                    return Ok(true);
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
            if look(vigil.look(&self.watched(), Instant::now()))? {
                return Ok(true);
            }
            if Instant::now() >= deadline {
                return Ok(false);
            }
            self.sleep(pending, deadline)?;
        }
    }

    /// Sleeps until woken, at most a slice and not past `until`.
    fn sleep(&self, pending: &SentRequest, until: Instant) -> Result<(), TransportError> {
        let left = until.saturating_duration_since(Instant::now()).min(WAIT_SLICE);
        let count = |more: i32| {
            let mut sleepers = lock(&self.sleepers);
            *sleepers = sleepers.saturating_add_signed(more);
            if *sleepers > 0 { self.own.falls_asleep() } else { self.own.wakes_up() }
        };
        count(1);
        let slept = if pending.is_answered() {
            Ok(())
        } else {
            sleep_on(self.bell.as_fd(), left)
        };
        count(-1);
        if !self.bell.take() {
            // The daemon has closed its end: it is looked at now and then.
            std::thread::sleep(left.min(WAIT_SLICE / 2));
        }
        slept
    }
}
