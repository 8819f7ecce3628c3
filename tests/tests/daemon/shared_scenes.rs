//! Scenes that several sessions write, held to the pairs of all boxes, whoever commits first, is late, dies, or
//! loses its daemon. One file, because its tests share the members, what they hear, and the pairs of all boxes.
#![allow(clippy::single_range_in_vec_init)] // Lists of ranges are meant.

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Write};
use std::ops::Range;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use pairmask::filters::{Filter, FilterId, FilterTable, Tag};
use pairmask::scene::shared::{AtEnd, Hears, LeaseError, NotLeased};
use pairmask::scene::{EndReason, Ended, Step, Want};
use pairmask::{
    Aabb, Backend, EngineChoice, EngineName, FrameError, JoinOptions, PairMask, PendingShared,
    Session, SharedAnswer, SharedError, SharedScene,
};
use pairmask_tests::daemon::{TestDaemon, eventually};
use pairmaskd::scene::Random;
use rustix::process::Signal;

const DAEMON: &str = env!("CARGO_BIN_EXE_pairmaskd_under_test");
const CLIENT: &str = env!("CARGO_BIN_EXE_fault_client");

/// Boxes of a writer.
const OWN: u32 = 40;
/// A deadline that a machine under load does not reach.
const LONG: Duration = Duration::from_secs(5);

type Pair = [u32; 2];
/// An answer as it was told.
type Heard = (Vec<Pair>, Vec<Ended>, Vec<Pair>, bool, u64);

fn daemon() -> TestDaemon {
    TestDaemon::start(DAEMON, &["--gpu", "none"])
}

fn pairs_of(boxes: &[Option<Aabb>]) -> BTreeSet<Pair> {
    let mut pairs = BTreeSet::new();
    for (a, one) in (0..).zip(boxes) {
        for (b, other) in (0..a).zip(boxes) {
            if let (Some(one), Some(other)) = (one, other)
                && one.overlaps(other)
            {
                pairs.insert([b, a]);
            }
        }
    }
    pairs
}

fn heard(answer: &SharedAnswer<'_>) -> Heard {
    let (begun, ended) = (answer.begun().to_vec(), answer.ended().to_vec());
    (begun, ended, answer.pairs().to_vec(), answer.is_resync(), answer.tick())
}

/// A member, and the pairs that it knows by the answers that it took.
struct Member {
    session: Session,
    scene: SharedScene,
    hears: Hears,
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
        Self { session, scene, hears: options.hears, own, known: BTreeSet::new() }
    }

    fn hears_of(&self, [a, b]: Pair) -> bool {
        self.hears == Hears::All || self.own.contains(&a) || self.own.contains(&b)
    }
}

/// What an answer that was taken makes of what a member knew.
fn learn(known: &mut BTreeSet<Pair>, (begun, ended, pairs, is_resync, _): &Heard, want: Want) {
    if *is_resync || want == Want::All {
        *known = pairs.iter().copied().collect();
        assert_eq!(known.len(), pairs.len());
        return;
    }
    for Ended { pair, .. } in ended {
        assert!(known.remove(pair), "{pair:?} ended and was not known");
    }
    for pair in begun {
        assert!(known.insert(*pair), "{pair:?} began twice");
    }
}

/// Some boxes of a writer for this tick: set, or removed.
fn draw(random: &mut Random, own: &Range<u32>, now: &[Option<Aabb>]) -> Vec<(u32, Option<Aabb>)> {
    let mut edits = Vec::new();
    for index in own.clone() {
        match random.below(6) {
            0 | 1 => {
                let x = random.below(60) as f32;
                edits.push((index, Some(Aabb::new([x, 0.0, 0.0], [x + 2.0, 1.0, 1.0]))));
            }
            2 if now[index as usize].is_some() && random.below(3) == 0 => edits.push((index, None)),
            _ => {}
        }
    }
    edits
}

