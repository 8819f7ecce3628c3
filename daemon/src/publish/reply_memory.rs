//! The memory of replies: present where answers need it, given back when nobody needs it any more.

use std::collections::{BTreeSet, HashMap};
use std::ops::Range;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use crate::locked;
use pairmask_transport::{ChunkLook, FreeChunks, PopulateError, PortTurn, populate_beyond};
use pairmask_wire::Page;

/// A chunk whose memory no answer of this time needed is given back: longer than a game's menus or a level that loads,
/// as with the engines' scratch. That of a disconnected client is given back at once.
const IDLE: Duration = Duration::from_secs(10);
/// Payloads up to this size stay: most answers take one page.
const KEPT_BYTES: usize = size_of::<Page>();

#[derive(Clone, Copy, Debug)]
struct Chunk {
    /// Bytes of its payload that are present.
    bytes: usize,
    /// Who last needed more than half of them.
    session: u128,
    at: Instant,
}

impl Chunk {
    fn note(&mut self, bytes: usize, session: u128, now: Instant) {
        self.bytes = self.bytes.max(bytes);
        if 2 * bytes > self.bytes {
            (self.session, self.at) = (session, now);
        }
    }

    fn is_due(&self, now: Instant, has_ended: impl Fn(u128) -> bool) -> bool {
        self.bytes > KEPT_BYTES
            && (has_ended(self.session) || now.saturating_duration_since(self.at) >= IDLE)
    }
}

/// The chunks of the server port that were lent so far, by the addresses of their payloads.
#[derive(Debug, Default)]
pub(super) struct ReplyMemory {
    chunks: Mutex<HashMap<usize, Chunk>>,
}

impl ReplyMemory {
    /// Makes the pages of a chunk present that is lent for an answer of a session. While one thread does so, which may
    /// take tens of milliseconds, others with other chunks do not wait.
    pub(super) fn ensure(&self, chunk: &mut [Page], session: u128) -> Result<(), PopulateError> {
        let (address, bytes) = (chunk.as_ptr() as usize, size_of_val(chunk));
        let now = Instant::now();
        let mut chunks = locked(&self.chunks);
        let known = chunks.entry(address).or_insert(Chunk { bytes: 0, session, at: now });
        let known_bytes = known.bytes;
        if bytes <= known_bytes {
            known.note(bytes, session, now);
            return Ok(());
        }
        drop(chunks);
        populate_beyond(chunk, known_bytes)?;
        if let Some(known) = locked(&self.chunks).get_mut(&address) {
            known.note(bytes, session, now);
        }
        Ok(())
    }

    /// Gives the memory of free chunks back that no session needs: those of ended sessions, and those that were
    /// idle for long. `release` has others let go of a range of addresses, and says whether they did.
    pub(super) fn give_back(
        &self,
        free: &FreeChunks,
        turn: &PortTurn,
        has_ended: impl Fn(u128) -> bool,
        mut release: impl FnMut(&Range<usize>) -> bool,
    ) {
        let now = Instant::now();
        let mut due: BTreeSet<usize> = {
            let chunks = locked(&self.chunks);
            let due = chunks.iter().filter(|(_, chunk)| chunk.is_due(now, &has_ended));
            due.map(|(address, _)| *address).collect()
        };
        let look = |due: &BTreeSet<usize>, address: usize| {
            if due.contains(&address) {
                ChunkLook::Requested
            } else if locked(&self.chunks).contains_key(&address) {
                ChunkLook::Other
            } else {
                ChunkLook::Unused
            }
        };
        // Those that are not free now are looked for again next time.
        while !due.is_empty()
            && let Some(mut chunk) = turn.take(|| free.take(|address| look(&due, address)))
        {
            let address = chunk.address();
            due.remove(&address);
            let bytes = locked(&self.chunks).get(&address).map_or(0, |chunk| chunk.bytes);
            if release(&(address..address + bytes)) {
                if let Some(known) = locked(&self.chunks).get_mut(&address) {
                    known.bytes = 0;
                }
                if !free.remove_pages(&mut chunk, bytes) {
                    log::debug!(
                        "{bytes} bytes of a reply that no longer exists stay in shared memory"
                    );
                }
            }
            turn.take(|| free.put_below(chunk, |address| look(&BTreeSet::new(), address)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MIB: usize = 1 << 20;

    #[test]
    fn memory_is_due_when_its_session_is_ended_or_has_not_needed_it_for_long() {
        let start = Instant::now();
        let mut chunk = Chunk { bytes: 0, session: 1, at: start };
        chunk.note(MIB, 1, start);
        let nobody = |_: u128| false;
        assert!(!chunk.is_due(start + IDLE / 2, nobody));
        assert!(chunk.is_due(start + IDLE, nobody));
        assert!(chunk.is_due(start, |session| session == 1) && !chunk.is_due(start, |s| s == 2));
        // Answers that need little of it leave it to the session that needed it.
        chunk.note(MIB / 2, 2, start + IDLE / 2);
        assert!(chunk.is_due(start + IDLE, nobody) && chunk.is_due(start, |session| session == 1));
        chunk.note(MIB / 2 + 1, 2, start + IDLE / 2);
        assert!(!chunk.is_due(start + IDLE, nobody) && chunk.is_due(start, |session| session == 2));
    }

    #[test]
    fn a_page_stays() {
        let start = Instant::now();
        let mut chunk = Chunk { bytes: 0, session: 1, at: start };
        chunk.note(KEPT_BYTES, 1, start);
        assert!(!chunk.is_due(start + 2 * IDLE, |_| true));
        chunk.note(KEPT_BYTES + 1, 1, start);
        assert!(chunk.is_due(start, |_| true));
    }
}
