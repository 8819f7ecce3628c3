//! Scenes of sessions, kept by a daemon: where they are kept, limits, and daemons that die. What they report is held to
//! the model.

use pairmask::filters::{Filter, FilterData, FilterId, FilterTable};
use pairmask::{Scene, SceneOptions};
use pairmask_core::scene::{Scene as CoreScene, SceneOptions as CoreOptions};
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::Received;
use pairmask_wire::{ReplyError, StatusCode};
use pairmaskd::scene::Random;

/// Boxes of two crowds, each box in one of them by chance: pairs by the hundred thousand, which a GPU is not
/// expected to mind.
fn crowds(count: u32, random: &mut Random) -> Vec<Aabb> {
    (0..count).map(|i| at(100.0 * random.below(2) as f32 + 0.0005 * i as f32)).collect()
}

#[test]
fn a_scene_moves_to_the_gpu_by_itself_and_its_answers_stay_right() {
    const BOXES: u32 = 1_200;
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let mut session = daemon.connect();
    let options = CoreOptions::default().with_threads(1);
    let mut scene = session.scene(pairmask::SceneOptions::default().with_threads(1)).unwrap();
    let mut here = CoreScene::new(options);
    let mut random = Random::new(7);
    // The engine of an answer that is read.
    let mut edit = |count: u32, is_read: bool| {
        let boxes = crowds(count, &mut random);
        let [step] = sets_all(&boxes);
        let edit = Edit { steps: &[step] };
        let reported = here.edit(edit, Report::Changes).map(Received::from).unwrap();
        // A scene stays where it is while an answer is not read, and the next answer makes up for it.
        if !is_read {
            drop(scene.edit().step(step).submit(Report::Changes).unwrap());
            return None;
        }
        let answer = scene.edit().step(step).commit(Report::Changes).unwrap();
        assert_eq!(answer.served_by(), ServedBy::Daemon);
        // Which engine of the cores searches a whole scene goes by what the daemon has measured of them.
        assert!(Received::from(&answer) == reported);
        here.acknowledge();
        Some(answer.engine())
    };
    assert!(edit(BOXES, true).unwrap() == EngineName::CpuGrid, "a scene begins with the cores");
    until("the scene moves to the GPU", || {
        edit(BOXES, false);
        edit(BOXES, true).unwrap() == EngineName::GpuGrid
    });
    for count in (1..70).chain([BOXES, 345]) {
        let engine = edit(count, count % 3 > 0 || count > 70);
        assert!(engine.is_none_or(|engine| engine == EngineName::GpuGrid), "it stays there");
    }
}

#[test]
fn a_scene_that_is_only_asked_moves_to_the_gpu_and_reports_what_it_has_not_reported() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let mut session = daemon.connect();
    let options = CoreOptions::default().with_threads(1);
    let mut scene = session.scene(pairmask::SceneOptions::default().with_threads(1)).unwrap();
    let mut here = CoreScene::new(options);
    let mut random = Random::new(8);
    let boxes = crowds(2_000, &mut random);
    drop(scene.edit().set_all(0..2_000, &boxes).commit(Report::Nothing).unwrap());
    here.edit(Edit { steps: &sets_all(&boxes) }, Report::Nothing).unwrap();
    let mut expected = Vec::new();
    // A software adapter that was measured on a busy machine pays only for more work.
    let mut sizes = (1_500..6_000).step_by(300);
    until("the scene moves to the GPU", || {
        let queries = crowds(sizes.next().unwrap_or(6_000), &mut random);
        here.query(&queries, QueryFilterData::None, &mut expected).unwrap();
        assert_eq!(scene.query(&queries).unwrap().to_vec(), expected);
        let answer = scene.edit().commit(Report::Nothing).unwrap();
        answer.engine() == EngineName::GpuGrid
    });
    here.edit(Edit::NONE, Report::Changes).unwrap();
    let answer = scene.edit().commit(Report::Changes).unwrap();
    assert_eq!(answer.engine(), EngineName::GpuGrid);
    assert!(Received::from(&answer) == Received::from(here.reported()));
    assert!(answer.begun().len() > 1_000);
}

#[test]
fn scenes_of_a_session_and_of_others_are_kept_apart() {
    let daemon = TestDaemon::of_cores();
    let mut sessions: Vec<Session> = (0..2).map(|_| daemon.connect()).collect();
    let mut scenes: Vec<Scene> =
        (0..6).map(|i| sessions[i % 2].scene(SceneOptions::default()).unwrap()).collect();
    for round in 0..4 {
        for (i, scene) in scenes.iter_mut().enumerate() {
            let shift = 0.1 * i as f32 + round as f32;
            let boxes: Vec<Aabb> = (0..=i).map(|k| at(shift + 0.8 * k as f32)).collect();
            let answer = scene.edit().set_all(0..i as u32 + 1, &boxes).commit(Report::All).unwrap();
            assert_eq!(answer.pairs().len(), i);
        }
    }
    let status = sessions[0].daemon_status().unwrap();
    assert_eq!((status.scenes, status.scene_mib > 0), (6, true));
    drop(scenes.split_off(4));
    assert_eq!(sessions[1].daemon_status().unwrap().scenes, 4);
    // A session that goes away with its scenes.
    drop((scenes, sessions.remove(0)));
    let mut last = sessions.remove(0);
    until("its scenes are freed", || last.daemon_status().unwrap().scenes == 0);
}

