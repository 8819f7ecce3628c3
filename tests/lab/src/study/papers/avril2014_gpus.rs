//! Avril et al. 2014, §5: one GPU against a core, several GPUs against one.

use super::model::{Claim, Item, Question, Row};
use super::more_gpus::{Parts, Reading};
use super::records::{Figures, Sourced, on_gpus};
use super::rule::Rule;
use super::shapes::TwoGpus;
use super::speed_up::{ALL_PAIRS, Series};

/// Objects of the first scene of §5.3, cubes.
const N: u32 = 20_000;
/// A core's time over one GPU's.
const ONE_GPU: f64 = 4.2;
/// One GPU's time over that of two, and of four ("by more than 3,5").
const TWO_GPUS: f64 = 1.79;
const FOUR_GPUS: f64 = 3.5;

const TWO_MISSING: &str = "two GPUs of one machine were not measured";
const FOUR_MISSING: &str = "four GPUs of one machine were not measured";

/// Figure 14: the time of one core, and of one, two and four GPUs.
pub fn architectures(figures: &Figures) -> Item {
    let unmeasured =
        |claim, rule, missing, row| Question { claim, rule, missing, note: "" }.judge(vec![row]);
    let claims = vec![
        one_gpu(figures),
        unmeasured(
            "two GPUs reduce the time of 20,000 cubes by 1.79",
            Rule::Reaches,
            "two GPUs were measured with a million boxes and more; a frame of 20,000 goes to one",
            Row::new("20000 cubes, 2 GPUs over 1", "times", TWO_GPUS, None),
        ),
        large_scenes(figures),
        more_gpus(figures),
        four_gpus(figures),
        all_gpus(figures),
        unmeasured(
            "four GPUs reduce the time of 20,000 cubes by more than 3.5",
            Rule::Reaches,
            FOUR_MISSING,
            Row::new("20000 cubes, 4 GPUs over 1", "times", FOUR_GPUS, None),
        ),
        unmeasured(
            "four GPUs lose time with a small scene",
            Rule::Between(0.0, 1.0),
            FOUR_MISSING,
            Row::new("letters, 4 GPUs over 1", "times", None, None),
        ),
        unmeasured(
            "a core is the fastest for the scene of few objects",
            Rule::AtLeast(1.0),
            "the text does not say how many letters there are",
            Row::new("letters, a GPU's time over a core's", "times", None, None),
        ),
    ];
    Item::new("Figure 14", "time of a core, of 1, 2 and 4 GPUs", claims)
}

/// A core and a GPU of the same machine, both with the paper's cubes.
fn one_gpu(figures: &Figures) -> Claim {
    let core = Series::pairs("cubes", N as usize, ALL_PAIRS);
    let mut times = Vec::new();
    for grid in on_gpus(&figures.grid) {
        for threads in &figures.threads {
            let frame = grid.data.engines.iter().find(|row| row.n == N);
            let is_same = grid.data.machine.cpu == threads.data.machine.cpu;
            if let (Some(frame), Some(core_ms), true) =
                (frame, core.ms(Some(&threads.data), 1), is_same)
            {
                times.push(Sourced {
                    from: format!("{}, {}", grid.from, threads.from),
                    machine: grid.machine.clone(),
                    gpu_is_software: false,
                    data: core_ms / frame.gpu_grid_ms,
                });
            }
        }
    }
    Question {
        claim: "one GPU reduces the time of 20,000 cubes by 4.2",
        rule: Rule::Reaches,
        missing: "no machine was measured with 20,000 cubes on a GPU and on one core",
        note: "One core compares all pairs, as in the paper; the GPU has a grid.",
    }
    .ask(&times, |times| {
        vec![Row::new("20000 cubes, a core over a GPU", "times", ONE_GPU, times.copied())]
    })
}

/// Of all scenes the one that gains most: the claim breaks only where none comes near.
fn large_scenes(figures: &Figures) -> Claim {
    Question {
        claim: "in a large scene two GPUs gain as much",
        rule: Rule::Reaches,
        missing: TWO_MISSING,
        note: "A million boxes and more in place of 20,000, which is to the advantage of two GPUs; a \
               whole round trip through the daemon. The scene that gains most.",
    }
    .ask(&figures.two_gpus, |scenes| {
        let best = scenes.and_then(|scenes| best(scenes));
        let what = best.map_or_else(String::new, |best| format!("{}, ", best.scene));
        vec![Row::new(format!("{what}2 GPUs over 1"), "times", TWO_GPUS, best.map(gain))]
    })
}

const SIMULATED: &str = "Simulated, not measured: from the measured parts of one GPU and of two. What two halve, k divide \
                         by k; each reads all boxes over its own link; each further one costs the host 35 µs. The \
                         scene that gains most from two.";

