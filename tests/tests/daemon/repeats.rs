//! Whole frames that are equal to the last one: answered without an engine, and no other frame is.

use pairmask_tests::prelude::*;
use pairmask_tests::spheres::whole_scene;

/// Whether a mask was another frame's; its meter says so, and its pairs are those of the boxes.
fn is_repeat(mask: &PairMask, boxes: &[Aabb]) -> bool {
    let truth = oracle::truth(boxes);
    assert_eq!(mask.sorted(), truth.pairs);
    let info = mask.info();
    assert_eq!(info.census, truth.census);
    let (meter, n) = (&info.skipped, boxes.len() as u64);
    assert_eq!(meter.why.total(), meter.pairs);
    if meter.is_repeat() {
        assert_eq!((meter.boxes, meter.why.unmoved), (n, n * (n - 1) / 2));
        assert_eq!(info.times.execute_ns, 0, "no engine worked");
    }
    meter.is_repeat()
}

fn backends(daemon: &TestDaemon) -> [(ServedBy, pairmask::SessionBuilder); 2] {
    let builder = daemon.session();
    [
        (ServedBy::Daemon, builder.clone()),
        (ServedBy::InProcess, builder.backend(Backend::InProcess)),
    ]
}

#[test]
fn equal_frames_are_not_culled_and_one_changed_box_is_found_at_once() {
    let daemon = TestDaemon::start(&[]);
    for (served_by, builder) in backends(&daemon) {
        for n in [40_usize, 300, 2_000] {
            let mut session = builder.clone().connect().unwrap();
            let mut boxes = stress_scenes::named("uniform").boxes(n as u32, 3);
            boxes[n / 2] = Aabb::EMPTY;
            let mut repeats = Vec::new();
            for _ in 0..5 {
                let mask = session.answer(&boxes);
                assert_eq!(mask.info().served_by, served_by);
                repeats.push(is_repeat(&mask, &boxes));
            }
            assert_eq!(repeats, [false, false, true, true, true], "{served_by:?} {n}");
            // Every box in turn: most are in no sample.
            for i in (0..n).step_by(n / 20) {
                boxes[i] = boxes[(i + 1) % n];
                let mask = session.answer(&boxes);
                assert!(!is_repeat(&mask, &boxes), "{served_by:?} {n} {i}");
                for _ in 0..4 {
                    is_repeat(&session.answer(&boxes), &boxes);
                }
            }
        }
    }
}

#[test]
fn a_named_engine_and_a_session_that_asks_for_it_cull_every_frame() {
    let daemon = TestDaemon::start(&[]);
    let boxes = stress_scenes::named("uniform").boxes(300, 4);
    for (served_by, builder) in backends(&daemon) {
        let named = builder.clone().engine(EngineChoice::Only(EngineName::CpuGrid));
        for builder in [named, builder.answer_repeats(false)] {
            let mut session = builder.connect().unwrap();
            for _ in 0..6 {
                assert!(!is_repeat(&session.answer(&boxes), &boxes), "{served_by:?}");
            }
        }
    }
}

type Submit<'s> = &'s dyn Fn(&mut Session) -> Pending<PairMask>;

#[test]
fn narrow_boxes_and_spheres_are_answered_again_too() {
    let daemon = TestDaemon::start(&[]);
    let boxes = stress_scenes::named("uniform").boxes(300, 5);
    let spheres: Vec<Sphere> = whole_scene(300, 25, 6).0;
    let bounds = Bounds::new([0.0; 3], [100.0; 3]).unwrap();
    let narrow = |precision| {
        let boxes = &boxes;
        move |session: &mut Session| session.ask_narrow(boxes, precision)
    };
    let [q16, q8, f16] =
        [Precision::Q16(bounds), Precision::Q8(bounds), Precision::F16].map(narrow);
    let of_spheres = |session: &mut Session| session.ask_spheres(&spheres);
    let ways: [Submit<'_>; 4] = [&q16, &q8, &f16, &of_spheres];
    for (served_by, builder) in backends(&daemon) {
        let mut session = builder.connect().unwrap();
        for (way, submit) in ways.iter().enumerate() {
            let masks = [(); 4].map(|()| {
                let mask = submit(&mut session).wait().unwrap();
                // The second frame may be another engine's, in another order.
                (mask.info().skipped.is_repeat(), mask.sorted())
            });
            let repeats = masks.each_ref().map(|(repeat, _)| *repeat);
            assert_eq!(repeats, [false, false, true, true], "{served_by:?} {way}");
            assert!(masks.iter().all(|(_, pairs)| *pairs == masks[0].1));
        }
    }
}

#[test]
fn another_sessions_frame_is_never_answered_again() {
    let daemon = TestDaemon::start(&[]);
    let scenes = [7, 8].map(|seed| stress_scenes::named("uniform").boxes(200, seed));
    let mut sessions = [(); 2].map(|()| daemon.connect());
    for round in 0..5 {
        for (session, boxes) in sessions.iter_mut().zip(&scenes) {
            assert_eq!(is_repeat(&session.answer(boxes), boxes), round >= 2);
        }
    }
    // A session that comes later begins anew, also with boxes that were seen.
    let mut third = daemon.connect();
    assert!(!is_repeat(&third.answer(&scenes[0]), &scenes[0]));
}

#[test]
fn frames_under_way_together_are_answered_each_with_its_own_pairs() {
    let daemon = TestDaemon::start(&[]);
    let scenes = [9, 10].map(|seed| stress_scenes::named("uniform").boxes(3_000, seed));
    let mut session = daemon.connect();
    for round in 0..40 {
        // Runs of equal frames of two scenes, two frames at a time.
        let pending = [0, 1].map(|i| {
            let boxes = &scenes[(round + i) / 7 % 2];
            (session.ask(boxes), boxes)
        });
        for (pending, boxes) in pending {
            is_repeat(&pending.wait().unwrap(), boxes);
        }
    }
}

/// Answers that are given again are audited as others are.
#[test]
fn the_auditor_checks_them() {
    let daemon = TestDaemon::start(&["--audit", "1/1"]);
    let boxes = stress_scenes::named("uniform").boxes(500, 11);
    let mut session = daemon.connect();
    let mut repeats = 0;
    for _ in 0..10 {
        repeats += u64::from(is_repeat(&session.answer(&boxes), &boxes));
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    assert_eq!(repeats, 8);
    daemon.audit_is_clean(|audit| audit.frames + audit.skipped == 10);
    // Two windows are in circulation: the third frame that is checked is a repeat.
    daemon.audit_is_clean(|audit| {
        is_repeat(&session.answer(&boxes), &boxes);
        audit.frames > 2
    });
}
