//! A subject of the test: an engine with an instruction set, an encoding and a thread count, or any
//! other way to find pairs.
//!
//! A subject may report more pairs than the truth where its contract allows that (a mode that
//! rounds boxes outward), never fewer: [`compare`] takes the pairs that must be in the answer and
//! those that may be.

use std::sync::Arc;

use pairmask_core::Encoding;
use pairmask_core::engine::{CullError, CullInput, Engine, HeapReply};
use pairmask_core::oracle::check::{Mismatch, check_frame};
use pairmask_core::oracle::{Pair, naive_decoder};
use pairmaskd::explain::Explanation;
use rayon::ThreadPool;
use serde::{Deserialize, Serialize};

use super::case::Case;
use super::modes::Mode;

/// A way to find pairs, and the check of its answers.
pub trait Subject {
    /// Name for messages: engine, instruction set, encoding, threads.
    fn name(&self) -> &str;

    /// The value of `--engine` that runs it.
    fn engine(&self) -> &'static str;

    /// The value of `--mode` that runs it.
    fn mode(&self) -> Mode {
        Mode::Exact
    }

    /// Answers a case and checks the answer.
    ///
    /// # Errors
    /// [`Finding`] with the mistake.
    fn check(&mut self, case: &Case) -> Result<Outcome, Finding>;

    /// The part of the case that it answered: number of objects, and how they were made.
    fn scene(&self, case: &Case) -> (usize, String) {
        (case.boxes.len(), case.recipe.clone())
    }

    /// Explains why a pair of the case must be in the answer or not, where that is possible.
    fn explain(&self, case: &Case, (i, j): Pair) -> Option<Explanation> {
        Explanation::of(&case.boxes, i, j).ok()
    }
}

/// The outcome of a case without a mistake.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Answered, and the answer is right.
    Right,
    /// Not answered: the engine left a scene with too many boxes in one place to another engine
    /// ([`CullError::TooCrowded`]), which is allowed.
    Declined,
}

/// A mistake in an answer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// In words.
    pub what: String,
    /// Pairs that must be in the answer and are not.
    pub missed: u64,
    /// Pairs that are in the answer and may not be.
    pub extra: u64,
    /// The lowest wrong pair, if it is about pairs.
    pub first: Option<Pair>,
}

impl Finding {
    /// A finding that is not about pairs.
    pub fn other(what: &impl ToString) -> Self {
        Self { what: what.to_string(), missed: 0, extra: 0, first: None }
    }
}

/// Checks a sorted list of pairs: all of `must`, none outside `may`. Both are sorted, and `must` is
/// part of `may`.
///
/// # Errors
/// [`Finding`] counts the wrong pairs and names the lowest.
pub fn compare(got: &[Pair], must: &[Pair], may: &[Pair]) -> Result<(), Finding> {
    let (missed, first_missed) = count(absent(must, got));
    let (extra, first_extra) = count(absent(got, may));
    let (what, first) = match (first_missed, first_extra) {
        (None, None) => return Ok(()),
        (Some(pair), None) => (format!("pair {pair:?} is missing"), pair),
        (Some(pair), Some(extra)) if pair <= extra => (format!("pair {pair:?} is missing"), pair),
        (_, Some(pair)) => (format!("pair {pair:?} does not overlap"), pair),
    };
    Err(Finding { what, missed, extra, first: Some(first) })
}

/// Those of `these` that are not in `those`. Both are sorted.
pub(super) fn absent(these: &[Pair], those: &[Pair]) -> impl Iterator<Item = Pair> {
    these.iter().filter(|pair| those.binary_search(pair).is_err()).copied()
}

/// The number of pairs, and the first of them.
fn count(mut pairs: impl Iterator<Item = Pair>) -> (u64, Option<Pair>) {
    let first = pairs.next();
    (u64::from(first.is_some()) + pairs.count() as u64, first)
}

