//! A frame that is equal to the last one, answered without an engine.
//!
//! Games pause, menus open, turns wait: then the same boxes come again and again. A frame whose boxes and
//! options are the last one's, bit by bit, has the last one's answer.
//!
//! Scenes that move pay next to nothing for that: of each frame a sample of a few boxes is
//! remembered and compared, which differs at its first box where all boxes move. Only where the sample is
//! alike, a copy of boxes and answer is made, and frames are compared with it as a whole. Where
//! copies turn out to be useless, because a box moves that is not in the sample, the next one is made
//! after more frames that look alike (`patience`).
//!
//! ```text
//! sample    a few boxes of a frame, and what else decides its answer    (pure)
//! patience  after how many frames that look alike a copy is made        (pure)
//! kept      boxes and answer of a frame, and the comparison             (pure)
//! cost      whether the comparison is sooner done than a cull           (pure)
//! mod       the three together
//! ```
//!
//! **Exactness.** Bits are compared: −0 and +0 differ, equal NaNs do not. Boxes may lie in memory that
//! another process writes to meanwhile. Each byte of them is read once for the comparison, and once for
//! the copy, within the bounds that were validated before. What a client changes while its frame is under
//! way may be missed: then it gets the answer that it got for a frame before, with indices below its own
//! number of boxes. Another client's answer it never gets: the state belongs to one session.
//!
//! ```
//! use pairmask_core::Aabb;
//! use pairmask_core::dispatch::{CpuEngines, CullOptions};
//! use pairmask_core::engine::HeapReply;
//! use pairmask_core::objects::Objects;
//! use pairmask_core::repeat::{Repeats, Seen};
//!
//! let boxes = vec![Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]); 100];
//! let objects = Objects::Boxes((&boxes).into());
//! let (mut engines, mut repeats) = (CpuEngines::new(), Repeats::default());
//! let (mut reply, options) = (HeapReply::new(), CullOptions::default());
//! let mut answered_again = 0;
//! for _ in 0..10 {
//!     let pairs = match repeats.look(objects, &options, &mut reply) {
//!         Seen::Answered(answer) => {
//!             answered_again += 1;
//!             answer.report.pair_count
//!         }
//!         seen => {
//!             let answer = engines.cull(&boxes, &options, &mut reply)?;
//!             if seen == Seen::Alike
//!                 && let Some(ticket) = repeats.ticket()
//!             {
//!                 ticket.keep(objects, reply.words(), &answer);
//!             }
//!             answer.report.pair_count
//!         }
//!     };
//!     assert_eq!(pairs, 4_950);
//! }
//! assert_eq!(answered_again, 8);
//! # Ok::<(), pairmask_core::engine::CullError>(())
//! ```

mod cost;
mod kept;
mod patience;
mod sample;
#[cfg(test)]
mod tests;

pub use cost::is_sooner_compared;

use std::sync::{Arc, Mutex, PoisonError};

use self::kept::Kept;
use self::patience::Patience;
use self::sample::{Facts, Sample};
use crate::dispatch::{CullAnswer, CullOptions};
use crate::engine::{EngineChoice, ReplyBuffer};
use crate::objects::Objects;

/// What is remembered of a session's last frame.
#[derive(Default)]
pub struct Repeats {
    last: Sample,
    patience: Patience,
    kept: Option<Box<Kept>>,
    /// Where a copy will be found that is being made.
    promised: Option<Arc<Promise>>,
}

/// Where a copy is left: the frame may end on another thread than the one that began it.
type Promise = Mutex<Option<Box<Kept>>>;

/// What a look at a frame showed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(clippy::large_enum_variant)] // A box would be an allocation.
pub enum Seen {
    /// It is equal to the last one, whose answer is in the reply.
    Answered(CullAnswer),
    /// It may be equal to the last one, and so may the next be: its answer is worth [a copy](Repeats::ticket).
    Alike,
    /// It is to be culled.
    New,
}

