//! A guard of a process against memory that is cut: a file that another process truncates while this one reads its
//! mapping raises SIGBUS, which ends a process that does nothing about it.
//!
//! A process that [installs](install) the guard gets pages of zeros in the place of those that are missing, and goes
//! on. It is the daemon's worker that does, since its clients may do with the memory that they share as they please:
//! with their own, and, where they are of its user, with what they map of its. A library does not change how its host
//! takes signals.
#![allow(unsafe_code)]

use std::io;
use std::mem::MaybeUninit;
use std::ptr;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rustix::mm::{MapFlags, ProtFlags, mmap_anonymous};

/// Segments that are watched over at a time, at most: all that 100 clients may have, on both sides. What is beyond is not
/// mapped.
const PLACES: usize = 4096;

/// A range that is watched over; free where `end` is 0. A handler of signals may read nothing that a lock guards.
struct Place {
    start: AtomicUsize,
    end: AtomicUsize,
    is_writable: AtomicBool,
}

static WATCHED: [Place; PLACES] = [const {
    Place {
        start: AtomicUsize::new(usize::MAX),
        end: AtomicUsize::new(0),
        is_writable: AtomicBool::new(false),
    }
}; PLACES];

/// How the process took the signal before.
static BEFORE: OnceLock<libc::sigaction> = OnceLock::new();

/// Watches over a range of addresses until it is dropped.
#[derive(Debug)]
pub(super) struct Guarded(usize);

impl Guarded {
    /// Watches over a mapping; `None` where nothing is installed.
    ///
    /// # Errors
    /// Out of memory, where no place is left.
    pub(super) fn watch(start: usize, bytes: usize, is_writable: bool) -> io::Result<Option<Self>> {
        if BEFORE.get().is_none() {
            return Ok(None);
        }
        let take = |place: &Place| {
            let taken = place.start.compare_exchange(
                usize::MAX,
                start,
                Ordering::AcqRel,
                Ordering::Relaxed,
            );
            taken.is_ok()
        };
        let at = WATCHED.iter().position(take).ok_or(io::ErrorKind::OutOfMemory)?;
        WATCHED[at].is_writable.store(is_writable, Ordering::Relaxed);
        WATCHED[at].end.store(start + bytes, Ordering::Release);
        Ok(Some(Self(at)))
    }
}

impl Drop for Guarded {
    fn drop(&mut self) {
        WATCHED[self.0].end.store(0, Ordering::Release);
        WATCHED[self.0].start.store(usize::MAX, Ordering::Release);
    }
}

/// Has this process survive memory of others that is cut while it is read. Once; later calls do nothing.
///
/// # Errors
/// The system's.
pub fn install() -> io::Result<()> {
    if BEFORE.get().is_some() {
        return Ok(());
    }
    let mut before = MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: a `sigaction` of zeros is one: no flags, an empty mask, the default handler.
    let mut action: libc::sigaction = unsafe { MaybeUninit::zeroed().assume_init() };
    action.sa_sigaction = on_bus_error as *const () as usize;
    // On the stack of the thread's own for signals, where it has one.
    action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
    // SAFETY: both are valid `sigaction`s; the handler has the signature that SA_SIGINFO asks for, and does only what a
    // handler may: it reads atomics, maps pages, and sets a handler.
    let done = unsafe { libc::sigaction(libc::SIGBUS, &raw const action, before.as_mut_ptr()) };
    if done != 0 {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: the call has filled it in.
    let _ = BEFORE.set(unsafe { before.assume_init() });
    Ok(())
}

extern "C" fn on_bus_error(
    _signal: libc::c_int,
    info: *mut libc::siginfo_t,
    _context: *mut libc::c_void,
) {
    // SAFETY: the kernel gives a handler with SA_SIGINFO a valid `siginfo_t`, which has an address for SIGBUS.
    let address = unsafe { (*info).si_addr() } as usize;
    if !replace(address) {
        let default = || {
            // SAFETY: as in `install`.
            unsafe { MaybeUninit::<libc::sigaction>::zeroed().assume_init() }
        };
        let before = BEFORE.get().copied().unwrap_or_else(default);
        // SAFETY: what was there before is a valid `sigaction`. The access is made again on return, and taken as it
        // would have been.
        unsafe { libc::sigaction(libc::SIGBUS, &raw const before, ptr::null_mut()) };
    }
}

/// Puts zeros in the place of a missing page and those behind it, where somebody watches over it.
fn replace(address: usize) -> bool {
    let page = address & !(pairmask_wire::PAGE_BYTES - 1);
    let is_its = |place: &&Place| {
        let end = place.end.load(Ordering::Acquire);
        place.start.load(Ordering::Acquire) <= page && page < end
    };
    let Some(place) = WATCHED.iter().find(is_its) else { return false };
    let bytes = place.end.load(Ordering::Acquire).saturating_sub(page);
    if bytes == 0 {
        return false;
    }
    let is_writable = place.is_writable.load(Ordering::Relaxed);
    let access = if is_writable { ProtFlags::READ | ProtFlags::WRITE } else { ProtFlags::READ };
    let flags = MapFlags::PRIVATE | MapFlags::FIXED | MapFlags::NORESERVE;
    let first = ptr::with_exposed_provenance_mut(page);
    // SAFETY: the range is the rest of a mapping of ours, which is held for as long as it is watched over: pages of it
    // are replaced by others, as its owner might have changed what they hold at any time.
    unsafe { mmap_anonymous(first, bytes, access, flags) }.is_ok()
}
