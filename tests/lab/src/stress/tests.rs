use std::sync::Arc;

use pairmask_core::Encoding;
use pairmask_core::engine::{CullError, CullInput, CullReport, Engine, EngineName, ReplyBuffer};
use pairmaskd::execute::gpu::GpuChoice;

use super::roster::{CullSubject, Culls};
use super::*;
use crate::sabotage::Sabotage;

fn roster(engines: &[&str], mode: &str, sabotage: Option<Sabotage>) -> Roster {
    let engines = engines.iter().map(|name| (*name).to_owned()).collect();
    let wanted = Wanted { engines, modes: vec![mode.to_owned()], threads: 2 };
    Roster { wanted, gpu: GpuChoice::None, sabotage }
}

fn run_for(seed: u64, ms: u64, subjects: &mut [Box<dyn Subject>]) -> StressReport {
    run(&Cases::Run { seed, time: Duration::from_millis(ms) }, subjects, |_, _| {})
}

/// Each kind of subject passes as it is, and is caught where it is broken; its case is given again.
#[test]
fn right_subjects_pass_and_broken_ones_are_caught_and_replayed() {
    let (lossy, inward) = (Sabotage::Lossy, Sabotage::Inward);
    for (engines, mode, sabotage, word) in [
        (&["cpu-sap", "cpu-grid"][..], "all", lossy, "is missing"),
        (&["spheres"], "all", lossy, "Sphere"),
        (&["scenes"], "all", lossy, "is missing"),
        (&["updates"], "all", lossy, "with the default flags"),
        (&["cpu-sap"], "q16", inward, "q16"),
        (&["cpu-sap"], "q8", inward, "q8"),
        (&["cpu-sap"], "f16", inward, "f16"),
        (&["cpu-sap"], "margin", inward, "margin"),
        (&["cpu-sap"], "f64", inward, "around"),
    ] {
        let subjects = |sabotage| roster(engines, mode, sabotage).subjects().expect("cores");
        let (mut sound, mut broken) = (subjects(None), subjects(Some(sabotage)));
        let report = run_for(1, 300, &mut sound);
        assert!(report.is_clean(), "{report}");
        assert_eq!(report.answers, report.cases * sound.len() as u64);

        let report = run_for(1, 60_000, &mut broken);
        assert!(!report.is_clean() && report.extra == 0, "{engines:?} {mode}: {report}");
        assert_eq!(report.missed > 0, engines != ["updates"], "{report}");
        let failure = &report.failures[0];
        assert!(failure.what.contains(word), "{report}");
        assert!(report.to_string().contains(&failure.replay));
        match &failure.explain {
            Some(explain) => {
                assert!(explain.overlaps && Some(explain.pair) == failure.pair, "{report}");
                assert!(mode == "all" || explain.mode.starts_with(mode), "{report}");
            }
            None => assert!(["spheres", "scenes", "updates"].contains(&engines[0]), "{report}"),
        }
        let one = Cases::One { seed: failure.case };
        assert_eq!(&run(&one, &mut broken, |_, _| {}).failures[0], failure);
        assert!(run(&one, &mut sound, |_, _| {}).is_clean());
    }
}

/// A subject that declines every scene.
struct Decliner;

impl Engine for Decliner {
    fn name(&self) -> EngineName {
        EngineName::GpuGrid
    }

    fn cull(
        &mut self,
        _: &CullInput<'_>,
        _: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        Err(CullError::TooCrowded { engine: self.name() })
    }
}

#[test]
fn what_is_left_to_others_is_counted_and_proves_nothing() {
    let pool = Arc::new(rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread"));
    let decliner = |form| -> Box<dyn Subject> {
        let culls = Culls::Boxes(Box::new(Decliner));
        Box::new(CullSubject::new(culls, "declines", form, Encoding::Sparse, &pool))
    };
    let mut subjects = vec![decliner(Form::Boxes), decliner(Form::Mode(modes::Usage::Q8))];
    let report = run(&Cases::One { seed: 1 }, &mut subjects, |_, _| {});
    assert_eq!((report.answers, report.checked(), report.failures.len()), (2, 0, 0));
    assert!(!report.is_clean() && report.to_string().contains("nothing was checked"), "{report}");

    subjects.extend(roster(&["cpu-sap"], "all", None).subjects().expect("CPU engines"));
    let report = run(&Cases::One { seed: 1 }, &mut subjects, |_, _| {});
    assert_eq!(report.checked(), report.answers - 2);
    let skipped: Vec<&str> = report.skipped.iter().map(|s| s.subject.as_str()).collect();
    assert_eq!(skipped, [subjects[0].name(), subjects[1].name()]);
    let text = report.to_string();
    assert!(report.is_clean() && text.contains("2 skipped, 0 missed, 0 extra"), "{report}");
}

#[test]
fn a_run_without_answers_is_not_clean() {
    assert!(!run(&Cases::One { seed: 1 }, &mut [], |_, _| {}).is_clean());
    let nobody = roster(&["spheres"], "q16", None).subjects();
    assert!(nobody.is_err_and(|error| error.to_string().contains("nothing to run")));
}

/// Engines of a GPU: right ones pass in every mode, broken ones are caught.
#[test]
fn engines_of_a_gpu_pass_in_every_mode_and_broken_ones_are_caught_and_replayed() {
    let stress = |engine: EngineName, sabotage, cases: &Cases| {
        let wanted = roster(&[engine.as_str()], "all", sabotage);
        let roster = Roster { gpu: pairmask_tests::gpu::choice(), ..wanted };
        let mut subjects = roster.subjects().unwrap_or_else(|error| panic!("{error}"));
        assert!(subjects.iter().all(|subject| subject.engine() == engine.as_str()));
        run(cases, &mut subjects, |_, _| {})
    };
    for engine in [EngineName::GpuBrute, EngineName::GpuGrid] {
        let report = stress(engine, None, &Cases::Run { seed: 5, time: Duration::from_secs(2) });
        assert!(report.is_clean() && report.checked() == report.answers, "{report}");
        for mode in ["q16", "q8", "f16", "margin", "f64"] {
            assert!(report.subjects.iter().any(|name| name.contains(mode)), "{report:?}");
        }
    }
    for sabotage in [Sabotage::Lossy, Sabotage::Inward] {
        // Long enough for a software adapter to meet the broken part many times.
        let cases = Cases::Run { seed: 6, time: Duration::from_secs(60) };
        let report = stress(EngineName::GpuGrid, Some(sabotage), &cases);
        assert!(report.missed > 0 && report.extra == 0, "{report}");
        let failure = &report.failures[0];
        assert!(failure.replay.contains("--engine gpu-grid"), "{report}");
        let again = Cases::One { seed: failure.case };
        assert!(!stress(EngineName::GpuGrid, Some(sabotage), &again).is_clean());
        assert!(stress(EngineName::GpuGrid, None, &again).is_clean());
    }
}
