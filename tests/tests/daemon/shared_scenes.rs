//! Scenes that several sessions write: who is late, refused, dies, or loses its daemon. What is reported to members is
//! held to the model. One file, because all tests share the same members, and each is a page.
#![allow(clippy::single_range_in_vec_init)] // Lists of ranges are meant.

use std::collections::BTreeSet;
use std::ops::Range;
use std::time::{Duration, Instant};

use pairmask::filters::{Filter, FilterTable};
use pairmask::{
    AtEnd, EditError, EndReason, Ended, Error, JoinOptions, Margin, PendingAnswer, Scene,
    SceneAnswer, Scope,
};
use pairmask_core::scene::shared::{LeaseError, NotLeased};
use pairmask_tests::fault_client::FaultClient;
use pairmask_tests::prelude::*;
use pairmaskd::scene::Random;

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");
const CLIENT: &str = env!("CARGO_BIN_EXE_fault_client");

/// A deadline that a machine under load does not reach.
const LONG: Duration = Duration::from_secs(5);

type Pair = [u32; 2];
fn daemon() -> TestDaemon {
    TestDaemon::start(DAEMON, &["--gpu", "none"])
}

/// A member, and the pairs that it knows by the answers that it took.
struct Member {
    session: Session,
    scene: Scene,
    own: Range<u32>,
    known: BTreeSet<Pair>,
}

impl Member {
    fn join(daemon: &TestDaemon, name: &str, own: Range<u32>, options: JoinOptions) -> Self {
        let mut session = daemon.session().connect().unwrap();
        let mut scene = session.join_scene(name, options).unwrap();
        if !own.is_empty() {
            scene.lease(own.clone()).unwrap();
        }
        Self { session, scene, own, known: BTreeSet::new() }
    }
}

/// What an answer to changes makes of what a member knew.
fn learn(known: &mut BTreeSet<Pair>, answer: &SceneAnswer<'_>) {
    if answer.is_resync() {
        *known = answer.pairs().iter().collect();
        return;
    }
    answer.ended().for_each(|ended| assert!(known.remove(&ended.pair), "{ended:?}"));
    answer.begun().iter().for_each(|begun| assert!(known.insert(begun), "{begun:?} began twice"));
}

#[test]
fn a_late_writer_is_named_and_keeps_its_boxes() {
    let daemon = daemon();
    let deadline = Duration::from_millis(150);
    let options = JoinOptions::default().with_tick_deadline(deadline).with_scope(Scope::All);
    let mut one = Member::join(&daemon, "late", 0..10, options);
    let mut other = Member::join(&daemon, "late", 10..30, JoinOptions::default());
    // Behind its first lease, and one of somebody else behind that.
    other.scene.lease(30..35).unwrap();
    let third = Member::join(&daemon, "late", 35..40, JoinOptions::default());
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
    assert_eq!(answer.ended().to_vec(), [Ended { pair: [3, 15], reason: EndReason::Removed }]);
    drop(answer);
    let answer = pending.wait().unwrap();
    assert_eq!(answer.ended().len(), 2);
}

#[test]
fn what_is_not_its_own_a_member_is_refused() {
    let daemon = daemon();
    let mut here = in_process();
    let refused = here.join_scene("rules", JoinOptions::default());
    assert!(matches!(refused, Err(Error::NeedsDaemon)));
    let options = JoinOptions::default().with_most_boxes(100).with_tick_deadline(LONG);
    let mut one = Member::join(&daemon, "rules", 0..10, options.with_scope(Scope::All));
    let mut session = daemon.session().connect().unwrap();
    for name in ["", "a b", &"x".repeat(65)] {
        let refused = session.join_scene(name, JoinOptions::default());
        assert!(matches!(refused, Err(Error::SceneName(_))), "{name}");
    }
    for other in [
        options.with_most_boxes(101),
        options.with_tick_deadline(Duration::from_secs(1)),
        options.with_at_end(AtEnd::Keep),
    ] {
        let refused = session.join_scene("rules", other);
        assert!(matches!(refused, Err(Error::TermsDiffer(_))), "{other:?}: {refused:?}");
    }
    let margined = JoinOptions::default().with_usual_margin(Margin::default());
    let mut other = session.join_scene("rules", margined).unwrap();
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
    let daemon = daemon();
    let options = JoinOptions::default().with_tick_deadline(LONG).with_scope(Scope::All);
    let mut one = Member::join(&daemon, "tables", 10..20, options);
    let mut other = Member::join(&daemon, "tables", 20..30, options);
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

fn found(scene: &mut Scene, query: Aabb) -> Vec<u32> {
    scene.query(&[query]).find().unwrap().of_query(0).collect()
}

/// What the first member asks for, and gets of its own pairs where it waits; what the other one sets, and gets.
type MovedTurn<'a> = (Report, Option<&'a [Pair]>, &'a [(u32, f32)], &'a [Pair]);

