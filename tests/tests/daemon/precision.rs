//! Precision modes: never a missed pair, and exactly the extra pairs of the mode's definition.

use pairmask_tests::naive_modes::{self, missed};
use pairmask_tests::prelude::*;
use pairmaskd::scene::{Scene, SceneName};

/// Bounds that contain the scenes, cut them, and lie apart from them.
fn all_bounds(boxes: &[Aabb]) -> Vec<Bounds> {
    let corners = |low: f32, high: f32| Bounds::new([low; 3], [high; 3]).unwrap();
    vec![
        Bounds::around(boxes),
        corners(0.0, 50.0),
        corners(-1e-44, 1e-44),
        corners(f32::MIN, f32::MAX),
        corners(7.0, 7.0),
        corners(1e6, 1e6 + 1.0),
    ]
}

fn all_modes(boxes: &[Aabb]) -> Vec<Precision> {
    let mut modes = vec![Precision::Exact, Precision::F16];
    modes.extend(all_bounds(boxes).into_iter().flat_map(|b| [Precision::Q16(b), Precision::Q8(b)]));
    modes
}

/// Culls in a mode and checks the answer against both oracles.
fn check(
    session: &mut Session,
    boxes: &[Aabb],
    precision: Precision,
    one_by_one: bool,
    what: &str,
) {
    let mut frame = session.narrow_frame(boxes.len(), precision).unwrap();
    if one_by_one {
        boxes.iter().enumerate().for_each(|(i, b)| frame.set(i, b));
    } else {
        frame.write(boxes).unwrap();
    }
    let mask = frame.submit().unwrap().wait().unwrap();
    let info = mask.info();
    assert_eq!((info.form, info.widening), (precision.form().into(), precision.widening()));
    assert_eq!(info.box_bytes, precision.form().box_bytes() as u64 * boxes.len() as u64);
    let pairs = mask.sorted();
    let (exact, expected) = (oracle::truth(boxes), naive_modes::truth(boxes, &precision));
    let what = format!("{what}, {} boxes, {precision:?}, {}", boxes.len(), info.engine);
    assert_eq!(missed(&pairs, &exact.pairs), [] as [Pair; 0], "{what}");
    assert_eq!(check_pairs(&pairs, &expected.pairs), Ok(()), "{what}");
    assert_eq!(info.census, exact.census, "{what}");
}

fn sessions() -> (TestDaemon, Vec<Session>) {
    let daemon = TestDaemon::of_cores();
    let backends = [Backend::Daemon, Backend::InProcess];
    let sessions = backends.map(|b| daemon.session().backend(b).connect().unwrap());
    (daemon, sessions.into())
}

#[test]
fn every_mode_answers_as_it_is_defined_on_every_stress_scene() {
    let (_daemon, mut sessions) = sessions();
    for scene in stress_scenes::ALL {
        let sizes = match scene.name() {
            "empty mixed in" => (0..=70).chain([345]).collect(),
            _ if tier::is_nightly() => tier::small_sizes(),
            _ => vec![0, 2, 33, 70, 345],
        };
        for n in sizes {
            let boxes = scene.boxes(n, 5);
            for precision in all_modes(&boxes) {
                for session in &mut sessions {
                    check(session, &boxes, precision, n % 2 == 0, scene.name());
                }
            }
        }
    }
}

#[test]
fn every_mode_answers_as_it_is_defined_by_each_engine_of_a_gpu() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    for engine in [EngineName::GpuBrute, EngineName::GpuGrid] {
        let mut session = daemon.connect_to(engine);
        for n in [2, 345] {
            let boxes = stress_scenes::named("uniform").boxes(n, 5);
            for precision in all_modes(&boxes) {
                check(&mut session, &boxes, precision, false, "uniform");
            }
        }
    }
}

