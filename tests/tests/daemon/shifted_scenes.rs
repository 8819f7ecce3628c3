//! Scenes whose origin moves report what one does that stays where it is.

use pairmask::{EditError, Ended, Margin, Scene, SceneEdit, SceneOptions};
use pairmask_tests::prelude::*;
use pairmask_tests::stress_scenes::Rng;

const INDICES: u32 = 80;

#[derive(Clone, Copy)]
enum Change {
    Set(u32, Aabb),
    Remove(u32),
    Enable(u32, bool),
    Static(u32, bool),
}

/// Some changes of boxes of quarters, each index at most once.
fn some_changes(rng: &mut Rng, present: &mut [bool]) -> Vec<Change> {
    let mut changes = Vec::new();
    let step = 1 + rng.below(30);
    let mut index = rng.below(step);
    while index < INDICES {
        let mut point = || rng.point().map(|x| (x * 48.0).floor() / 4.0);
        let (min, edges) = (point(), point());
        let b = Aabb::new(min, std::array::from_fn(|axis| min[axis] + edges[axis] / 4.0));
        let is_there = &mut present[index as usize];
        changes.push(match rng.below(8) {
            0 if *is_there => Change::Remove(index),
            1 if *is_there => Change::Enable(index, rng.below(2) == 0),
            2 if *is_there => Change::Static(index, rng.below(2) == 0),
            3 => Change::Set(index, Aabb::EMPTY),
            _ => Change::Set(index, b),
        });
        *is_there = !matches!(changes.last(), Some(Change::Remove(_)));
        index += 1 + rng.below(step);
    }
    changes
}

type Said = (bool, Vec<Pair>, Vec<Ended>, Vec<Pair>);

/// Makes the changes where the scene's origin is now. An answer that is dropped unread counts as lost.
fn answered(
    scene: &mut Scene,
    changes: &[Change],
    origin: [f32; 3],
    report: Report,
    reads: bool,
) -> Option<Said> {
    let edit = changes.iter().fold(scene.edit(), |edit: SceneEdit<'_, '_>, change| match *change {
        Change::Set(index, b) => {
            let (moved, is_exact) = b.moved(origin);
            assert!(is_exact);
            edit.set(index, moved)
        }
        Change::Remove(index) => edit.remove(index),
        Change::Enable(index, on) => edit.set_enabled(index, on),
        Change::Static(index, on) => edit.make_static(index, on),
    });
    let pending = edit.submit(report).unwrap();
    if !reads {
        return None;
    }
    let answer = pending.wait().unwrap();
    let ended = answer.ended().collect();
    Some((answer.is_resync(), answer.begun().to_vec(), ended, answer.pairs().to_vec()))
}

/// Holds a scene that is moved to one that stays.
fn check(session: &mut Session, options: &SceneOptions, seed: u64, rounds: usize) {
    let mut rng = Rng::new(seed);
    let mut scenes = [(); 2].map(|()| session.scene(options.clone()).unwrap());
    let (mut present, mut origin) = ([false; INDICES as usize], [0.0f32; 3]);
    let mut changed = 0;
    for _ in 0..rounds {
        if rng.below(3) == 0 {
            let by: [f32; 3] = std::array::from_fn(|_| (rng.below(9) as f32 - 4.0) * 512.0);
            scenes[1].shift_origin(by).unwrap();
            origin = std::array::from_fn(|axis| origin[axis] + by[axis]);
        }
        let changes = some_changes(&mut rng, &mut present);
        let report =
            [Report::Changes, Report::Changes, Report::All, Report::Nothing][rng.below(4) as usize];
        let reads = rng.below(5) > 0;
        let [still, moved] = &mut scenes;
        let expected = answered(still, &changes, [0.0; 3], report, reads);
        let found = answered(moved, &changes, origin, report, reads);
        assert_eq!(found, expected, "seed {seed}");
        changed += expected.map_or(0, |(_, begun, ended, _)| begun.len() + ended.len());
        for index in 0..INDICES {
            let b = still.get(index).map(|b| b.moved(origin).0);
            assert_eq!(moved.get(index), b);
        }
    }
    assert!(changed > rounds, "{changed}");
}

#[test]
fn no_pair_begins_or_ends() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--audit", "1/1"]);
    let without = SceneOptions::default().with_most_boxes(INDICES);
    let exact = without.clone().with_margin(Margin::new(0.7).unwrap());
    for session in [&mut in_process(), &mut daemon.connect()] {
        for seed in 0..tier::nightly_or(100, 4) {
            for options in [&without, &exact] {
                check(session, options, seed, 60);
            }
        }
    }
    daemon.audit_is_clean(|audit| audit.pairs > 0);
}

#[test]
fn no_pair_begins_or_ends_in_video_memory() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let mut session = daemon.connect_to(EngineName::GpuGrid);
    for seed in 10..12 {
        check(&mut session, &SceneOptions::default().with_most_boxes(INDICES), seed, 30);
    }
}

#[test]
fn a_shift_that_f32_does_not_hold_is_refused_and_the_scene_stays() {
    let mut session = in_process();
    let far = Aabb::new([0.1; 3], [0.3; 3]);
    let boxes = [Aabb::new([1.0; 3], [2.0; 3]), far, Aabb::new([1.5; 3], [3.0; 3])];
    let near = SceneOptions::default().with_margin(Margin::new(0.7).unwrap()).with_near_pairs(true);
    for (options, boxes, by, refused) in [
        (SceneOptions::default(), &boxes[..], [16.0, 0.0, 0.0], Some(1)),
        (SceneOptions::default(), &boxes[..1], [f32::MAX, 0.0, 0.0], Some(0)),
        (SceneOptions::default(), &boxes[..1], [f32::NAN, 0.0, 0.0], Some(0)),
        (SceneOptions::default(), &boxes[..1], [0.0, f32::INFINITY, 0.0], Some(0)),
        (SceneOptions::default(), &[], [f32::NAN; 3], None),
        // Where pairs are those of inflated boxes, f32 has to hold these.
        (near, &boxes[..1], [4_096.0, 0.0, 0.0], Some(0)),
    ] {
        let mut scene = session.scene(options).unwrap();
        drop(scene.edit().set_all(0..boxes.len() as u32, boxes).commit(Report::Changes).unwrap());
        match (scene.shift_origin(by), refused) {
            (Ok(()), None) => {}
            (Err(Error::Edit(EditError::InexactShift { index })), Some(refused)) => {
                assert_eq!(index, refused);
            }
            (other, _) => panic!("{other:?}"),
        }
        assert!((0..).zip(boxes).all(|(index, b)| scene.get(index) == Some(*b)));
        let answer = scene.edit().commit(Report::Changes).unwrap();
        assert!(answer.begun().is_empty() && answer.ended().count() == 0 && !answer.is_resync());
    }
}