#[test]
fn moved_pairs_are_counted_from_the_last_answer_that_was_received() {
    let daemon = daemon();
    let options = JoinOptions::default().with_tick_deadline(LONG);
    let mut one = Member::join(&daemon, "moved", 0..10, options);
    let mut other = Member::join(&daemon, "moved", 10..20, options.with_scope(Scope::All));
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
    let daemon = daemon();
    let options = JoinOptions::default().with_tick_deadline(LONG);
    let mut one = Member::join(&daemon, "asked", 0..10, options);
    let mut listener = Member::join(&daemon, "asked", 0..0, options);
    assert!(found(&mut listener.scene, at(0.0)).is_empty());
    drop(one.scene.edit().set(1, at(0.0)).commit(Report::Nothing).unwrap());
    let mut other = Member::join(&daemon, "asked", 10..20, options);
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
    let asked = eventually("an answer", || one.scene.query(&query).find().ok());
    assert!(asked.is_empty());
    drop(asked);
    drop(one.scene.edit().set(3, at(9.0)).commit(Report::Nothing).unwrap());
    assert_eq!(found(&mut one.scene, Aabb::new([0.0; 3], [20.0; 3])), [2, 3]);
}

/// To members with margins and to one without, the pairs of fat AABBs are reported, those that overlap among them.
#[test]
fn pairs_of_members_with_margins_are_near_ones() {
    let daemon = daemon();
    let options = JoinOptions::default().with_tick_deadline(LONG).with_scope(Scope::All);
    let margined = |units| options.with_usual_margin(Margin::new(units).unwrap());
    let mut members = [(0..30, margined(0.3)), (30..60, margined(1.0)), (60..80, options)]
        .map(|(own, options)| Member::join(&daemon, "margins", own, options));
    let mut random = Random::new(7);
    let mut boxes: Vec<Aabb> = (0..80).map(|index| at((index * 37 % 80) as f32)).collect();
    let sent_of = |members: &[Member]| -> Vec<Aabb> {
        let boxes = |member: &Member| {
            member
                .own
                .clone()
                .map(|index| member.scene.inflated(index).unwrap())
                .collect::<Vec<_>>()
        };
        members.iter().flat_map(boxes).collect()
    };
    for tick in 0..60 {
        let drops = (tick > 0 && random.below(4) == 0).then(|| random.below(3) as usize);
        let report = [Report::Changes, Report::Changes, Report::All, Report::Moved];
        let report = if tick == 0 { Report::Changes } else { report[random.below(4) as usize] };
        for b in &mut boxes {
            let by = if random.below(3) == 0 { random.below(5) as f32 * 0.1 - 0.2 } else { 0.0 };
            (b.min[0], b.max[0]) = (b.min[0] + by, b.max[0] + by);
        }
        let commits = members.iter_mut().map(|Member { scene, own, known, .. }| {
            let set = &boxes[own.start as usize..own.end as usize];
            (known, scene.edit().set_all(own.clone(), set).submit(report).unwrap())
        });
        let mut all = Vec::new();
        for (member, (known, pending)) in commits.collect::<Vec<_>>().into_iter().enumerate() {
            if drops == Some(member) {
                continue;
            }
            let answer = pending.wait().unwrap();
            if report == Report::Changes {
                learn(known, &answer);
                all.push(known.iter().copied().collect());
            } else {
                all.push(answer.pairs().to_vec());
            }
            if report == Report::All {
                *known = answer.pairs().iter().collect();
            }
        }
        let near = oracle::truth(&sent_of(&members)).pairs;
        assert!(all.iter().all(|pairs: &Vec<Pair>| *pairs == near), "tick {tick}, {report:?}");
        let exact = oracle::truth(&boxes).pairs;
        assert!(exact.iter().all(|pair| near.contains(pair)));
    }
    for Member { scene, .. } in &members[..2] {
        let stats = scene.margin_stats().unwrap();
        assert!(stats.requests == 60 && stats.sent < stats.set / 2, "{stats:?}");
    }
    // A query finds own boxes as they were set, and those of others as they were sent.
    let sent = sent_of(&members);
    let asked = |index: u32| if index < 30 { boxes[index as usize] } else { sent[index as usize] };
    let overlaps = |index: &u32| asked(*index).overlaps(&at(20.0));
    let expected: Vec<u32> = (0..80).filter(overlaps).collect();
    assert_eq!(found(&mut members[0].scene, at(20.0)), expected);
    // What another daemon is sent is what the last one had.
    daemon.signal_worker(Signal::KILL);
    let [one, ..] = &mut members;
    let pairs = eventually("the member joins again", || {
        let answer = one.scene.edit().commit(Report::All).ok()?;
        Some(answer.pairs().to_vec())
    });
    assert_eq!(pairs, oracle::truth(&sent[..30]).pairs);
}

