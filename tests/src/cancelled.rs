//! Work whose answer nobody waits for any more, after so many looks.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use pairmask_core::cancel::Wanted;
use pairmask_core::engine::{CullError, CullReport, HeapReply};

/// Wants an answer for so many looks.
#[derive(Default)]
pub struct Looks {
    left: u64,
    seen: AtomicU64,
}

impl Looks {
    pub fn left(left: u64) -> Arc<Self> {
        Arc::new(Self { left, seen: AtomicU64::new(0) })
    }

    pub fn seen(&self) -> u64 {
        self.seen.load(Ordering::Relaxed)
    }
}

impl Wanted for Looks {
    fn is_wanted(&self) -> bool {
        self.seen.fetch_add(1, Ordering::Relaxed) < self.left
    }
}

/// Looks of a whole piece of work up to which each is tried as the one that ends it; of more, so many are.
const TRIED: u64 = 10;

/// Cancels work at its first look, its second, and so on, as a `reply` says it, and does it to its end each time after
/// that: with the same answer. Returns how many looks there were.
pub fn cancel_at_each_look(
    what: &str,
    mut work: impl FnMut(&mut HeapReply) -> Result<Vec<u32>, CullError>,
) -> u64 {
    let mut reply = HeapReply::new();
    let looks = Looks::left(u64::MAX);
    reply.set_asker(Some(looks.clone()));
    let expected = work(&mut reply).unwrap_or_else(|error| panic!("{what}: {error}"));
    let all = looks.seen();
    let step = all.div_ceil(TRIED).max(1);
    let mut ended = 0;
    for left in (0..all).step_by(step as usize) {
        reply.set_asker(Some(Looks::left(left)));
        match work(&mut reply) {
            Err(CullError::Cancelled) => ended += 1,
            // Threads look as often as they come to, which is not the same each time.
            Ok(answer) => assert!(left > 0 && answer == expected, "{what}, look {left} of {all}"),
            Err(error) => panic!("{what}, look {left}: {error}"),
        }
        reply.set_asker(None);
        let again =
            work(&mut reply).unwrap_or_else(|error| panic!("{what}, after {left}: {error}"));
        assert!(again == expected, "{what}: the frame after one that ended at look {left}");
    }
    assert!(ended > 0 || all == 0, "{what}: none of {all} looks ended it");
    all
}

/// The words of a mask, without what lies between its parts.
pub fn words_of(report: &CullReport, reply: &HeapReply) -> Vec<u32> {
    let spans = report.shape.spans();
    spans
        .flat_map(|span| reply.words()[span.start as usize..][..span.len as usize].to_vec())
        .collect()
}
