//! Scenes that several sessions write: who is late or refused, and what it receives.
#![allow(clippy::single_range_in_vec_init)] // Lists of ranges are meant.

use std::collections::BTreeSet;
use std::ops::Range;
use std::time::{Duration, Instant};

use pairmask::filters::{Filter, FilterTable};
use pairmask::{AtEnd, EditError, EndReason, Ended, Margin, Scene, SceneOptions, Scope};
use pairmask_core::scene::shared::{LeaseError, NotLeased};
use pairmask_tests::prelude::*;

/// A deadline that a machine under load does not reach.
pub(super) const LONG: Duration = Duration::from_secs(5);

/// A member, and the pairs that it knows by the answers that it took.
pub(super) struct Member {
    pub session: Session,
    pub scene: Scene,
    pub own: Range<u32>,
    pub known: BTreeSet<Pair>,
}

impl Member {
    pub fn join(daemon: &TestDaemon, name: &str, own: Range<u32>, options: &SceneOptions) -> Self {
        let mut session = daemon.connect();
        let mut scene = session.scene(options.clone().with_shared(name)).unwrap();
        if !own.is_empty() {
            scene.lease(own.clone()).unwrap();
        }
        Self { session, scene, own, known: BTreeSet::new() }
    }
}

#[test]
fn a_late_writer_is_named_and_keeps_its_boxes() {
    let daemon = TestDaemon::of_cores();
    let deadline = Duration::from_millis(150);
    let options = SceneOptions::default().with_tick_deadline(deadline).with_scope(Scope::All);
    let mut one = Member::join(&daemon, "late", 0..10, &options);
    let mut other = Member::join(&daemon, "late", 10..30, &SceneOptions::default());
    // Behind its first lease, and one of somebody else behind that.
    other.scene.lease(30..35).unwrap();
    let third = Member::join(&daemon, "late", 35..40, &SceneOptions::default());
    assert_eq!(other.scene.tick_deadline(), Some(deadline), "who says nothing agrees");
    let pending = other.scene.edit().set(15, at(0.0)).submit(Report::Changes).unwrap();
    drop(one.scene.edit().set(3, at(0.5)).commit(Report::Changes).unwrap());
    drop(pending.wait().unwrap());
    for tick in 2..5 {
        let start = Instant::now();
        let answer = one.scene.edit().set(4, at(0.2)).commit(Report::All).unwrap();
        let took = start.elapsed();
        assert!(took >= deadline && took < deadline + Duration::from_secs(2), "{took:?}");
        assert_eq!((answer.late(), answer.tick()), (&[10..30, 30..35, 35..40][..], Some(tick)));
        assert_eq!(answer.pairs(), [[3, 4], [3, 15], [4, 15]]);
    }
    drop(third);
    // Its next commit is part of the next tick, and has all that it missed.
    let pending = one.scene.edit().submit(Report::Changes).unwrap();
    let answer = other.scene.edit().remove(15).commit(Report::Changes).unwrap();
    assert_eq!((answer.tick(), answer.late()), (Some(5), &[][..]));
    let ended = Ended { pair: [3, 15], reason: EndReason::Removed };
    assert!(answer.ended().eq([ended]));
    drop(answer);
    let answer = pending.wait().unwrap();
    assert_eq!(answer.ended().count(), 2);
}