/// Speed-up over one GPU: of two measured, of four simulated.
fn more_gpus(figures: &Figures) -> Claim {
    Question {
        claim: "in a large scene, going from one GPU to four gains much",
        rule: Rule::Rises,
        missing: TWO_MISSING,
        note: SIMULATED,
    }
    .ask(&figures.two_gpus, |scenes| {
        let best = scenes.and_then(|scenes| best(scenes));
        let four = best.map(|best| simulated(best, Reading::All, [1, 4]));
        let what = best.map_or_else(String::new, |best| format!("{}, ", best.scene));
        vec![
            Row::new(format!("{what}2 GPUs over 1, measured"), "times", None, best.map(gain)),
            Row::new(format!("{what}4 GPUs over 1, simulated"), "times", None, four),
        ]
    })
}

/// Eight GPUs beside four.
fn all_gpus(figures: &Figures) -> Claim {
    Question {
        claim: "all GPUs that there are may not be the fastest",
        rule: Rule::AtMost(1.0),
        missing: TWO_MISSING,
        note: SIMULATED,
    }
    .ask(&figures.two_gpus, |scenes| {
        let best = scenes.and_then(|scenes| best(scenes));
        let eight = best.map(|best| simulated(best, Reading::All, [4, 8]));
        vec![Row::new("8 GPUs over 4, simulated", "times", None, eight)]
    })
}

/// The same with boxes that would be written slab by slab, beside the paper's figure.
fn four_gpus(figures: &Figures) -> Claim {
    Question {
        claim: "in a large scene four GPUs reduce the time by more than 3.5",
        rule: Rule::Reaches,
        missing: TWO_MISSING,
        note: SIMULATED,
    }
    .ask(&figures.two_gpus, |scenes| {
        let best = scenes.and_then(|scenes| best(scenes));
        let row = |reading, how: &str| {
            let gain = best.map(|best| simulated(best, reading, [1, 4]));
            Row::new(format!("4 GPUs over 1, simulated{how}"), "times", FOUR_GPUS, gain)
        };
        vec![
            row(Reading::All, ""),
            row(Reading::Slabs, ", if each read its part of the boxes alone"),
        ]
    })
}

/// The scene that gains most from a second GPU.
fn best(scenes: &[TwoGpus]) -> Option<&TwoGpus> {
    scenes.iter().max_by(|a, b| gain(a).total_cmp(&gain(b)))
}

/// Time on some GPUs over that on others, simulated.
fn simulated(scene: &TwoGpus, reading: Reading, [some, others]: [u32; 2]) -> f64 {
    let parts = Parts::of(scene, scene.boxes());
    parts.ms(some, reading) / parts.ms(others, reading)
}

/// One GPU's time over that of two.
fn gain(scene: &TwoGpus) -> f64 {
    scene.one_ms / scene.two_ms
}

/// Figure 15: the balls' fall, frame by frame, on a core and on GPUs.
pub fn simulation() -> Item {
    let claim = Question {
        claim: "the time of a core, and of 1, 2 and 4 GPUs changes alike as the balls fall",
        rule: Rule::IsConstant,
        missing: "the plot has no numbers in the text, and four GPUs of one machine were not measured",
        note: "",
    }
    .judge(Vec::new());
    Item::new("Figure 15", "time frame by frame while balls fall", vec![claim])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::verdict::Verdict;

    #[test]
    fn the_scene_that_gains_most_decides() {
        let scene = |name: &str, one_ms, two_ms| TwoGpus { scene: name.into(), one_ms, two_ms };
        let figures = |two_ms| Figures {
            two_gpus: vec![Sourced {
                from: "r".into(),
                machine: String::new(),
                gpu_is_software: false,
                data: vec![scene("a", 1.0, 0.98), scene("b", 1.0, two_ms)],
            }],
            ..Figures::default()
        };
        let claim = large_scenes(&figures(0.72));
        assert_eq!((claim.verdict, claim.rows.len()), (Verdict::Breaks, 1));
        assert!(claim.why.starts_with("b, 2 GPUs over 1"), "{}", claim.why);
        assert_eq!(large_scenes(&figures(0.5)).verdict, Verdict::Holds);
        assert_eq!(large_scenes(&Figures::default()).verdict, Verdict::NotMeasured);
        // More GPUs are simulated from the same two figures, and say so.
        for ask in [more_gpus, four_gpus, all_gpus] {
            let claim = ask(&figures(0.75));
            assert!(claim.note.starts_with("Simulated, not measured"), "{}", claim.note);
            assert!(claim.rows.iter().any(|row| row.what.contains("simulated")));
        }
        assert_eq!(more_gpus(&figures(0.75)).verdict, Verdict::Holds);
        assert_eq!(more_gpus(&figures(1.5)).verdict, Verdict::Breaks);
        assert_eq!(four_gpus(&figures(0.75)).verdict, Verdict::Breaks);
        // Each further one costs 35 µs: eight are no faster than four.
        assert_eq!(all_gpus(&figures(0.75)).verdict, Verdict::Holds);
        assert_eq!(four_gpus(&Figures::default()).verdict, Verdict::NotMeasured);
    }
}