/// Ticks of writers and listeners that commit in an order of this seed. Returns all that was told.
fn play(daemon: &TestDaemon, writers: u32, ticks: u64, (edits, order): (u64, u64)) -> Vec<Heard> {
    let name = format!("play-{writers}-{edits}-{order}");
    let options = JoinOptions::default().with_tick_deadline(LONG).with_most_boxes(1_000);
    let mut members: Vec<Member> = Vec::new();
    let mut all: Vec<Option<Aabb>> = vec![None; (OWN * writers) as usize];
    let (mut random, mut shuffle) = (Random::new(edits), Random::new(order));
    let mut told = Vec::new();
    // Whoever comes first, a writer has its indices.
    let mut coming: Vec<u32> = (0..writers).collect();
    while !coming.is_empty() {
        let at = shuffle.below(coming.len() as u64) as usize;
        let writer = coming.swap_remove(at);
        let hears = if writer.is_multiple_of(2) { Hears::Own } else { Hears::All };
        let own = writer * OWN..(writer + 1) * OWN;
        members.push(Member::join(daemon, &name, own, options.hearing(hears)));
    }
    for tick in 0..ticks {
        if tick == ticks / 2 {
            // One that joins late has all pairs at once.
            members.push(Member::join(daemon, &name, 0..0, options.hearing(Hears::All)));
        }
        members.sort_by_key(|member| (member.own.is_empty(), member.own.start));
        let drawn: Vec<_> = members.iter().map(|m| draw(&mut random, &m.own, &all)).collect();
        let wants: Vec<(Want, bool)> = members
            .iter()
            .map(|_| {
                let wants = [Want::Changes, Want::Changes, Want::Changes, Want::All, Want::Nothing];
                (wants[random.below(5) as usize], random.below(4) > 0)
            })
            .collect();
        for (index, new) in drawn.iter().flatten() {
            all[*index as usize] = *new;
        }
        let mut waiting: Vec<_> = members.iter_mut().enumerate().collect();
        // A listener is part of the tick that it commits in: it comes before the last writer.
        let mut listeners = waiting.split_off(writers as usize);
        let mut pending = Vec::new();
        while !waiting.is_empty() || !listeners.is_empty() {
            let (at, member) = match listeners.pop() {
                Some(listener) => listener,
                None => waiting.swap_remove(shuffle.below(waiting.len() as u64) as usize),
            };
            let is_listener = member.own.is_empty();
            let Member { session, scene, known, .. } = member;
            let mut edit = scene.edit();
            for (index, new) in &drawn[at] {
                edit = match new {
                    Some(b) => edit.set(*index, *b),
                    None => edit.remove(*index),
                };
            }
            let submitted = edit.submit(wants[at].0).unwrap();
            if is_listener {
                // The daemon takes requests of different sessions in any order, those of one in theirs.
                session.daemon_status().unwrap();
            }
            pending.push((at, submitted, known));
        }
        let mut of_tick: Vec<(usize, Heard)> = Vec::new();
        for (at, pending, known) in pending {
            let answer = pending.wait().unwrap();
            assert!(answer.late().is_empty());
            let (want, is_taken) = wants[at];
            assert_eq!(answer.tick(), tick + 1);
            let heard = heard(&answer);
            // An answer that is not taken tells the same as one that is.
            let mut knows = known.clone();
            if want != Want::Nothing {
                learn(&mut knows, &heard, want);
            }
            if is_taken {
                drop(answer.take());
                *known = knows;
            }
            of_tick.push((at, heard));
        }
        let truth = pairs_of(&all);
        for (at, heard) in &of_tick {
            let (want, is_taken) = wants[*at];
            let member = &members[*at];
            if want != Want::Nothing && is_taken {
                let expected: BTreeSet<Pair> =
                    truth.iter().copied().filter(|pair| member.hears_of(*pair)).collect();
                assert_eq!(member.known, expected, "tick {tick}, member {at}");
            }
            assert!(heard.0.is_sorted() && heard.1.is_sorted() && heard.2.is_sorted());
        }
        of_tick.sort_by_key(|(at, _)| *at);
        told.extend(of_tick.into_iter().map(|(_, heard)| heard));
    }
    told
}