fn hold_all_places(session: &mut Session) -> Vec<PairMask> {
    (0..3).map(|_| session.frame(4).unwrap().submit().unwrap().wait().unwrap()).collect()
}

/// For want of a place nothing has happened: the same edit can be made again.
#[test]
fn an_edit_without_a_place_has_not_happened() {
    let daemon = daemon();
    let options = JoinOptions::default().with_tick_deadline(LONG).with_scope(Scope::All);
    let mut one = Member::join(&daemon, "unsent", 0..10, options);
    let edit = one.scene.edit().set(1, at(0.0)).set(2, at(0.5));
    assert_eq!(edit.commit(Report::Changes).unwrap().pairs(), [[1, 2]]);
    let places = hold_all_places(&mut one.session);
    let unsent = one.scene.edit().set(3, at(0.2)).remove(2).commit(Report::Changes).map(drop);
    assert!(matches!(unsent, Err(Error::TooManyFrames)), "{unsent:?}");
    drop(places);
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
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none", "--max-scene-mib", "128"]);
    let options = JoinOptions::default().with_tick_deadline(LONG);
    let own = 599_000..600_000;
    let mut one = Member::join(&daemon, "room", own.clone(), options);
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
    let daemon = daemon();
    let table = FilterTable::new(&[Filter::new(1, 2)]).unwrap();
    let options = JoinOptions::default().with_tick_deadline(Duration::from_millis(50));
    let options = options.with_scope(Scope::All);
    let margined = options.with_usual_margin(Margin::default());
    for (waits, member) in [(true, options), (false, options), (true, margined), (false, margined)]
    {
        let name = format!("refused-{waits}-{}", member.usual_margin.is_some());
        let _first = Member::join(&daemon, &name, 0..5, options);
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
        assert_eq!(answer.ended().len(), 0);
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
    let daemon = daemon();
    let options = JoinOptions::default().with_tick_deadline(LONG).with_scope(Scope::All);
    let _listener = Member::join(&daemon, "lists", 0..0, options);
    let boxes = [at(0.0); 2];
    for (gives_back, removes) in [(true, false), (true, true), (false, false), (false, true)] {
        let mut one = Member::join(&daemon, "lists", 0..10, options);
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
        let mut other = Member::join(&daemon, "lists", 0..0, options);
        eventually("the lease is free", || other.scene.lease(0..10).ok());
        let edit = other.scene.edit().set_all(1..3, &boxes);
        assert_eq!(edit.commit(Report::All).unwrap().pairs(), [[1, 2]]);
        other.scene.give_back(0).unwrap();
        drop(listens);
    }
}

#[test]
fn a_member_joins_again_without_the_lists_of_a_lease_that_it_gave_back() {
    let daemon = daemon();
    let options = JoinOptions::default().with_tick_deadline(Duration::from_millis(50));
    let options = options.with_scope(Scope::All);
    let _first = Member::join(&daemon, "lists-again", 0..1, options);
    let mut one = Member::join(&daemon, "lists-again", 1..10, options);
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

#[test]
fn members_commit_join_and_leave_side_by_side() {
    const TICKS: u32 = 30;
    let daemon = daemon();
    let options = JoinOptions::default().with_tick_deadline(Duration::from_millis(200));
    let all_at = |tick: u32, own: &Range<u32>| -> Vec<Aabb> {
        own.clone().map(|index| at((index * 7 % 50 + tick % 3) as f32)).collect()
    };
    let writers: Vec<Member> = (0..3)
        .map(|which| Member::join(&daemon, "side", which * 600..(which + 1) * 600, options))
        .collect();
    let mut last = Member::join(&daemon, "side", 0..0, options.with_scope(Scope::All));
    let writers: Vec<Member> = std::thread::scope(|scope| {
        let guests = (0..2).map(|which| {
            let daemon = &daemon;
            scope.spawn(move || {
                for _ in 0..6 {
                    let own = 3_000 + 100 * which..3_100 + 100 * which;
                    let mut guest = Member::join(daemon, "side", 0..0, options);
                    // The guest before may still be on its way out.
                    eventually("the lease is free", || guest.scene.lease(own.clone()).ok());
                    let boxes = all_at(0, &own);
                    drop(guest.scene.edit().set_all(own, &boxes).commit(Report::Changes).unwrap());
                }
            })
        });
        let guests: Vec<_> = guests.collect();
        let writers = writers.into_iter().map(|mut member| {
            scope.spawn(move || {
                for tick in 0..TICKS {
                    let own = member.own.clone();
                    let boxes = all_at(tick, &own);
                    let edit = member.scene.edit().set_all(own, &boxes);
                    let answer = edit.commit(Report::Changes).unwrap();
                    learn(&mut member.known, &answer);
                }
                member
            })
        });
        let writers: Vec<_> = writers.collect();
        for guest in guests {
            guest.join().unwrap();
        }
        writers.into_iter().map(|writer| writer.join().unwrap()).collect()
    });
    let truth = oracle::truth(&all_at(TICKS - 1, &(0..1_800))).pairs;
    // Guests have left by then.
    eventually("the boxes of the writers alone", || {
        let answer = last.scene.edit().commit(Report::All).unwrap();
        answer.pairs().iter().eq(truth.iter().map(|[a, b]| [*a, *b])).then_some(())
    });
    drop(writers);
}

#[test]
fn a_scene_that_is_left_during_a_tick_holds_nobody_up() {
    let daemon = daemon();
    let options = JoinOptions::default().with_tick_deadline(LONG).with_scope(Scope::All);
    let mut one = Member::join(&daemon, "left", 0..10, options);
    for round in 0..5 {
        let mut other = Member::join(&daemon, "left", 10..20, options);
        drop(other.scene.edit().set(10, at(0.0)).submit(Report::Changes).unwrap());
        let Member { mut session, scene, .. } = other;
        drop(scene);
        // The place of the commit that nobody waits for is free again.
        let boxes = session.frame(3).unwrap().submit().unwrap().wait().unwrap();
        assert_eq!(boxes.n().get(), 3);
        let start = Instant::now();
        let answer = one.scene.edit().set(round, at(0.0)).commit(Report::All).unwrap();
        assert!(start.elapsed() < LONG, "it waits for nobody");
        assert_eq!(answer.pairs().len(), (round * (round + 1) / 2) as usize);
    }
}

fn kill_writers(times: usize, at_end: AtEnd) {
    let daemon = daemon();
    let deadline = Duration::from_millis(50);
    let options = JoinOptions::default().with_tick_deadline(deadline).with_at_end(at_end);
    let mut member = Member::join(&daemon, "killed", 0..1, options);
    let mut random = Random::new(times as u64);
    let mut tick = |edit: bool| {
        let start = Instant::now();
        let mut next = member.scene.edit();
        if edit {
            next = next.set(0, at(0.0));
        }
        let answer = next.commit(Report::Changes).unwrap();
        assert!(start.elapsed() < deadline + Duration::from_secs(2), "a tick is stuck");
        learn(&mut member.known, &answer);
        let ended = answer.ended().to_vec();
        drop(answer);
        (member.known.len(), ended, found(&mut member.scene, at(0.0)).len())
    };
    tick(true);
    for _ in 0..times {
        // A writer of another process: boxes 10 to 19 of the scene, all around the origin.
        let mut writer = FaultClient::start(CLIENT, &daemon, &["shared", "auto", "killed"]);
        writer.go();
        let boxes = eventually("the writer's boxes are there", || {
            let (pairs, _, boxes) = tick(false);
            (pairs == 10).then_some(boxes)
        });
        assert_eq!(boxes, 11);
        for _ in 0..random.below(5) {
            tick(false);
        }
        drop(writer);
        let killed = Instant::now();
        if at_end == AtEnd::Keep {
            // They stay for the next one, which leases them as soon as they are free.
            continue;
        }
        loop {
            let (pairs, ended, boxes) = tick(false);
            if pairs == 0 {
                assert_eq!((ended.len(), boxes), (10, 1));
                assert!(ended.iter().all(|ended| ended.reason == EndReason::Removed));
                break;
            }
            assert!(killed.elapsed() < Duration::from_secs(10), "the boxes of the dead stay");
        }
    }
    if at_end == AtEnd::Keep {
        let (pairs, _, boxes) = tick(false);
        assert_eq!((pairs, boxes), (10, 11), "kept");
    }
    let status = member.session.daemon_status().unwrap();
    assert_eq!((status.scenes, status.scene_mib), (1, 1));
    let Member { mut session, scene, .. } = member;
    drop(scene);
    eventually("a scene ends with its last member", || {
        let status = session.daemon_status().unwrap();
        ((status.scenes, status.scene_mib) == (0, 0)).then_some(())
    });
}

#[test]
fn boxes_of_killed_writers_are_removed() {
    kill_writers(14, AtEnd::Remove);
}

#[test]
fn boxes_of_killed_writers_are_kept() {
    kill_writers(6, AtEnd::Keep);
}

#[test]
#[ignore = "long: nightly"]
fn boxes_of_many_killed_writers_are_removed() {
    kill_writers(200, AtEnd::Remove);
}

#[test]
fn a_restarted_daemon_is_joined_again() {
    let mut daemon = daemon();
    let deadline = Duration::from_millis(300);
    let options = JoinOptions::default().with_tick_deadline(deadline).with_scope(Scope::All);
    let mut one = Member::join(&daemon, "again", 0..10, options);
    let mut other = Member::join(&daemon, "again", 10..20, options);
    for round in 0..6 {
        let x = round as f32;
        // Both commit, until a tick has both.
        eventually("a tick of both", || {
            let first = one.scene.edit().set(2, at(x)).set(3, at(9.0)).submit(Report::All);
            let second = other.scene.edit().set(12, at(x)).commit(Report::Changes);
            let answered = first.and_then(PendingAnswer::wait);
            if let Ok(second) = &second {
                learn(&mut other.known, second);
            }
            match (answered, second) {
                // A daemon that has just started may know one of them alone.
                (Ok(first), Ok(_)) if first.late().is_empty() && first.pairs().len() == 1 => {
                    assert_eq!(first.pairs(), [[2, 12]], "round {round}");
                    assert_eq!(other.known.len(), 1);
                    Some(())
                }
                (first, second) => {
                    for error in [first.err(), second.err()].into_iter().flatten() {
                        println!("round {round}: {error}");
                    }
                    None
                }
            }
        });
        match round {
            0 | 3 => daemon.signal_worker(Signal::KILL),
            1 | 4 => {
                daemon.kill();
                daemon.restart();
            }
            _ => {}
        }
    }
}
