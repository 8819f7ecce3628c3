//! Compares an engine's answer with the truth: sets of pairs, never only their numbers.

use super::naive_decoder;
use super::{Pair, Truth};
use crate::engine::{Census, CullError, CullInput, CullReport, Engine, EngineTimes, HeapReply};
use crate::mask::{Encoding, MaskError, SECTION_ALIGN_WORDS, Span};
use crate::units::BoxCount;

/// Words that reply memory is filled with before the first and the second run of a frame.
const POISON: [u32; 2] = [0xa5a5_a5a5, 0x5a5a_5a5a];

/// The first mistake in the answer to one frame.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Mismatch {
    /// The engine failed.
    #[error(transparent)]
    Cull(#[from] CullError),
    /// The mask breaks a rule of its encoding.
    #[error(transparent)]
    Mask(#[from] MaskError),
    /// A section starts off the 64-byte grid.
    #[error("section {0:?} does not start on a multiple of 16 words")]
    Unaligned(Span),
    /// The mask has an encoding that was not asked for.
    #[error("asked for {asked}, got {got}")]
    Encoding {
        /// Asked for.
        asked: Encoding,
        /// In the reply.
        got: Encoding,
    },
    /// A pair of the oracle that the mask does not have.
    #[error("pair {0:?} is missing")]
    Missing(Pair),
    /// A pair of the mask that the oracle does not have.
    #[error("pair {0:?} does not overlap")]
    Extra(Pair),
    /// The number of pairs in the report is not that of the mask.
    #[error("the report counts {reported} pairs, the mask has {decoded}")]
    PairCount {
        /// In the report.
        reported: u64,
        /// In the mask.
        decoded: u64,
    },
    /// The census is not the oracle's.
    #[error("census {got:?}, expected {expected:?}")]
    Census {
        /// In the report.
        got: Census,
        /// By the oracle.
        expected: Census,
    },
    /// A skip meter that cannot be true.
    #[error("skip meter: {what} reads {got}, possible are {possible:?}")]
    Skip {
        /// The field.
        what: &'static str,
        /// Its value.
        got: u64,
        /// Its bounds.
        possible: std::ops::RangeInclusive<u64>,
    },
    /// Two runs of one frame differ.
    #[error("two runs differ in word {0} of the mask (or the engine left it unwritten)")]
    NotDeterministic(usize),
    /// Two runs of one frame differ in their reports, times apart.
    #[error("two runs differ in their reports")]
    ReportNotDeterministic,
}

/// Culls one frame twice and checks the answer.
///
/// Reply memory is filled with other words before each run, so that a word which the engine did not
/// write shows up as a difference.
///
/// # Errors
/// [`Mismatch`] says what is wrong.
pub fn check_frame(
    engine: &mut dyn Engine,
    input: &CullInput<'_>,
    truth: &Truth,
    reply: &mut HeapReply,
) -> Result<(), Mismatch> {
    let mut runs = Vec::with_capacity(POISON.len());
    for poison in POISON {
        reply.fill(poison);
        let report = engine.cull(input, reply)?;
        // New reply memory is zeroed, so that unwritten zero words would look right in the first
        // run. The second run reuses the memory.
        runs.push((report, naive_decoder::sections(reply.words(), &report.shape)));
    }
    let [(first, first_words), (second, second_words)] = &runs[..] else {
        unreachable!("one run a poison word")
    };
    if let (Some(first), Some(second)) = (first_words, second_words)
        && let Some(word) =
            (0..first.len().max(second.len())).find(|&i| first.get(i) != second.get(i))
    {
        return Err(Mismatch::NotDeterministic(word));
    }
    let timeless = |report: &CullReport| CullReport { times: EngineTimes::default(), ..*report };
    if timeless(first) != timeless(second) {
        return Err(Mismatch::ReportNotDeterministic);
    }
    check_reply(reply.words(), second, input.objects.len() as u32, input.encoding, truth)
}

/// Checks a mask and its report against the truth.
///
/// # Errors
/// [`Mismatch`] says what is wrong.
pub fn check_reply(
    reply: &[u32],
    report: &CullReport,
    n: u32,
    asked: Encoding,
    truth: &Truth,
) -> Result<(), Mismatch> {
    let got = report.shape.encoding();
    if got != asked {
        return Err(Mismatch::Encoding { asked, got });
    }
    let off_grid = |span: &Span| !span.start.is_multiple_of(SECTION_ALIGN_WORDS);
    if let Some(span) = report.shape.spans().find(off_grid) {
        return Err(Mismatch::Unaligned(span));
    }
    let pairs = naive_decoder::decode(reply, &report.shape, n)?;
    check_pairs(&pairs, &truth.pairs)?;
    let (reported, decoded) = (report.pair_count, pairs.len() as u64);
    if reported != decoded {
        return Err(Mismatch::PairCount { reported, decoded });
    }
    if report.census != truth.census {
        return Err(Mismatch::Census { got: report.census, expected: truth.census });
    }
    check_skips(report, BoxCount::new(n), truth)
}

/// Compares two sorted lists of pairs.
///
/// # Errors
/// [`Mismatch::Missing`] or [`Mismatch::Extra`] with the first pair that only one list has.
pub fn check_pairs(got: &[Pair], expected: &[Pair]) -> Result<(), Mismatch> {
    let mut got_rest = got.iter();
    let mut next = got_rest.next();
    for pair in expected {
        match next {
            Some(g) if g == pair => next = got_rest.next(),
            Some(g) if g < pair => return Err(Mismatch::Extra(*g)),
            _ => return Err(Mismatch::Missing(*pair)),
        }
    }
    next.map_or(Ok(()), |extra| Err(Mismatch::Extra(*extra)))
}

/// Checks that a meter counts at most the work there was, less the work that the answer needed.
fn check_skips(report: &CullReport, n: BoxCount, truth: &Truth) -> Result<(), Mismatch> {
    let nothing = u64::from(truth.census.empty) + u64::from(truth.census.invalid);
    // Another order of boxes puts the pairs into fewer or more words, so that there is no lower
    // bound. Only the sparse encoding leaves zeros out.
    let is_sparse = report.shape.encoding() == Encoding::Sparse;
    let zero_words = 0..=if is_sparse { n.sparse_words_max() } else { 0 };
    let meter = &report.skipped;
    for (what, got, possible) in [
        ("boxes", meter.boxes, nothing..=nothing),
        ("pairs", meter.pairs, 0..=n.pair_count() - truth.pairs.len() as u64),
        ("zero_words", meter.zero_words, zero_words),
        ("reasons", meter.why.total(), meter.pairs..=meter.pairs),
    ] {
        if !possible.contains(&got) {
            return Err(Mismatch::Skip { what, got, possible });
        }
    }
    Ok(())
}