#[test]
fn every_member_has_its_pairs_after_every_tick() {
    let daemon = daemon();
    for (writers, seed) in [(1, 11), (2, 12), (3, 13), (5, 14)] {
        play(&daemon, writers, 30, (seed, seed));
    }
}

#[test]
fn answers_are_the_same_bytes_whoever_was_first() {
    let daemon = daemon();
    let first = play(&daemon, 3, 20, (77, 1));
    assert!(first.iter().any(|heard| !heard.0.is_empty()));
    for order in 2..5 {
        assert_eq!(play(&daemon, 3, 20, (77, order)), first, "order {order}");
    }
    assert_ne!(play(&daemon, 3, 20, (78, 1)), first, "other edits are told otherwise");
}

#[test]
fn ticks_are_audited() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none", "--audit", "1/1"]);
    let mut session = daemon.session().connect().unwrap();
    let mut seed = 20;
    let audit = eventually("ticks are audited", || {
        // The auditor gives up a scene that is edited faster than it follows: then there is another one.
        seed += 1;
        play(&daemon, 3, 30, (seed, seed));
        let audit = session.daemon_status().unwrap().audit;
        (audit.frames > 100 && audit.pairs > 10_000).then_some(audit)
    });
    assert_eq!((audit.missed, audit.extra), (0, 0), "{audit:?}");
}

fn at(x: f32) -> Aabb {
    Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0])
}

#[test]
fn a_late_writer_is_named_and_keeps_its_boxes() {
    let daemon = daemon();
    let deadline = Duration::from_millis(150);
    let options = JoinOptions::default().with_tick_deadline(deadline).hearing(Hears::All);
    let mut one = Member::join(&daemon, "late", 0..10, options);
    let mut other = Member::join(&daemon, "late", 10..30, JoinOptions::default());
    // Behind its first lease, and one of somebody else behind that.
    other.scene.lease(30..35).unwrap();
    let third = Member::join(&daemon, "late", 35..40, JoinOptions::default());
    assert_eq!(other.scene.tick_deadline(), deadline, "who says nothing agrees");
    let pending = other.scene.edit().set(15, at(0.0)).submit(Want::Changes).unwrap();
    drop(one.scene.edit().set(3, at(0.5)).commit(Want::Changes).unwrap().take());
    drop(pending.wait().unwrap().take());
    for tick in 2..5 {
        let start = Instant::now();
        let answer = one.scene.edit().set(4, at(0.2)).commit(Want::All).unwrap().take();
        let took = start.elapsed();
        assert!(took >= deadline && took < deadline + Duration::from_secs(2), "{took:?}");
        assert_eq!((answer.late(), answer.tick()), (vec![10..30, 30..35, 35..40], tick));
        assert_eq!(answer.pairs(), [[3, 4], [3, 15], [4, 15]]);
    }
    drop(third);
    // Its next commit is part of the next tick, and has all that it missed.
    let pending = one.scene.edit().submit(Want::Changes).unwrap();
    let answer = other.scene.edit().remove(15).commit(Want::Changes).unwrap().take();
    assert_eq!((answer.tick(), answer.late()), (5, vec![]));
    assert_eq!(answer.ended().to_vec(), [Ended { pair: [3, 15], reason: EndReason::Removed }]);
    drop(answer);
    let answer = pending.wait().unwrap();
    assert_eq!(answer.ended().len(), 2);
}

