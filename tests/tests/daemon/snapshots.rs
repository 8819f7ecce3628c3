//! Scenes that go back to snapshots, against the model: in process, by daemons of cores and of a GPU, with margins, and
//! when the daemon is killed.

use std::cell::{Cell, RefCell};
use std::time::Duration;

use pairmask::{Margin, Scene, SceneEdit, SceneOptions};
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::{
    Edits, Grouped, Kind, Moment, Op, Received, Script, Seen, SessionScene, Subject, hold_all,
    hold_scripts, script_with_snapshots,
};

/// Edits, snapshots and restores: about as many of each.
fn hold_kinds<S: Subject>(
    seed: u64,
    kinds: [(Kind, usize); 3],
    subject: impl FnMut(&Script) -> S,
) -> Seen {
    hold_all(script_with_snapshots, seed, kinds, subject)
}

fn kinds(quick: [usize; 3], nightly: [usize; 3]) -> [(Kind, usize); 3] {
    let [small, crowd, large] = tier::nightly_or(nightly, quick);
    [(Kind::Small, small), (Kind::Crowd, crowd), (Kind::Large, large)]
}

#[test]
fn scenes_in_process_go_back() {
    let mut session = in_process();
    hold_kinds(200_000, kinds([4_000, 60, 60], [100_000, 2_000, 1_000]), |script| {
        SessionScene::of(&mut session, script, ServedBy::InProcess, EngineName::CpuGrid)
    });
}

#[test]
fn scenes_of_a_daemon_go_back() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--audit", "1/1"]);
    let mut session = daemon.connect();
    let mut scene = |script: &Script| {
        SessionScene::of(&mut session, script, ServedBy::Daemon, EngineName::CpuGrid)
    };
    hold_kinds(210_000, kinds([2_000, 30, 30], [40_000, 500, 500]), &mut scene);
    let mut seed = 211_000;
    daemon.audit_is_clean(|audit| {
        seed += 100;
        let script_of = |seed| script_with_snapshots(Kind::Small, seed);
        hold_scripts(Kind::Small, script_of, seed, 200, &mut scene);
        audit.frames > 100 && audit.pairs > 1_000
    });
}

#[test]
fn scenes_of_a_gpu_go_back() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let engine = EngineName::GpuGrid;
    let mut session = daemon.connect_to(engine);
    hold_kinds(220_000, kinds([400, 20, 20], [10_000, 100, 100]), |script| {
        SessionScene::of(&mut session, script, ServedBy::Daemon, engine)
    });
}

#[test]
fn scenes_with_margins_go_back() {
    let daemon = TestDaemon::of_cores();
    for session in &mut [in_process(), daemon.connect()] {
        hold_kinds(230_000, kinds([1_500, 20, 20], [100_000, 500, 500]), |script| {
            SessionScene::margined(session, script, |_| ())
        });
    }
}

/// The worker, or all of the daemon, is killed between edits, during them, and before the scene goes back.
#[test]
fn scenes_go_back_after_their_daemon_was_killed() {
    let daemon = RefCell::new(TestDaemon::of_cores());
    let mut session = daemon.borrow().session().backend(Backend::Auto).connect().unwrap();
    let (served, kills) = (Cell::new(0), Cell::new(0));
    let disturb = |moment: Moment| match moment {
        // Time to come back.
        Moment::Answered(ServedBy::InProcess, _) => std::thread::sleep(Duration::from_millis(20)),
        Moment::Answered(..) => served.set(served.get() + 1),
        Moment::UnderWay if served.get() > tier::nightly_or(80, 8) => {
            served.set(0);
            kills.set(kills.get() + 1);
            std::thread::sleep(Duration::from_micros(kills.get() as u64 * 37 % 300));
            if kills.get() % 4 == 0 {
                daemon.borrow_mut().kill();
                daemon.borrow_mut().restart();
            } else {
                daemon.borrow().signal_worker(Signal::KILL);
            }
        }
        Moment::UnderWay => {}
    };
    let all = kinds([300, 20, 20], [50_000, 200, 200]);
    hold_kinds(240_000, all, |script| SessionScene::disturbed(&mut session, script, &disturb));
    hold_kinds(241_000, all, |script| SessionScene::margined(&mut session, script, &disturb));
    assert!(kills.get() > 10, "{}", kills.get());
}

fn committed(scene: &mut Scene, ops: &[Op], report: Report) -> Received {
    let grouped = Grouped::of(ops);
    let edit = grouped.steps().into_iter().fold(scene.edit(), SceneEdit::step);
    Received::from(&edit.commit(report).unwrap())
}

