//! Scenes whose boxes have margins: few boxes are sent, and the pairs are those of the model of scenes without.

use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use pairmask::{EditError, Margin, MarginStats, Scene, SceneEdit, SceneOptions};
use pairmask_lab::stress::{FloatFlags, Rounding};
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::{
    Edits, Grouped, Kind, Moment, Op, Received, SessionScene, a_margin, hold, margins_for,
};
use pairmask_tests::stress_scenes::Rng;
use pairmaskd::scene::{Random, Scene as World, SceneName};

fn margin(units: f32) -> Margin {
    Margin::new(units).unwrap()
}

/// Options of a scene with margins, none of which is usual.
fn with_margins(near_pairs: bool) -> SceneOptions {
    SceneOptions::default().with_margin(Margin::default()).with_near_pairs(near_pairs)
}

fn stats_of(scene: &Scene) -> MarginStats {
    scene.margin_stats().unwrap()
}

/// An edit that sets boxes by their indices and places, all with one margin.
fn moved<'s>(scene: &'s mut Scene, boxes: &[(u32, f32)], units: f32) -> SceneEdit<'s, 'static> {
    let set = |edit: SceneEdit<'s, 'static>, (index, x): &(u32, f32)| {
        edit.set_margined(*index, at(*x), margin(units))
    };
    boxes.iter().fold(scene.edit(), set)
}

/// Holds scenes with margins to the model of scenes without.
fn hold_exact(session: &mut Session, seed: u64, kinds: [(Kind, usize); 2]) {
    for (kind, edits) in kinds {
        hold(kind, seed, edits, |script| SessionScene::margined(session, script, |_| ()));
    }
}

#[test]
fn exact_pairs_are_those_of_a_scene_of_all_boxes() {
    let [small, large] = tier::nightly_or([400_000, 4_000], [1_500, 40]);
    hold_exact(&mut in_process(), 80_000, [(Kind::Small, small), (Kind::Large, large)]);
}

#[test]
fn a_daemon_is_sent_few_boxes_and_the_pairs_are_the_same() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--audit", "1/1"]);
    let mut session = daemon.connect();
    hold_exact(&mut session, 81_000, [(Kind::Small, 600), (Kind::Large, 25)]);
    let mut seed = 82_000;
    daemon.audit_is_clean(|audit| {
        // The auditor gives up a scene that is edited faster than it follows: then there is another one.
        seed += 100;
        hold_exact(&mut session, seed, [(Kind::Small, 200), (Kind::Large, 0)]);
        audit.frames > 50
    });
}

#[test]
fn a_gpu_is_sent_few_boxes_and_the_pairs_are_the_same() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let builder = daemon.session().engine(EngineChoice::Only(EngineName::GpuGrid));
    let mut session = builder.deadline(4 * TIMEOUT).connect().unwrap();
    hold_exact(&mut session, 83_000, [(Kind::Small, 60), (Kind::Large, 8)]);
}

/// The largest gap of two boxes on an axis, and where.
fn gaps(a: &Aabb, b: &Aabb) -> [(f64, f64, f64); 3] {
    std::array::from_fn(|axis| {
        let [a, b] = [a, b].map(|b| (f64::from(b.min[axis]), f64::from(b.max[axis])));
        let (ends, starts) = if a.1 < b.0 { (a.1, b.0) } else { (b.1, a.0) };
        (starts - ends, ends, starts)
    })
}

/// Whether what is known are the near pairs, by the boxes of now.
fn check_near(
    near: &BTreeSet<[u32; 2]>,
    exact: &[[u32; 2]],
    scene: &Scene,
    margins: &BTreeMap<u32, Margin>,
) {
    assert!(exact.iter().all(|pair| near.contains(pair)), "a pair that overlaps is near");
    for pair in near {
        let [a, b] = pair.map(|index| scene.get(index).unwrap());
        assert!([a, b].iter().all(|b| b.class() == BoxClass::Valid), "{pair:?}");
        let reach = pair.map(|index| 4.0 * f64::from(margins[&index].get())).iter().sum::<f64>();
        for (axis, (gap, ends, starts)) in gaps(&a, &b).into_iter().enumerate() {
            // Four margins each; steps of f32 as one margin has them, at the faces that were sent.
            let (ends, starts) = (ends.abs() + reach, starts.abs() + reach);
            let steps = margin(0.0).gap_limit(&Widening::None, axis, ends, starts);
            assert!(gap <= reach + steps, "{pair:?}: a gap of {gap} on axis {axis}, over {reach}");
        }
    }
}