#[test]
fn what_is_not_its_own_a_member_is_refused() {
    let daemon = daemon();
    let mut here = Session::builder().backend(Backend::InProcess).connect().unwrap();
    let refused = here.join_scene("rules", JoinOptions::default());
    assert!(matches!(refused, Err(SharedError::InProcess)));
    let options = JoinOptions::default().with_most_boxes(100).with_tick_deadline(LONG);
    let mut one = Member::join(&daemon, "rules", 0..10, options.hearing(Hears::All));
    let mut session = daemon.session().connect().unwrap();
    for name in ["", "a b", &"x".repeat(65)] {
        let refused = session.join_scene(name, JoinOptions::default());
        assert!(matches!(refused, Err(SharedError::Name(_))), "{name}");
    }
    for other in [
        options.with_most_boxes(101),
        options.with_tick_deadline(Duration::from_secs(1)),
        options.with_at_end(AtEnd::Keep),
    ] {
        let refused = session.join_scene("rules", other);
        assert!(matches!(refused, Err(SharedError::Differs(_))), "{other:?}: {refused:?}");
    }
    let mut other = session.join_scene("rules", JoinOptions::default()).unwrap();
    let lease = |scene: &mut SharedScene, range| match scene.lease(range) {
        Err(SharedError::Lease(error)) => Some(error),
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
    assert!(matches!(full, SharedError::Lease(LeaseError::Full { count: 71 })));
    let not_own = other.edit().set(9, at(0.0)).commit(Want::Nothing).unwrap_err();
    assert!(matches!(not_own, SharedError::NotLeased(NotLeased::Index { index: 9 })));
    let moved = other.edit().commit(Want::Moved).unwrap_err();
    assert!(matches!(moved, SharedError::Moved));
    // What was refused holds nobody up, and a lease that was given back is free.
    let pending = one.scene.edit().set(1, at(0.0)).submit(Want::All).unwrap();
    drop(other.edit().set(12, at(0.0)).set(25, at(0.0)).commit(Want::Nothing).unwrap());
    assert_eq!(pending.wait().unwrap().take().pairs(), [[1, 12], [1, 25], [12, 25]]);
    other.give_back(10).unwrap();
    assert_eq!((other.len(), other.leases()), (1, &[20..30][..]));
    one.scene.lease(10..15).unwrap();
    let pending = one.scene.edit().set(12, at(7.0)).submit(Want::All).unwrap();
    drop(other.edit().commit(Want::Nothing).unwrap());
    assert_eq!(pending.wait().unwrap().take().pairs(), [[1, 25]]);
}

#[test]
fn tags_and_lists_are_those_of_their_writers() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "none", "--audit", "1/1"]);
    let options = JoinOptions::default().with_tick_deadline(LONG).hearing(Hears::All);
    let mut one = Member::join(&daemon, "tags", 0..4, options);
    let mut other = Member::join(&daemon, "tags", 4..8, options);
    let all = [at(0.0); 4];
    // Bodies of the first writer meet all, sensors of the other one bodies alone.
    let table = FilterTable::new(&[Filter::new(1, 3), Filter::new(2, 1)]).unwrap();
    let tags = [0, 1].map(|filter| [Tag::default().with_filter(FilterId(filter)); 4]);
    let edit = one.scene.edit().set_all(0..4, &all).tag_all(0..4, &tags[0]);
    let edit = edit.step(Step::Filters(&table)).step(Step::Exclude(&[[0, 1]], true));
    let pending = edit.submit(Want::All).unwrap();
    let edit = other.scene.edit().set_all(4..8, &all).tag_all(4..8, &tags[1]);
    drop(edit.commit(Want::Nothing).unwrap());
    let bodies = (0..4).flat_map(|a| (a + 1..8).map(move |b| [a, b]));
    let expected: Vec<Pair> = bodies.filter(|pair| *pair != [0, 1]).collect();
    assert_eq!(pending.wait().unwrap().take().pairs().to_vec(), expected);

    // Of the table the first writer decides.
    let edit = other.scene.edit().set(4, at(50.0)).step(Step::Filters(&table));
    let refused = edit.commit(Want::Nothing).unwrap_err();
    assert!(matches!(refused, SharedError::NotLeased(NotLeased::Filters)), "{refused:?}");
    let again = other.scene.edit().set(4, at(50.0)).submit(Want::Nothing).unwrap();
    let answer = one.scene.edit().commit(Want::All).unwrap();
    let without = expected.iter().copied().filter(|[_, b]| *b != 4).collect::<Vec<_>>();
    assert_eq!(answer.take().pairs().to_vec(), without);
    drop(again.wait().unwrap());
    let audit = eventually("the rules are audited", || {
        let audit = one.session.daemon_status().unwrap().audit;
        // Two ticks, and all pairs after each of them.
        (audit.frames >= 4).then_some(audit)
    });
    assert_eq!((audit.missed, audit.extra), (0, 0), "{audit:?}");
}

