//! Work whose client is gone, and answers that fit no reply: neither holds others up.

use pairmask::{Error, SceneOptions};
use pairmask_tests::fault_client::FaultClient;
use pairmask_tests::prelude::*;
use pairmask_wire::{ReplyError, StatusCode};

/// Boxes of a frame that takes the cores minutes where all pairs are tested.
const MANY: usize = 1_000_000;

/// A frame that takes the engines' pool, as the long one does.
fn large_frame_is_answered(session: &mut Session) {
    let boxes: Vec<Aabb> = (0..200_000).map(|i| at(2.0 * i as f32)).collect();
    let mask = session.ask(&boxes).wait().expect("an answer");
    assert_eq!((mask.sorted().len(), mask.info().served_by), (0, ServedBy::Daemon));
}

fn row() -> Vec<Aabb> {
    (0..MANY).map(|i| at(2.0 * i as f32)).collect()
}

#[test]
fn a_client_killed_in_mid_frame_holds_nobody_up() {
    let daemon = TestDaemon::of_cores();
    let worker = daemon.worker();
    let mut other = daemon.connect();
    for _ in 0..2 {
        let mut victim = FaultClient::start(&daemon, &["long", "cpu-brute"]);
        victim.go();
        // Killed with SIGKILL, while its frame is culled or about to be.
        drop(victim);
        large_frame_is_answered(&mut other);
    }
    assert_eq!(daemon.worker(), worker, "no worker had to end for it");
}

#[test]
fn a_frame_that_its_client_lets_go_of_ends_and_is_no_error() {
    let daemon = TestDaemon::of_cores();
    let mut session = daemon.connect_to(EngineName::CpuBrute);
    let mut other = daemon.connect();
    let errors = |session: &mut Session| session.daemon_status().expect("a status").errors;
    let before = errors(&mut other);
    let boxes = row();
    for _ in 0..3 {
        drop(session.ask(&boxes));
        large_frame_is_answered(&mut other);
    }
    assert_eq!(errors(&mut other), before);
    assert_eq!(
        session.ask(&boxes[..100]).wait().expect("an answer").info().served_by,
        ServedBy::Daemon
    );
}

#[test]
fn crowds_are_refused_by_every_engine_and_in_scenes() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--max-reply-mib", "64"]);
    let worker = daemon.worker();
    let n = 300_000;
    let jittered = |i: usize| {
        let [x, y, z] = [i % 7, i / 7 % 11, i / 77 % 13].map(|part| part as f32 * 1e-3);
        Aabb::new([x, y, z], [x + 1.0, y + 1.0, z + 1.0])
    };
    let scenes = [
        vec![at(0.0); n],
        (0..n).map(jittered).collect(),
        vec![Aabb::new([f32::NEG_INFINITY; 3], [f32::INFINITY; 3]); n],
    ];
    let is_refused = |error: Error| {
        matches!(error, Error::Reply(ReplyError::Status { status: StatusCode::ReplyTooLarge, .. }))
    };
    let engines = EngineName::CPU.map(EngineChoice::Only);
    for engine in engines.into_iter().chain([EngineChoice::Auto]) {
        let mut session = daemon.session().engine(engine).connect().expect("the daemon answers");
        for boxes in &scenes {
            let refused = session.ask(boxes).wait().expect_err("it fits no reply");
            assert!(is_refused(refused), "{engine:?}");
        }
        let spheres = vec![Sphere::new([0.0; 3], 1.0); n];
        let mut frame = session.sphere_frame(n).expect("memory");
        frame.spheres_mut().copy_from_slice(&spheres);
        let refused = frame.submit().and_then(Pending::wait).expect_err("it fits no reply");
        assert!(is_refused(refused), "{engine:?}: spheres");
    }
    let mut session = daemon.connect();
    let mut scene = session.scene(SceneOptions::default()).expect("a scene");
    let refused = scene.edit().set_with(0..n as u32, |_| at(0.0)).commit(Report::Changes);
    let refused = refused.map(|_| ()).expect_err("it fits no reply");
    assert!(is_refused(refused), "a scene");
    drop(scene);
    large_frame_is_answered(&mut session);
    assert_eq!(daemon.worker(), worker);
}