/// Near pairs, accumulated from changes, beside all pairs of the model.
fn near(session: &mut Session, (seed, most_boxes): (u64, u32), edits: usize) {
    let mut rng = Rng::new(seed);
    let usual = a_margin(&mut rng, 0);
    let options = SceneOptions::default().with_margin(usual).with_near_pairs(true);
    let mut scene = session.scene(options).unwrap();
    let mut source = Edits::new(seed, most_boxes);
    let (mut known, mut of_boxes) = (BTreeSet::new(), BTreeMap::new());
    for _ in 0..edits {
        let ops = source.next_edit();
        let grouped = Grouped::of(&ops);
        let margins = margins_for(&grouped, &mut rng, source.model().len());
        of_boxes.extend(grouped.margins_of_boxes(&margins, usual));
        let exact: Vec<[u32; 2]> = source.model().pairs().into_keys().collect();
        let asks_for =
            [Report::Changes, Report::Changes, Report::Changes, Report::Moved, Report::All];
        let report = asks_for[rng.below(5) as usize];
        let pending = grouped.with_margins(scene.edit(), &margins).submit(report).unwrap();
        if report == Report::Changes && rng.below(4) == 0 {
            // Nobody waits for it: the next answer makes up for it.
            drop(pending);
            continue;
        }
        let answer = pending.wait().unwrap();
        if report == Report::Moved {
            let names = ops.iter().filter(|op| !matches!(op, Op::UserData(..)));
            let named: BTreeSet<u32> = names.flat_map(Op::indices).copied().collect();
            let mut of_moved = exact.iter().filter(|pair| pair.iter().any(|i| named.contains(i)));
            let reported: BTreeSet<_> = answer.pairs().iter().collect();
            assert!(of_moved.all(|pair| reported.contains(pair)), "all boxes that the edit names");
            continue;
        }
        let mut received = Received::from(&answer);
        received.is_resync |= report == Report::All;
        received.teach(&mut known);
        drop(answer);
        check_near(&known, &exact, &scene, &of_boxes);
    }
}

#[test]
fn near_pairs_are_reported_once_and_hold_all_that_overlap() {
    for of in [(1, 70), (2, 600), (3, 2_000)] {
        near(&mut in_process(), of, if of.1 == 70 { 800 } else { 200 });
    }
    let daemon = TestDaemon::of_cores();
    near(&mut daemon.connect(), (4, 600), 200);
}

fn pairs_of(scene: &mut Scene, boxes: &[Aabb], margin: Margin) -> Vec<Pair> {
    let edit = scene.edit().set_all_margined(0..boxes.len() as u32, boxes, margin);
    edit.commit(Report::All).unwrap().pairs().iter().collect()
}

#[test]
fn odd_large_scenes_have_the_oracles_pairs() {
    for n in [345, 1_234, 40_003] {
        let mut random = Random::new(n as u64);
        let mut scene = in_process().scene(with_margins(false)).unwrap();
        let mut boxes = World::new(SceneName::Uniform, n, 1).boxes().to_vec();
        for _ in 0..4 {
            assert_eq!(pairs_of(&mut scene, &boxes, margin(0.02)), oracle_pairs(&boxes));
            for b in &mut boxes {
                let by = 0.02 * (random.unit() - 0.5);
                (b.min[0], b.max[0]) = (b.min[0] + by, b.max[0] + by);
            }
        }
        let stats = stats_of(&scene);
        assert!(stats.sent <= stats.set / 2 + 1, "{n}: {stats:?}");
    }
}

/// The oracle's pairs; in a large scene those of an engine, which the oracle was held to.
fn oracle_pairs(boxes: &[Aabb]) -> Vec<[u32; 2]> {
    if boxes.len() < 5_000 {
        return oracle::truth(boxes).pairs;
    }
    in_process().answer(boxes).sorted()
}

#[test]
fn one_that_teleports_among_thousands_that_drift_is_sent_alone() {
    let (n, frames) = (5_000u32, 100u32);
    for is_near in [true, false] {
        let mut random = Random::new(5);
        let mut scene = in_process().scene(with_margins(is_near)).unwrap();
        let mut boxes = World::new(SceneName::Uniform, n as usize, 1).boxes().to_vec();
        let (half, step) = (margin(0.5), 0.5 / 101.0);
        drop(scene.edit().set_all_margined(0..n, &boxes, half).commit(Report::Changes).unwrap());
        for frame in 0..frames {
            for b in &mut boxes {
                (b.min[1], b.max[1]) = (b.min[1] + step, b.max[1] + step);
            }
            let by = 50.0 + 10.0 * random.unit();
            let far = &mut boxes[(frame * 31 % n) as usize];
            (far.min[0], far.max[0]) = (far.min[0] + by, far.max[0] + by);
            let edit = scene.edit().set_all_margined(0..n, &boxes, half);
            assert!(!edit.commit(Report::Changes).unwrap().is_resync());
        }
        let stats = stats_of(&scene);
        assert_eq!(stats.set, u64::from(n * (frames + 1)));
        // Of 505,000 boxes set: all at first, and one a frame.
        assert_eq!(stats.sent, u64::from(n + frames));
        assert_eq!(stats.requests, u64::from(frames + 1));
    }
}

