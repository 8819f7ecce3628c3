//! The three slots of a session, which frames share with edits, answers and ends of scenes.

use std::time::Duration;

use pairmask::{Scene, SceneOptions};
use pairmask_tests::prelude::*;

/// Scenes of two boxes each, whose one pair was reported.
fn reported_scenes<const N: usize>(session: &mut Session) -> [Scene; N] {
    std::array::from_fn(|_| {
        let mut scene = session.scene(SceneOptions::default()).unwrap();
        let edit = scene.edit().set(0, at(0.0)).set(1, at(0.5));
        assert_eq!(edit.commit(Report::Changes).unwrap().begun(), [[0, 1]]);
        scene
    })
}

/// Adds a box that touches box 1 alone, and waits for nothing.
fn leave_an_edit(scene: &mut Scene) {
    drop(scene.edit().set(2, at(1.2)).submit(Report::Changes).unwrap());
}

/// The answer after [`leave_an_edit`] reports what that would have reported, and what is new.
fn make_up(scene: &mut Scene) {
    let answer = scene.edit().remove(0).commit(Report::Changes).unwrap();
    assert_eq!((answer.served_by(), answer.is_resync()), (ServedBy::Daemon, false));
    assert_eq!(answer.begun(), [[1, 2]]);
    assert_eq!(answer.ended().next().unwrap().pair, [0, 1]);
    assert_eq!(answer.pair_count(), Some(1));
}

fn is_full<T>(result: &Result<T, Error>) -> bool {
    matches!(result, Err(Error::TooManyFrames))
}

#[test]
fn an_edit_that_nobody_waits_for_holds_no_slot() {
    let (_daemon, mut session) = served();
    let mut scenes: [Scene; 5] = reported_scenes(&mut session);
    // The fourth and fifth edit need places too.
    scenes.iter_mut().for_each(leave_an_edit);
    assert_eq!(session.daemon_status().unwrap().scenes, 5);
    assert_eq!(session.answer(&[at(0.0), at(0.5)]).to_vec(), [[0, 1]]);

    let frames: Vec<_> = (0..3).map(|_| session.frame(4).unwrap()).collect();
    assert!(is_full(&session.frame(4)), "three frames hold the three slots");
    let full = scenes[0].edit().set(7, at(0.0)).commit(Report::All).map(drop).unwrap_err();
    assert!(matches!(full, Error::TooManyFrames), "{full}");
    assert_eq!(scenes[0].len(), 3, "the edit was not made");
    drop(frames);
    scenes.iter_mut().for_each(make_up);

    // An edit that somebody waits for keeps its place, and so does an answer.
    let [a, b, c, ..] = &mut scenes;
    let pending = a.edit().set(0, at(0.0)).submit(Report::All).unwrap();
    let answer = b.edit().commit(Report::All).unwrap();
    leave_an_edit(c);
    let frame = session.frame(4).unwrap();
    assert!(is_full(&session.frame(4)));
    assert_eq!(pending.wait().unwrap().pair_count(), Some(2));
    assert_eq!(answer.pair_count(), Some(1));
    drop(frame);

    // A scene that ends by its client ends in the daemon too.
    scenes.iter_mut().for_each(leave_an_edit);
    drop(scenes);
    assert_eq!(session.daemon_status().unwrap().scenes, 0);
}

#[test]
fn a_scene_that_ends_while_there_is_no_slot_ends_in_the_daemon_too() {
    let (daemon, mut session) = served();
    let scenes: [Scene; 5] = reported_scenes(&mut session);
    let frames: Vec<_> = (0..3).map(|_| session.frame(4).unwrap()).collect();
    drop(scenes);
    drop(frames);
    assert_eq!(session.daemon_status().unwrap().scenes, 0);

    // Nor is it lost where the daemon does nothing for longer than the end waits.
    let mut scenes: [Scene; 5] = reported_scenes(&mut session);
    daemon.signal_worker(Signal::STOP);
    scenes[..2].iter_mut().for_each(leave_an_edit);
    drop(scenes);
    daemon.signal_worker(Signal::CONT);
    assert_eq!(session.daemon_status().unwrap().scenes, 0);
}

#[test]
fn a_slot_is_waited_for_while_an_answer_is_under_way() {
    let (daemon, mut session) = served();
    let mut scenes: [Scene; 3] = reported_scenes(&mut session);
    daemon.signal_worker(Signal::STOP);
    scenes.iter_mut().for_each(leave_an_edit);
    std::thread::scope(|threads| {
        threads.spawn(|| {
            std::thread::sleep(Duration::from_millis(50));
            daemon.signal_worker(Signal::CONT);
        });
        // Two scenes on threads of their own, beside frames: the three share the places with the third
        // scene's edit, which nobody waits for.
        for scene in &mut scenes[..2] {
            threads.spawn(|| make_up(scene));
        }
        for _ in 0..20 {
            assert_eq!(session.answer(&[at(0.0), at(0.5)]).to_vec(), [[0, 1]]);
        }
    });
    make_up(&mut scenes[2]);
}

#[test]
fn a_daemon_that_answers_no_edit_is_given_up_by_the_frame_that_needs_its_slot() {
    let daemon = TestDaemon::of_cores();
    let deadline = Duration::from_millis(100);
    let mut strict = daemon.session().deadline(deadline).connect().unwrap();
    let mut session = daemon.session().deadline(deadline).backend(Backend::Auto).connect().unwrap();
    let mut strict_scenes: [Scene; 3] = reported_scenes(&mut strict);
    let mut scenes: [Scene; 3] = reported_scenes(&mut session);
    daemon.signal_worker(Signal::STOP);
    strict_scenes.iter_mut().chain(&mut scenes).for_each(leave_an_edit);
    let silent = strict.frame(2).unwrap_err();
    assert!(matches!(silent, Error::Connect(ConnectError::Silent { .. })), "{silent}");
    let mask = session.answer(&[at(0.0), at(0.5)]);
    assert_eq!((mask.info().served_by, mask.to_vec()), (ServedBy::InProcess, vec![[0, 1]]));
    for scene in &mut scenes {
        let answer = scene.edit().remove(0).commit(Report::Changes).unwrap();
        assert_eq!((answer.served_by(), answer.is_resync()), (ServedBy::InProcess, true));
        assert_eq!(answer.pairs(), [[1, 2]]);
    }
    daemon.signal_worker(Signal::CONT);
    for scene in &mut strict_scenes {
        eventually("the scene is sent again", || {
            let answer = scene.edit().commit(Report::Changes).ok()?;
            assert_eq!(answer.pairs(), [[0, 1], [1, 2]]);
            Some(())
        });
    }
}