#[test]
fn a_tick_has_one_table_of_filters() {
    let daemon = daemon();
    let options = JoinOptions::default().with_tick_deadline(LONG).hearing(Hears::All);
    let mut one = Member::join(&daemon, "tables", 10..20, options);
    let mut other = Member::join(&daemon, "tables", 20..30, options);
    let (none_meet, boxes) = (FilterTable::new(&[Filter::new(1, 2)]).unwrap(), [at(0.0); 2]);
    let edit = one.scene.edit().set_all(10..12, &boxes).step(Step::Filters(&none_meet));
    let pending = edit.submit(Want::All).unwrap();
    // The daemon has the first table by now.
    one.session.daemon_status().unwrap();
    other.scene.lease(0..5).unwrap();
    let all_meet = FilterTable::new(&[Filter::new(1, 1)]).unwrap();
    let edit = other.scene.edit().step(Step::Filters(&all_meet));
    let refused = edit.commit(Want::Nothing).map(drop).unwrap_err();
    assert!(matches!(refused, SharedError::NotLeased(NotLeased::Filters)), "{refused:?}");
    drop(other);
    assert_eq!(pending.wait().unwrap().take().pairs().len(), 0);
}

/// Answers that hold all places of a session.
fn hold_all_places(session: &mut Session) -> Vec<PairMask> {
    (0..3).map(|_| session.frame(4).unwrap().submit().unwrap().wait().unwrap()).collect()
}

/// For want of a place nothing has happened: the same edit can be made again.
#[test]
fn an_edit_without_a_place_has_not_happened() {
    let daemon = daemon();
    let options = JoinOptions::default().with_tick_deadline(LONG).hearing(Hears::All);
    let mut one = Member::join(&daemon, "unsent", 0..10, options);
    let edit = one.scene.edit().set(1, at(0.0)).set(2, at(0.5));
    assert_eq!(edit.commit(Want::Changes).unwrap().take().pairs(), [[1, 2]]);
    let places = hold_all_places(&mut one.session);
    let unsent = one.scene.edit().set(3, at(0.2)).remove(2).commit(Want::Changes).map(drop);
    assert!(matches!(unsent, Err(SharedError::Frame(FrameError::TooManyFrames))), "{unsent:?}");
    drop(places);
    let answer = one.scene.edit().set(4, at(0.4)).commit(Want::Changes).unwrap().take();
    assert!(!answer.is_resync());
    assert_eq!(answer.begun(), [[1, 4], [2, 4]]);
    let edit = one.scene.edit().set(3, at(0.2)).remove(2);
    let answer = edit.commit(Want::All).unwrap().take();
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
        let answered = edit.commit(Want::Nothing).map(drop);
        assert!(answered.is_ok(), "tick {tick}: {answered:?}");
    }
}

