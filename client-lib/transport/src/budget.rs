//! The memory that a daemon may take: by client, and in all.
//!
//! What a client has the daemon keep or read draws from its [`Share`]: scenes, scratch, answers, what a request carries. It
//! goes back when the [`Charge`] is dropped. A part of the budget is kept for each client that may connect, so that
//! those who come late are served however greedy the others were; the rest goes to who asks first, up to a
//! half of the budget each.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use crate::locked::lock;
use crate::process_limits;

/// The part of the budget that is kept for clients in equal shares, as a divisor: 1 MiB for each of a hundred clients
/// of 512 MiB is a frame of some thousand boxes. A larger part would lie idle where few clients connect.
const KEPT_PART: u64 = 4;

/// The part that a client may have, as a divisor: with less, a daemon of one client would
/// leave most of it idle, with more, one client could take all that is not kept.
const CLIENT_PART: u64 = 2;

/// Which memory a charge is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Memory {
    /// The daemon's own, and video memory.
    Own,
    /// Shared with the client.
    Shared,
}

/// A client would take more memory than it may.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the client would take {needed_bytes} bytes of memory and may take {limit_bytes} now: serve with a larger --max-memory"
)]
pub struct OverBudget {
    /// What it would take in all.
    pub needed_bytes: u64,
    /// What it may take in all, beside the others.
    pub limit_bytes: u64,
}

/// What all clients of a daemon may take.
#[derive(Clone, Debug)]
pub struct Budget(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    limit: u64,
    /// Of each client, kept for it.
    kept: u64,
    /// Bytes that are kept for none.
    common: u64,
    used: Mutex<Used>,
}

#[derive(Debug, Default)]
struct Used {
    /// Of what is kept for none, by clients.
    common: u64,
    /// By the daemon for itself: its code, its drivers.
    daemon: u64,
    own: u64,
    shared: u64,
}

/// The memory of one client.
#[derive(Clone, Debug)]
pub struct Share(Arc<OfClient>);

#[derive(Debug)]
struct OfClient {
    of: Budget,
    /// Both are changed under the lock of the budget.
    used: AtomicU64,
    /// Bytes that are kept for it: none once it is gone.
    kept: AtomicU64,
}

/// Memory that is taken. Dropped, it goes back.
#[derive(Debug)]
pub struct Charge {
    share: Share,
    memory: Memory,
    bytes: u64,
}

impl Budget {
    /// Of so many bytes, for so many clients at a time.
    pub fn new(limit: u64, clients: usize) -> Self {
        let kept = limit / KEPT_PART / (clients.max(1) as u64);
        let common = limit - kept * clients as u64;
        Self(Arc::new(Inner { limit, kept, common, used: Mutex::default() }))
    }

    /// The share of a client that has taken nothing.
    pub fn share(&self) -> Share {
        let kept = AtomicU64::new(self.0.kept);
        Share(Arc::new(OfClient { of: self.clone(), used: AtomicU64::new(0), kept }))
    }

    /// Looks how much memory this process has of its own: what was not charged of it is the daemon's, and is taken from
    /// what clients may have. Takes some microseconds.
    pub fn note_process(&self) {
        if let Some(bytes) = own_bytes() {
            self.note_own(bytes);
        }
    }

    fn note_own(&self, bytes: u64) {
        let mut used = lock(&self.0.used);
        used.daemon = bytes.saturating_sub(used.own);
    }

    /// Bytes that are taken, by the daemon for itself too, and that may be.
    pub fn used(&self) -> (u64, u64) {
        let used = lock(&self.0.used);
        (used.daemon + used.own + used.shared, self.0.limit)
    }
}

/// Memory of this process that no file is behind; `None` where the kernel does not say.
fn own_bytes() -> Option<u64> {
    let [_, resident, shared] = process_limits::sizes()?;
    Some(resident.saturating_sub(shared))
}

impl Inner {
    /// What a client may have that has `bytes`, and for which so many are kept.
    fn most(&self, used: &Used, bytes: u64, kept: u64) -> u64 {
        let left = self.common.saturating_sub(used.common + used.daemon);
        (bytes.max(kept) + left).min(self.limit / CLIENT_PART)
    }
}

