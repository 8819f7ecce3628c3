//! Frames of which only those pairs count that [`Rules`] let meet.
//!
//! ```text
//! look     one pass over the filter data: what there is to test at all        (look)
//! worlds   several worlds: boxes by world, each culled by itself       (groups, worlds, small)
//! test     else one frame, whose engine hands its words to the test    (test, kinds, laid, sift_avx512)
//! marks    the rules as arrays, for the GPU's grid                     (marks)
//! mask     the same test over a mask that a GPU has written            (mask)
//! sets     two sets of boxes, of which only pairs of both count        (sets)
//! ```

mod groups;
mod kinds;
mod laid;
mod look;
mod marks;
mod mask;
mod sets;
#[cfg(target_arch = "x86_64")]
mod sift_avx512;
mod small;
mod test;
#[cfg(test)]
mod tests;
mod worlds;

pub(super) use self::laid::Laid;
pub use self::marks::{MARKED_KINDS, Marks, RANK_SHIFT};
pub use self::mask::{BadMask, MaskFilter};
pub use self::worlds::WorldRange;
pub(super) use self::worlds::Worlds;

use std::num::NonZeroU64;
use std::ops::Range;

use self::look::Look;
use self::test::{FilterTest, Indices};
use super::{CpuEngines, CullAnswer, CullOptions};
use crate::engine::{CullError, PairRules, ReplyBuffer};
use crate::filters::{Rules, World};
use crate::mask::{Encoding, EncodingChoice};
use crate::precision::BoxSlice;

/// An answered cull with rules.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct FilteredAnswer<'a> {
    /// What an answer without rules says too. The engine is the one that most boxes were culled by.
    pub answer: CullAnswer,
    /// Where the pairs of each world stand in the list, by rising world: those of [`World::ALL`] are the
    /// pairs of which both boxes are in all worlds. Empty where the mask is no list, or where all boxes
    /// are of one world.
    pub worlds: &'a [WorldRange],
}

impl FilteredAnswer<'_> {
    /// Where the pairs of a world stand in the list; `None` where the list is not ordered by world, or no
    /// box is of that world.
    pub fn range_of(&self, world: World) -> Option<Range<usize>> {
        WorldRange::of(self.worlds, world)
    }
}

impl CpuEngines {
    /// Plans a frame among the CPU engines and finds the pairs that `rules` let meet. Rules that let all
    /// pairs meet take no time.
    ///
    /// Boxes of several worlds are culled world by world where the answer may be a list, whose pairs are
    /// ordered by world then. A scene without filters of many worlds takes about as long as one of a
    /// single world. A dense or sparse mask that is insisted on is one of all boxes.
    ///
    /// # Errors
    /// As [`cull`](Self::cull). Boxes have to be in f32.
    pub fn cull_filtered<'a>(
        &mut self,
        boxes: impl Into<BoxSlice<'a>>,
        rules: &Rules,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<FilteredAnswer<'_>, CullError> {
        self.cull_filtered_known(boxes, rules, None, options, reply)
    }

    /// As [`cull_filtered`](Self::cull_filtered), with rules that have a number: a caller that gives rules one
    /// to these engines gives other rules another. What was found of the rules of the last number, which
    /// boxes are of which world first of all, is not found again.
    ///
    /// # Errors
    /// Those of [`cull_filtered`](Self::cull_filtered).
    pub fn cull_filtered_known<'a>(
        &mut self,
        boxes: impl Into<BoxSlice<'a>>,
        rules: &Rules,
        known: Option<NonZeroU64>,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<FilteredAnswer<'_>, CullError> {
        let boxes = boxes.into();
        let (n, limit_words) = (boxes.len(), reply.limit_words());
        let look = self.worlds.look(rules, known, n);
        let may_be_list = [EncodingChoice::Auto, EncodingChoice::Only(Encoding::List)]
            .contains(&options.encoding);
        let mut options = *options;
        if look.worlds.is_some() && may_be_list {
            match self.cull_worlds(boxes, (rules, known), &look, &options, reply) {
                Ok(answer) => return Ok(FilteredAnswer { answer, worlds: self.worlds.ranges() }),
                Err(error) => {
                    options = options.after(Encoding::List, &error, n, limit_words).ok_or(error)?;
                }
            }
        }
        let answer = if look.all_meet {
            self.cull(boxes, &options, reply)?
        } else {
            self.cull_tested(boxes, rules, &look, &options, reply)?
        };
        Ok(FilteredAnswer { answer, worlds: &[] })
    }

    /// One frame, whose engine tests each pair.
    fn cull_tested(
        &mut self,
        boxes: BoxSlice<'_>,
        rules: &Rules,
        look: &Look,
        options: &CullOptions,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullAnswer, CullError> {
        self.cull_by(boxes, options, reply, |engines, plan, reply| {
            let memory = std::mem::take(&mut engines.filter_memory);
            let test = FilterTest::new(rules, look, Indices::Same, memory);
            let input = plan.input(boxes).rules(PairRules::tested_by(&test));
            let done = engines.run(plan.engine, &input, reply);
            engines.filter_memory = test.into_memory();
            done
        })
    }
}
