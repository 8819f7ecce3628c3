//! A sleep that ends with a wake-up or at an instant, to within tens of microseconds.
#![allow(unsafe_code)]

use std::os::fd::BorrowedFd;
use std::time::Instant;

use iceoryx2::prelude::FileDescriptorBased;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use crate::services::{TransportError, WakeDaemon};

/// Sleeps until the listener is woken, at most until `until`; takes all wake-ups that have come.
///
/// The listener's own wait ends with a tick of the system's coarse clock, 1 to 10 ms late. This one goes
/// by the fine clock: it is late by the thread's timer slack (50 µs) and a wake-up.
///
/// # Errors
/// [`TransportError`] where the system refuses to wait.
pub fn sleep_until(listener: &WakeDaemon, until: Instant) -> Result<(), TransportError> {
    let left = until.saturating_duration_since(Instant::now());
    let timeout = Timespec {
        tv_sec: i64::try_from(left.as_secs()).unwrap_or(i64::MAX),
        tv_nsec: left.subsec_nanos().into(),
    };
    // SAFETY: the listener owns this open descriptor, and is borrowed until the borrowed descriptor is
    // used for the last time. It is neither closed nor kept.
    let socket = unsafe { BorrowedFd::borrow_raw(listener.file_descriptor().native_handle()) };
    match poll(&mut [PollFd::new(&socket, PollFlags::IN)], Some(&timeout)) {
        // A signal ends the sleep: the caller looks what it asks for.
        Ok(_) | Err(Errno::INTR) => {}
        Err(error) => return Err(TransportError::new("waiting to be woken", &error)),
    }
    // Wake-ups that stay would end the next sleep at once.
    let taken = listener.try_wait(|_| {});
    taken.map(|_| ()).map_err(|error| TransportError::new("taking wake-ups", &error))
}
