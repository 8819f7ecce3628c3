use std::sync::Arc;

use pairmask_core::engine::{
    CullError, CullInput, CullReport, Engine, EngineName, HeapReply, ReplyBuffer,
};
use pairmask_core::sphere::Sphere;
use pairmask_core::{Aabb, BoxClass, Encoding};
use pairmaskd::execute::gpu::GpuChoice;

use super::roster::Culler;
use super::*;
use crate::sabotage::Sabotage;
use crate::study::spheres::oracle;

fn roster(engines: &[&str], mode: &str, sabotage: Option<Sabotage>) -> Roster {
    let is_on_gpu = engines.iter().any(|name| name.starts_with("gpu"));
    let engines = engines.iter().map(|name| (*name).to_owned()).collect();
    let requested = Requested { engines, modes: vec![mode.to_owned()], threads: 2 };
    let gpu = if is_on_gpu { pairmask_tests::gpu::choice() } else { GpuChoice::None };
    Roster { requested, gpu, sabotage }
}

fn run_for(seed: u64, ms: u64, subjects: &mut [Subject]) -> StressReport {
    run(seed, Some(Duration::from_millis(ms)), subjects, |_, _| {})
}

/// Each kind of subject passes as it is, and is caught where it is broken; its case is given again.
#[test]
fn right_subjects_pass_and_broken_ones_are_caught_and_replayed() {
    let (lossy, inward) = (Sabotage::Lossy, Sabotage::Inward);
    // Long enough for a software adapter to meet the broken part many times.
    for (engines, mode, ms, sabotage, word) in [
        (&["cpu-sap", "cpu-grid"][..], "all", 300, lossy, "is missing"),
        (&["spheres"], "all", 300, lossy, "Sphere"),
        (&["cpu-sap"], "q16", 300, inward, "q16"),
        (&["cpu-sap"], "q8", 300, inward, "q8"),
        (&["cpu-sap"], "f16", 300, inward, "f16"),
        (&["cpu-sap"], "margin", 300, inward, "margin"),
        (&["cpu-sap"], "f64", 300, inward, "around"),
        (&["gpu-brute"], "all", 2_000, lossy, "is missing"),
        (&["gpu-grid"], "all", 2_000, lossy, "is missing"),
        (&["gpu-grid"], "all", 2_000, inward, "is missing"),
    ] {
        let subjects = |sabotage| roster(engines, mode, sabotage).subjects().expect("engines");
        let (mut sound, mut broken) = (subjects(None), subjects(Some(sabotage)));
        assert!(sound.iter().all(|subject| engines.contains(&subject.engine)));
        let report = run_for(1, ms, &mut sound);
        assert!(report.is_clean() && report.checked() == report.answers, "{report}");
        assert_eq!(report.answers, report.cases * sound.len() as u64);
        if mode == "all" && engines[0].contains("pu-") {
            for mode in ["q16", "q8", "f16", "margin", "f64"] {
                assert!(report.subjects.iter().any(|name| name.contains(mode)), "{report:?}");
            }
        }

        let report = run_for(1, 60_000, &mut broken);
        assert!(!report.is_clean() && report.extra == 0, "{engines:?} {mode}: {report}");
        assert!(report.missed > 0, "{report}");
        let failure = &report.failures[0];
        assert!(failure.found.what.contains(word), "{report}");
        assert!(report.to_string().contains(&failure.replay));
        assert!(failure.replay.contains(&format!("--engine {}", engines[0])) || engines.len() > 1);
        match &failure.explain {
            Some(explain) => {
                let fields = &explain.fields;
                let pair = serde_json::json!(failure.found.pair);
                assert!(fields["overlaps"] == true && fields["pair"] == pair, "{report}");
                let is_its = fields["mode"].as_str().is_some_and(|its| its.starts_with(mode));
                assert!(mode == "all" || is_its, "{report}");
            }
            None => assert_eq!(engines, ["spheres"], "{report}"),
        }
        assert_eq!(&run(failure.case, None, &mut broken, |_, _| {}).failures[0], failure);
        assert!(run(failure.case, None, &mut sound, |_, _| {}).is_clean());
    }
}

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
    let decliner = |form| {
        let (engine, pool, reply) = (Box::new(Decliner), Arc::clone(&pool), HeapReply::new());
        let encoding = Encoding::Sparse;
        Culler { engine, form, encoding, pool, reply, is_broken: false }.subject("declines")
    };
    let mut subjects = vec![decliner(Form::Boxes), decliner(Form::Mode(modes::Usage::Q8))];
    let report = run(1, None, &mut subjects, |_, _| {});
    assert_eq!((report.answers, report.checked(), report.failures.len()), (2, 0, 0));
    assert!(!report.is_clean() && report.to_string().contains("nothing was checked"), "{report}");

    subjects.extend(roster(&["cpu-sap"], "all", None).subjects().expect("CPU engines"));
    let report = run(1, None, &mut subjects, |_, _| {});
    assert_eq!(report.checked(), report.answers - 2);
    let skipped: Vec<&str> = report.skipped.iter().map(|s| s.subject.as_str()).collect();
    assert_eq!(skipped, [&subjects[0].name, &subjects[1].name]);
    let text = report.to_string();
    assert!(report.is_clean() && text.contains("2 skipped, 0 missed, 0 extra"), "{report}");
}

