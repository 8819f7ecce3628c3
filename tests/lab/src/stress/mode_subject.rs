//! Engines on boxes of a precision mode: the answer must have the overlapping pairs, and may have
//! those that the mode's definition adds, with gaps up to the stated one.

use std::sync::Arc;

use pairmask_core::Aabb;
use pairmask_core::engine::{CullError, CullInput, CullReport, Engine, HeapReply};
use pairmask_core::oracle::Pair;
use pairmask_core::oracle::naive_decoder::decode;
use pairmaskd::explain::{Explanation, SentBoxes};
use rayon::ThreadPool;

use super::case::Case;
use super::flags::MixedFlags;
use super::gaps;
use super::modes::{Mode, ModeCase, Sending, Usage};
use super::subject::{Finding, Outcome, Subject, compare};
use crate::sabotage::shrink;

/// An engine in one usage of a mode.
pub struct ModeSubject {
    name: String,
    usage: Usage,
    engine: Box<dyn Engine>,
    pool: Arc<ThreadPool>,
    reply: HeapReply,
    inward: bool,
}

impl ModeSubject {
    /// An engine in one usage, on a pool whose threads it may use. With `inward` boxes are rounded
    /// the wrong way, to test that the checks notice. `variant` distinguishes it from other
    /// subjects of the same engine.
    pub fn new(
        engine: Box<dyn Engine>,
        variant: &str,
        usage: Usage,
        pool: &Arc<ThreadPool>,
        inward: bool,
    ) -> Self {
        Self {
            name: format!("{}{variant}, {usage}", engine.name()),
            usage,
            engine,
            pool: Arc::clone(pool),
            reply: HeapReply::new(),
            inward,
        }
    }

    /// The answer; `None` where the engine leaves the scene to another one.
    fn answer(
        &mut self,
        boxes: &[Aabb],
        flags: &MixedFlags,
    ) -> Result<Option<(CullReport, Vec<Pair>)>, Finding> {
        let Self { engine, pool, reply, .. } = self;
        // The exact subjects test the encodings: masks do not depend on modes.
        let input = CullInput::boxes(boxes).threads(pool.current_num_threads());
        let report = match flags.install(pool, || engine.cull(&input, reply)) {
            Err(CullError::TooCrowded { .. }) => return Ok(None),
            answer => answer.map_err(|error| Finding::other(&error))?,
        };
        let pairs = decode(reply.words(), &report.shape, boxes.len() as u32)
            .map_err(|error| Finding::other(&error))?;
        Ok(Some((report, pairs)))
    }
}

impl Subject for ModeSubject {
    fn name(&self) -> &str {
        &self.name
    }

    fn engine(&self) -> &'static str {
        self.engine.name().as_str()
    }

    fn mode(&self) -> Mode {
        self.usage.mode()
    }

    fn check(&mut self, case: &Case) -> Result<Outcome, Finding> {
        let flags = case.flags;
        let case = case.in_mode(self.usage);
        if let Some(index) = case.written_unlike {
            let what = format!("box {index} becomes another one when it is written by itself");
            return Err(Finding::other(&what));
        }
        let inward = self.inward.then(|| rounded_inward(case));
        let Some((report, got)) = self.answer(inward.as_deref().unwrap_or(&case.sent), &flags)?
        else {
            return Ok(Outcome::Declined);
        };
        compare(&got, &case.allowed.must.pairs, &case.allowed.may).map_err(|mut finding| {
            finding.what = format!("{}: {}", self.usage, finding.what);
            if let (Some(pair), Sending::World { boxes, origin }) = (finding.first, &case.sending) {
                let (a, b) = (boxes[pair.0 as usize], boxes[pair.1 as usize]);
                finding.what = format!("{}: {a:?} and {b:?} around {origin:?}", finding.what);
            }
            finding
        })?;
        gaps::check(case, &got).map_err(|mut finding| {
            finding.what = format!("{}: {}", self.usage, finding.what);
            finding
        })?;
        if report.pair_count != got.len() as u64 {
            let (reported, decoded) = (report.pair_count, got.len());
            let what = format!("the report counts {reported} pairs, the mask has {decoded}");
            return Err(Finding::other(&what));
        }
        let (census, expected) = (report.census, case.allowed.must.census);
        if census != expected {
            return Err(Finding::other(&format!("census {census:?}, expected {expected:?}")));
        }
        Ok(Outcome::Right)
    }

    fn scene(&self, case: &Case) -> (usize, String) {
        (case.in_mode(self.usage).given.len(), case.recipe.clone())
    }

    fn explain(&self, case: &Case, pair: Pair) -> Option<Explanation> {
        explain(case.in_mode(self.usage), pair)
    }
}

/// Explains why a pair must be in the answer to a case or not, where that is possible.
pub(super) fn explain(case: &ModeCase, (i, j): Pair) -> Option<Explanation> {
    // An explanation begins with f32 boxes; for a world, with those that were sent.
    let (given, sent) = match &case.sending {
        Sending::Narrow(precision) => (&case.given, SentBoxes::narrow(precision, &case.sent)),
        Sending::Inflated(margin) => (&case.given, SentBoxes::inflated(*margin, &case.sent)),
        Sending::World { .. } => (&case.sent, SentBoxes::relative(&case.sent)),
    };
    Explanation::of_sent(given, &sent, i, j).ok()
}

/// The boxes to send with faces rounded inward instead of outward.
fn rounded_inward(case: &ModeCase) -> Vec<Aabb> {
    let boxes = match case.sending {
        Sending::Inflated(_) => &case.given,
        Sending::Narrow(_) | Sending::World { .. } => &case.sent,
    };
    boxes.iter().map(shrink).collect()
}
