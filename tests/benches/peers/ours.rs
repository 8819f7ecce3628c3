//! A session as a contender: the boxes in its memory, submitted, awaited, every pair decoded.

use std::time::Duration;

use pairmask::Frame;
use rayon::iter::ParallelIterator;

use pairmask_tests::peers::contender::{Contender, ContenderError, Tally};
use pairmask_tests::prelude::*;

/// From this many pairs on, two threads decode faster than one: waking the second takes as long as
/// decoding some 60,000.
const PARALLEL_PAIRS: u64 = 131_072;

#[derive(Debug)]
pub struct Ours {
    session: Session,
    threads: usize,
    rest: Duration,
    written: Option<Frame>,
    mask: Option<PairMask>,
}

impl Ours {
    /// A session that may use `threads` threads. After its turn no contender is timed for `rest`.
    pub const fn new(session: Session, threads: usize, rest: Duration) -> Self {
        Self { session, threads, rest, written: None, mask: None }
    }
}

fn failed(reason: impl std::fmt::Display) -> ContenderError {
    ContenderError { name: "pairmask".to_owned(), reason: reason.to_string() }
}

impl Contender for Ours {
    fn write(&mut self, boxes: &[Aabb]) -> Result<(), ContenderError> {
        // A client holds the mask of a frame until it has the next one's boxes.
        self.mask = None;
        let mut frame = self.session.frame(boxes.len()).map_err(failed)?;
        frame.write(boxes).map_err(failed)?;
        self.written = Some(frame);
        Ok(())
    }

    fn find(&mut self, _: &[Aabb]) -> Result<Tally, ContenderError> {
        let frame = self.written.take().ok_or_else(|| failed("no boxes were written"))?;
        let mask = frame.submit().map_err(failed)?.wait().map_err(failed)?;
        let tally = if self.threads > 1 && mask.count() >= PARALLEL_PAIRS {
            let iterated = |mut tally: Tally, [a, b]: [u32; 2]| {
                tally.iterate(a, b);
                tally
            };
            mask.par_pairs().fold(Tally::default, iterated).reduce(Tally::default, Tally::plus)
        } else {
            let mut tally = Tally::default();
            mask.for_each_slice(|pairs| pairs.iter().for_each(|&[a, b]| tally.iterate(a, b)));
            tally
        };
        self.mask = Some(mask);
        Ok(tally)
    }

    fn pairs(&mut self, _: &[Aabb]) -> Result<Vec<Pair>, ContenderError> {
        Ok(self.mask.as_ref().ok_or_else(|| failed("no frame was answered"))?.to_vec())
    }

    fn engine(&self) -> Option<String> {
        self.mask.as_ref().map(|mask| mask.info().engine.to_string())
    }

    fn settle(&self) {
        std::thread::sleep(self.rest);
    }
}