#[test]
fn an_edit_within_margins_needs_no_daemon() {
    let daemon = TestDaemon::of_cores();
    for is_near in [true, false] {
        let mut session = daemon.connect();
        let mut scene = session.scene(with_margins(is_near)).unwrap();
        let edit = moved(&mut scene, &[(1, 0.0), (2, 1.2)], 0.5);
        let answer = edit.commit(Report::Changes).unwrap();
        assert_eq!(answer.served_by(), ServedBy::Daemon);
        assert_eq!(answer.begun().len(), usize::from(is_near));
        drop(answer);

        daemon.signal_worker(Signal::STOP);
        let answer = moved(&mut scene, &[(2, 0.9)], 0.5).commit(Report::Changes).unwrap();
        assert_eq!((answer.served_by(), answer.pair_count()), (ServedBy::InProcess, Some(1)));
        assert_eq!(answer.begun().len(), usize::from(!is_near));
        drop(answer);
        let answer = scene.edit().commit(Report::Changes).unwrap();
        assert!(answer.begun().is_empty() && answer.ended().next().is_none());
        assert_eq!(answer.served_by(), ServedBy::InProcess);
        drop(answer);
        if !is_near {
            let answer = moved(&mut scene, &[(1, -0.4)], 0.5).commit(Report::All).unwrap();
            assert_eq!((answer.pairs().len(), answer.served_by()), (0, ServedBy::InProcess));
        }
        daemon.signal_worker(Signal::CONT);
        assert_eq!((stats_of(&scene).requests, stats_of(&scene).sent), (1, 2));
    }
}

#[test]
fn what_is_wrong_with_an_edit_is_reported_and_changes_nothing() {
    let options = with_margins(false).with_most_boxes(9);
    let mut scene = in_process().scene(options).unwrap();
    let boxes = [at(0.0), at(0.5), at(3.0)];
    drop(scene.edit().set_all_margined(0..3, &boxes, margin(1.0)).commit(Report::Changes).unwrap());
    let (far, three) = ([at(7.0), at(8.0)], [margin(0.0); 3]);
    let edits: [fn(&mut Scene) -> SceneEdit<'_, 'static>; 5] = [
        |scene| moved(scene, &[(9, 0.0)], 0.0),
        |scene| moved(scene, &[(1, 9.0)], 0.0).remove(5),
        // Neither of them has left its margin.
        |scene| moved(scene, &[(1, 0.6), (1, 0.7)], 1.0),
        |scene| moved(scene, &[(1, 0.6)], 1.0).set_enabled(4, true),
        |scene| scene.edit().set_all_margined(0..3, &[Aabb::EMPTY; 2], Margin::default()),
    ];
    for wrong in edits {
        let refused = wrong(&mut scene).commit(Report::All).map(drop);
        assert!(matches!(refused, Err(Error::Edit(_))));
    }
    let edit = scene.edit().set_all_margined(0..2, &far, &three);
    let lengths = edit.commit(Report::All).map(drop);
    let margins = EditError::Margins { boxes: 2, margins: 3 };
    assert!(matches!(lengths, Err(Error::Edit(error)) if error == margins));
    for (index, b) in (0..).zip(boxes) {
        assert_eq!(scene.get(index), Some(b));
    }
    let answer = scene.edit().commit(Report::All).unwrap();
    assert_eq!(answer.pairs(), [[0, 1]]);
}

#[test]
fn a_request_that_could_not_be_sent_changes_nothing() {
    let (_daemon, mut session) = served();
    let mut scene = session.scene(with_margins(false)).unwrap();
    let edit = moved(&mut scene, &[(0, 0.0), (1, 0.5)], 0.1);
    assert_eq!(edit.commit(Report::Changes).unwrap().begun(), [[0, 1]]);
    let frames: Vec<_> = (0..3).map(|_| session.frame(4).unwrap()).collect();
    let full = moved(&mut scene, &[(0, 5.0)], 0.1).commit(Report::All).map(drop).unwrap_err();
    assert!(matches!(full, Error::TooManyFrames), "{full}");
    assert_eq!(scene.get(0), Some(at(0.0)));
    // What needs no request is answered.
    let edit = moved(&mut scene, &[(0, 0.05)], 0.1);
    assert_eq!(edit.commit(Report::All).unwrap().pairs(), [[0, 1]]);
    drop(frames);
    let answer = moved(&mut scene, &[(0, 5.0)], 0.1).commit(Report::Changes).unwrap();
    assert_eq!(answer.ended().next().unwrap().pair, [0, 1]);
}

