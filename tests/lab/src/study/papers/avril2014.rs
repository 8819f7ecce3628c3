//! Q. Avril, V. Gouranton, B. Arnaldi, "Collision detection: broad phase adaptation from multi-core to
//! multi-GPU architecture", JVRB 11, 2014.

use super::avril2014_gpus as gpus;
use super::model::{A_DRAWING, A_SCENE, Claim, Item, Paper, Question, Row};
use super::records::Figures;
use super::rule::Rule;
use super::shapes::Threads;
use super::speed_up::{ALL_PAIRS, Series, without_cores};
use crate::study::threads::Stage;
use crate::study::threads::paper::{CORES, PaperScene, SCENES};

const NOTE: &str = "The paper's scenes and numbers of objects; least time of ours. Our cores are virtual \
                    CPUs, of which two may share a core.";
/// The scene whose shares Figures 6 and 8 show: they are those of the cubes in Figures 5 and 7.
const CUBES: &PaperScene = &SCENES[0];
/// Figure 6: time on 2, 4 and 8 cores, percent of that on one.
const UPDATE_SHARES: [f64; 3] = [56.04, 31.49, 17.03];
/// Figure 8.
const PAIRS_SHARES: [f64; 3] = [59.2, 35.34, 21.56];
/// Figure 9: speed-up of both stages on 8 cores.
const OVERALL: f64 = 5.1;

/// The times of a stage of a scene.
const fn series(stage: Stage, scene: &PaperScene) -> Series {
    match stage {
        Stage::UpdateAabbs => Series::update(scene.scene.as_str(), scene.n),
        Stage::OverlappingPairs => Series::pairs(scene.scene.as_str(), scene.n, ALL_PAIRS),
    }
}

/// The paper's figures.
pub fn paper(figures: &Figures) -> Paper {
    let drawing = |place, shows| Item::drawing(place, shows, A_DRAWING);
    Paper {
        name: "Avril 2014",
        title: "Q. Avril, V. Gouranton, B. Arnaldi: Collision detection: broad phase adaptation from \
                multi-core to multi-GPU architecture. JVRB 11, 2014",
        machine: "two Xeon X5482, 8 cores; four Quadro FX 4600",
        items: vec![
            drawing("Figure 1", "the pipeline of collision detection"),
            drawing("Figure 2", "sweep and prune on two axes"),
            drawing("Figure 3", "the parallel algorithm"),
            Item::drawing("Figure 4", "the three scenes of §4", A_SCENE),
            times(figures, "Figure 5", "time of the boxes' update", Stage::UpdateAabbs),
            shares(figures, "Figure 6", "the update by cores", Stage::UpdateAabbs, UPDATE_SHARES),
            times(figures, "Figure 7", "time of the overlapping pairs", Stage::OverlappingPairs),
            shares(
                figures,
                "Figure 8",
                "overlapping pairs by cores",
                Stage::OverlappingPairs,
                PAIRS_SHARES,
            ),
            overall(figures),
            drawing("Figure 10", "sweep and prune on one GPU"),
            drawing("Figure 11", "space divided among GPUs"),
            Item::drawing("Figure 12", "the four scenes of §5", A_SCENE),
            Item::drawing(
                "Figure 13",
                "geometry and numbers of the four scenes",
                "properties of scenes",
            ),
            gpus::architectures(figures),
            gpus::simulation(),
        ],
    }
}

fn label(scene: &PaperScene) -> String {
    format!("{} {}", scene.n, scene.scene)
}

/// Figures 5 and 7: times of three scenes on 1, 2, 4 and 8 cores.
fn times(figures: &Figures, place: &'static str, shows: &'static str, stage: Stage) -> Item {
    let one = |threads: Option<&Threads>| {
        let row = |scene: &PaperScene| {
            let ours = series(stage, scene).ms(threads, 1);
            Row::new(format!("{}, 1 core", label(scene)), "ms", scene.ms(stage)[0], ours)
        };
        SCENES.iter().map(row).collect()
    };
    let mut claims =
        vec![ask(figures, "one core does it in the paper's time", Rule::NoMore, 1, one)];
    let texts = [
        "two cores are as many times faster than one",
        "four cores are as many times faster than one",
        "eight cores are as many times faster than one",
    ];
    for (column, claim) in (1..).zip(texts) {
        let cores = CORES[column];
        claims.push(ask(figures, claim, Rule::Reaches, cores, |threads| {
            let row = |scene: &PaperScene| {
                let paper = scene.ms(stage);
                let ours = series(stage, scene).speed_up(threads, cores);
                let what = format!("{}, {cores} cores over 1", label(scene));
                Row::new(what, "times", paper[0] / paper[column], ours)
            };
            SCENES.iter().map(row).collect()
        }));
    }
    Item::new(place, shows, claims)
}

/// Figures 6 and 8: time on 2, 4 and 8 cores in percent of that on one.
fn shares(
    figures: &Figures,
    place: &'static str,
    shows: &'static str,
    stage: Stage,
    percent: [f64; 3],
) -> Item {
    let row = |threads: Option<&Threads>, column: usize| {
        let cores = CORES[column + 1];
        let ours = series(stage, CUBES).speed_up(threads, cores).map(|times| 100.0 / times);
        Row::new(format!("{}, {cores} cores", label(CUBES)), "%", percent[column], ours)
    };
    let two = ask(figures, "two cores take this share of one core's time", Rule::Within, 2, |t| {
        vec![row(t, 0)]
    });
    let more =
        ask(figures, "four and eight cores take this share of it", Rule::Within, 8, |threads| {
            vec![row(threads, 1), row(threads, 2)]
        });
    Item::new(place, shows, vec![two, more])
}

fn overall(figures: &Figures) -> Item {
    let eight =
        ask(figures, "both stages are 5.1 times faster on 8 cores", Rule::Reaches, 8, |t| {
            let both = |cores| {
                let (update, pairs) =
                    (series(Stage::UpdateAabbs, CUBES), series(Stage::OverlappingPairs, CUBES));
                Some(update.ms(t, cores)? + pairs.ms(t, cores)?)
            };
            let ours = both(1).zip(both(8)).map(|(one, eight)| one / eight);
            vec![Row::new(format!("{}, 8 cores over 1", label(CUBES)), "times", OVERALL, ours)]
        });
    Item::new("Figure 9", "the whole speed-up by cores", vec![eight])
}

fn ask(
    figures: &Figures,
    claim: &'static str,
    rule: Rule,
    cores: usize,
    rows: impl Fn(Option<&Threads>) -> Vec<Row>,
) -> Claim {
    let missing = without_cores(figures, series(Stage::UpdateAabbs, CUBES), cores);
    Question { claim, rule, missing: &missing, note: NOTE }.ask(&figures.threads, rows)
}
