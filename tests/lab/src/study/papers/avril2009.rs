//! Q. Avril, V. Gouranton, B. Arnaldi, "Détection de collision : d'un algorithme sur multi-cœurs à une
//! nouvelle dimension dans le pipeline 3D", AFRV 2009. Its plots have no numbers; its text has some.

use super::model::{A_DRAWING, Item, Paper, Question, Row};
use super::records::Figures;
use super::rule::Rule;
use super::shapes::Threads;
use super::speed_up::{ALL_PAIRS, Series, without_cores};

/// §6: "600k polygones", cubes of 6 polygons each.
const N: usize = 100_000;
/// The scene of ours: neither stage's work hangs on how the cubes lie before they fall.
const SCENE: &str = "uniform";
/// The engine that serves such scenes on cores.
const OURS: &str = "cpu-grid";
const NOTE: &str = "100,000 boxes of a uniform scene in place of 100,000 falling cubes; a virtual CPU \
                    is half a core where two share one.";
const NOTE_GRID: &str = "Ours is the engine that serves such scenes, a grid; the paper compares all \
                         pairs.";

const UPDATE: Series = Series::update(SCENE, N);
const PAIRS: Series = Series::pairs(SCENE, N, ALL_PAIRS);
const PAIRS_OF_OURS: Series = Series::pairs(SCENE, N, OURS);

/// The paper's figures.
pub fn paper(figures: &Figures) -> Paper {
    let drawing = |place, shows| Item::drawing(place, shows, A_DRAWING);
    Paper {
        name: "Avril 2009",
        title: "Q. Avril, V. Gouranton, B. Arnaldi: Détection de collision : d'un algorithme sur \
                multi-cœurs à une nouvelle dimension dans le pipeline 3D. AFRV 2009",
        machine: "two Xeon X5482, 8 cores",
        items: vec![
            drawing("Figure 1", "the pipeline of collision detection"),
            drawing("Figure 2", "a CPU beside a GPU"),
            drawing("Figure 3", "levels of a GPU's memory"),
            drawing("Figure 4", "levels of languages for GPUs"),
            drawing("Figure 5", "the matrix of pairs, shared out to cores"),
            drawing("Figure 6", "intervals that overlap and that do not"),
            drawing("Figure 7", "sweep and prune, sequential"),
            drawing("Figure 8", "sweep and prune, parallel"),
            drawing("Figure 9", "the parallel algorithm"),
            drawing("Figure 10", "the algorithm as a pipeline"),
            drawing("Figure 11", "the pipeline with the machine as a dimension"),
            update(figures),
            pairs(figures),
            overall(figures),
            gain(figures),
        ],
    }
}

fn update(figures: &Figures) -> Item {
    let two = ask(
        figures,
        "two cores halve the time of the update",
        Rule::RoundsTo,
        2,
        NOTE,
        |threads| vec![Row::new("2 cores over 1", "times", 2.0, UPDATE.speed_up(threads, 2))],
    );
    let more = ask(
        figures,
        "from 2 to 4 and from 4 to 8 cores the update gets faster, but not twice as fast",
        Rule::Between(1.0, 2.0),
        8,
        NOTE,
        |threads| further_gains(UPDATE, threads),
    );
    Item::new("Figure 12", "time of the boxes' update by polygons, 1 to 8 cores", vec![two, more])
}

fn pairs(figures: &Figures) -> Item {
    let all_pairs = Question {
        claim: "two cores halve the time of the overlap test, as they do the update's",
        rule: Rule::RoundsTo,
        missing: "all pairs of 100,000 boxes are in no record: a grid takes a small part of the time, \
                  and `threads` leaves out engines that take many times the fastest's",
        note: NOTE,
    }
    .ask(&figures.threads, |threads| {
        vec![Row::new("2 cores over 1", "times", 2.0, PAIRS.speed_up(threads, 2))]
    });
    let ours = ask(
        figures,
        "two cores halve its time in the engine that serves such scenes now",
        Rule::RoundsTo,
        2,
        NOTE_GRID,
        |threads| {
            vec![Row::new("2 cores over 1", "times", 2.0, PAIRS_OF_OURS.speed_up(threads, 2))]
        },
    );
    Item::new("Figure 13", "time of the overlap test by polygons", vec![all_pairs, ours])
}

fn overall(figures: &Figures) -> Item {
    let falls = ask(
        figures,
        "the whole time falls with the number of cores",
        Rule::Falls,
        8,
        NOTE_GRID,
        |threads| {
            [1, 2, 4, 8].map(|cores| row_ms(cores, both_ms(threads, cores))).into_iter().collect()
        },
    );
    let less = ask(
        figures,
        "each doubling of the cores saves less time than the one before",
        Rule::Falls,
        8,
        NOTE_GRID,
        |threads| {
            let saved = |from, to| Some(both_ms(threads, from)? - both_ms(threads, to)?);
            let row = |from, to| {
                Row::new(format!("saved from {from} to {to} cores"), "ms", None, saved(from, to))
            };
            vec![row(1, 2), row(2, 4), row(4, 8)]
        },
    );
    Item::new("Figure 14", "the whole time by cores, 600,000 polygons", vec![falls, less])
}

fn gain(figures: &Figures) -> Item {
    let three = ask(
        figures,
        "8 cores divide the whole time by 3",
        Rule::RoundsTo,
        8,
        NOTE_GRID,
        |threads| {
            let gain = both_ms(threads, 1).zip(both_ms(threads, 8)).map(|(one, eight)| one / eight);
            vec![Row::new("8 cores over 1", "times", 3.0, gain)]
        },
    );
    Item::new("Figure 15", "the whole speed-up by cores", vec![three])
}

/// A claim over thread counts up to `cores`.
fn ask(
    figures: &Figures,
    claim: &'static str,
    rule: Rule,
    cores: usize,
    note: &'static str,
    rows: impl Fn(Option<&Threads>) -> Vec<Row>,
) -> super::model::Claim {
    let missing = without_cores(figures, UPDATE, cores);
    Question { claim, rule, missing: &missing, note }.ask(&figures.threads, rows)
}

fn further_gains(series: Series, threads: Option<&Threads>) -> Vec<Row> {
    let ms = |cores| series.ms(threads, cores);
    let gain = |from, to| Some(ms(from)? / ms(to)?);
    let row = |from, to| Row::new(format!("{to} cores over {from}"), "times", None, gain(from, to));
    vec![row(2, 4), row(4, 8)]
}

/// Both stages, one after the other.
fn both_ms(threads: Option<&Threads>, cores: usize) -> Option<f64> {
    Some(UPDATE.ms(threads, cores)? + PAIRS_OF_OURS.ms(threads, cores)?)
}

fn row_ms(cores: usize, ms: Option<f64>) -> Row {
    let what = if cores == 1 { "1 core".to_owned() } else { format!("{cores} cores") };
    Row::new(what, "ms", None, ms)
}