#[test]
fn every_scene_in_motion_by_every_engine() {
    let daemon = TestDaemon::of_cores();
    for engine in EngineName::CPU {
        let mut session = daemon.connect_to(engine);
        for name in SceneName::ALL {
            let n = if name.is_quadratic() { 300 } else { 1234 };
            let mut scene = Scene::new(name, n, 2);
            let bounds = Bounds::around(scene.boxes());
            for precision in [Precision::Q16(bounds), Precision::Q8(bounds), Precision::F16] {
                check(&mut session, scene.boxes(), precision, false, name.as_str());
                scene.step();
            }
        }
    }
}

/// Large enough for every conversion to go through the pool.
#[test]
fn large_scenes_miss_nothing_and_add_little() {
    let (_daemon, mut sessions) = sessions();
    for name in [SceneName::Uniform, SceneName::Pile] {
        let scene = Scene::new(name, 100_000, 1);
        let bounds = Bounds::around(scene.boxes());
        let pairs = |session: &mut Session, precision| {
            session.ask_narrow(scene.boxes(), precision).wait().unwrap().sorted()
        };
        let exact = pairs(&mut sessions[0], Precision::Exact);
        let answers = [0, 1].map(|i| pairs(&mut sessions[i], Precision::Q16(bounds)));
        assert_eq!(answers[0], answers[1], "both backends");
        assert_eq!(missed(&answers[0], &exact), [] as [Pair; 0]);
        let extra = answers[0].len() - exact.len();
        assert!(100 * extra <= exact.len(), "{name}: {extra} extra of {}", exact.len());
        println!("{name}: {extra} extra pairs of {} by q16", exact.len());
    }
}

#[test]
fn the_comparator_catches_rounding_inward() {
    let boxes = stress_scenes::named("lattice").boxes(345, 1);
    let bounds = Bounds::new([-2.0; 3], [6.3; 3]).unwrap();
    let (exact, expected) =
        (oracle::truth(&boxes), naive_modes::truth(&boxes, &Precision::Q8(bounds)));
    assert_eq!(missed(&expected.pairs, &exact.pairs), [] as [Pair; 0]);
    let position = |x: f32, axis: usize| {
        let (low, high) = (f64::from(bounds.low()[axis]), f64::from(bounds.high()[axis]));
        (f64::from(x) - low) * 256.0 / (high - low)
    };
    // Min to the next cell border and max to the one before: touching boxes are separated.
    let inward = naive_modes::truth_by(&boxes, |x, axis, up| {
        if up { position(x, axis).floor() } else { position(x, axis).ceil() }
    });
    assert!(!missed(&inward.pairs, &exact.pairs).is_empty());
    assert!(matches!(check_pairs(&inward.pairs, &expected.pairs), Err(Mismatch::Missing(_))));
    // One border farther outward than the mode rounds: no pair is missed, and more pairs are extra.
    let outward = naive_modes::truth_by(&boxes, |x, axis, up| {
        position(x, axis).floor() + if up { 40.0 } else { 0.0 }
    });
    assert_eq!(missed(&outward.pairs, &exact.pairs), [] as [Pair; 0]);
    assert!(matches!(check_pairs(&outward.pairs, &expected.pairs), Err(Mismatch::Extra(_))));
}

#[test]
fn a_daemon_that_dies_under_a_narrow_frame_costs_no_pair() {
    let mut daemon = TestDaemon::of_cores();
    let mut session = daemon.connect_auto();
    let boxes = stress_scenes::named("uniform").boxes(345, 6);
    let precision = Precision::Q8(Bounds::around(&boxes));
    let expected = naive_modes::truth(&boxes, &precision).pairs;
    let mut frame = session.narrow_frame(boxes.len(), precision).unwrap();
    assert!(frame.is_shared());
    frame.write(&boxes).unwrap();
    daemon.kill();
    let mask = frame.submit().unwrap().wait().unwrap();
    assert_eq!(mask.info().served_by, ServedBy::InProcess);
    assert_eq!(mask.info().form, BoxForm::Q8.into());
    assert_eq!(mask.sorted(), expected);
}
