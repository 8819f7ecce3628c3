//! A session that falls back logs that once, and logs once when the daemon answers again.

use log::{Level, LevelFilter};
use pairmask_tests::library_log::{capture, take_captured};
use pairmask_tests::prelude::*;
use pairmask_wire::InstanceName;

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");

fn frames(session: &mut Session, count: usize) -> ServedBy {
    let mut last = ServedBy::InProcess;
    for _ in 0..count {
        let mut frame = session.frame(2).unwrap();
        frame.boxes_mut().fill(pairmask_core::Aabb::EMPTY);
        last = frame.submit().unwrap().wait().unwrap().info().served_by;
    }
    last
}

#[test]
fn falling_back_is_said_once() {
    let _alone = crate::alone();
    capture(LevelFilter::Info);
    let mut daemon = TestDaemon::start(DAEMON, &[]);
    let mut session = daemon.session().backend(Backend::Auto).connect().unwrap();
    assert_eq!(frames(&mut session, 10), ServedBy::Daemon);
    assert_eq!(take_captured(), []);

    daemon.kill();
    assert_eq!(frames(&mut session, 100), ServedBy::InProcess);
    let lost = take_captured();
    assert_eq!(lost.len(), 1, "{lost:?}");
    assert!(lost[0].0 == Level::Warn && lost[0].1.contains("answered in process"), "{lost:?}");

    daemon.restart();
    eventually("the session is back", || {
        (frames(&mut session, 1) == ServedBy::Daemon).then_some(())
    });
    assert_eq!(frames(&mut session, 100), ServedBy::Daemon);
    let back = take_captured();
    assert_eq!(back.len(), 1, "{back:?}");
    assert!(back[0].0 == Level::Info && back[0].1.contains("answers again"), "{back:?}");

    // A daemon whose record says wire 1.0 gets narrow boxes as f32.
    let mut record = daemon.record().unwrap();
    record.version.minor = 0;
    daemon.dir().write_record(&InstanceName::default(), &record).unwrap();
    let mut session = daemon.session().connect().unwrap();
    for _ in 0..10 {
        let mut frame = session.narrow_frame(2, Precision::F16).unwrap();
        frame.fill(&[pairmask_core::Aabb::EMPTY; 2]);
        assert_eq!(frame.submit().unwrap().wait().unwrap().info().form, BoxForm::F32.into());
    }
    let exact = take_captured();
    assert_eq!(exact.len(), 1, "{exact:?}");
    assert!(exact[0].0 == Level::Warn && exact[0].1.contains("frames are exact"), "{exact:?}");

    // Frames of spheres are answered in process.
    let mut session = daemon.session().backend(Backend::Auto).connect().unwrap();
    for _ in 0..10 {
        let mut frame = session.sphere_frame(2).unwrap();
        frame.spheres_mut().fill(pairmask_core::Sphere::EMPTY);
        let mask = frame.submit().unwrap().wait().unwrap();
        assert_eq!(mask.info().served_by, ServedBy::InProcess);
        assert_eq!(frames(&mut session, 1), ServedBy::Daemon);
    }
    let spheres = take_captured();
    assert_eq!(spheres.len(), 1, "{spheres:?}");
    let (level, said) = &spheres[0];
    assert!(*level == Level::Warn && said.contains("does not know spheres"), "{spheres:?}");
}