/// What outlives a daemon that is killed behind the first edit of a scene.
fn outlive(edit: impl Fn(&mut Scene), check: impl Fn(&mut Session, &mut Scene)) {
    for backend in [Backend::Daemon, Backend::Auto] {
        let daemon = TestDaemon::of_cores();
        let mut session = daemon.session().backend(backend).connect().unwrap();
        let mut scene = session.scene(SceneOptions::default()).unwrap();
        edit(&mut scene);
        let died = daemon.worker();
        daemon.signal_worker(Signal::KILL);
        until("another worker serves", || daemon.worker() != died);
        check(&mut session, &mut scene);
    }
}

/// The first daemon learns of it with an edit that asks for no changes, and dies with it.
#[test]
fn a_resync_that_was_asked_for_outlives_the_daemon() {
    let edit = |scene: &mut Scene| {
        scene.resync();
        let edit = scene.edit().set(1, at(0.0)).set(2, at(0.5));
        assert_eq!(edit.commit(Report::Moved).unwrap().pairs(), [[1, 2]]);
    };
    outlive(edit, |_, scene| {
        let reported = eventually("the scene is answered", || {
            let reported = scene.edit().commit(Report::Changes).ok()?;
            Some((reported.is_resync(), reported.pairs().to_vec()))
        });
        assert_eq!(reported, (true, vec![[1, 2]]));
    });
}

/// Filters and lists that a scene has before it has boxes are sent again too.
#[test]
fn rules_without_boxes_outlive_the_daemon() {
    let apart = FilterTable::new(&[Filter::new(1, 2)]).unwrap();
    let edit = |scene: &mut Scene| {
        let edit = scene.edit().exclude(&[[1, 2]], true).filter_table(&apart);
        drop(edit.commit(Report::Changes).unwrap());
    };
    outlive(edit, |session, scene| {
        // So that the next edit goes to the next daemon at once, and is not sent again with its boxes.
        eventually("the session has the next daemon", || session.daemon_status().ok());
        let boxes = [at(0.0); 4];
        // Those of 3 and 4 have the first filter, which does not admit itself; the others are in no category of it.
        let pairs = eventually("the scene is answered", || {
            let filter_data = [FilterData::default().with_filter(FilterId(7)); 2];
            let edit = scene.edit().set_all(1..5, &boxes).set_all_filters(1..3, &filter_data);
            Some(edit.commit(Report::All).ok()?.pairs().to_vec())
        });
        assert!(!pairs.contains(&[1, 2]) && !pairs.contains(&[3, 4]), "{pairs:?}");
    });
}

#[test]
fn a_daemon_that_died_costs_a_typed_error_and_no_edit() {
    let mut daemon = TestDaemon::of_cores();
    let mut session = daemon.connect();
    let mut scene = session.scene(SceneOptions::default()).unwrap();
    let edit = scene.edit().set(1, at(0.0)).set(2, at(0.5));
    assert_eq!(edit.commit(Report::Changes).unwrap().begun(), [[1, 2]]);

    daemon.signal_worker(Signal::STOP);
    let pending = scene.edit().set(3, at(1.2)).submit(Report::Changes).unwrap();
    daemon.kill();
    let error = pending.wait().map(drop).unwrap_err();
    assert!(matches!(error, Error::DaemonDied), "{error}");
    assert_eq!(scene.len(), 3, "the edit was applied");
    let refused = scene.edit().remove(1).commit(Report::Changes).map(drop).unwrap_err();
    assert!(matches!(refused, Error::Connect(_)), "{refused}");
    assert_eq!(scene.len(), 3, "the edit was not");

    daemon.restart();
    eventually("the scene is sent again", || {
        let answer = scene.edit().commit(Report::Changes).ok()?;
        assert!(answer.is_resync());
        assert_eq!(answer.pairs(), [[1, 2], [2, 3]]);
        Some(())
    });
    let answer = scene.edit().remove(1).commit(Report::Changes).unwrap();
    assert_eq!((answer.is_resync(), answer.ended().next().unwrap().pair), (false, [1, 2]));
}