#[test]
fn what_is_not_its_own_a_member_is_refused() {
    let daemon = TestDaemon::of_cores();
    let mut here = in_process();
    let refused = here.scene(SceneOptions::default().with_shared("rules"));
    assert!(matches!(refused, Err(Error::NeedsDaemon)));
    let options = SceneOptions::default().with_most_boxes(100).with_tick_deadline(LONG);
    let mut one = Member::join(&daemon, "rules", 0..10, &options.clone().with_scope(Scope::All));
    let mut session = daemon.connect();
    for name in ["", "a b", &"x".repeat(65)] {
        let refused = session.scene(SceneOptions::default().with_shared(name));
        assert!(matches!(refused, Err(Error::SceneName(_))), "{name}");
    }
    for other in [
        options.clone().with_most_boxes(101),
        options.clone().with_tick_deadline(Duration::from_secs(1)),
        options.with_at_end(AtEnd::Keep),
    ] {
        let refused = session.scene(other.clone().with_shared("rules"));
        assert!(matches!(refused, Err(Error::TermsDiffer(_))), "{other:?}: {refused:?}");
    }
    let margined = SceneOptions::default().with_margin(Margin::default());
    let mut other = session.scene(margined.with_shared("rules")).unwrap();
    let lease = |scene: &mut Scene, range| match scene.lease(range) {
        Err(Error::Lease(error)) => Some(error),
        Ok(()) => None,
        Err(error) => panic!("{error}"),
    };
    let taken = LeaseError::Taken { first: 0, end: 10 };
    assert_eq!(lease(&mut other, 9..20), Some(taken));
    assert_eq!(lease(&mut other, 90..101), Some(LeaseError::BeyondLimit { end: 101, limit: 100 }));
    assert_eq!(lease(&mut other, 5..5), Some(LeaseError::Empty));
    assert_eq!(lease(&mut other, 20..30), None);
    assert_eq!(other.lease_any(10).unwrap(), 10..20);
    let full = other.lease_any(71).unwrap_err();
    assert!(matches!(full, Error::Lease(LeaseError::Full { count: 71 })));
    let not_own = other.edit().set(9, at(0.0)).commit(Report::Nothing).unwrap_err();
    assert!(matches!(not_own, Error::NotLeased(NotLeased::Index { index: 9 })));
    // What was refused holds nobody up, and a lease that was given back is free.
    let pending = one.scene.edit().set(1, at(0.0)).submit(Report::All).unwrap();
    drop(other.edit().set(12, at(0.0)).set(25, at(0.0)).commit(Report::Nothing).unwrap());
    assert_eq!(pending.wait().unwrap().pairs(), [[1, 12], [1, 25], [12, 25]]);
    other.give_back(10).unwrap();
    assert_eq!((other.len(), other.leases()), (1, &[20..30][..]));
    one.scene.lease(10..15).unwrap();
    let pending = one.scene.edit().set(12, at(7.0)).submit(Report::All).unwrap();
    drop(other.edit().commit(Report::Nothing).unwrap());
    assert_eq!(pending.wait().unwrap().pairs(), [[1, 25]]);
}

#[test]
fn a_tick_has_one_table_of_filters() {
    let daemon = TestDaemon::of_cores();
    let options = SceneOptions::default().with_tick_deadline(LONG).with_scope(Scope::All);
    let mut one = Member::join(&daemon, "tables", 10..20, &options);
    let mut other = Member::join(&daemon, "tables", 20..30, &options);
    let (none_meet, boxes) = (FilterTable::new(&[Filter::new(1, 2)]).unwrap(), [at(0.0); 2]);
    let edit = one.scene.edit().set_all(10..12, &boxes).step(Step::Filters(&none_meet));
    let pending = edit.submit(Report::All).unwrap();
    // The daemon has the first table by now.
    one.session.daemon_status().unwrap();
    other.scene.lease(0..5).unwrap();
    let all_meet = FilterTable::new(&[Filter::new(1, 1)]).unwrap();
    let edit = other.scene.edit().step(Step::Filters(&all_meet));
    let refused = edit.commit(Report::Nothing).map(drop).unwrap_err();
    assert!(matches!(refused, Error::NotLeased(NotLeased::Filters)), "{refused:?}");
    drop(other);
    assert_eq!(pending.wait().unwrap().pairs().len(), 0);
}

pub(super) fn found(scene: &mut Scene, query: Aabb) -> Vec<u32> {
    scene.query(&[query]).unwrap().of_query(0).collect()
}

/// What the first member asks for, and gets of its own pairs where it waits; what the other one sets, and gets.
type MovedTurn<'a> = (Report, Option<&'a [Pair]>, &'a [(u32, f32)], &'a [Pair]);