/// Only the daemon knows whose lease begins lowest. Nothing of a commit with a table that it refuses is applied, there or
/// here, whether somebody waits for it or not, and the membership goes on.
#[test]
fn nothing_of_a_commit_with_a_refused_table_is_applied() {
    let daemon = daemon();
    let table = FilterTable::new(&[Filter::new(1, 2)]).unwrap();
    for waits in [true, false] {
        let options = JoinOptions::default().with_tick_deadline(Duration::from_millis(50));
        let name = format!("refused-{waits}");
        let _first = Member::join(&daemon, &name, 0..5, options.hearing(Hears::All));
        let mut one = Member::join(&daemon, &name, 10..20, options.hearing(Hears::All));
        let edit = one.scene.edit().set(11, at(0.0)).set(12, at(0.5));
        assert_eq!(edit.commit(Want::Changes).unwrap().take().pairs(), [[11, 12]]);
        let edit = one.scene.edit().remove(12).set(14, at(0.1)).step(Step::Filters(&table));
        let pending = edit.submit(Want::Changes).unwrap();
        if waits {
            let refused = pending.wait().map(drop).unwrap_err();
            assert!(matches!(refused, SharedError::NotLeased(NotLeased::Filters)), "{refused:?}");
            assert_eq!((one.scene.get(12), one.scene.get(14)), (Some(at(0.5)), None));
        } else {
            drop(pending);
        }
        let answer = one.scene.edit().set(13, at(0.2)).commit(Want::Changes).unwrap().take();
        assert!(!answer.is_resync());
        assert_eq!(answer.begun(), [[11, 13], [12, 13]]);
        assert_eq!(answer.ended().len(), 0);
    }
}

