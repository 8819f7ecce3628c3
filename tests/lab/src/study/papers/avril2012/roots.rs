//! Tables 3 and 4: errors and times of approximated roots.

use crate::study::mapping::paper as paper_of;
use crate::study::mapping::stage::{Discriminant, Magic, Root, Steps, Variant};
use crate::study::papers::model::{Claim, Item, Question, Row};
use crate::study::papers::records::{Figures, on_gpus};
use crate::study::papers::rule::Rule;
use crate::study::papers::shapes::{Mapping, RootErrors};

/// Numbers of roots of table 3.
const ERROR_COUNTS: [u64; 6] = [1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000];
/// Numbers of roots of table 4.
const TIME_COUNTS: [u64; 4] = [1_000_000, 10_000_000, 100_000_000, 1_000_000_000];
/// §3.3: "From 1K to 100M tests": boxes with at most 100 million pairs.
const MOST_BOXES: u32 = 14_142;

/// Table 4, γ: percent of the time that the approximation saves.
const SAVED: [f64; 4] = [12.6, 14.7, 13.2, 14.6];

const MISSING: &str = "no GPU was measured with these numbers of roots";

/// Percent of integer parts that are wrong on the GPU.
fn percent(mapping: Option<&Mapping>, root: Root, count: u64) -> Option<f64> {
    let name = root.to_string();
    let is_it =
        |row: &&RootErrors| row.processor == "gpu" && row.root == name && row.tally.count == count;
    let tally = &mapping?.root_errors.iter().find(is_it)?.tally;
    Some(100.0 * tally.other as f64 / tally.count.max(1) as f64)
}

/// A claim on the rows of several sizes.
fn ask<const N: usize>(
    figures: &Figures,
    claim: &'static str,
    rule: Rule,
    counts: [u64; N],
    row: impl Fn(Option<&Mapping>, u64) -> Row,
) -> Claim {
    Question { claim, rule, missing: MISSING, note: "" }
        .ask(on_gpus(&figures.mapping), |mapping| counts.map(|count| row(mapping, count)).into())
}

/// Table 3: wrong integer parts by steps.
pub fn table_3(figures: &Figures) -> Item {
    let errors = |claim, root| {
        ask(figures, claim, Rule::Within, ERROR_COUNTS, move |mapping, count| {
            let paper = paper_of::table_3(root, count);
            Row::new(format!("{root}, {count} roots"), "%", paper, percent(mapping, root, count))
        })
    };
    let difference = |claim, rule, steps: [Steps; 2]| {
        ask(figures, claim, rule, ERROR_COUNTS, move |mapping, count| {
            let [fewer, more] = steps.map(|steps| Root::Newton(Magic::Carmack, steps));
            let over = |of: &dyn Fn(Root) -> Option<f64>| Some(of(more)? / of(fewer)?);
            let paper = over(&|root| paper_of::table_3(root, count));
            let ours = over(&|root| percent(mapping, root, count));
            Row::new(format!("{more} over {fewer}, {count} roots"), "times", paper, ours)
        })
    };
    let claims = vec![
        errors(
            "as few errors with Carmack's constant and 2 steps",
            newton(Magic::Carmack, Steps::Two),
        ),
        errors(
            "as few errors with Lomont's constant and 2 steps",
            newton(Magic::Lomont, Steps::Two),
        ),
        errors(
            "as few errors with Carmack's constant and 3 steps",
            newton(Magic::Carmack, Steps::Three),
        ),
        errors(
            "as few errors with Lomont's constant and 3 steps",
            newton(Magic::Lomont, Steps::Three),
        ),
        difference(
            "a third step takes errors away",
            Rule::Between(0.0, 1.0),
            [Steps::Two, Steps::Three],
        ),
        difference("a fourth step changes nothing", Rule::SameShare, [Steps::Three, Steps::Four]),
        corrected(figures),
    ];
    Item::new("Table 3", "wrong integer parts of approximated roots", claims)
}

const fn newton(magic: Magic, steps: Steps) -> Root {
    Root::Newton(magic, steps)
}

/// "0% of error is obtained, when applying the conditions": wrong pairs of the corrected ways.
fn corrected(figures: &Figures) -> Claim {
    let ways =
        [(Magic::Carmack, Steps::Two), (Magic::Lomont, Steps::Three)].map(|(magic, steps)| {
            let root = Root::Newton(magic, steps);
            Variant::Closed { root, discriminant: Discriminant::Float, corrected: true }.to_string()
        });
    Question {
        claim: "with the two corrections no pair is wrong, up to 100 million pairs",
        rule: Rule::AtMost(0.0),
        missing: "no GPU was measured up to so many pairs",
        note: "Pairs of boxes up to 14,142, which have 100 million pairs.",
    }
    .ask(on_gpus(&figures.mapping), |mapping| {
        let all = mapping.map(|mapping| mapping.pair_errors.as_slice()).unwrap_or_default();
        let rows: Vec<Row> = all
            .iter()
            .filter(|row| row.processor == "gpu" && row.n <= MOST_BOXES)
            .filter(|row| ways.contains(&row.variant))
            .map(|row| {
                let what = format!("{}, {} boxes", row.variant, row.n);
                Row::new(what, "wrong", 0.0, Some(row.tally.wrong as f64))
            })
            .collect();
        if rows.is_empty() { vec![Row::new("all boxes", "wrong", 0.0, None)] } else { rows }
    })
}

/// The time of so many roots on the GPU, ms.
fn ms(mapping: Option<&Mapping>, root: Root, count: u64) -> Option<f64> {
    let name = root.to_string();
    let mut rows = mapping?.root_times.iter();
    rows.find(|row| row.processor == "gpu" && row.root == name && row.count == count)?.ms
}

/// Table 4: the time of approximated roots against the GPU's own.
pub fn table_4(figures: &Figures) -> Item {
    let faster = |claim, root: Root, rule| {
        ask(figures, claim, rule, TIME_COUNTS, move |mapping, count| {
            let paper = TIME_COUNTS.iter().position(|of_it| *of_it == count).map(|i| SAVED[i]);
            let own = ms(mapping, Root::BuiltIn, count);
            let ours = own.zip(ms(mapping, root, count));
            let ours = ours.map(|(own, approximated)| 100.0 * (1.0 - approximated / own));
            Row::new(format!("{root}, {count} roots: time saved"), "%", paper, ours)
        })
    };
    let time = |claim, root: Root| {
        ask(figures, claim, Rule::NoMore, TIME_COUNTS, move |mapping, count| {
            let paper = paper_of::table_4(root, count);
            Row::new(format!("{root}, {count} roots"), "ms", paper, ms(mapping, root, count))
        })
    };
    let claims = vec![
        time(
            "roots with Carmack's constant are taken in the paper's time",
            newton(Magic::Carmack, Steps::One),
        ),
        time(
            "roots with Lomont's constant are taken in the paper's time",
            newton(Magic::Lomont, Steps::One),
        ),
        time("the GPU's own roots are taken in the paper's time", Root::BuiltIn),
        faster(
            "Carmack's constant saves 12.6 to 14.7 % of the time (one step, as the code shows)",
            newton(Magic::Carmack, Steps::One),
            Rule::Reaches,
        ),
        faster(
            "Lomont's constant saves as much (one step)",
            newton(Magic::Lomont, Steps::One),
            Rule::Reaches,
        ),
        faster(
            "it saves time with the two steps of Table 3 (Carmack)",
            newton(Magic::Carmack, Steps::Two),
            Rule::AtLeast(0.0),
        ),
    ];
    Item::new("Table 4", "time of approximated roots and of the GPU's own", claims)
}
