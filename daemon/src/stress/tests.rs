use super::*;
use pairmask::engine::EngineName;

use crate::execute::gpu::GpuChoice;

fn roster(broken: bool) -> Roster {
    let entrants = vec![Entrant::Engine(EngineName::CpuSap), Entrant::Engine(EngineName::CpuGrid)];
    Roster { entrants, threads: 2, gpu: GpuChoice::None, broken }
}

#[test]
fn right_engines_pass_and_the_run_is_counted() {
    let mut subjects = roster(false).subjects().expect("CPU engines");
    let cases = Cases::Run { seed: 1, time: Duration::from_millis(200) };
    let report = run(&cases, &mut subjects, |_, _| {});
    assert!(report.is_clean(), "{report}");
    assert_eq!(report.answers, report.cases * subjects.len() as u64);
}

#[test]
fn a_broken_engine_is_caught_and_its_case_replayed() {
    let mut subjects = roster(true).subjects().expect("CPU engines");
    let cases = Cases::Run { seed: 1, time: Duration::from_secs(60) };
    let report = run(&cases, &mut subjects, |_, _| {});
    assert!(!report.is_clean() && report.missed > 0 && report.extra == 0, "{report}");
    let failure = &report.failures[0];
    let explain = failure.explain.as_ref().expect("a pair is missing");
    assert!(explain.overlaps && Some(explain.pair) == failure.pair, "{report}");
    assert!(report.to_string().contains(&failure.replay));

    let again = run(&Cases::One { seed: failure.case }, &mut subjects, |_, _| {});
    assert_eq!(&again.failures[0], failure);
    let mut sound = roster(false).subjects().expect("CPU engines");
    assert!(run(&Cases::One { seed: failure.case }, &mut sound, |_, _| {}).is_clean());
}

#[test]
fn a_run_of_nobody_is_not_clean() {
    let report = run(&Cases::One { seed: 1 }, &mut [], |_, _| {});
    assert!(!report.is_clean());
}

#[test]
fn spheres_take_part_and_broken_ones_are_caught() {
    let roster = |broken| Roster { entrants: vec![Entrant::Spheres], ..roster(broken) };
    let cases = Cases::Run { seed: 2, time: Duration::from_secs(2) };
    let report = run(&cases, &mut roster(false).subjects().expect("CPU engines"), |_, _| {});
    assert!(report.is_clean(), "{report}");
    let cases = Cases::Run { seed: 2, time: Duration::from_secs(60) };
    let report = run(&cases, &mut roster(true).subjects().expect("CPU engines"), |_, _| {});
    assert!(report.missed > 0 && report.extra == 0, "{report}");
    let failure = &report.failures[0];
    assert!(failure.explain.is_none() && failure.what.contains("Sphere"), "{report}");
}
