//! Waits of a client for what the daemon says on the socket.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::board::TheirBoard;
use crate::error::{OpenError, TransportError};
use crate::link_error::LinkError;
use crate::liveness::DaemonWatch;
use crate::pool::Pool;
use crate::process_limits;
use crate::segment::Segment;
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
            Some(Door::Refused | Door::Mapped) | None => return Err(OpenError::Incompatible),
        }
        let Ok([segment, bell]) = <[OwnedFd; 2]>::try_from(files) else {
            // Descriptors for which this process has no room do not come.
            let limit = process_limits::no_files_left();
            return Err(limit.map_or(OpenError::Incompatible, OpenError::Limit));
        };
        let segment = Segment::map(segment, usize::MAX).map_err(|e| {
            process_limits::behind(0).map_or_else(|| failed(&e).into(), OpenError::Limit)
        })?;
        let segment = Arc::new(segment);
        let board = TheirBoard::at(Arc::clone(&segment), welcome.board);
        Ok((segment, board.ok_or(OpenError::Incompatible)?, Bell::of(bell)))
    }
}

/// Sleeps until a file can be read, for so long at most. By the system's fine clock.
pub(super) fn sleep_on(file: BorrowedFd<'_>, most: Duration) -> Result<(), TransportError> {
    let most = Timespec { tv_sec: most.as_secs() as i64, tv_nsec: most.subsec_nanos().into() };
    match poll(&mut [PollFd::from_borrowed_fd(file, PollFlags::IN)], Some(&most)) {
        Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
        Err(error) => Err(TransportError::new("waiting to be woken", &error)),
    }
}
