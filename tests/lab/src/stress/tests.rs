use std::sync::Arc;

use pairmask_core::Encoding;
use pairmask_core::engine::{CullInput, CullReport, Engine, EngineName, ReplyBuffer};
use pairmaskd::execute::gpu::GpuChoice;

use super::*;
use crate::sabotage::Sabotage;

fn roster(broken: bool) -> Roster {
    let entrants = vec![Entrant::Engine(EngineName::CpuSap), Entrant::Engine(EngineName::CpuGrid)];
    let modes = vec![ModeChoice::All];
    let sabotage = broken.then_some(Sabotage::Lossy);
    Roster { entrants, modes, threads: 2, gpu: GpuChoice::None, sabotage }
}

#[test]
fn every_mode_that_rounds_inward_is_caught() {
    let entrants = vec![Entrant::Engine(EngineName::CpuSap)];
    for mode in Mode::ALL.into_iter().filter(|mode| *mode != Mode::Exact) {
        let modes = vec![ModeChoice::Only(mode)];
        let roster = Roster { entrants: entrants.clone(), modes, ..roster(false) };
        let broken = Roster { sabotage: Some(Sabotage::Inward), ..roster.clone() };
        let cases = Cases::Run { seed: 4, time: Duration::from_secs(60) };
        let mut subjects = broken.subjects().expect("CPU engines");
        let report = run(&cases, &mut subjects, |_, _| {});
        assert!(report.missed > 0 && report.extra == 0, "{mode}: {report}");
        let failure = &report.failures[0];
        assert_eq!(failure.mode, mode.as_str());
        let explain = failure.explain.as_ref().expect("a pair is missing");
        assert!(explain.overlaps && explain.mode.starts_with(mode.as_str()), "{mode}: {report}");
        let mut sound = roster.subjects().expect("CPU engines");
        assert!(run(&Cases::One { seed: failure.case }, &mut sound, |_, _| {}).is_clean());
    }
}

#[test]
fn spheres_have_no_other_mode_than_exact() {
    let modes = vec![ModeChoice::Only(Mode::Q16)];
    let roster = Roster { entrants: vec![Entrant::Spheres], modes, ..roster(false) };
    assert!(matches!(roster.subjects(), Err(StressError::NoSubject)));
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
    let exact = ExactSubject::new(Box::new(Decliner), "declines", Encoding::Sparse, &pool);
    let mode = ModeSubject::new(Box::new(Decliner), "", modes::Usage::Q8, &pool, false);
    let mut subjects: Vec<Box<dyn Subject>> = vec![Box::new(exact), Box::new(mode)];
    let report = run(&Cases::One { seed: 1 }, &mut subjects, |_, _| {});
    assert_eq!((report.answers, report.checked(), report.failures.len()), (2, 0, 0));
    assert!(!report.is_clean() && report.to_string().contains("nothing was checked"), "{report}");

    subjects.extend(roster(false).subjects().expect("CPU engines"));
    let report = run(&Cases::One { seed: 1 }, &mut subjects, |_, _| {});
    assert_eq!(report.checked(), report.answers - 2);
    let skipped: Vec<&str> = report.skipped.iter().map(|s| s.subject.as_str()).collect();
    assert_eq!(skipped, [subjects[0].name(), subjects[1].name()]);
    let text = report.to_string();
    assert!(report.is_clean() && text.contains("2 skipped, 0 missed, 0 extra"), "{report}");
}

#[test]
fn a_run_without_answers_is_not_clean() {
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

#[test]
fn scenes_take_part_and_broken_ones_are_caught() {
    let roster = |broken| Roster { entrants: vec![Entrant::Scenes], ..roster(broken) };
    let cases = Cases::Run { seed: 3, time: Duration::from_secs(2) };
    let report = run(&cases, &mut roster(false).subjects().expect("cores"), |_, _| {});
    assert!(report.is_clean(), "{report}");
    let cases = Cases::Run { seed: 3, time: Duration::from_secs(60) };
    let report = run(&cases, &mut roster(true).subjects().expect("cores"), |_, _| {});
    assert!(report.missed > 0 && report.extra == 0, "{report}");
}