#[test]
fn a_run_without_answers_is_not_clean() {
    assert!(!run(1, None, &mut [], |_, _| {}).is_clean());
}

/// What is drawn is the same for a seed, as many as asked for, and what its name says.
#[test]
fn scenes_and_changes_are_what_their_names_say() {
    let bytes = |boxes: &[Aabb]| bytemuck::cast_slice::<Aabb, u8>(boxes).to_vec();
    let share = |boxes: &[Aabb], class| {
        boxes.iter().filter(|b| b.class() == class).count() as f64 / boxes.len() as f64
    };
    let pairs = |boxes: &[Aabb]| pairmask_core::oracle::truth(boxes).pairs;
    for scene in scenes::ALL {
        assert_eq!(bytes(&scene.boxes(70, 1)), bytes(&scene.boxes(70, 1)), "{scene:?}");
    }
    let uniform = scenes::named("uniform");
    assert_ne!(uniform.boxes(70, 1), uniform.boxes(70, 2));
    let named = |name| scenes::named(name).boxes(345, 3);
    assert!((0.2..0.7).contains(&share(&named("empty mixed in"), BoxClass::Empty)));
    assert!(share(&named("nan in each slot"), BoxClass::Invalid) > 0.8);
    assert!(share(&named("signed zeroes"), BoxClass::Valid) > 0.2);
    assert!(named("subnormals").iter().all(|b| b.max[0].abs() < f32::MIN_POSITIVE));
    assert!(share(&named("random key order"), BoxClass::Valid) > 0.9);
    assert!(pairs(&named("lattice")).len() > 3 * 345, "corners touch");
    for name in ["uniform", "flat"] {
        assert!((345 / 4..345 * 4).contains(&pairs(&named(name)).len()), "{name}");
    }
    for (name, make_scene) in hard::ALL {
        for n in [0, 1, 345] {
            let make = || make_scene(n, &mut Random::new(9));
            assert_eq!((make().len(), bytes(&make())), (n, bytes(&make())), "{name}");
            assert!(n == 0 || share(&make(), BoxClass::Valid) >= 0.8, "{name}");
        }
        // Moving every face out by an ulp must change the pairs, else the scene does not test borders.
        if ["chain of touching boxes", "grid borders", "quantisation borders"].contains(name) {
            let boxes = make_scene(345, &mut Random::new(4));
            let wider =
                |b: &Aabb| Aabb { min: b.min.map(f32::next_down), max: b.max.map(f32::next_up) };
            let wider: Vec<Aabb> = boxes.iter().map(wider).collect();
            assert!(pairs(&wider).len() > pairs(&boxes).len(), "{name}");
        }
    }
    for (name, apply) in changes::ALL {
        for n in [0, 1] {
            apply(&mut vec![Aabb::from([0.0; 6]); n], &mut Random::new(5));
        }
        let (before, mut after) = (uniform.boxes(345, 1), uniform.boxes(345, 1));
        apply(&mut after, &mut Random::new(3));
        let is_changed = bytes(&before) != bytes(&after);
        assert!(is_changed || *name == "zeros of either sign", "{name}");
        let class = match *name {
            "empty boxes" => BoxClass::Empty,
            "NaN in some slots" => BoxClass::Invalid,
            _ => BoxClass::Valid,
        };
        assert!(share(&after, class) > 0.08, "{name}");
        assert!(*name != "mirrored" || pairs(&before) == pairs(&after));
    }
    // An ulp less of every radius must lose pairs, else the spheres do not touch.
    let mut lost = 0;
    for SphereCase { spheres, pairs } in (0..40).map(SphereCase::new) {
        let less = |r: f32| if r > 0.0 { r.next_down() } else { r };
        let smaller = spheres.iter().map(|s| Sphere::new(s.center, less(s.radius)));
        lost += pairs.len() - oracle::pairs(&smaller.collect::<Vec<_>>()).len();
    }
    assert!(lost > 100, "{lost} pairs were on the edge");
}
