//! Frames of spheres: every session backend has the answers of exact arithmetic, also when the
//! daemon dies.

use pairmask::FrameInfo;
use pairmask_core::ObjectForm;
use pairmask_lab::stress::SphereCase;
use pairmask_tests::frames::served_by;
use pairmask_tests::prelude::*;
use pairmask_tests::spheres::{check_mask, cull, hard_scene, truth, whole_scene};

/// A session of a backend, and the side that must serve it.
struct Setup {
    session: Session,
    encoding: Encoding,
    expected: ServedBy,
    what: String,
}

impl Setup {
    fn check(&mut self, spheres: &[Sphere], truth: &oracle::Truth) {
        let mask = served_by(self.expected, || cull(&mut self.session, spheres));
        let info: FrameInfo = *mask.info();
        let what = format!("{}, {} spheres, {}", self.what, spheres.len(), info.engine);
        assert_eq!((info.form, info.widening), (ObjectForm::Spheres, Widening::None), "{what}");
        assert_eq!(info.box_bytes, 16 * spheres.len() as u64, "{what}");
        mask.view().verify().unwrap();
        assert_eq!(check_mask(&mask, self.encoding, truth), Ok(()), "{what}");
    }
}

fn setups(daemon: &TestDaemon) -> Vec<Setup> {
    let mut setups = Vec::new();
    for (backend, expected) in [
        (Backend::Daemon, ServedBy::Daemon),
        (Backend::Auto, ServedBy::Daemon),
        (Backend::InProcess, ServedBy::InProcess),
    ] {
        for engine in
            [EngineChoice::Auto].into_iter().chain(EngineName::CPU.map(EngineChoice::Only))
        {
            // One session of Backend::Auto is enough to see that it takes the daemon.
            if backend == Backend::Auto && engine != EngineChoice::Auto {
                continue;
            }
            for encoding in [Encoding::Dense, Encoding::Sparse] {
                let builder = daemon.session().backend(backend).engine(engine);
                let builder = builder.encoding(EncodingChoice::Only(encoding));
                setups.push(Setup {
                    session: builder.connect().unwrap(),
                    encoding,
                    expected,
                    what: format!("{backend}, {engine}, {encoding}"),
                });
            }
        }
    }
    setups
}

fn daemon() -> TestDaemon {
    TestDaemon::start(&["--gpu", "none", "--max-clients", "32"])
}

/// Every size, scenes that aim at borders, and large ones that touch.
#[test]
fn scenes_by_every_backend_engine_and_encoding() {
    let daemon = daemon();
    let mut setups = setups(&daemon);
    let of = |spheres: Vec<Sphere>| {
        let truth = truth(&spheres);
        (spheres, truth)
    };
    let sizes = (0..=70).chain([130, 255, 256, 257, 345]).map(|n| of(hard_scene(n, 1)));
    let borders = 0..if tier::is_nightly() { 100 } else { 40 };
    let borders = borders.map(|seed| of(SphereCase::new(seed).spheres));
    let large = [(1234, 40), (5000, 60)].map(|(n, side)| whole_scene(n, side, 3));
    assert!(large.iter().all(|(spheres, truth)| truth.pairs.len() > spheres.len() / 2));
    for (spheres, truth) in sizes.chain(borders).chain(large) {
        for setup in &mut setups {
            setup.check(&spheres, &truth);
        }
    }
    // More bytes than the session's first segment holds, and words for several tasks.
    let many: Vec<Sphere> =
        (0..150_000).map(|i| Sphere::new([(i % 400) as f32, (i / 400) as f32, 0.0], 0.5)).collect();
    for setup in &mut setups {
        if setup.encoding == Encoding::Dense || setup.what.contains("cpu-brute") {
            continue;
        }
        // Each touches the next in its row and in its column.
        let mask = cull(&mut setup.session, &many);
        assert_eq!(mask.count(), 399 * 375 + 400 * 374, "{}", setup.what);
        assert!(mask.contains(0, 1) && mask.contains(0, 400) && !mask.contains(0, 401));
        assert!(!mask.contains(399, 400), "the next row begins elsewhere");
    }
}