#[test]
fn moved_pairs_are_counted_from_the_last_answer_that_was_received() {
    let daemon = TestDaemon::of_cores();
    let options = SceneOptions::default().with_tick_deadline(LONG);
    let mut one = Member::join(&daemon, "moved", 0..10, &options);
    let mut other = Member::join(&daemon, "moved", 10..20, &options.clone().with_scope(Scope::All));
    let ticks: [MovedTurn<'_>; 6] = [
        (Report::Moved, Some(&[[1, 11]]), &[(11, 0.5), (12, 20.0)], &[[1, 11]]),
        (Report::Nothing, Some(&[]), &[(12, 0.2)], &[[1, 12], [11, 12]]),
        (Report::Moved, None, &[(11, 0.4)], &[[1, 11], [11, 12]]),
        (Report::Moved, Some(&[[1, 11]]), &[], &[]),
        (Report::All, Some(&[[1, 11], [1, 12]]), &[(12, 0.2)], &[[1, 12], [11, 12]]),
        (Report::Moved, Some(&[]), &[], &[]),
    ];
    for (tick, (report, own, set, all)) in ticks.into_iter().enumerate() {
        let edit = one.scene.edit();
        let edit = if tick == 0 { edit.set(1, at(0.0)) } else { edit };
        let pending = edit.submit(report).unwrap();
        let edit = set.iter().fold(other.scene.edit(), |edit, (index, x)| edit.set(*index, at(*x)));
        let answer = edit.commit(Report::Moved).unwrap();
        assert_eq!((answer.pairs().to_vec(), answer.pair_count()), (all.into(), None), "{tick}");
        match own {
            Some(own) => assert_eq!(pending.wait().unwrap().pairs().to_vec(), own, "{tick}"),
            None => drop(pending),
        }
    }
}

#[test]
fn a_query_asks_for_what_the_last_tick_made() {
    let daemon = TestDaemon::of_cores();
    let options = SceneOptions::default().with_tick_deadline(LONG);
    let mut one = Member::join(&daemon, "asked", 0..10, &options);
    let mut listener = Member::join(&daemon, "asked", 0..0, &options);
    assert!(found(&mut listener.scene, at(0.0)).is_empty());
    drop(one.scene.edit().set(1, at(0.0)).commit(Report::Nothing).unwrap());
    let mut other = Member::join(&daemon, "asked", 10..20, &options);
    // The tick waits for the other one.
    drop(one.scene.edit().set(2, at(0.5)).remove(1).submit(Report::Nothing).unwrap());
    for scene in [&mut one.scene, &mut other.scene, &mut listener.scene] {
        assert_eq!(found(scene, at(0.0)), [1]);
    }
    drop(other.scene.edit().set(11, at(0.2)).commit(Report::Nothing).unwrap());
    for scene in [&mut one.scene, &mut other.scene, &mut listener.scene] {
        assert_eq!(found(scene, at(0.0)), [2, 11]);
    }
    drop(other);
    assert_eq!(found(&mut one.scene, at(0.0)), [2]);
    // Of another daemon, boxes are in the scene from the next commit on.
    daemon.signal_worker(Signal::KILL);
    let query = [at(0.0)];
    let asked = eventually("an answer", || one.scene.query(&query).ok());
    assert!(asked.is_empty());
    drop(asked);
    drop(one.scene.edit().set(3, at(9.0)).commit(Report::Nothing).unwrap());
    assert_eq!(found(&mut one.scene, Aabb::new([0.0; 3], [20.0; 3])), [2, 3]);
}

fn hold_all_slots(session: &mut Session) -> Vec<PairMask> {
    (0..3).map(|_| session.frame(4).unwrap().submit().unwrap().wait().unwrap()).collect()
}

