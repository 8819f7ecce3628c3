//! Tables 1 and 2: the numbering of pairs, and the ways from a number to its pair.

use pairmask_core::{BoxCount, PairIndex};

use crate::study::mapping::paper as paper_of;
use crate::study::mapping::rows::PAPERS_OWN;
use crate::study::mapping::stage::Variant;
use crate::study::papers::model::{Item, Question, Row};
use crate::study::papers::records::{Figures, on_gpus};
use crate::study::papers::rule::Rule;
use crate::study::papers::shapes::Mapping;

/// Objects of the example of §3.1.
const N: u32 = 1_000;
/// Boxes of table 2.
pub const COUNTS: [u32; 3] = [1_000, 10_000, 100_000];

/// What the last row of table 2 would mean.
const RATE: &str = "100,000 boxes have 5·10⁹ pairs, which in 29.66 ms would be 1.7·10¹¹ a second.";

/// The number of a pair of the paper, which counts objects from 1.
fn number(a: u32, b: u32) -> Option<f64> {
    PairIndex::of(BoxCount::new(N), a - 1, b - 1).map(|k| k.get() as f64)
}

/// Table 1: computed now, by the numbering that the wire has.
pub fn table_1() -> Item {
    let n = f64::from(N);
    let last = (n * n - n) / 2.0;
    let row = |a, b, paper: f64| {
        Row::new(format!("pair ({a}, {b}) of {N}"), "", paper, number(a, b)).of_this_build()
    };
    let examples = Question {
        claim: "pairs are numbered row by row: 71452 is (75, 303), 46108 is (48, 285)",
        rule: Rule::Equals,
        missing: "",
        note: "",
    }
    .judge(vec![
        row(1, 2, 0.0),
        row(1, N, n - 2.0),
        row(2, 3, n - 1.0),
        row(2, N, 2.0 * n - 4.0),
        row(3, N, 3.0 * n - 7.0),
        row(75, 303, 71_452.0),
        row(48, 285, 46_108.0),
    ]);
    let end = Question {
        claim: "the last pair has the number (n² − n)/2",
        rule: Rule::Equals,
        missing: "",
        note: "Numbers begin at 0, so that the last one is smaller by 1.",
    }
    .judge(vec![row(N - 1, N, last)]);
    Item::new("Table 1", "the matrix of pairs and their numbers", vec![examples, end])
}

/// The time to map all numbers, ms.
fn ms(mapping: Option<&Mapping>, processor: &str, variant: Variant, n: u32) -> Option<f64> {
    let name = variant.to_string();
    let mut rows = mapping?.map_times.iter();
    rows.find(|row| row.processor == processor && row.variant == name && row.n == n)?.ms
}

/// The lazy way's time over that of the paper's own.
fn lazy_over_own(mapping: Option<&Mapping>, processor: &str, n: u32) -> Option<f64> {
    let own = ms(mapping, processor, PAPERS_OWN, n)?;
    Some(ms(mapping, processor, Variant::Lazy, n)? / own)
}

/// Table 2: with a square root and the lazy way.
pub fn table_2(figures: &Figures) -> Item {
    let missing = "no GPU was measured with these numbers of boxes";
    let time = |claim, variant, theirs: fn((f64, f64)) -> f64| {
        Question { claim, rule: Rule::NoMore, missing, note: RATE }.ask(
            on_gpus(&figures.mapping),
            |mapping| {
                let row = |n| {
                    let paper = paper_of::table_2(n).map(theirs);
                    Row::new(format!("{n} boxes"), "ms", paper, ms(mapping, "gpu", variant, n))
                };
                COUNTS.map(row).into()
            },
        )
    };
    let own = time(
        "with a square root all numbers are mapped in the paper's time",
        PAPERS_OWN,
        |(own, _)| own,
    );
    let lazy =
        time("without one they are mapped in the paper's time", Variant::Lazy, |(_, lazy)| lazy);
    let slower = Question {
        claim: "on a GPU the way without a root takes longer",
        rule: Rule::SameSide(1.0),
        missing,
        note: "",
    }
    .ask(on_gpus(&figures.mapping), |mapping| {
        let row = |n| {
            let paper = paper_of::table_2(n).map(|(own, lazy)| lazy / own);
            let ours = lazy_over_own(mapping, "gpu", n);
            Row::new(format!("{n} boxes, without over with"), "times", paper, ours)
        };
        COUNTS.map(row).into()
    });
    let on_cpus = Question {
        claim: "on one core the way without a root is four times faster (§3.2.2)",
        rule: Rule::RoundsTo,
        missing: "no core was measured with these numbers of boxes",
        note: "The paper gives the factor once, and no size.",
    }
    .ask(&figures.mapping, |mapping| {
        let row = |n| {
            let ours = lazy_over_own(mapping, "cpu_thread", n).map(|ratio| 1.0 / ratio);
            Row::new(format!("{n} boxes, with over without"), "times", 4.0, ours)
        };
        COUNTS.map(row).into()
    });
    Item::new("Table 2", "time with a square root and without", vec![own, lazy, slower, on_cpus])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::verdict::Verdict;

    #[test]
    fn the_papers_examples_are_right_and_its_last_number_is_not() {
        let item = table_1();
        let verdicts: Vec<_> = item.claims.iter().map(|claim| claim.verdict).collect();
        assert_eq!(verdicts, [Verdict::Holds, Verdict::Breaks]);
        assert_eq!(item.claims[1].rows[0].ours, Some(499_499.0));
    }
}
