//! Requests under way, and the wait for their answers.

use std::fmt::Debug;
use std::time::{Duration, Instant};

use super::error::Error;
use super::settings::LONGEST_WAIT;

/// A frame or an edit that was submitted, and its answer to be: a [`PairMask`](super::PairMask) or a
/// [`SceneAnswer`](super::SceneAnswer). In process it is answered already.
///
/// Dropped, the answer is discarded. An edit is applied all the same, and the next answer reports what this one would
/// have reported. It holds one of the session's three slots for frames, and leaves that to the request that needs one
/// next, which waits for the daemon's answer first where no other is free.
#[derive(Debug)]
#[must_use = "a request is answered when it is waited for"]
pub struct Pending<A: Answered> {
    /// `None` once the answer was taken.
    request: Option<A::Request>,
}

/// What is waited for.
pub trait Answered: Sized {
    type Request: Request<Self>;
}

/// A request that was submitted.
pub trait Request<A>: Sized + Debug {
    /// How long the session waits for a daemon.
    fn deadline(&self) -> Duration;

    /// Waits until then. Whether there is an answer, or will be none.
    fn has_come(&mut self, until: Instant) -> bool;

    /// The answer that has come; the request where it had to be sent again.
    fn take(self) -> Result<Result<A, Self>, Error>;

    /// The answer of this process to a request that had none within the deadline, or an error.
    fn answer_here(self) -> Result<A, Error>;
}

impl<A: Answered> Pending<A> {
    pub(super) const fn new(request: A::Request) -> Self {
        Self { request: Some(request) }
    }

    /// Waits for the answer, as long as the session's deadline allows. That of an edit is acknowledged by that: what it
    /// reports is not reported again.
    ///
    /// # Errors
    /// [`Error`]. With [`Backend::Auto`](super::Backend::Auto), no failure of the daemon is an error of a frame: this
    /// process answers it then. After an error the edit is applied, and the next answer makes up for this one.
    pub fn wait(mut self) -> Result<A, Error> {
        let deadline = self.request.as_ref().map_or(Duration::ZERO, Request::deadline);
        match self.take_within(deadline)? {
            Some(answer) => Ok(answer),
            None => self.request.take().ok_or(Error::AlreadyReceived)?.answer_here(),
        }
    }

    /// The answer if it has come.
    ///
    /// # Errors
    /// [`Error`], [`Error::AlreadyReceived`] where it was taken before.
    pub fn try_receive(&mut self) -> Result<Option<A>, Error> {
        self.take_within(Duration::ZERO)
    }

    /// Waits for the answer, at most `timeout`. More than a day is a day.
    ///
    /// # Errors
    /// [`Error::Timeout`] when `timeout` passed: the request is still under way. Else [`Error`].
    pub fn wait_timeout(&mut self, timeout: Duration) -> Result<A, Error> {
        let waited = timeout.min(LONGEST_WAIT);
        self.take_within(waited)?.ok_or(Error::Timeout { waited })
    }

    fn take_within(&mut self, timeout: Duration) -> Result<Option<A>, Error> {
        let until = Instant::now() + timeout;
        let mut request = self.request.take().ok_or(Error::AlreadyReceived)?;
        while request.has_come(until) {
            match request.take()? {
                Ok(answer) => return Ok(Some(answer)),
                Err(again) => request = again,
            }
        }
        self.request = Some(request);
        Ok(None)
    }
}
