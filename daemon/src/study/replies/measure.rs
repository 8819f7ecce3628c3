//! All forms of a scene's mask, weighed and timed.

use std::hint::black_box;
use std::time::{Duration, Instant};

use pairmask::dispatch::{CpuEngines, CullWish, nanoseconds_since};
use pairmask::engine::{CullError, EngineName, HeapReply};
use pairmask::mask::{EncodingChoice, MaskError};
use pairmask::oracle::check::Mismatch;
use pairmask::{BoxCount, Encoding, EngineChoice, MaskView};
use serde::Serialize;

use super::check::{check, expected_pairs};
use super::copy::{CopyError, MaskCopy};
use super::encoded::Encoded;
use super::form::Form;
use crate::scene::Scene;
use crate::study::engines::Case;

/// Rounds at least: the median of fewer means little.
const LEAST_ROUNDS: usize = 9;
/// Rounds at most: the median of more is no better.
const MOST_ROUNDS: usize = 101;
/// No further round of a case begins after this time.
const TIME: Duration = Duration::from_millis(100);
/// Masks of few words are decoded again and again until a time is about as long, ns: beside it the
/// clock's own 20 to 40 ns are nothing.
const LEAST_TIME_NS: u64 = 20_000;
/// Times that a mask is decoded for one time, at most.
const MOST_REPEATS: u64 = 10_000;