/// An engine that must answer exactly.
pub struct ExactSubject {
    name: String,
    engine: Box<dyn Engine>,
    encoding: Encoding,
    pool: Arc<ThreadPool>,
    reply: HeapReply,
}

impl ExactSubject {
    /// An engine with an encoding, on a pool whose threads it may use. `variant` distinguishes it
    /// from other subjects of the same engine.
    pub fn new(
        engine: Box<dyn Engine>,
        variant: &str,
        encoding: Encoding,
        pool: &Arc<ThreadPool>,
    ) -> Self {
        let threads = pool.current_num_threads();
        let plural = if threads == 1 { "" } else { "s" };
        Self {
            name: format!("{} {variant}, {encoding}, {threads} thread{plural}", engine.name()),
            engine,
            encoding,
            pool: Arc::clone(pool),
            reply: HeapReply::new(),
        }
    }

    /// All wrong pairs of the answer, if the mask can be decoded.
    fn wrong_pairs(&mut self, case: &Case) -> Option<Finding> {
        let Self { engine, encoding, pool, reply, .. } = self;
        let input = input(case, *encoding, pool);
        let report = case.flags.install(pool, || engine.cull(&input, reply)).ok()?;
        let n = case.boxes.len() as u32;
        let got = naive_decoder::decode(reply.words(), &report.shape, n).ok()?;
        compare(&got, &case.truth.pairs, &case.truth.pairs).err()
    }
}

/// The input of an engine for a case, on a pool whose threads it may use.
fn input<'a>(case: &'a Case, encoding: Encoding, pool: &ThreadPool) -> CullInput<'a> {
    CullInput::boxes(&case.boxes).encoding(encoding).threads(pool.current_num_threads())
}

impl Subject for ExactSubject {
    fn name(&self) -> &str {
        &self.name
    }

    fn engine(&self) -> &'static str {
        self.engine.name().as_str()
    }

    fn check(&mut self, case: &Case) -> Result<Outcome, Finding> {
        let Self { engine, encoding, pool, reply, .. } = self;
        let input = input(case, *encoding, pool);
        let found =
            case.flags.install(pool, || check_frame(engine.as_mut(), &input, &case.truth, reply));
        let Err(mismatch) = found else { return Ok(Outcome::Right) };
        let finding = match mismatch {
            Mismatch::Cull(CullError::TooCrowded { .. }) => return Ok(Outcome::Declined),
            Mismatch::Missing(pair) | Mismatch::Extra(pair) => {
                // Without wrong pairs in the second run, the answer changes from run to run: that
                // counts as one mistake.
                self.wrong_pairs(case).unwrap_or_else(|| Finding {
                    what: mismatch.to_string(),
                    missed: u64::from(matches!(mismatch, Mismatch::Missing(_))),
                    extra: u64::from(matches!(mismatch, Mismatch::Extra(_))),
                    first: Some(pair),
                })
            }
            other => Finding::other(&other),
        };
        Err(finding)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_between_must_and_may_are_right() {
        let (must, may) = ([(0, 1), (2, 3)], [(0, 1), (0, 2), (2, 3)]);
        assert_eq!(compare(&must, &must, &may), Ok(()));
        assert_eq!(compare(&may, &must, &may), Ok(()));
        let missed = compare(&may[..2], &must, &may).expect_err("(2, 3) is missing");
        assert_eq!((missed.missed, missed.extra, missed.first), (1, 0, Some((2, 3))));
        let extra = compare(&[(0, 1), (0, 3), (2, 3)], &must, &may).expect_err("(0, 3) is extra");
        assert_eq!((extra.missed, extra.extra, extra.first), (0, 1, Some((0, 3))));
        let both = compare(&[(0, 3)], &must, &may).expect_err("all wrong");
        assert_eq!((both.missed, both.extra, both.first), (2, 1, Some((0, 1))));
        assert!(both.what.contains("missing"), "{}", both.what);
    }
}