/// A promise to keep boxes and answer of a frame.
#[derive(Debug)]
pub struct KeepTicket {
    facts: Facts,
    promise: Arc<Promise>,
}

impl std::fmt::Debug for Repeats {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let bytes = self.allocated_bytes();
        f.debug_struct("Repeats").field("allocated_bytes", &bytes).finish_non_exhaustive()
    }
}

impl Repeats {
    /// Looks at a frame. Where it is equal to the last one, the reply gets that one's mask.
    ///
    /// A client that names an engine wants that engine to work: its frames are always new.
    pub fn look(
        &mut self,
        objects: Objects<'_>,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Seen {
        self.look_with_rules(objects, options, 0, reply)
    }

    /// As [`look`](Self::look), at a frame with the rules of a number: 0 where all boxes may meet, and
    /// another one for other rules.
    pub fn look_with_rules(
        &mut self,
        objects: Objects<'_>,
        options: &CullOptions,
        rules: u64,
        reply: &mut dyn ReplyBuffer,
    ) -> Seen {
        if options.engine != EngineChoice::Auto || objects.len() < 2 {
            self.forget();
            return Seen::New;
        }
        let facts = Facts::of(objects, options, rules, reply.limit_words());
        if !self.last.is_alike(&facts, objects) {
            self.last.take(&facts, objects);
            self.drop_kept();
            self.patience.note_moved();
            return Seen::New;
        }
        self.last.extend(objects);
        if let Some(promise) = &self.promised {
            let done = promise.lock().unwrap_or_else(PoisonError::into_inner).take();
            match done {
                Some(kept) => (self.kept, self.promised) = (Some(kept), None),
                // The frame is still under way.
                None if Arc::strong_count(promise) > 1 => return Seen::New,
                // It was not answered.
                None => self.promised = None,
            }
        }
        let Some(kept) = &mut self.kept else {
            return if self.patience.note_alike() { Seen::Alike } else { Seen::New };
        };
        if let Some(answer) = kept.answer_again(&facts, objects, options.threads, reply) {
            return Seen::Answered(answer);
        }
        self.drop_kept();
        Seen::New
    }

    /// A promise to keep boxes and answer of the frame that was looked at last, once it is culled. `None`
    /// where that would take too much memory.
    pub fn ticket(&mut self) -> Option<KeepTicket> {
        let facts = self.last.facts().filter(Facts::may_be_kept)?;
        let promise = Arc::new(Promise::default());
        self.promised = Some(Arc::clone(&promise));
        Some(KeepTicket { facts, promise })
    }

    /// Words behind the mask that were kept with it.
    pub fn words_behind(&self) -> u64 {
        self.kept.as_ref().map_or(0, |kept| kept.words_behind())
    }

    /// Gives the copy up, and whatever else is known of the last frame.
    pub fn forget(&mut self) {
        self.last.clear();
        self.drop_kept();
    }

    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.kept.as_ref().map_or(0, |kept| kept.allocated_bytes())
    }

    fn drop_kept(&mut self) {
        let was_used = self.kept.take().map(|kept| kept.was_used());
        let was_promised = self.promised.take().map(|_| false);
        if let Some(was_used) = was_used.or(was_promised) {
            self.patience.note_dropped(was_used);
        }
    }
}

impl KeepTicket {
    /// Copies the objects of the frame and its answer, whose mask `words` hold, where there is memory for
    /// them.
    pub fn keep(self, objects: Objects<'_>, words: &[u32], answer: &CullAnswer) {
        self.keep_with(objects, words, answer, 0);
    }

    /// As [`keep`](Self::keep), with so many words that stand behind the mask.
    pub fn keep_with(self, objects: Objects<'_>, words: &[u32], answer: &CullAnswer, behind: u64) {
        if let Some(kept) = Kept::new(self.facts, objects, words, answer, behind) {
            *self.promise.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(kept));
        }
    }
}
