//! Tables 6 and 7, Figures 1, 5 and 6: the grid.

use crate::study::grid::{PAPER_PARTS, PAPER_WITHOUT};
use crate::study::papers::model::{Claim, Item, Question, Row};
use crate::study::papers::records::{Figures, on_gpus};
use crate::study::papers::rule::Rule;
use crate::study::papers::shapes::{Engines, Grid, Parts, WithAndWithout};

/// Abstract: more than 100,000 objects in less than 25 ms.
const INTERACTIVE: (u32, f64) = (100_000, 25.0);
/// Sizes of figure 5 at which the paper says that it significantly outperforms others.
const LARGE: [u32; 2] = [100_000, 1_000_000];
/// Percent of moving boxes of figure 6.
const MOVING: [u32; 6] = [0, 10, 25, 50, 75, 100];

const MISSING: &str = "no GPU was measured with these numbers of boxes";
const CUBES: &str = "Falling cubes of one size, as in the paper.";

fn ask(
    figures: &Figures,
    claim: &'static str,
    rule: Rule,
    note: &'static str,
    rows: impl Fn(Option<&Grid>) -> Vec<Row>,
) -> Claim {
    Question { claim, rule, missing: MISSING, note }.ask(on_gpus(&figures.grid), rows)
}

fn parts(grid: Option<&Grid>, n: u32) -> Option<&Parts> {
    grid?.parts.iter().find(|row| row.n == n)
}

/// Table 6: update of the boxes, of the grid, pairs.
pub fn table_6(figures: &Figures) -> Item {
    let column = |claim, index: usize, of: fn(&Parts) -> f64| {
        ask(figures, claim, Rule::NoMore, CUBES, |grid| {
            let row = |(n, paper): (u32, [f64; 4])| {
                Row::new(format!("{n} boxes"), "ms", paper[index], parts(grid, n).map(of))
            };
            PAPER_PARTS.map(row).into()
        })
    };
    let culled = ask(
        figures,
        "100,000 objects are culled in less than 25 ms: grid update and pairs",
        Rule::AtMost(INTERACTIVE.1),
        CUBES,
        |grid| {
            let (n, _) = INTERACTIVE;
            let theirs = PAPER_PARTS.iter().find(|row| row.0 == n).map(|(_, ms)| ms[1] + ms[2]);
            let ours = parts(grid, n).map(|row| row.update_grid_ms + row.cull_ms);
            vec![Row::new(format!("{n} boxes"), "ms", theirs, ours)]
        },
    );
    let claims = vec![
        column("the boxes are updated in the paper's time (α)", 0, |row| row.update_boxes_ms),
        column("the grid is updated in the paper's time (β)", 1, |row| row.update_grid_ms),
        column("the pairs are found in the paper's time (δ)", 2, |row| row.cull_ms),
        column("the whole is done in the paper's time", 3, |row| row.total_ms),
        culled,
    ];
    Item::new("Table 6", "time by part and number of objects", claims)
}

fn without(grid: Option<&Grid>, n: u32) -> Option<&WithAndWithout> {
    grid?.with_and_without.iter().find(|row| row.n == n)
}

/// Table 7: all pairs against the grid.
pub fn table_7(figures: &Figures) -> Item {
    let side = |claim, sizes: &'static [u32]| {
        ask(figures, claim, Rule::SameSide(1.0), CUBES, |grid| {
            let row = |(n, [all, with]): &(u32, [f64; 2])| {
                let ours = without(grid, *n).map(|row| row.without_ms / row.with_ms);
                Row::new(format!("{n} boxes, without over with"), "times", all / with, ours)
            };
            PAPER_WITHOUT.iter().filter(|(n, _)| sizes.contains(n)).map(row).collect()
        })
    };
    let column = |claim, index: usize, of: fn(&WithAndWithout) -> f64| {
        ask(figures, claim, Rule::NoMore, CUBES, |grid| {
            let row = |(n, paper): (u32, [f64; 2])| {
                Row::new(format!("{n} boxes"), "ms", paper[index], without(grid, n).map(of))
            };
            PAPER_WITHOUT.map(row).into()
        })
    };
    let claims = vec![
        side("up to 1,000 objects all pairs are faster than the grid", &[100, 1_000]),
        side("beyond 1,000 objects the grid is faster", &[10_000]),
        column("a frame without the grid is done in the paper's time", 0, |row| row.without_ms),
        column("a frame with the grid is done in the paper's time", 1, |row| row.with_ms),
    ];
    Item::new("Table 7", "time without and with the grid", claims)
}

fn engines(grid: Option<&Grid>, n: u32) -> Option<&Engines> {
    grid?.engines.iter().find(|row| row.n == n)
}

fn interactive(figures: &Figures, claim: &'static str, note: &'static str) -> Claim {
    ask(figures, claim, Rule::AtMost(INTERACTIVE.1), note, |grid| {
        let (n, ms) = INTERACTIVE;
        let ours = engines(grid, n).map(|row| row.gpu_grid_ms);
        vec![Row::new(format!("{n} boxes"), "ms", ms, ours)]
    })
}

/// Figure 1: the scenes, with a time in the caption.
pub fn figure_1(figures: &Figures) -> Item {
    let note = "Cubes in place of spheres: a broad phase sees their boxes, which are as large.";
    let claim = interactive(figures, "100,000 spheres are culled in less than 25 ms", note);
    Item::new("Figure 1", "three scenes; the caption has a time", vec![claim])
}

/// Figure 5: the grid against two broad phases of Bullet.
pub fn figure_5(figures: &Figures) -> Item {
    let sweep = ask(
        figures,
        "the GPU's grid significantly outperforms sweep and prune in large scenes",
        Rule::AtLeast(1.0),
        "Ours, on all cores, in place of Bullet's.",
        |grid| {
            let over = |row: &Engines| Some(row.cpu_sap_ms? / row.gpu_grid_ms);
            let row = |n| {
                let ours = engines(grid, n).and_then(over);
                Row::new(format!("{n} boxes, sweep and prune over grid"), "times", None, ours)
            };
            LARGE.map(row).into()
        },
    );
    let trees = Question {
        claim: "it significantly outperforms Bullet's dynamic trees in large scenes",
        rule: Rule::AtLeast(1.0),
        missing: "Bullet is measured in a program of its own (examples/bullet), in piles of up to \
                  64,000 balls",
        note: "",
    }
    .judge(
        LARGE.map(|n| Row::new(format!("{n} boxes, trees over grid"), "times", None, None)).into(),
    );
    let time = interactive(figures, "100,000 objects stay interactive, below 25 ms", CUBES);
    Item::new("Figure 5", "three algorithms by number of objects", vec![sweep, trees, time])
}

/// Figure 6: the share of objects that move.
pub fn figure_6(figures: &Figures) -> Item {
    let claim = ask(
        figures,
        "the time does not depend on how many objects move",
        Rule::IsConstant,
        "100,000 boxes.",
        |grid| {
            let row = |percent| {
                let mut rows = grid.map(|grid| grid.moving.iter()).into_iter().flatten();
                let is_it = |n, moving| n == INTERACTIVE.0 && moving == percent;
                let ours =
                    rows.find(|row| is_it(row.n, row.moving_percent)).map(|row| row.frame_ms);
                Row::new(format!("{percent} % moving"), "ms", None, ours)
            };
            MOVING.map(row).into()
        },
    );
    Item::new("Figure 6", "time by share of moving objects", vec![claim])
}