#[test]
fn a_daemon_without_room_refuses_and_the_client_answers() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--max-memory", "64M"]);
    let boxes: Vec<Aabb> = (0..200_000).map(|i| at(0.7 * i as f32)).collect();
    let mut strict = daemon.connect();
    let mut scene = strict.scene(SceneOptions::default()).unwrap();
    let edit = scene.edit().set_all(0..200_000, &boxes);
    let refused = edit.commit(Report::All).map(drop).unwrap_err();
    let Error::Reply(ReplyError::Status { status, detail }) = refused else {
        panic!("{refused}");
    };
    assert_eq!(status, StatusCode::OverBudget);
    let [needed, limit] = detail;
    assert!(needed > limit && (16 << 20..=32 << 20).contains(&limit), "{needed} {limit}");
    // What was refused was applied here, and so is what makes it fit, though the whole is refused once more.
    assert_eq!(scene.len(), 200_000);
    let refused = scene.edit().remove_all(5..200_000).commit(Report::All).map(drop);
    assert!(matches!(refused, Err(Error::Reply(_))), "{refused:?}");
    assert_eq!(scene.len(), 5);
    let answer = scene.edit().commit(Report::All).unwrap();
    assert_eq!(answer.pairs().len(), 4);
    drop(answer);
    // An index far away takes as much as the boxes before it would.
    let mut sparse = strict.scene(SceneOptions::default()).unwrap();
    assert!(sparse.edit().set(1 << 23, at(0.0)).commit(Report::All).is_err());

    let mut session = daemon.connect_auto();
    let mut scene = session.scene(SceneOptions::default()).unwrap();
    let answer = scene.edit().set_all(0..10, &boxes[..10]).commit(Report::Changes).unwrap();
    assert_eq!((answer.served_by(), answer.begun().len()), (ServedBy::Daemon, 9));
    let all = scene.edit().set_all(0..200_000, &boxes).commit(Report::Changes).unwrap();
    assert_eq!(all.served_by(), ServedBy::InProcess);
    assert!(all.is_resync(), "this process does not know what the daemon reported");
    assert_eq!(all.pairs().len(), 199_999);
    drop(all);
    let fewer = scene.edit().remove_all(5..200_000).commit(Report::Changes).unwrap();
    assert_eq!((fewer.served_by(), fewer.pair_count()), (ServedBy::InProcess, Some(4)));
}

/// Boxes that move are in the scene already: an edit of all needs no room for as many again.
#[test]
fn a_scene_that_fills_more_than_half_of_the_room_moves_as_a_whole() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--max-memory", "64M"]);
    let mut session = daemon.connect();
    let mut scene = session.scene(SceneOptions::default()).unwrap();
    for step in 0..3 {
        let boxes: Vec<Aabb> = (0..60_000).map(|i| at(0.7 * (i + step) as f32)).collect();
        let answer = scene.edit().set_all(0..60_000, &boxes).commit(Report::All).unwrap();
        assert_eq!(answer.pairs().len(), 59_999);
    }
}

#[test]
fn a_daemon_drops_a_scene_that_it_refused_when_the_client_does() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--max-memory", "64M"]);
    let boxes: Vec<Aabb> = (0..200_000).map(|i| at(0.7 * i as f32)).collect();
    for backend in [Backend::Auto, Backend::Daemon] {
        let mut session = daemon.session().backend(backend).connect().unwrap();
        let mut scene = session.scene(SceneOptions::default()).unwrap();
        let few = scene.edit().set_all(0..10, &boxes[..10]).commit(Report::Changes).unwrap();
        assert_eq!(few.served_by(), ServedBy::Daemon);
        drop(few);
        let many = scene.edit().set_all(0..200_000, &boxes).commit(Report::Changes).map(drop);
        assert_eq!(many.is_ok(), backend == Backend::Auto, "{many:?}");
        drop(scene);
        until("the scene has ended", || session.daemon_status().unwrap().scenes == 0);
    }
}

#[test]
fn boxes_by_a_function_go_to_a_daemon_and_are_sent_again() {
    let (daemon, mut session) = served_or_here();
    let mut scene = session.scene(SceneOptions::default()).unwrap();
    for step in 0..6 {
        let shift = 0.3 * step as f32;
        let edit = scene.edit().set_with(0..400, |index| at(0.7 * index as f32 + shift));
        let pending = edit.set_with(&[400], |_| at(0.0)).submit(Report::All).unwrap();
        if step % 2 == 1 {
            daemon.signal_worker(Signal::KILL);
        }
        let answer = pending.wait().unwrap();
        let boxes: Vec<Aabb> =
            (0..400).map(|index| at(0.7 * index as f32 + shift)).chain([at(0.0)]).collect();
        assert_eq!(answer.pairs().to_vec(), oracle::truth(&boxes).pairs);
    }
}

#[test]
fn a_wrong_edit_is_refused_before_it_is_sent() {
    let (_daemon, mut session) = served();
    let mut scene = session.scene(SceneOptions::default().with_most_boxes(9)).unwrap();
    for _ in 0..2 {
        let wrong = scene.edit().set(3, at(0.0)).remove(2).commit(Report::All).map(drop);
        assert!(matches!(wrong, Err(Error::Edit(_))));
        let beyond = scene.edit().set(9, at(0.0)).commit(Report::All).map(drop);
        assert!(matches!(beyond, Err(Error::Edit(_))));
    }
    assert_eq!(session.daemon_status().unwrap().errors, 0, "nothing was sent");
}