#[test]
fn the_comparator_notices_an_ulp_and_a_class() {
    let mut session = in_process();
    let row = |radius| {
        let [a, b] = [0.0, 4.0].map(|x| Sphere::new([x, 0.0, 0.0], 1.0));
        vec![a, Sphere::new([2.0, 0.0, 0.0], radius), b]
    };
    let (touching, less) = (row(1.0), row(1.0f32.next_down()));
    let mut verdict = |answered: &[Sphere], other: &[Sphere]| {
        check_mask(&cull(&mut session, answered), Encoding::Dense, &truth(other))
    };
    assert_eq!(verdict(&touching, &touching), Ok(()));
    assert_eq!(verdict(&less, &less), Ok(()));
    assert_eq!(verdict(&touching, &less), Err(Mismatch::Extra([0, 1])));
    assert_eq!(verdict(&less, &touching), Err(Mismatch::Missing([0, 1])));
    // Only the census distinguishes spheres that touch no other from empty and invalid ones.
    let apart = |radius| vec![Sphere::new([0.0; 3], 1.0), Sphere::new([9.0, 0.0, 0.0], radius)];
    for wrong in [-1.0, f32::NAN] {
        let verdict = verdict(&apart(1.0), &apart(wrong));
        assert!(matches!(verdict, Err(Mismatch::Census { .. })), "{verdict:?}");
    }
}

#[test]
fn boxes_and_spheres_may_be_under_way_at_once() {
    let daemon = daemon();
    let boxes = stress_scenes::named("uniform").boxes(345, 1);
    let expected = oracle::truth(&boxes);
    let (spheres, truth) = whole_scene(345, 12, 5);
    for backend in [Backend::Daemon, Backend::InProcess] {
        let sparse = EncodingChoice::Only(Encoding::Sparse);
        let mut session = daemon.session().backend(backend).encoding(sparse).connect().unwrap();
        for _ in 0..5 {
            let mut first = session.frame(boxes.len()).unwrap();
            let mut second = session.sphere_frame(spheres.len()).unwrap();
            assert_eq!(second.is_shared(), backend == Backend::Daemon);
            first.boxes_mut().copy_from_slice(&boxes);
            second.spheres_mut().copy_from_slice(&spheres);
            assert_eq!(second.spheres(), &spheres[..]);
            let (first, second) = (first.submit().unwrap(), second.submit().unwrap());
            let (second, first) = (second.wait().unwrap(), first.wait().unwrap());
            assert_eq!(first.info().form, BoxForm::F32.into());
            assert_eq!(first.sorted(), expected.pairs);
            assert_eq!(check_mask(&second, Encoding::Sparse, &truth), Ok(()));
        }
    }
}

/// Spheres are answered between frames of boxes that a GPU works on.
#[test]
fn spheres_pass_boxes_that_a_gpu_works_on() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let mut busy = daemon.connect_to(EngineName::GpuGrid);
    let boxes = stress_scenes::named("uniform").boxes(33_000, 1);
    let expected = in_process().answer(&boxes).sorted();
    let mut session = daemon.connect();
    let (spheres, truth) = whole_scene(700, 15, 2);
    for _ in 0..3 {
        let pending = [busy.ask(&boxes), busy.ask(&boxes)];
        let mask = cull(&mut session, &spheres);
        assert_eq!(check_mask(&mask, mask.encoding(), &truth), Ok(()));
        assert_eq!(mask.info().served_by, ServedBy::Daemon);
        for frame in pending {
            let mask = frame.wait().unwrap();
            assert_eq!(mask.info().engine, EngineName::GpuGrid);
            assert_eq!(mask.sorted(), expected);
        }
    }
}
