//! When the next frames are due, learned from when the last ones came: a pure function of instants.
//!
//! A thread that sleeps until a frame comes answers it late: it is woken in 50 to 100 µs on a virtual
//! machine, the core's clock is down, and its caches hold what others left. A frame of 1,000 boxes then
//! takes several times as long. A thread that spins all the time costs a core. A [`Pacing`] says when
//! to be awake instead: from shortly before a frame is due until shortly after.

mod estimate;
mod predictor;

pub use self::estimate::{Answered, Estimate, Expected};

use std::time::{Duration, Instant};

use self::predictor::{Beat, Predictor};

/// How long before the earliest expected request a thread is woken. The timer comes 0.1 ms late on a
/// virtual machine, and sometimes 0.3 ms: a lead of 0.1 ms gains nothing.
const LEAD: Duration = Duration::from_micros(300);
/// How long a thread spins beyond the latest expected request: its client's own wake-up may be late. It
/// costs time for late requests only.
const LAG: Duration = Duration::from_micros(150);
/// The longest time awake for a beat: 3.6 % of a core at 60 Hz where every request comes at its end.
const LONGEST: Duration = Duration::from_micros(600);
/// The largest share of a period to be awake, as one in so many: it bounds rates above 370 Hz.
const SHARE: u32 = 6;
/// The largest share of a core that all clients together may take, as one in so many.
const SHARE_OF_ALL: u32 = 4;
/// A client whose requests come within so many times the time that is left for them has no pace: the
/// most of them would come when nobody is awake.
const WIDEST: u32 = 2;
/// Less time than this is not worth a wake-up of its own.
const SHORTEST: Duration = Duration::from_micros(80);
/// Clients that are remembered. The one that was silent longest makes room.
const MOST_CLIENTS: usize = 64;

/// When a thread sleeps, and when it spins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wake {
    /// Sleep until then unless a request comes; it may have passed.
    pub sleep_until: Instant,
    /// When the first request may come.
    pub expected: Instant,
    /// Then spin until here.
    pub spin_until: Instant,
}

impl Wake {
    /// Whether it is time to spin.
    pub fn is_awake(&self, now: Instant) -> bool {
        self.sleep_until <= now && now < self.spin_until
    }
}

/// The paces of clients that one thread serves. `C` distinguishes clients.
#[derive(Clone, Debug)]
pub struct Pacing<C> {
    clients: Vec<(C, Predictor)>,
}

impl<C> Default for Pacing<C> {
    fn default() -> Self {
        Self { clients: Vec::with_capacity(MOST_CLIENTS) }
    }
}

impl<C: PartialEq> Pacing<C> {
    /// A request of a client came.
    pub fn note_request(&mut self, client: C, now: Instant) {
        if let Some((_, predictor)) = self.clients.iter_mut().find(|(known, _)| *known == client) {
            return predictor.note(now);
        }
        if self.clients.len() == MOST_CLIENTS {
            let silent = self.clients.iter().enumerate().min_by_key(|(_, (_, p))| p.last());
            if let Some(index) = silent.map(|(index, _)| index) {
                self.clients.swap_remove(index);
            }
        }
        self.clients.push((client, Predictor::new(now)));
    }

    /// Whether the pace of a client is known.
    pub fn is_known(&self) -> bool {
        self.clients.iter().any(|(_, predictor)| predictor.beat().is_some())
    }

    /// When to be awake next: now, where `sleep_until` has passed. `None` where no client is expected;
    /// then sleep until a request comes.
    pub fn next_wake(&self, now: Instant) -> Option<Wake> {
        let budget = self.budget(now);
        let mut windows: Vec<Wake> = self
            .clients
            .iter()
            .filter_map(|(_, predictor)| window(predictor, budget, now))
            .collect();
        windows.sort_unstable_by_key(|wake| wake.sleep_until);
        // Windows that overlap, or lie too close for a sleep between them, are one.
        let mut windows = windows.into_iter();
        let first = windows.next()?;
        Some(windows.fold(first, |wake, next| {
            if next.sleep_until <= wake.spin_until + SHORTEST {
                Wake { spin_until: wake.spin_until.max(next.spin_until), ..wake }
            } else {
                wake
            }
        }))
    }

    /// The longest time awake for a beat of each client, so that all together keep to their share.
    fn budget(&self, now: Instant) -> Duration {
        let beats = self.clients.iter().filter(|(_, predictor)| predictor.next(now, LAG).is_some());
        let per_second: f64 = beats
            .filter_map(|(_, predictor)| Some(1.0 / predictor.beat()?.period.as_secs_f64()))
            .filter(|rate| rate.is_finite())
            .sum();
        let share = Duration::from_secs(1) / SHARE_OF_ALL;
        if per_second <= 1.0 { LONGEST } else { LONGEST.min(share.div_f64(per_second)) }
    }
}

/// When to be awake for the next beat of a client; `None` where none is expected, or where too little
/// time is left for it.
fn window(predictor: &Predictor, budget: Duration, now: Instant) -> Option<Wake> {
    let Beat { period, early, late } = predictor.beat()?;
    let budget = budget.min(period / SHARE);
    let spread = early + late;
    if budget < SHORTEST {
        return None;
    }
    let (lead, lag) = (LEAD.min(budget / 2), LAG.min(budget / 4));
    let room = budget.saturating_sub(lead + lag);
    if spread > room * WIDEST {
        return None;
    }
    // Where requests come within a longer time than the budget, its middle is covered.
    let (early, late) = if spread <= room {
        (early, late)
    } else {
        (scaled(early, room, spread), scaled(late, room, spread))
    };
    let due = predictor.next(now, late + lag)?;
    let expected = due.checked_sub(early)?;
    Some(Wake { sleep_until: expected.checked_sub(lead)?, expected, spin_until: due + late + lag })
}

/// `part` of a whole that shrinks from `whole` to `room`.
fn scaled(part: Duration, room: Duration, whole: Duration) -> Duration {
    part.mul_f64(room.as_secs_f64() / whole.as_secs_f64())
}

#[cfg(test)]
mod tests;
