//! Batches from one bridge to another, in their order, over a network that loses, doubles, delays and reorders messages.
//!
//! Each batch names the tick of the one before it, so that the receiver knows which it lacks. The sender keeps what is not
//! acknowledged and sends it again: at once where a later one has come, and else after twice a round trip. So what a
//! network does changes when a batch is applied, and nothing else.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use crate::protocol::Batch;

/// Batches that are kept while one before them is missing. A sender sends again what does not fit.
const MOST_EARLY: usize = 1_024;
/// Bytes that are sent again in one tick, at the most, beside one batch: a link that has been cut is not filled at once.
const MOST_AGAIN_BYTES: usize = 1 << 20;

/// Batches to one receiver.
#[derive(Debug, Default)]
pub struct Outgoing {
    unacknowledged: VecDeque<Sent>,
    last: u64,
    /// All up to this tick is acknowledged.
    pub acknowledged: u64,
    /// The first time since when nothing was acknowledged though something was sent.
    waits_since: Option<Duration>,
    /// A smoothed round trip, with the receiver's wait for its tick.
    round_trip: Option<Duration>,
}

#[derive(Debug)]
struct Sent {
    since: u64,
    tick: u64,
    edits: Vec<u8>,
    /// When it was sent last.
    last: Option<Duration>,
    /// Whether that was not the first time: what an acknowledgement answers is not known then.
    is_again: bool,
    /// Whether a later one has come.
    is_missed: bool,
}

impl Outgoing {
    /// The tick of the last batch.
    pub const fn last(&self) -> u64 {
        self.last
    }

    /// Adds the batch of a tick, and returns the tick that it follows.
    pub fn push(&mut self, tick: u64, edits: Vec<u8>, now: Duration) -> u64 {
        let since = self.last;
        self.last = tick;
        self.waits_since.get_or_insert(now);
        let (is_again, is_missed, last) = (false, false, None);
        self.unacknowledged.push_back(Sent { since, tick, edits, last, is_again, is_missed });
        since
    }

    /// Notes what the receiver has acknowledged, and the highest tick that it has seen.
    pub fn acknowledge(&mut self, acknowledged: u64, seen: u64, now: Duration) {
        let acknowledged = acknowledged.min(self.last);
        if acknowledged > self.acknowledged {
            self.acknowledged = acknowledged;
            while let Some(sent) = self.unacknowledged.pop_front_if(|s| s.tick <= acknowledged) {
                if let Some(last) = sent.last.filter(|_| !sent.is_again) {
                    let took = now.saturating_sub(last);
                    let smooth = |mean: Duration| (mean * 7 + took) / 8;
                    self.round_trip = Some(self.round_trip.map_or(took, smooth));
                }
            }
            self.waits_since = self.unacknowledged.front().map(|_| now);
        }
        // A later one has come: this one is lost, or comes late.
        let waited = self.round_trip.unwrap_or_default();
        if let Some(oldest) = self.unacknowledged.front_mut()
            && seen > oldest.tick
            && oldest.last.is_some_and(|last| now >= last + waited)
        {
            oldest.is_missed = true;
        }
    }

    /// Calls a function with each batch that is to be sent, or sent again: the tick that it follows, its tick and its edits.
    /// Without a round trip known, they are sent again after the slowest wait.
    pub fn send_due(
        &mut self,
        (now, slowest): (Duration, Duration),
        mut f: impl FnMut(u64, u64, &[u8]),
    ) {
        let wait = self.round_trip.map_or(slowest, |mean| (2 * mean).min(slowest));
        let mut bytes = 0;
        for sent in &mut self.unacknowledged {
            if let Some(last) = sent.last {
                if bytes > MOST_AGAIN_BYTES || !sent.is_missed && now <= last + wait {
                    continue;
                }
                (sent.is_again, sent.is_missed) = (true, false);
                bytes += sent.edits.len();
            }
            sent.last = Some(now);
            f(sent.since, sent.tick, &sent.edits);
        }
    }

