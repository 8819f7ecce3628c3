//! The wait of a client for an answer.

use std::os::fd::AsFd;
use std::time::{Duration, Instant};

use pairmask_core::pacing::Expected;
use pairmask_core::spinner::Spinner;

use crate::error::TransportError;
use crate::link::Link;
use crate::link_error::LinkError;
use crate::locked::lock;
use crate::sent::SentRequest;
use crate::vigil::{Seen, Vigil, WAIT_SLICE};
use crate::waiting::sleep_on;

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
        if !self.is_own() {
            return Err(LinkError::Died);
        }
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
        let slept = if pending.is_answered() { Ok(()) } else { sleep_on(self.bell.as_fd(), left) };
        count(-1);
        if !self.bell.take() {
            // The daemon has closed its end: it is looked at now and then.
            std::thread::sleep(left.min(WAIT_SLICE / 2));
        }
        slept
    }
}
