//! A request and its answer.

use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::pacing::Expected;
use pairmask_wire::{Page, RequestHeader, ResponseHeader};

use crate::link::{Link, Slot};
use crate::link_error::LinkError;
use crate::sent::{CheckedResponse, SentRequest, SharedFrame, Unsent};
use crate::vigil::Vigil;

/// A request that was sent. Dropping it discards the answer.
pub struct Exchange {
    pending: SentRequest,
    slot: Slot,
    at: Instant,
    vigil: Vigil,
    /// After what time the answer came, or why there will be none.
    came: Option<Result<Duration, LinkError>>,
}

/// The answer to a request. Its memory is held until it is dropped.
pub struct Answer {
    /// A copy, not validated yet.
    pub header: ResponseHeader,
    /// Where its words lie.
    pub memory: AnswerMemory,
    /// From the request to the answer.
    pub round_trip: Duration,
}

/// The memory of an answer: the daemon's until its request is dropped.
pub struct AnswerMemory {
    response: CheckedResponse,
    _pending: SentRequest,
    _slot: Slot,
}

impl AnswerMemory {
    /// The pages of the answer.
    pub fn pages(&self) -> &[Page] {
        self.response.pages()
    }
}

impl Exchange {
    /// Sends a request.
    ///
    /// # Errors
    /// [`Unsent`].
    #[allow(clippy::result_large_err)] // The error holds the request, which a frame goes on with.
    pub fn begin(shared: SharedFrame, header: &RequestHeader) -> Result<Self, Unsent> {
        let at = Instant::now();
        let (pending, slot) = shared.send(header)?;
        Ok(Self { pending, slot, at, vigil: Vigil::default(), came: None })
    }

    /// The connection.
    pub const fn link(&self) -> &Arc<Link> {
        self.slot.link()
    }

    /// The pages of the request.
    pub fn pages(&self) -> &[Page] {
        self.pending.pages()
    }

    /// Ends the request. Its place is free for another one.
    pub fn into_slot(self) -> Slot {
        self.slot
    }

    /// Waits until then for the answer, or for what says that there will be none. Whether either has come.
    pub fn has_come(&mut self, expected: Expected, spin: Duration, until: Instant) -> bool {
        if self.came.is_none() {
            let Self { pending, slot, at, vigil, .. } = self;
            self.came = match slot.link().receive(pending, *at, expected, spin, until, vigil) {
                Ok(true) => Some(Ok(at.elapsed())),
                Ok(false) => None,
                Err(error) => Some(Err(error)),
            };
        }
        self.came.is_some()
    }

    /// As [`has_come`](Self::has_come), for whom the answer does not matter yet.
    pub fn has_come_by(&mut self, until: Instant) -> bool {
        self.has_come(Expected::default(), Duration::ZERO, until)
    }

    /// Whether what has come is an answer.
    pub const fn is_answered(&self) -> bool {
        matches!(self.came, Some(Ok(_)))
    }

    /// Takes the answer that has come: a copy of its header, its memory, and the time since the request.
    ///
    /// # Errors
    /// [`LinkError`]; a [`Timeout`](LinkError::Timeout) where nothing has come.
    pub fn take(&mut self) -> Result<(ResponseHeader, CheckedResponse, Duration), LinkError> {
        let timeout = || Err(LinkError::Timeout { waited: self.at.elapsed() });
        let round_trip = self.came.take().unwrap_or_else(timeout)?;
        let (header, response) = self.pending.answer()?;
        Ok((header, response, round_trip))
    }

    /// Waits for the answer, at most `deadline`.
    ///
    /// # Errors
    /// [`LinkError`].
    pub fn end(
        mut self,
        expected: Expected,
        spin: Duration,
        deadline: Duration,
    ) -> Result<Answer, LinkError> {
        if !self.has_come(expected, spin, Instant::now() + deadline) {
            return Err(LinkError::Timeout { waited: deadline });
        }
        self.received()
    }

    /// The answer that has come.
    ///
    /// # Errors
    /// As [`take`](Self::take).
    pub fn received(mut self) -> Result<Answer, LinkError> {
        let (header, response, round_trip) = self.take()?;
        Ok(Answer { header, memory: self.hold(response), round_trip })
    }

    /// Holds the memory of an answer that was taken.
    pub fn hold(self, response: CheckedResponse) -> AnswerMemory {
        AnswerMemory { response, _pending: self.pending, _slot: self.slot }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use pairmask_wire::{InstanceName, Version, words_in, words_in_mut};

    use super::*;
    use crate::budget::Budget;
    use crate::counters::Counters;
    use crate::door::Door;
    use crate::instance::{DaemonRecord, RuntimeDir};
    use crate::limits::quiet_transport_log;
    use crate::link::LinkOptions;
    use crate::peer::CheckedRequest;

    const WORDS: usize = 100_000;

    /// Sends a payload of one number, and closes the session when the daemon has the request.
    fn close_under_way(dir: &RuntimeDir, door: &Door, number: u32) -> CheckedRequest {
        let instance = &InstanceName::default();
        let options = LinkOptions { dir, instance, capacity: None, leaves_silent: false };
        let link = Arc::new(Link::open(&options).unwrap());
        let mut frame = link.loan(4 * WORDS as u64).unwrap();
        words_in_mut(frame.loan.pages_mut()).fill(number);
        let header = bytemuck::Zeroable::zeroed();
        let exchange = Exchange::begin(frame, &header).ok().unwrap();
        let mut received = Vec::new();
        while received.is_empty() {
            for peer in door.peers() {
                peer.receive(|request| received.push(request));
            }
        }
        let request = received.pop().unwrap();
        drop((link, exchange));
        request
    }

    #[test]
    fn what_is_under_way_stays_as_it_is_when_its_session_is_closed() {
        quiet_transport_log();
        let home = tempfile::tempdir().unwrap();
        let (dir, name) = (RuntimeDir::at(home.path()), InstanceName::default());
        dir.ensure().unwrap();
        let door =
            Door::open(&dir, &name, 8, Budget::new(1 << 30, 8), Counters::unseen(8)).unwrap();
        let pid = std::process::id();
        let version = Version::CURRENT;
        let record = DaemonRecord { worker_pid: pid, supervisor_pid: pid, version, fences: 0 };
        dir.write_record(&name, &record).unwrap();
        std::thread::scope(|scope| {
            let porter = scope.spawn(|| door.attend());
            // Asserted when the door has ended: a test that fails does not wait for it.
            let stayed = (1..=20).all(|number| {
                let request = close_under_way(&dir, &door, number);
                let until = Instant::now() + Duration::from_millis(5);
                let is_awaited =
                    std::iter::from_fn(|| (Instant::now() < until).then(|| request.is_wanted()));
                let is_let_go = !is_awaited.fold(false, |any, is_wanted| any | is_wanted);
                let words = words_in(request.pages());
                is_let_go && words.len() >= WORDS && words[..WORDS].iter().all(|w| *w == number)
            });
            door.end();
            porter.join().unwrap().unwrap();
            assert!(stayed, "it is not wanted again, and its memory is as it was");
        });
    }
}