/// For need of a place nothing has happened: the same edit can be made again.
#[test]
fn an_edit_without_a_slot_has_not_happened() {
    let daemon = TestDaemon::of_cores();
    let options = SceneOptions::default().with_tick_deadline(LONG).with_scope(Scope::All);
    let mut one = Member::join(&daemon, "unsent", 0..10, &options);
    let edit = one.scene.edit().set(1, at(0.0)).set(2, at(0.5));
    assert_eq!(edit.commit(Report::Changes).unwrap().pairs(), [[1, 2]]);
    let slots = hold_all_slots(&mut one.session);
    let unsent = one.scene.edit().set(3, at(0.2)).remove(2).commit(Report::Changes).map(drop);
    assert!(matches!(unsent, Err(Error::TooManyFrames)), "{unsent:?}");
    drop(slots);
    let answer = one.scene.edit().set(4, at(0.4)).commit(Report::Changes).unwrap();
    assert!(!answer.is_resync());
    assert_eq!(answer.begun(), [[1, 4], [2, 4]]);
    let edit = one.scene.edit().set(3, at(0.2)).remove(2);
    let answer = edit.commit(Report::All).unwrap();
    assert_eq!(answer.pairs(), [[1, 3], [1, 4], [3, 4]]);
}

/// What a tick has applied is in the scene, and no longer beside it: room for the boxes of many ticks is no more than
/// for those of one.
#[test]
fn boxes_that_were_applied_take_no_more_room() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--max-memory", "256M"]);
    let options = SceneOptions::default().with_tick_deadline(LONG);
    let own = 599_000..600_000;
    let mut one = Member::join(&daemon, "room", own.clone(), &options);
    let boxes: Vec<Aabb> = (0..1_000).map(|i| at(3.0 * i as f32)).collect();
    for tick in 0..600 {
        let edit = one.scene.edit().set_all(own.clone(), &boxes);
        let answered = edit.commit(Report::Nothing).map(drop);
        assert!(answered.is_ok(), "tick {tick}: {answered:?}");
    }
}

/// Only the daemon knows whose lease begins lowest. Nothing of a commit with a table that it refuses is applied, there or
/// here, whether somebody waits for it or not, and the membership goes on.
#[test]
fn nothing_of_a_commit_with_a_refused_table_is_applied() {
    let daemon = TestDaemon::of_cores();
    let table = FilterTable::new(&[Filter::new(1, 2)]).unwrap();
    let options = SceneOptions::default().with_tick_deadline(Duration::from_millis(50));
    let options = options.with_scope(Scope::All);
    let margined = options.clone().with_margin(Margin::default());
    for (waits, member) in
        [(true, &options), (false, &options), (true, &margined), (false, &margined)]
    {
        let name = format!("refused-{waits}-{}", member.margin.is_some());
        let _first = Member::join(&daemon, &name, 0..5, &options);
        let mut one = Member::join(&daemon, &name, 10..20, member);
        let edit = one.scene.edit().set(11, at(0.0)).set(12, at(0.5));
        assert_eq!(edit.commit(Report::Changes).unwrap().pairs(), [[11, 12]]);
        let edit = one.scene.edit().remove(12).set(14, at(0.1)).step(Step::Filters(&table));
        let pending = edit.submit(Report::Changes).unwrap();
        if waits {
            let refused = pending.wait().map(drop).unwrap_err();
            assert!(matches!(refused, Error::NotLeased(NotLeased::Filters)), "{refused:?}");
            assert_eq!((one.scene.get(12), one.scene.get(14)), (Some(at(0.5)), None));
        } else {
            drop(pending);
        }
        // Beyond what the refused commit had room for, and not of a box that it alone set.
        let absent = one.scene.edit().remove(14).commit(Report::Changes).map(drop);
        assert!(matches!(absent, Err(Error::Edit(EditError::Absent { index: 14 }))));
        let edit = one.scene.edit().set(13, at(0.2)).set(16, at(9.0));
        let answer = edit.commit(Report::Changes).unwrap();
        assert!(!answer.is_resync());
        assert_eq!(answer.begun(), [[11, 13], [12, 13]]);
        assert_eq!(answer.ended().count(), 0);
        drop(answer);

        // A resync that was asked for outlives a refused commit.
        let edit = one.scene.edit().step(Step::Filters(&table));
        let pending = edit.submit(Report::Changes).unwrap();
        drop(pending);
        one.scene.resync();
        let answer = one.scene.edit().commit(Report::Changes).unwrap();
        assert!(answer.is_resync());
        assert_eq!(answer.pairs(), [[11, 12], [11, 13], [12, 13]]);
        drop(answer);
        assert!(!one.scene.edit().commit(Report::Changes).unwrap().is_resync());
    }
}