impl Share {
    /// Takes memory.
    ///
    /// # Errors
    /// [`OverBudget`].
    pub fn charge(&self, memory: Memory, bytes: u64) -> Result<Charge, OverBudget> {
        let mut charge = self.nothing(memory);
        charge.grow_to(bytes).map(|()| charge)
    }

    /// A charge of no bytes.
    pub fn nothing(&self, memory: Memory) -> Charge {
        Charge { share: self.clone(), memory, bytes: 0 }
    }

    /// Bytes that the client has taken.
    pub fn used(&self) -> u64 {
        self.0.used.load(Ordering::Relaxed)
    }

    /// Bytes that the client may take on top.
    pub fn left(&self) -> u64 {
        let Inner { used, .. } = &*self.0.of.0;
        let used = lock(used);
        let bytes = self.0.used.load(Ordering::Relaxed);
        let kept = self.0.kept.load(Ordering::Relaxed);
        self.0.of.0.most(&used, bytes, kept).saturating_sub(bytes)
    }

    /// Its client is gone: what was kept for it is kept for the next one, and what it has is taken from all until it is
    /// freed.
    pub(crate) fn end(&self) {
        let OfClient { of: Budget(budget), used: of_client, kept } = &*self.0;
        let mut used = lock(&budget.used);
        used.common += of_client.load(Ordering::Relaxed).min(kept.swap(0, Ordering::Relaxed));
    }

    /// The error of a client that needs so many bytes on top, for which there was no room.
    pub fn over(&self, bytes: u64) -> OverBudget {
        let (used, left) = (self.0.used.load(Ordering::Relaxed), self.left());
        // Others may have given some back meanwhile.
        let needed = bytes.max(left + 1);
        OverBudget { needed_bytes: used.saturating_add(needed), limit_bytes: used + left }
    }
}

impl Charge {
    /// Bytes that are taken.
    pub const fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Whose they are.
    pub const fn share(&self) -> &Share {
        &self.share
    }

    /// Takes more, so that it is at least so much; where it may not, it stays what it was.
    ///
    /// # Errors
    /// [`OverBudget`].
    pub fn grow_to(&mut self, bytes: u64) -> Result<(), OverBudget> {
        if bytes <= self.bytes { Ok(()) } else { self.change(bytes, true) }
    }

    /// Notes what it takes by now, which may be more than it may.
    pub fn set(&mut self, bytes: u64) {
        if bytes != self.bytes {
            // Nothing is refused.
            let _ = self.change(bytes, false);
        }
    }

    fn change(&mut self, bytes: u64, is_asked: bool) -> Result<(), OverBudget> {
        let OfClient { of: Budget(budget), used: of_client, kept } = &*self.share.0;
        let mut used = lock(&budget.used);
        let kept = kept.load(Ordering::Relaxed);
        let before = of_client.load(Ordering::Relaxed);
        let after = (before - self.bytes).saturating_add(bytes);
        let limit_bytes = budget.most(&used, before, kept);
        if is_asked && after > limit_bytes {
            return Err(OverBudget { needed_bytes: after, limit_bytes });
        }
        of_client.store(after, Ordering::Relaxed);
        let replace = |sum: &mut u64, from: u64, to: u64| *sum = (*sum - from).saturating_add(to);
        replace(&mut used.common, before.saturating_sub(kept), after.saturating_sub(kept));
        match self.memory {
            Memory::Own => replace(&mut used.own, self.bytes, bytes),
            Memory::Shared => replace(&mut used.shared, self.bytes, bytes),
        }
        self.bytes = bytes;
        Ok(())
    }
}