/// Why forms were not measured.
#[derive(Debug, thiserror::Error)]
pub enum ReplyStudyError {
    /// The engine gave no mask.
    #[error(transparent)]
    Cull(#[from] CullError),
    /// The engine is broken: its mask is none.
    #[error("a mask cannot be read: {0}: please report this")]
    Mask(#[from] MaskError),
    /// The engine is broken, or gave another encoding than it was asked for.
    #[error("a mask cannot be copied: {0}: please report this")]
    Copy(#[from] CopyError),
    /// A form is broken: it does not hold the mask's pairs.
    #[error("form '{form}' of {n} boxes of {scene}: {mismatch}: please report this")]
    Form {
        /// Which form.
        form: &'static str,
        /// Which scene.
        scene: &'static str,
        /// Boxes.
        n: usize,
        /// The first wrong pair.
        mismatch: Box<Mismatch>,
    },
}

/// A scene's mask in one form.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FormRow {
    /// Which scene.
    pub scene: &'static str,
    /// Boxes.
    pub n: usize,
    /// Pairs of the mask.
    pub pairs: u64,
    /// Which form.
    pub form: &'static str,
    /// Words, or pairs of a list.
    pub entries: u64,
    /// Bytes with the order.
    pub bytes: u64,
    /// Bytes of the order among them: none where boxes have no order, and in a list.
    pub order_bytes: u64,
    /// `bytes` a pair; null where there is no pair.
    pub bytes_a_pair: Option<f64>,
    /// The same without the order, as when it did not change and the client kept it.
    pub order_kept_bytes_a_pair: Option<f64>,
    /// Median time to decode it on one thread with the study's decoder of this form, ns.
    pub decode_ns: u64,
    /// Median time of the production decoder with the sparse form, in the same run, ns.
    pub production_decode_ns: u64,
    /// The first over the second.
    pub decode_ratio: f64,
}

impl FormRow {
    fn new(
        case: Case,
        pairs: u64,
        form: Form,
        encoded: &Encoded<'_>,
        [ns, production]: [u64; 2],
    ) -> Self {
        let order_bytes = encoded.order_bytes();
        let a_pair = |bytes: u64| (pairs > 0).then(|| bytes as f64 / pairs as f64);
        Self {
            scene: case.scene.as_str(),
            n: case.n,
            pairs,
            form: form.as_str(),
            entries: encoded.entry_count(),
            bytes: encoded.bytes() + order_bytes,
            order_bytes,
            bytes_a_pair: a_pair(encoded.bytes() + order_bytes),
            order_kept_bytes_a_pair: a_pair(encoded.bytes()),
            decode_ns: ns,
            production_decode_ns: production,
            decode_ratio: ns as f64 / production.max(1) as f64,
        }
    }
}

/// Culls a scene with `cpu-grid`, and writes, checks, weighs and times its mask in every form.
///
/// # Errors
/// [`ReplyStudyError`], also where a form does not hold the pairs of the mask.
pub fn measure(
    case: Case,
    scene: &Scene,
    engines: &mut CpuEngines,
) -> Result<Vec<FormRow>, ReplyStudyError> {
    let wish = CullWish {
        engine: EngineChoice::Only(EngineName::CpuGrid),
        encoding: EncodingChoice::Only(Encoding::Sparse),
        ..CullWish::default()
    };
    let mut reply = HeapReply::new();
    let answer = engines.cull(scene.boxes(), &wish, &mut reply)?;
    let n = BoxCount::new(case.n as u32);
    let view = MaskView::new(n, &answer.report.shape, reply.words())?;
    let mask = MaskCopy::of(&view)?;
    let expected = expected_pairs(&view);
    let forms = Form::ALL.map(|form| Encoded::new(form, &mask));
    for (form, encoded) in Form::ALL.into_iter().zip(&forms) {
        check(encoded, &expected).map_err(|mismatch| {
            let (form, scene) = (form.as_str(), case.scene.as_str());
            ReplyStudyError::Form { form, scene, n: case.n, mismatch: Box::new(mismatch) }
        })?;
    }
    let pairs = expected.len() as u64;
    drop(expected);
    let (production_ns, times) = medians(&view, &forms);
    let rows = Form::ALL.into_iter().zip(&forms).zip(times);
    Ok(rows
        .map(|((form, encoded), ns)| FormRow::new(case, pairs, form, encoded, [ns, production_ns]))
        .collect())
}

/// Median times of the production decoder and of each form's, ns. They take turns, each round
/// another one first.
fn medians<const N: usize>(view: &MaskView<'_>, forms: &[Encoded<'_>; N]) -> (u64, [u64; N]) {
    // The first time also touches the memory.
    let repeats = (LEAST_TIME_NS / production_ns(view, 1).max(1)).clamp(1, MOST_REPEATS);
    let mut production = Vec::new();
    let mut times = [const { Vec::new() }; N];
    let start = Instant::now();
    for round in 0..MOST_ROUNDS {
        if round >= LEAST_ROUNDS && start.elapsed() > TIME {
            break;
        }
        for turn in 0..=N {
            let way = (turn + round) % (N + 1);
            match forms.get(way) {
                Some(form) => times[way].push(form_ns(form, repeats)),
                None => production.push(production_ns(view, repeats)),
            }
        }
    }
    (median(production), times.map(median))
}

/// The middle one, or 0 where there is none.
fn median(mut times: Vec<u64>) -> u64 {
    times.sort_unstable();
    times.get(times.len() / 2).copied().unwrap_or(0)
}

/// A consumer that costs next to nothing and looks at every pair.
#[derive(Default)]
struct Consumer {
    pairs: u64,
    indices: u32,
}

impl Consumer {
    #[inline(always)]
    fn take(&mut self, a: u32, b: u32) {
        self.pairs += 1;
        self.indices ^= a ^ b;
    }
}

/// Mean time of so many decodings by the production decoder, ns.
fn production_ns(view: &MaskView<'_>, repeats: u64) -> u64 {
    mean_ns(repeats, |consumer| black_box(view).for_each(|a, b| consumer.take(a, b)))
}

/// Mean time of so many decodings of a form, ns.
fn form_ns(form: &Encoded<'_>, repeats: u64) -> u64 {
    mean_ns(repeats, |consumer| black_box(form).decode(|a, b| consumer.take(a, b)))
}

fn mean_ns(repeats: u64, mut decode: impl FnMut(&mut Consumer)) -> u64 {
    let start = Instant::now();
    for _ in 0..repeats {
        let mut consumer = Consumer::default();
        decode(&mut consumer);
        black_box((consumer.pairs, consumer.indices));
    }
    nanoseconds_since(start) / repeats.max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::SceneName;

    #[test]
    fn every_scene_has_every_form() {
        let mut engines = CpuEngines::new();
        for scene in SceneName::ALL {
            for n in [0, 1, 345] {
                let case = Case { scene, n };
                let rows = measure(case, &Scene::new(scene, n, 1), &mut engines)
                    .expect("forms that hold the pairs");
                assert_eq!(rows.len(), Form::ALL.len());
                for row in rows {
                    let list = row.form == Form::List.as_str();
                    assert_eq!(row.bytes_a_pair.is_some(), row.pairs > 0, "{row:?}");
                    assert!(!list || row.bytes == 8 * row.pairs, "{row:?}");
                    let lean = row.order_kept_bytes_a_pair.unwrap_or(0.0);
                    let sum = lean * row.pairs as f64 + row.order_bytes as f64;
                    assert!(row.pairs == 0 || (sum - row.bytes as f64).abs() < 0.5, "{row:?}");
                }
            }
        }
    }

    #[test]
    fn the_median_is_the_middle_one() {
        assert_eq!(median(vec![]), 0);
        assert_eq!(median(vec![9, 1, 5]), 5);
        assert_eq!(median(vec![9, 1]), 9);
    }
}