/// Plays eight ticks, goes back, and plays them again.
fn check_again(session: &mut Session, options: &SceneOptions, seed: u64) {
    let mut edits = Edits::new(seed, 60);
    let mut scene = session.scene(options.clone()).unwrap();
    let report = |tick: u64| match (seed + tick) % 7 {
        0 => Report::Nothing,
        1 => Report::Moved,
        2 => Report::All,
        _ => Report::Changes,
    };
    for tick in 0..seed % 5 {
        committed(&mut scene, &edits.next_edit(), report(tick));
    }
    let before = scene.snapshot().unwrap();
    let all: Vec<Vec<Op>> = (0..8).map(|_| edits.next_edit()).collect();
    let play = |scene: &mut Scene, from: u64| -> Vec<Received> {
        let ticks = (from..).zip(&all[from as usize..]);
        ticks.map(|(tick, ops)| committed(scene, ops, report(seed + tick))).collect()
    };
    let first = play(&mut scene, 0);
    scene.restore(before).unwrap();
    assert_eq!(play(&mut scene, 0), first, "seed {seed}");
    // From the middle, from a snapshot that was taken after going back.
    scene.restore(before).unwrap();
    for (tick, ops) in (0..4).zip(&all) {
        assert_eq!(committed(&mut scene, ops, report(seed + tick)), first[tick as usize]);
    }
    let middle = scene.snapshot().unwrap();
    for snapshot in [middle, before, middle] {
        let from = if snapshot == before { 0 } else { 4 };
        scene.restore(snapshot).unwrap();
        assert_eq!(play(&mut scene, from), first[from as usize..], "seed {seed}");
    }
}

#[test]
fn the_same_ticks_have_the_same_answers_again() {
    let daemons = [&["--gpu", "none"][..], &["--gpu", "software"]].map(TestDaemon::start);
    let by_gpu = daemons[1].connect_to(EngineName::GpuGrid);
    let mut sessions = [in_process(), daemons[0].connect(), by_gpu];
    let plain = SceneOptions::default();
    let exact = plain.clone().with_margin(Margin::new(0.7).unwrap());
    let near = exact.clone().with_near_pairs(true);
    for seed in 0..tier::nightly_or(400, 24) {
        for session in &mut sessions {
            for options in [&plain, &exact, &near] {
                check_again(session, options, seed);
            }
        }
    }
}

#[test]
fn what_has_no_snapshots_says_so() {
    let daemon = TestDaemon::of_cores();
    let mut shared = daemon.connect().scene(SceneOptions::default().with_shared("town")).unwrap();
    assert!(matches!(shared.snapshot(), Err(Error::SharedSnapshot)));
    let mut session = in_process();
    let mut scene = session.scene(SceneOptions::default()).unwrap();
    let snapshot = scene.snapshot().unwrap();
    drop(scene.edit().set(3, at(0.0)).commit(Report::Changes).unwrap());
    scene.forget_snapshot(snapshot).unwrap();
    assert!(matches!(scene.restore(snapshot), Err(Error::Snapshot(_))));
    assert!(matches!(scene.forget_snapshot(snapshot), Err(Error::Snapshot(_))));
    assert_eq!(scene.len(), 1);
}

/// What happens between an acknowledged answer and a snapshot is reported again, also of boxes that are what they were.
#[test]
fn what_was_yet_to_be_reported_is_reported_again() {
    let daemon = TestDaemon::of_cores();
    let plain = SceneOptions::default();
    let exact = plain.clone().with_margin(Margin::new(0.7).unwrap());
    let near = exact.clone().with_near_pairs(true);
    for session in &mut [in_process(), daemon.connect()] {
        for options in [&plain, &exact, &near] {
            let mut scene = session.scene(options.clone()).unwrap();
            drop(scene.edit().set(0, at(0.0)).set(1, at(0.5)).commit(Report::Changes).unwrap());
            let first = scene.snapshot().unwrap();
            // Another box, equal to the one before; and one that was sent anew, and is back.
            let renewed = scene.edit().remove(0).set(0, at(0.0)).set(1, at(9.0));
            drop(renewed.commit(Report::Nothing).unwrap());
            drop(scene.edit().set(1, at(0.5)).commit(Report::Nothing).unwrap());
            let sent = scene.inflated(1);
            let second = scene.snapshot().unwrap();
            let mut played = Vec::new();
            for snapshot in [second, second, first, second] {
                scene.restore(snapshot).unwrap();
                if snapshot == second {
                    assert_eq!(scene.inflated(1), sent);
                    played.push(committed(&mut scene, &[], Report::Changes));
                }
            }
            let [one, two] = [played[0].begun.len(), played[0].ended.len()];
            assert_eq!([one, two], [1; 2], "it ended, and began");
            assert!(played.iter().all(|again| *again == played[0]));
        }
    }
}

#[test]
fn a_restore_that_is_refused_leaves_what_was_reported() {
    let (daemon, mut session) = served();
    let mut scene = session.scene(SceneOptions::default()).unwrap();
    drop(scene.edit().set(0, at(0.0)).set(1, at(9.0)).commit(Report::Changes).unwrap());
    let apart = scene.snapshot().unwrap();
    drop(scene.edit().set(1, at(0.5)).commit(Report::Changes).unwrap());
    daemon.signal_worker(Signal::KILL);
    eventually("the daemon is back", || session.frame(1).ok()?.submit().ok()?.wait().ok());
    let frames = [(); 3].map(|()| session.frame(1).unwrap());
    assert!(matches!(scene.restore(apart), Err(Error::TooManyFrames)));
    drop(frames);
    // Another daemon is sent the scene, which went nowhere.
    assert_eq!(scene.query(&[at(0.0)]).unwrap().count(), 2);
    let answer = scene.edit().commit(Report::Changes).unwrap();
    assert!(answer.is_resync());
    assert_eq!(answer.pairs(), [[0, 1]]);
    drop(answer);
    scene.restore(apart).unwrap();
    let answer = scene.edit().set(1, at(0.5)).commit(Report::Changes).unwrap();
    assert_eq!(answer.begun(), [[0, 1]]);
}