impl Drop for Charge {
    fn drop(&mut self) {
        self.set(0);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    const CLIENTS: usize = 10;

    fn take(share: &Share, bytes: u64) -> Result<Charge, OverBudget> {
        share.charge(Memory::Own, bytes)
    }

    #[test]
    fn a_client_has_a_half_and_what_is_kept_for_others_stays() {
        let budget = Budget::new(4000, CLIENTS);
        let clients: Vec<Share> = (0..CLIENTS).map(|_| budget.share()).collect();
        assert_eq!(clients[0].left(), 2000);
        let refused = take(&clients[0], 2001).unwrap_err();
        assert_eq!(refused, OverBudget { needed_bytes: 2001, limit_bytes: 2000 });
        let greedy: Vec<Charge> =
            clients[..9].iter().map(|share| take(share, share.left()).unwrap()).collect();
        let taken: Vec<u64> = greedy.iter().map(Charge::bytes).collect();
        assert_eq!(taken, [2000, 1200, 100, 100, 100, 100, 100, 100, 100]);
        assert_eq!((clients[9].left(), budget.used()), (100, (3900, 4000)));
        drop(greedy);
        assert_eq!((clients[9].left(), budget.used()), (2000, (0, 4000)));
    }

    #[test]
    fn nothing_is_kept_for_a_client_that_is_gone() {
        let budget = Budget::new(4000, CLIENTS);
        let (gone, next) = (budget.share(), budget.share());
        let (large, small) = (take(&gone, 60).unwrap(), take(&gone, 20).unwrap());
        gone.end();
        gone.end();
        assert_eq!(lock(&budget.0.used).common, 80);
        drop(large);
        assert_eq!(lock(&budget.0.used).common, 20);
        let taken = take(&next, 150).unwrap();
        assert_eq!(lock(&budget.0.used).common, 70);
        drop((small, taken));
        assert_eq!(lock(&budget.0.used).common, 0);
        assert_eq!(budget.used().0, 0);
    }

    #[test]
    fn what_was_refused_changes_nothing_and_what_is_noted_may_be_more() {
        let budget = Budget::new(4000, CLIENTS);
        let (one, two) = (budget.share(), budget.share());
        let mut charge = take(&one, 500).unwrap();
        assert!(charge.grow_to(u64::MAX).is_err() && charge.grow_to(10).is_ok());
        assert_eq!((charge.bytes(), one.left()), (500, 1500));
        charge.set(3900);
        assert_eq!((one.left(), two.left(), budget.used().0), (0, 100, 3900));
        let refused = charge.grow_to(3901).unwrap_err();
        assert_eq!(refused, OverBudget { needed_bytes: 3901, limit_bytes: 2000 });
        assert!(take(&two, 101).is_err() && take(&two, 100).is_ok());
        charge.set(0);
        assert_eq!((two.left(), budget.used().0), (2000, 0));
    }

    #[test]
    fn the_daemon_has_what_was_not_charged() {
        let budget = Budget::new(4000, CLIENTS);
        let share = budget.share();
        let own = take(&share, 1000).unwrap();
        let shared = share.charge(Memory::Shared, 500).unwrap();
        budget.note_own(1700);
        assert_eq!((share.left(), budget.used().0), (500, 2200));
        budget.note_own(900);
        assert_eq!((own.bytes() + shared.bytes(), budget.used().0), (1500, 1500));
        budget.note_own(5000);
        assert_eq!((share.left(), budget.share().left()), (0, 100), "what is kept stays");
    }

    #[test]
    fn the_kernel_says_what_this_process_has() {
        let before = own_bytes().unwrap();
        let memory = vec![1_u8; 32 << 20];
        let after = own_bytes().unwrap();
        assert!(after > before + (24 << 20), "{before} {after} {}", memory.len());
    }

    #[test]
    fn threads_that_take_and_give_leave_nothing_behind() {
        let budget = Budget::new(1 << 20, CLIENTS);
        std::thread::scope(|scope| {
            for client in 0..4_u64 {
                let (budget, share) = (&budget, budget.share());
                for thread in 0..2_u64 {
                    let share = share.clone();
                    scope.spawn(move || {
                        let mut charges: Vec<Charge> = Vec::new();
                        let mut state = 1 + 2 * client + thread;
                        for _ in 0..3000 {
                            state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(1);
                            let bytes = state >> 46;
                            charges.extend(take(&share, bytes).ok());
                            if state.is_multiple_of(3) {
                                charges.clear();
                            }
                            assert!(budget.used().0 <= 1 << 20);
                        }
                    });
                }
            }
        });
        assert_eq!(budget.used().0, 0);
        assert_eq!(lock(&budget.0.used).common, 0);
    }
}
