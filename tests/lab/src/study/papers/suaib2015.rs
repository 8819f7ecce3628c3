//! N. Mohd Suaib, F. Mohd Nasir, "Broad phase collision detection using graphics processing unit", 2015.

use super::model::{A_DRAWING, A_SCENE, Claim, Item, Paper, Question, Row};
use super::records::{Figures, on_gpus};
use super::rule::Rule;
use super::shapes::{GpuSpheres, Spheres};
use crate::study::spheres::paper::{PaperRow, TABLE_1};

const NOTE: &str = "One pair after the other in plain f32 on one thread, as in algorithm 1 but without \
                    its root, against all pairs on the GPU, exact; the paper draws its frames, too.";
const MISSING: &str = "no GPU was measured with these numbers of spheres";

/// The paper's figures.
pub fn paper(figures: &Figures) -> Paper {
    let drawing = |place, shows| Item::drawing(place, shows, A_DRAWING);
    Paper {
        name: "Suaib 2015",
        title: "N. Mohd Suaib, F. Mohd Nasir: Broad phase collision detection using graphics \
                processing unit. 2015",
        machine: "GeForce G105M",
        items: vec![
            table_1(figures),
            drawing("Figure 1", "approaches to collision detection"),
            drawing("Figure 2", "the sequential approach"),
            figure_3(figures),
            drawing("Figure 4", "the parallel approach"),
            drawing("Figure 5", "work shared out to a GPU's threads"),
            Item::drawing("Figure 6", "the scene", A_SCENE),
            figure_7(figures),
            figure_8(figures),
        ],
    }
}

fn of_ours(spheres: Option<&Spheres>, n: u32) -> Option<&GpuSpheres> {
    spheres?.gpu_speed.iter().find(|row| row.n == u64::from(n))
}

fn speed_up(spheres: Option<&Spheres>, n: u32) -> Option<f64> {
    let row = of_ours(spheres, n)?;
    Some(row.all_pairs_fps? / row.plain_fps?)
}

fn ask(
    figures: &Figures,
    claim: &'static str,
    rule: Rule,
    row: impl Fn(Option<&Spheres>, &PaperRow) -> Row,
) -> Claim {
    Question { claim, rule, missing: MISSING, note: NOTE }
        .ask(on_gpus(&figures.spheres), |spheres| {
            TABLE_1.iter().map(|paper| row(spheres, paper)).collect()
        })
}

fn label(paper: &PaperRow) -> String {
    format!("{} spheres", paper.n)
}

fn speed_up_row(spheres: Option<&Spheres>, paper: &PaperRow) -> Row {
    Row::new(label(paper), "times", paper.speed_up, speed_up(spheres, paper.n))
}

fn sequential_row(spheres: Option<&Spheres>, paper: &PaperRow) -> Row {
    let ours = of_ours(spheres, paper.n).and_then(|row| row.plain_fps);
    Row::new(label(paper), "frames/s", paper.sequential, ours).without_ratio()
}

fn parallel_row(spheres: Option<&Spheres>, paper: &PaperRow) -> Row {
    let ours = of_ours(spheres, paper.n).and_then(|row| row.all_pairs_fps);
    Row::new(label(paper), "frames/s", paper.parallel, ours).without_ratio()
}

fn table_1(figures: &Figures) -> Item {
    let crossing = ask(
        figures,
        "the GPU is slower than one core at 64 and 128 spheres and faster from 192 on",
        Rule::SameSide(1.0),
        speed_up_row,
    );
    let reaches =
        ask(figures, "the GPU is as many times faster than one core", Rule::Reaches, speed_up_row);
    Item::new("Table 1", "frames a second by number of spheres", vec![crossing, reaches])
}

/// The test that the figure draws is that of algorithm 1: d ≤ r₁ + r₂, d with a root.
fn figure_3(figures: &Figures) -> Item {
    let claim = Question {
        claim: "two spheres collide where the distance of their centres is at most the sum of their \
                radii, as algorithm 1 computes it",
        rule: Rule::AtMost(0.0),
        missing: "`spheres --errors` has no record",
        note: "Algorithm 1 in f32 against exact arithmetic: pairs decided wrongly.",
    }
    .ask(&figures.spheres, |spheres| {
        let errors = spheres.map(|spheres| spheres.errors.as_slice()).unwrap_or_default();
        let row = |family: String, wrong| Row::new(family, "wrong", 0.0, wrong);
        let rows = errors
            .iter()
            .map(|row_of| row(format!("{}, {} pairs", row_of.family, row_of.pairs), Some((row_of.root_missed + row_of.root_extra) as f64)));
        if errors.is_empty() { vec![row("all families".to_owned(), None)] } else { rows.collect() }
    });
    Item::new("Figure 3", "the test of two spheres", vec![claim])
}

fn figure_7(figures: &Figures) -> Item {
    let sequential = ask(
        figures,
        "one core: frames a second fall with the number of spheres",
        Rule::Falls,
        sequential_row,
    );
    let parallel = ask(
        figures,
        "the GPU: frames a second fall with the number of spheres",
        Rule::Falls,
        parallel_row,
    );
    let reached = Question {
        claim: "the paper's frames a second are reached",
        rule: Rule::Reaches,
        missing: "the paper counts frames that are drawn, ours are culled only",
        note: "",
    }
    .judge(vec![Row::new("frames drawn", "frames/s", None, None)]);
    Item::new("Figure 7", "frames a second of both approaches", vec![sequential, parallel, reached])
}

fn figure_8(figures: &Figures) -> Item {
    let rises = ask(
        figures,
        "the more spheres, the more times the GPU is faster",
        Rule::Rises,
        speed_up_row,
    );
    Item::new("Figure 8", "speed-up by number of spheres", vec![rises])
}
