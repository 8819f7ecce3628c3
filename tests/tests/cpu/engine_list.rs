//! Checks of the list of engines: unique names and numbers, and descriptors that agree with the engines.

use pairmask_tests::prelude::*;
use std::collections::BTreeSet;

/// The wire contract names every engine with its number.
const WIRE: &str = include_str!("../../../client-lib/wire/WIRE.md");

#[test]
fn names_and_numbers_distinguish_engines() {
    let all = EngineName::ALL;
    let names: BTreeSet<_> = all.map(EngineName::as_str).into();
    let numbers: BTreeSet<_> = all.map(|engine| engine as u32).into();
    assert_eq!((names.len(), numbers.len()), (all.len(), all.len()));
    assert!(!numbers.contains(&0), "0 is the plan's choice");
    for (slot, engine) in all.into_iter().enumerate() {
        assert_eq!(engine.ordinal(), slot);
        assert_eq!(EngineName::from_wire(engine as u32), Some(engine));
        assert_eq!(EngineName::from_name(engine.as_str()), Some(engine));
        assert!(!["auto", "all", "spheres", "updates"].contains(&engine.as_str()), "{engine}");
        let listed = format!("{} `{engine}`", engine as u32);
        assert!(WIRE.contains(&listed), "WIRE.md lacks {listed}");
    }
}

#[test]
fn every_cpu_engine_is_made_and_has_terms_of_its_own() {
    for engine in EngineName::ALL {
        assert!(!engine.descriptor().encodings.is_empty(), "{engine}");
        let terms = engine.descriptor().cpu().map_or(0, |cpu| cpu.terms.len());
        assert_eq!(terms == 0, engine.is_gpu(), "{engine}");
        for isa in Isa::ALL {
            let made = cpu_engine(engine, isa).ok().map(|made| made.name());
            let expected = (isa.is_available() && !engine.is_gpu()).then_some(engine);
            assert_eq!(made, expected, "{engine}, {isa}");
        }
    }
}

#[test]
fn every_cpu_engine_reads_its_forms_and_refuses_others() {
    let boxes = stress_scenes::named("uniform").boxes(70, 1);
    let mut reply = HeapReply::new();
    for mut engine in cpu_engines() {
        let forms = engine.name().descriptor().forms;
        assert!(forms.contains(&BoxForm::F32), "{}", engine.name());
        for precision in [Precision::Exact, Precision::F16] {
            let memory = NarrowMemory::write(&precision, &boxes);
            let done = engine.cull(&CullInput::boxes(memory.boxes()), &mut reply);
            let form = precision.form();
            match done {
                Ok(_) => assert!(forms.contains(&form), "{}, {form}", engine.name()),
                Err(CullError::Unavailable { .. }) => assert!(!forms.contains(&form)),
                Err(error) => panic!("{error}"),
            }
        }
    }
}

#[test]
fn an_order_is_written_by_those_that_have_one() {
    let boxes = stress_scenes::named("uniform").boxes(345, 1);
    let mut reply = HeapReply::new();
    for mut engine in cpu_engines() {
        let input = CullInput::boxes(&boxes).encoding(Encoding::Sparse);
        let shape = engine.cull(&input, &mut reply).expect("memory").shape;
        let has_order = engine.name().descriptor().has_order;
        let is_ordered = matches!(shape, MaskShape::Sparse { order: Some(_), .. });
        assert_eq!(is_ordered, has_order, "{}", engine.name());
    }
}

#[test]
fn scratch_is_kept_and_given_back() {
    let boxes = stress_scenes::named("uniform").boxes(10_000, 1);
    let mut reply = HeapReply::new();
    for mut engine in cpu_engines() {
        let fresh = engine.scratch_bytes();
        let first = engine.cull(&CullInput::boxes(&boxes), &mut reply).expect("memory").pair_count;
        assert!(engine.scratch_bytes() > fresh, "{}", engine.name());
        engine.give_back();
        assert_eq!(engine.scratch_bytes(), fresh, "{}", engine.name());
        let again = engine.cull(&CullInput::boxes(&boxes), &mut reply).expect("memory").pair_count;
        assert_eq!(first, again);
    }
}