    /// How long the receiver has acknowledged nothing of what it was sent.
    pub fn waits(&self, now: Duration) -> Duration {
        self.waits_since.map_or(Duration::ZERO, |since| now.saturating_sub(since))
    }

    /// Bytes that are kept until they are acknowledged.
    pub fn kept_bytes(&self) -> usize {
        self.unacknowledged.iter().map(|sent| sent.edits.len()).sum()
    }
}

/// Batches from one sender.
#[derive(Debug, Default)]
pub struct Incoming {
    /// All up to this tick has come.
    pub received: u64,
    /// The highest tick of a batch that has come.
    pub seen: u64,
    /// By the tick that they follow.
    early: BTreeMap<u64, Batch>,
    /// Whether the sender is to be sent an acknowledgement.
    pub owes: bool,
}

impl Incoming {
    /// Takes a batch in, and calls a function with each that is next in order.
    pub fn take(&mut self, batch: Batch, mut f: impl FnMut(Batch)) {
        self.owes = true;
        self.seen = self.seen.max(batch.tick);
        if batch.tick <= self.received {
            return;
        }
        if batch.since != self.received {
            if self.early.len() < MOST_EARLY {
                self.early.insert(batch.since, batch);
            }
            return;
        }
        let mut next = Some(batch);
        while let Some(batch) = next {
            self.received = batch.tick;
            f(batch);
            next = self.early.remove(&self.received);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::protocol::Edits;
    use crate::view::Version;

    fn batch(since: u64, tick: u64) -> Batch {
        let (version, edits) = (Version::default(), Edits::default());
        let [start, hold, acknowledged, seen] = [0; 4];
        let (to, prior) = (crate::ids::Peer::default(), version);
        Batch { to, version, prior, start, hold, acknowledged, seen, since, tick, edits }
    }

    #[test]
    fn batches_come_in_order_and_once() {
        let mut incoming = Incoming::default();
        let mut came = Vec::new();
        for (since, tick) in [(5, 6), (0, 5), (0, 5), (9, 12), (6, 7), (5, 6), (7, 9), (12, 13)] {
            incoming.take(batch(since, tick), |batch| came.push(batch.tick));
        }
        assert_eq!(came, [5, 6, 7, 9, 12, 13]);
        assert_eq!((incoming.received, incoming.early.len()), (13, 0));
    }

    #[test]
    fn what_is_not_acknowledged_is_sent_again() {
        let ms = Duration::from_millis;
        let mut out = Outgoing::default();
        let again = |out: &mut Outgoing, now| {
            let mut ticks = Vec::new();
            out.send_due((now, ms(100)), |_, tick, _| ticks.push(tick));
            ticks
        };
        assert_eq!(out.push(4, vec![0; 8], ms(1)), 0);
        assert_eq!(out.push(5, vec![0; 8], ms(2)), 4);
        out.push(6, vec![0; 8], ms(3));
        assert_eq!(again(&mut out, ms(3)), [4, 5, 6], "the first time");
        assert!(again(&mut out, ms(50)).is_empty());
        out.acknowledge(4, 4, ms(53));
        // A round trip took 50 ms.
        assert_eq!((out.kept_bytes(), again(&mut out, ms(60))), (16, vec![]));
        out.acknowledge(4, 6, ms(61));
        assert_eq!(again(&mut out, ms(61)), [5], "6 has come, and 5 has not");
        out.acknowledge(4, 6, ms(62));
        assert!(again(&mut out, ms(62)).is_empty(), "not twice in a round trip");
        assert_eq!(again(&mut out, ms(200)), [5, 6]);
        assert_eq!(out.waits(ms(200)), ms(147));
        out.acknowledge(u64::MAX, u64::MAX, ms(201));
        assert_eq!((out.acknowledged, out.kept_bytes(), out.waits(ms(300))), (6, 0, ms(0)));
    }
}
