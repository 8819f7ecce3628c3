//! GPU engines as subjects of `stress`: right ones pass in every mode, broken ones are caught.

use std::time::Duration;

use pairmask_core::EngineName;
use pairmask_lab::sabotage::Sabotage;
use pairmask_lab::stress::{Cases, Roster, StressReport, Wanted, run};
use pairmask_tests::gpu::choice;

/// Long enough for a software adapter to meet the broken part many times.
const PATIENCE: Duration = Duration::from_secs(60);

fn stress(engine: EngineName, sabotage: Option<Sabotage>, cases: &Cases) -> StressReport {
    let engines = vec![engine.as_str().to_owned()];
    let wanted = Wanted { engines, modes: vec!["all".to_owned()], threads: 1 };
    let roster = Roster { wanted, gpu: choice(), sabotage };
    let mut subjects = roster.subjects().unwrap_or_else(|error| panic!("{error}"));
    assert!(subjects.iter().all(|subject| subject.engine() == engine.as_str()));
    run(cases, &mut subjects, |_, _| {})
}

#[test]
fn right_engines_pass_in_every_mode() {
    for engine in [EngineName::GpuBrute, EngineName::GpuGrid] {
        let report = stress(engine, None, &Cases::Run { seed: 5, time: Duration::from_secs(2) });
        assert!(report.is_clean() && report.checked() == report.answers, "{report}");
        for mode in ["q16", "q8", "f16", "margin", "f64"] {
            assert!(report.subjects.iter().any(|name| name.contains(mode)), "{report:?}");
        }
    }
}

#[test]
fn a_lossy_grid_and_modes_that_round_inward_are_caught_and_replayed() {
    for sabotage in [Sabotage::Lossy, Sabotage::Inward] {
        let cases = Cases::Run { seed: 6, time: PATIENCE };
        let report = stress(EngineName::GpuGrid, Some(sabotage), &cases);
        assert!(report.missed > 0 && report.extra == 0, "{report}");
        let failure = &report.failures[0];
        assert!(failure.replay.contains("--engine gpu-grid"), "{report}");
        let again = Cases::One { seed: failure.case };
        assert!(!stress(EngineName::GpuGrid, Some(sabotage), &again).is_clean());
        assert!(stress(EngineName::GpuGrid, None, &again).is_clean());
    }
}