#[test]
fn exact_changes_go_on_while_worker_and_daemon_are_killed() {
    let daemon = RefCell::new(TestDaemon::of_cores());
    let mut session = daemon.borrow().session().backend(Backend::Auto).connect().unwrap();
    let (edits, random) = (Cell::new(0), RefCell::new(Random::new(11)));
    let served = Cell::new([0, 0]);
    hold(Kind::Small, 84_000, 240, |script| {
        SessionScene::margined(&mut session, script, |moment| {
            if let Moment::Answered(by, _) = moment {
                let [here, there] = served.get();
                let is_there = usize::from(by == ServedBy::Daemon);
                served.set([here + 1 - is_there, there + is_there]);
                return;
            }
            edits.set(edits.get() + 1);
            let mut daemon = daemon.borrow_mut();
            if edits.get() % 12 == 5 {
                std::thread::sleep(Duration::from_micros(random.borrow_mut().below(300)));
            }
            match edits.get() % 24 {
                5 => daemon.signal_worker(Signal::KILL),
                17 => daemon.kill(),
                18 => daemon.restart(),
                // Time to come back.
                0 | 12 => std::thread::sleep(Duration::from_millis(120)),
                _ => {}
            }
        })
    });
    let served = served.get();
    assert!(served.iter().all(|count| *count > 0), "in process, by the daemon: {served:?}");
}

#[test]
fn a_daemon_that_died_costs_a_typed_error_and_no_change() {
    let mut daemon = TestDaemon::of_cores();
    let mut session = daemon.connect();
    let mut scene = session.scene(with_margins(false)).unwrap();
    let edit = moved(&mut scene, &[(1, 0.0), (2, 0.5)], 0.1);
    assert_eq!(edit.commit(Report::Changes).unwrap().begun(), [[1, 2]]);
    daemon.signal_worker(Signal::STOP);
    let edit = moved(&mut scene, &[(3, 1.2)], 0.1).remove(1);
    let pending = edit.submit(Report::Changes).unwrap();
    daemon.kill();
    let error = pending.wait().map(drop).unwrap_err();
    assert!(matches!(error, Error::DaemonDied), "{error}");
    assert_eq!(scene.len(), 2, "the edit was applied");
    daemon.restart();
    eventually("the scene is sent again", || {
        let answer = scene.edit().commit(Report::Changes).ok()?;
        assert!(!answer.is_resync(), "this process knows what was reported");
        assert_eq!((answer.begun().to_vec(), answer.ended().count()), (vec![[2, 3]], 1));
        Some(())
    });
}

#[test]
fn flags_of_the_calling_thread_change_neither_pairs_nor_what_is_sent() {
    let all = Rounding::ALL.map(FloatFlags::rounding);
    let flags = all.into_iter().chain([FloatFlags::FLUSHING]);
    for extent in [1e-42f32, 3e-38, 6e-37, 100.0] {
        let mut random = Random::new(3);
        let n = 600;
        let mut frames = Vec::new();
        let mut boxes: Vec<Aabb> = (0..n)
            .map(|_| {
                let min: [f32; 3] = std::array::from_fn(|_| extent * random.unit());
                Aabb { min, max: min.map(|x| x + 0.1 * extent * random.unit()) }
            })
            .collect();
        for _ in 0..6 {
            frames.push((boxes.clone(), oracle::truth(&boxes).pairs));
            for b in &mut boxes {
                let by = 0.01 * extent * random.unit();
                (b.min[0], b.max[0]) = (b.min[0] + by, b.max[0] + by);
            }
        }
        // The margin is the same number regardless of the flags.
        let margin = margin(0.02 * extent);
        let run = || {
            let mut scene = in_process().scene(with_margins(false)).unwrap();
            for (boxes, pairs) in &frames {
                assert_eq!(pairs_of(&mut scene, boxes, margin), *pairs, "{extent}");
            }
            stats_of(&scene)
        };
        let plain = run();
        assert!(plain.sent < plain.set, "{extent}: {plain:?}");
        for flags in flags.clone() {
            assert_eq!(flags.run(run), plain, "{extent}, {flags}");
        }
    }
}
