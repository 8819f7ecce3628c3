//! Questions of many blocks at once: which boxes of cells they admit.
#![allow(unsafe_code)]

use super::block::{Block, FIRST, Question, SLOTS};
#[cfg(target_arch = "x86_64")]
use crate::isa::Isa;

/// Blocks with admitted boxes that are reported at a time, 12 bytes each: so few stay in the first cache beside what
/// was asked for.
const REPORTED: usize = 64;

/// Blocks that stand together, of one cell.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Span {
    /// Number of what they are asked.
    pub question: u32,
    /// The first block.
    pub start: u32,
    pub len: u32,
}

/// A block with boxes that are admitted.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Hit {
    pub question: u32,
    pub block: u32,
    /// As [`Question::admitted`]: not 0.
    pub admitted: u32,
}

/// Lists the blocks of spans that have boxes that are admitted, in order.
#[inline]
pub(super) fn admit(
    blocks: &[Block],
    questions: &[Question],
    spans: &[Span],
    report: &mut dyn FnMut(&[Hit]),
) {
    #[cfg(target_arch = "x86_64")]
    if Isa::Avx2.is_available() {
        // SAFETY: the processor has AVX2 and the others, as was just asked.
        return unsafe { admit_avx2(blocks, questions, spans, report) };
    }
    admit_with(blocks, questions, spans, report, Question::admitted);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,popcnt,bmi1,bmi2")]
fn admit_avx2(
    blocks: &[Block],
    questions: &[Question],
    spans: &[Span],
    report: &mut dyn FnMut(&[Hit]),
) {
    admit_with(blocks, questions, spans, report, |question, block| {
        // SAFETY: this function is called where there is AVX2.
        unsafe { question.admitted_avx2(block) }
    });
}

#[inline(always)]
fn admit_with(
    blocks: &[Block],
    questions: &[Question],
    spans: &[Span],
    report: &mut dyn FnMut(&[Hit]),
    admitted: impl Fn(&Question, &Block) -> u32,
) {
    let (mut hits, mut count) = ([Hit::default(); REPORTED], 0);
    for &Span { question, start, len } in spans {
        let asked = &questions[question as usize];
        let (mut number, mut rest) = (start, len);
        loop {
            let block = &blocks[number as usize];
            let admitted = admitted(asked, block) & FIRST[rest.min(SLOTS) as usize];
            // Whether there are any is as good as random: nothing branches on it.
            hits[count] = Hit { question, block: number, admitted };
            count += usize::from(admitted != 0);
            if count == REPORTED {
                report(&hits);
                count = 0;
            }
            if rest <= SLOTS {
                break;
            }
            (number, rest) = (number + 1, rest - SLOTS);
        }
    }
    report(&hits[..count]);
}