#[test]
fn lists_of_pairs_end_with_their_lease() {
    let daemon = TestDaemon::of_cores();
    let options = SceneOptions::default().with_tick_deadline(LONG).with_scope(Scope::All);
    let _listener = Member::join(&daemon, "lists", 0..0, &options);
    let boxes = [at(0.0); 2];
    for (gives_back, removes) in [(true, false), (true, true), (false, false), (false, true)] {
        let mut one = Member::join(&daemon, "lists", 0..10, &options);
        let edit = one.scene.edit().set_all(1..3, &boxes).step(Step::Exclude(&[[1, 2]], true));
        assert_eq!(edit.commit(Report::All).unwrap().pairs().len(), 0);
        if removes {
            // Lists are there without boxes as well.
            drop(one.scene.edit().remove_all(1..3).commit(Report::Nothing).unwrap());
        }
        let listens = if gives_back {
            one.scene.give_back(0).unwrap();
            Some(one)
        } else {
            drop(one);
            None
        };
        let mut other = Member::join(&daemon, "lists", 0..0, &options);
        eventually("the lease is free", || other.scene.lease(0..10).ok());
        let edit = other.scene.edit().set_all(1..3, &boxes);
        assert_eq!(edit.commit(Report::All).unwrap().pairs(), [[1, 2]]);
        other.scene.give_back(0).unwrap();
        drop(listens);
    }
}

#[test]
fn a_member_joins_again_without_the_lists_of_a_lease_that_it_gave_back() {
    let daemon = TestDaemon::of_cores();
    let options = SceneOptions::default().with_tick_deadline(Duration::from_millis(50));
    let options = options.with_scope(Scope::All);
    let _first = Member::join(&daemon, "lists-again", 0..1, &options);
    let mut one = Member::join(&daemon, "lists-again", 1..10, &options);
    one.scene.lease(10..20).unwrap();
    let (indices, boxes) = ([1_u32, 2, 11, 12], [at(0.0); 4]);
    let edit = one.scene.edit().set_all(&indices, &boxes);
    let edit = edit.step(Step::Exclude(&[[1, 2], [2, 11], [11, 12]], true));
    let edit = edit.step(Step::Include(&[[1, 11]], true));
    let answer = edit.commit(Report::All).unwrap();
    assert_eq!(answer.pairs(), [[1, 11], [1, 12], [2, 12]]);
    drop(answer);
    one.scene.give_back(1).unwrap();
    daemon.signal_worker(Signal::KILL);
    let answer = eventually("the member joins again", || {
        let answer = one.scene.edit().set(13, at(0.0)).commit(Report::All).ok()?;
        Some(answer.pairs().to_vec())
    });
    assert_eq!(answer, [[11, 13], [12, 13]]);
}

/// Requests of several processes have no queue in common, and are taken in the order in which they were sent all the same.
#[test]
fn a_commit_that_was_sent_before_the_last_writers_is_part_of_its_tick() {
    let daemon = TestDaemon::of_cores();
    let options = SceneOptions::default().with_tick_deadline(LONG).with_scope(Scope::All);
    let mut writer = Member::join(&daemon, "order", 0..10, &options);
    let mut sessions = [(); 2].map(|()| daemon.connect());
    let mut listeners =
        sessions.each_mut().map(|s| s.scene(options.clone().with_shared("order")).unwrap());
    for round in 0..300 {
        let [one, two] = &mut listeners;
        let pending = [one, two].map(|scene| scene.edit().submit(Report::Changes).unwrap());
        let tick =
            writer.scene.edit().set(3, at(round as f32)).commit(Report::Changes).unwrap().tick();
        for pending in pending {
            assert_eq!(pending.wait().unwrap().tick(), tick, "round {round}");
        }
    }
}