#[test]
fn lists_of_pairs_end_with_their_lease() {
    let daemon = daemon();
    let options = JoinOptions::default().with_tick_deadline(LONG).hearing(Hears::All);
    let _listener = Member::join(&daemon, "lists", 0..0, options);
    let boxes = [at(0.0); 2];
    for (gives_back, removes) in [(true, false), (true, true), (false, false), (false, true)] {
        let mut one = Member::join(&daemon, "lists", 0..10, options);
        let edit = one.scene.edit().set_all(1..3, &boxes).step(Step::Exclude(&[[1, 2]], true));
        assert_eq!(edit.commit(Want::All).unwrap().take().pairs().len(), 0);
        if removes {
            // Lists are there without boxes as well.
            drop(one.scene.edit().remove_all(1..3).commit(Want::Nothing).unwrap());
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
        assert_eq!(edit.commit(Want::All).unwrap().take().pairs(), [[1, 2]]);
        other.scene.give_back(0).unwrap();
        drop(listens);
    }
}

#[test]
fn a_member_joins_again_without_the_lists_of_a_lease_that_it_gave_back() {
    let daemon = daemon();
    let options = JoinOptions::default().with_tick_deadline(Duration::from_millis(50));
    let options = options.hearing(Hears::All);
    let _first = Member::join(&daemon, "lists-again", 0..1, options);
    let mut one = Member::join(&daemon, "lists-again", 1..10, options);
    one.scene.lease(10..20).unwrap();
    let (indices, boxes) = ([1_u32, 2, 11, 12], [at(0.0); 4]);
    let edit = one.scene.edit().set_all(&indices, &boxes);
    let edit = edit.step(Step::Exclude(&[[1, 2], [2, 11], [11, 12]], true));
    let edit = edit.step(Step::Include(&[[1, 11]], true));
    let answer = edit.commit(Want::All).unwrap().take();
    assert_eq!(answer.pairs(), [[1, 11], [1, 12], [2, 12]]);
    drop(answer);
    one.scene.give_back(1).unwrap();
    daemon.signal_worker(Signal::KILL);
    let answer = eventually("the member joins again", || {
        let answer = one.scene.edit().set(13, at(0.0)).commit(Want::All).ok()?;
        Some(answer.take().pairs().to_vec())
    });
    assert_eq!(answer, [[11, 13], [12, 13]]);
}

#[test]
fn members_come_and_go_between_ticks() {
    let daemon = daemon();
    let options = JoinOptions::default().with_tick_deadline(LONG).with_most_boxes(200);
    let mut random = Random::new(5);
    let mut members: Vec<Option<Member>> = (0..5).map(|_| None).collect();
    let mut all: Vec<Option<Aabb>> = vec![None; 200];
    for _ in 0..60 {
        for (which, member) in members.iter_mut().enumerate() {
            let own = which as u32 * OWN..(which as u32 + 1) * OWN;
            if random.below(4) > 0 {
                continue;
            }
            let boxes = &mut all[own.start as usize..own.end as usize];
            match member {
                // A lease that is given back takes its boxes along.
                Some(here) if random.below(2) == 0 => {
                    here.scene.give_back(own.start).unwrap();
                    here.scene.lease(own).unwrap();
                    boxes.fill(None);
                }
                Some(_) => {
                    *member = None;
                    boxes.fill(None);
                }
                None => {
                    let hears = if which % 2 == 0 { Hears::All } else { Hears::Own };
                    *member =
                        Some(Member::join(&daemon, "come-and-go", own, options.hearing(hears)));
                }
            }
        }
        let drawn: Vec<_> = members
            .iter()
            .map(|member| {
                member.as_ref().map(|m| draw(&mut random, &m.own, &all)).unwrap_or_default()
            })
            .collect();
        for (index, new) in drawn.iter().flatten() {
            all[*index as usize] = *new;
        }
        let mut pending = Vec::new();
        for (member, drawn) in members.iter_mut().zip(&drawn) {
            let Some(Member { scene, known, own, hears, .. }) = member else { continue };
            let mut edit = scene.edit();
            for (index, new) in drawn {
                edit = match new {
                    Some(b) => edit.set(*index, *b),
                    None => edit.remove(*index),
                };
            }
            pending.push((edit.submit(Want::Changes).unwrap(), known, own.clone(), *hears));
        }
        let truth = pairs_of(&all);
        for (pending, known, own, hears) in pending {
            let answer = pending.wait().unwrap().take();
            learn(known, &heard(&answer), Want::Changes);
            let hears_of =
                |pair: &&Pair| hears == Hears::All || pair.iter().any(|i| own.contains(i));
            assert!(known.iter().eq(truth.iter().filter(hears_of)));
        }
    }
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
    let mut last = Member::join(&daemon, "side", 0..0, options.hearing(Hears::All));
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
                    drop(guest.scene.edit().set_all(own, &boxes).commit(Want::Changes).unwrap());
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
                    let answer = edit.commit(Want::Changes).unwrap().take();
                    learn(&mut member.known, &heard(&answer), Want::Changes);
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
    let boxes: Vec<Option<Aabb>> = all_at(TICKS - 1, &(0..1_800)).into_iter().map(Some).collect();
    let truth = pairs_of(&boxes);
    // Guests have left by then.
    eventually("the boxes of the writers alone", || {
        let answer = last.scene.edit().commit(Want::All).unwrap().take();
        answer.pairs().iter().eq(truth.iter().copied()).then_some(())
    });
    drop(writers);
}

#[test]
fn a_scene_that_is_left_during_a_tick_holds_nobody_up() {
    let daemon = daemon();
    let options = JoinOptions::default().with_tick_deadline(LONG).hearing(Hears::All);
    let mut one = Member::join(&daemon, "left", 0..10, options);
    for round in 0..5 {
        let mut other = Member::join(&daemon, "left", 10..20, options);
        drop(other.scene.edit().set(10, at(0.0)).submit(Want::Changes).unwrap());
        let Member { mut session, scene, .. } = other;
        drop(scene);
        // The place of the commit that nobody waits for is free again.
        let boxes = session.frame(3).unwrap().submit().unwrap().wait().unwrap();
        assert_eq!(boxes.n().get(), 3);
        let start = Instant::now();
        let answer = one.scene.edit().set(round, at(0.0)).commit(Want::All).unwrap();
        assert!(start.elapsed() < LONG, "it waits for nobody");
        assert_eq!(answer.take().pairs().len(), (round * (round + 1) / 2) as usize);
    }
}

#[test]
fn a_gpu_keeps_a_shared_scene() {
    let daemon = TestDaemon::start(DAEMON, &["--gpu", "software"]);
    let engine = EngineChoice::Only(EngineName::GpuGrid);
    let join = |own: Range<u32>| {
        let mut session = daemon.session().engine(engine).connect().unwrap();
        let options = JoinOptions::default().with_tick_deadline(LONG).hearing(Hears::All);
        let mut scene = session.join_scene("gpu", options).unwrap();
        scene.lease(own).unwrap();
        scene
    };
    let (mut one, mut other) = (join(0..500), join(500..1_000));
    let mut random = Random::new(3);
    let mut all = vec![None; 1_000];
    for _ in 0..4 {
        for now in &mut all {
            *now = Some(at(random.below(400) as f32));
        }
        let boxes: Vec<Aabb> = all.iter().flatten().copied().collect();
        let pending = one.edit().set_all(0..500, &boxes[..500]).submit(Want::All).unwrap();
        drop(other.edit().set_all(500..1_000, &boxes[500..]).commit(Want::Nothing).unwrap());
        let answer = pending.wait().unwrap();
        assert_eq!(answer.engine(), EngineName::GpuGrid);
        assert!(answer.take().pairs().iter().eq(pairs_of(&all)));
    }
}

/// A writer of another process: boxes 10 to 19 of the scene, all around the origin.
struct Writer(Child);

impl Writer {
    fn start(daemon: &TestDaemon, scene: &str) -> Self {
        let mut child = Command::new(CLIENT)
            .args(["shared", "auto", scene])
            .env("PAIRMASK_RUNTIME_DIR", daemon.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        assert_eq!(lines.next().unwrap().unwrap(), "connected");
        child.stdin.as_mut().unwrap().write_all(b"\n").unwrap();
        assert_eq!(lines.next().unwrap().unwrap(), "ready");
        Self(child)
    }

    /// SIGKILL.
    fn kill(mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

/// Writers that are killed and come back.
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
        let answer = next.commit(Want::Changes).unwrap().take();
        let told = heard(&answer);
        drop(answer);
        assert!(start.elapsed() < deadline + Duration::from_secs(2), "a tick is stuck");
        learn(&mut member.known, &told, Want::Changes);
        (member.known.len(), told)
    };
    tick(true);
    for _ in 0..times {
        let writer = Writer::start(&daemon, "killed");
        eventually("the writer's boxes are there", || (tick(false).0 == 10).then_some(()));
        for _ in 0..random.below(5) {
            tick(false);
        }
        writer.kill();
        let killed = Instant::now();
        if at_end == AtEnd::Keep {
            // They stay for the next one, which leases them as soon as they are free.
            continue;
        }
        loop {
            let (pairs, (_, ended, ..)) = tick(false);
            if pairs == 0 {
                assert_eq!(ended.len(), 10);
                assert!(ended.iter().all(|ended| ended.reason == EndReason::Removed));
                break;
            }
            assert!(killed.elapsed() < Duration::from_secs(10), "the boxes of the dead stay");
        }
    }
    if at_end == AtEnd::Keep {
        assert_eq!(tick(false).0, 10, "kept");
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
    let options = JoinOptions::default().with_tick_deadline(deadline).hearing(Hears::All);
    let mut one = Member::join(&daemon, "again", 0..10, options);
    let mut other = Member::join(&daemon, "again", 10..20, options);
    for round in 0..6 {
        let x = round as f32;
        // Both commit, until a tick has both.
        eventually("a tick of both", || {
            let first = one.scene.edit().set(2, at(x)).set(3, at(9.0)).submit(Want::All);
            let second = other.scene.edit().set(12, at(x)).commit(Want::Changes);
            let answered = first.and_then(PendingShared::wait);
            match (answered, second) {
                // A daemon that has just started may know one of them alone.
                (Ok(first), Ok(second)) if first.late().is_empty() && first.pairs().len() == 1 => {
                    assert_eq!(first.pairs(), [[2, 12]], "round {round}");
                    learn(&mut other.known, &heard(&second.take()), Want::Changes);
                    assert_eq!(other.known.len(), 1);
                    drop(first.take());
                    Some(())
                }
                (first, second) => {
                    for known in [first.map(|a| heard(&a)), second.map(|a| heard(&a))] {
                        if let Err(error) = known {
                            println!("round {round}: {error}");
                        }
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
