//! Whole frames with rules, by every engine, encoding and backend, against the oracle and the seven rules.
// Rules are filled as users fill them.
#![allow(clippy::field_reassign_with_default)]

use std::sync::Arc;
use std::time::Duration;

use pairmask::Frame;
use pairmask::filters::{FilterData, Owner, Rules, World};
use pairmask_tests::daemon::outlive_kills;
use pairmask_tests::filtered_frames::{FilteredFrame, KINDS};
use pairmask_tests::frames::filtered;
use pairmask_tests::prelude::*;

/// A session of the grid of a GPU.
fn grid(builder: SessionBuilder) -> SessionBuilder {
    builder.engine(EngineChoice::Only(EngineName::GpuGrid))
}

/// Each pair stands in the range of its world, and ranges stand side by side.
fn check_worlds(mask: &PairMask, frame: &FilteredFrame) {
    let (rules, n) = (&frame.rules, frame.boxes.len());
    let mut worlds: Vec<World> =
        (0..n as u32).map(|index| rules.filter_data(index).world).collect();
    worlds.sort_unstable();
    worlds.dedup();
    let several = worlds.iter().filter(|world| **world != World::ALL).count() > 1;
    if !several || mask.encoding() != Encoding::List {
        assert!(mask.worlds().is_empty());
        return;
    }
    assert_eq!(mask.worlds().iter().map(|range| range.world).collect::<Vec<_>>(), worlds);
    let mut seen = 0;
    for world in worlds {
        for [a, b] in mask.pairs_of_world(world).unwrap() {
            let of = [*a, *b].map(|index| rules.filter_data(index).world);
            assert_eq!(if of[0] == World::ALL { of[1] } else { of[0] }, world);
            seen += 1;
        }
    }
    assert_eq!(seen, mask.count());
    assert_eq!(mask.pairs_of_world(World(123_456)), None);
}

/// Waits for an answer and checks it. Returns what served it.
fn check(pending: Pending<PairMask>, frame: &FilteredFrame) -> ServedBy {
    let mask = pending.wait().unwrap();
    check_mask(&mask, frame);
    mask.info().served_by
}

fn check_mask(mask: &PairMask, frame: &FilteredFrame) {
    let pairs = mask.sorted();
    assert_eq!(pairs, frame.pairs);
    mask.view().verify().unwrap();
    let (info, n) = (mask.info(), BoxCount::new(frame.boxes.len() as u32));
    assert_eq!(mask.count(), pairs.len() as u64);
    let compared = n.pair_count() - info.skipped.pairs;
    assert!(info.skipped.is_repeat() || mask.count() <= compared);
    assert_eq!(info.skipped.why.total(), info.skipped.pairs);
}

fn sessions(builder: &SessionBuilder) -> Vec<Session> {
    let encodings = Encoding::ALL.map(EncodingChoice::Only).into_iter();
    let encodings = encodings.chain([EncodingChoice::Auto]);
    encodings.map(|encoding| builder.clone().encoding(encoding).connect().unwrap()).collect()
}

#[test]
fn frames_through_the_daemon_by_every_engine() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let engines = EngineName::ALL.map(EngineChoice::Only).into_iter().chain([EngineChoice::Auto]);
    let mut with_worlds = 0;
    for engine in engines {
        let is_gpu = matches!(engine, EngineChoice::Only(name) if name.is_gpu());
        let mut sessions = sessions(&daemon.session().engine(engine));
        let small = if engine == EngineChoice::Auto || tier::is_nightly() {
            (0..=70).collect()
        } else {
            vec![0, 1, 9, 33, 63]
        };
        for n in small.into_iter().chain([345, 1_235]) {
            for (seed, kind) in KINDS.into_iter().enumerate() {
                let frame = FilteredFrame::drawn(n, kind, (100 * n + seed) as u64);
                for session in &mut sessions {
                    let mask = frame.submit(session).wait().unwrap();
                    assert_eq!(mask.info().served_by, ServedBy::Daemon);
                    check_mask(&mask, &frame);
                    if !is_gpu || !mask.worlds().is_empty() {
                        check_worlds(&mask, &frame);
                    }
                    if is_gpu && !mask.worlds().is_empty() {
                        let grid = EngineChoice::Only(EngineName::GpuGrid);
                        assert_eq!(engine, grid, "all pairs know no worlds");
                        with_worlds += 1;
                    }
                }
            }
        }
    }
    assert!(with_worlds > 4, "{with_worlds} lists ordered by world");
}

/// Rules that stay are taken into account by the GPU itself from their second frame on.
#[test]
fn rules_that_stay_go_to_the_gpu_and_change_in_time() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let mut session = grid(daemon.session()).answer_repeats(false).connect().unwrap();
    for kind in KINDS {
        let mut frame = FilteredFrame::drawn(700, kind, 21);
        for turn in 0..3 {
            check(frame.submit(&mut session), &frame);
            if let Some([a, _]) = frame.pairs.get(turn).copied() {
                frame.rules.filter_data[a as usize].world = World(4);
                frame.find_pairs();
            }
            for _ in 0..2 {
                check(frame.submit(&mut session), &frame);
            }
        }
    }
}

/// Frames that are left under way, two at a time, whose rules differ.
#[test]
fn frames_under_way_on_the_gpu_keep_their_rules() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let frames = [0, 1, 2].map(|seed| FilteredFrame::drawn(9_001, KINDS[seed], seed as u64));
    for encoding in [Encoding::Sparse, Encoding::List] {
        let builder = grid(daemon.session()).encoding(EncodingChoice::Only(encoding));
        let mut session = builder.connect().unwrap();
        for _ in 0..2 {
            let pending = frames.each_ref().map(|frame| frame.submit(&mut session));
            for (pending, frame) in pending.into_iter().zip(&frames) {
                check(pending, frame);
            }
        }
    }
}

#[test]
fn a_mask_of_all_pairs_that_has_no_room_becomes_one_of_those_that_meet() {
    let daemon = TestDaemon::start(&["--gpu", "software", "--max-reply-mib", "1"]);
    let mut frame = FilteredFrame::drawn(4_201, KINDS[0], 3);
    frame.boxes.fill(Aabb::new([0.0; 3], [1.0; 3]));
    frame.rules = Rules::default();
    frame.rules.filter_data =
        (0..4_201).map(|at| FilterData::default().with_owner(Owner(at / 4_200 + 1))).collect();
    frame.pairs = (0..4_200).map(|a| [a, 4_200]).collect();
    let mut session = daemon.connect_to(EngineName::GpuGrid);
    for _ in 0..3 {
        check(frame.submit(&mut session), &frame);
    }
}

#[test]
fn narrow_frames_have_rules_too() {
    let daemon = TestDaemon::of_cores();
    let drawn = FilteredFrame::drawn(500, KINDS[5], 9);
    let mut answers = Vec::new();
    for backend in [Backend::Daemon, Backend::InProcess] {
        let mut session = daemon.session().backend(backend).connect().unwrap();
        for _ in 0..3 {
            let mut frame = session.narrow_frame(500, Precision::F16).unwrap();
            frame.write(&drawn.boxes).unwrap();
            let pairs = frame.submit_with(&drawn.options()).unwrap().wait().unwrap().sorted();
            assert!(drawn.pairs.iter().all(|pair| pairs.binary_search(pair).is_ok()));
            assert!(pairs.iter().all(|[a, b]| drawn.rules.meet(*a, *b)));
            answers.push(pairs);
        }
    }
    assert!(answers.windows(2).all(|two| two[0] == two[1]));
}

#[test]
fn equal_boxes_with_other_rules_are_no_repeat() {
    let daemon = TestDaemon::of_cores();
    for kind in [KINDS[1], KINDS[2], KINDS[4]] {
        let mut session = daemon.connect();
        let mut frame = FilteredFrame::drawn(900, kind, 5);
        let check_repeats = |session: &mut Session, frame: &FilteredFrame| {
            let repeats = [(); 5].map(|()| {
                let mask = frame.submit(session).wait().unwrap();
                check_mask(&mask, frame);
                check_worlds(&mask, frame);
                mask.info().skipped.is_repeat()
            });
            assert_eq!(repeats, [false, false, true, true, true], "{kind:?}");
        };
        check_repeats(&mut session, &frame);
        // One entry of filter data, and then one pair of a list, and then the filters.
        let [a, b] = frame.pairs[frame.pairs.len() / 2];
        frame.rules.lists.exclude([a, b], true);
        frame.rules.lists.include([a, b], false);
        frame.pairs.retain(|pair| *pair != [a, b]);
        check_repeats(&mut session, &frame);
        let [a, b] = frame.pairs[0];
        frame.rules.filter_data[a as usize].world = World(77);
        frame.rules.filter_data[b as usize].world = World(78);
        frame.pairs.retain(|[a, b]| frame.rules.meet(*a, *b));
        check_repeats(&mut session, &frame);
        // Without rules, and with those that let all meet.
        let mut open = FilteredFrame { rules: Rules::default(), ..frame.clone() };
        open.find_pairs();
        for _ in 0..3 {
            check(open.submit(&mut session), &open);
            check(frame.submit(&mut session), &frame);
        }
    }
}

#[test]
fn frames_grow_and_their_rules_come_and_go() {
    let daemon = TestDaemon::of_cores();
    let mut session = daemon.session().capacity(BoxCount::new(64)).connect().unwrap();
    for (turn, n) in [5, 900, 60, 4_000, 61, 2_500, 9_000, 3].into_iter().enumerate() {
        let frame = FilteredFrame::drawn(n, KINDS[turn % KINDS.len()], turn as u64);
        // All memory of the port is lent when the first one with rules has no room.
        let frames: Vec<_> = (0..3).map(|_| session.frame(n).unwrap()).collect();
        let submit = |mut shared: Frame| {
            assert!(shared.is_shared());
            shared.write(&frame.boxes).unwrap();
            shared.submit_with(&frame.options()).unwrap()
        };
        let pending: Vec<_> = frames.into_iter().map(submit).collect();
        for pending in pending {
            assert_eq!(check(pending, &frame), ServedBy::Daemon);
        }
        let expected = oracle::truth(&frame.boxes).pairs.len() as u64;
        assert_eq!(session.answer(&frame.boxes).count(), expected);
    }
}

#[test]
fn lists_of_any_length_are_sent_or_answered_here() {
    let daemon = TestDaemon::of_cores();
    let excluded = |n: u32| {
        let mut frame = FilteredFrame::drawn(n as usize, KINDS[7], 2);
        for b in 1..n {
            for a in (0..b).filter(|a| (a + b) % 97 != 0) {
                frame.rules.lists.exclude([a, b], true);
            }
        }
        frame.find_pairs();
        frame
    };
    // More pairs than a request of so few boxes may name.
    let frame = excluded(600);
    assert_eq!(check(frame.submit(&mut daemon.connect_auto()), &frame), ServedBy::InProcess);
    let mut session = daemon.connect();
    let refused = session.frame(600).unwrap().submit_with(&frame.options());
    assert!(matches!(refused, Err(Error::TooManyListedPairs(_))));
    let fewer = excluded(300);
    assert_eq!(check(fewer.submit(&mut session), &fewer), ServedBy::Daemon);
}

#[test]
fn a_daemon_that_is_killed_costs_no_rule() {
    let (mut daemon, mut session) = served_or_here();
    let frames: Vec<(FilteredFrame, Arc<Rules>)> = (0..6)
        .map(|seed| FilteredFrame::drawn(60 * (1 + seed % 3), KINDS[seed], seed as u64))
        .map(|frame| (frame.clone(), Arc::new(frame.rules)))
        .collect();
    let check = |pending: Pending<PairMask>, frame: &FilteredFrame| {
        let mask = pending.wait().unwrap();
        check_mask(&mask, frame);
        check_worlds(&mask, frame);
        mask.info().served_by
    };
    outlive_kills(&mut daemon, |i| {
        // Most of them are kept ones, in runs.
        let (frame, rules) = &frames[i / 7 % frames.len()];
        let pending = match i % 3 {
            0 => frame.submit(&mut session),
            _ => session.ask_with(&frame.boxes, &filtered(rules)),
        };
        check(pending, frame)
    });
    daemon.signal_worker(Signal::STOP);
    let pending = [5, 2].map(|at| (frames[at].0.submit(&mut session), &frames[at].0));
    daemon.kill();
    for (pending, frame) in pending {
        assert_eq!(check(pending, frame), ServedBy::InProcess);
    }
}

#[test]
fn audited_frames_are_held_to_their_rules() {
    for gpu in ["none", "software"] {
        let daemon = TestDaemon::start(&["--gpu", gpu, "--audit", "1/1"]);
        let builder = daemon.session();
        let mut sessions = sessions(&if gpu == "none" { builder } else { grid(builder) });
        // The auditor takes a small part of the daemon's time: on a busy machine it skips most frames.
        daemon.audit_is_clean(|audit| {
            for (seed, kind) in KINDS.into_iter().enumerate() {
                let frame = FilteredFrame::drawn(300, kind, seed as u64);
                for session in &mut sessions {
                    frame.submit(session).wait().unwrap();
                }
            }
            audit.frames > 3 && audit.pairs > 3 * 300
        });
    }
}

#[test]
fn kept_rules_are_those_of_their_frame() {
    let daemon = TestDaemon::of_cores();
    let mut session = daemon.session().answer_repeats(false).connect().unwrap();
    let frames: Vec<_> = (0..4)
        .map(|seed| FilteredFrame::drawn([300, 300, 41, 1_200][seed], KINDS[seed * 2], 40))
        .map(|frame| (Arc::new(frame.rules.clone()), frame))
        .collect();
    // Each alone, in turns with another, with rules that are not kept between, and with none.
    for order in [[0, 0, 0, 0], [0, 1, 0, 1], [3, 3, 2, 2], [1, 1, 3, 1]] {
        for at in order {
            let (rules, frame) = &frames[at];
            check(session.ask_with(&frame.boxes, &filtered(rules)), frame);
        }
        let (_, other) = &frames[2];
        check(other.submit(&mut session), other);
        session.answer(&other.boxes);
    }
    // Two under way: the second names what the first one brings.
    let (rules, frame) = &frames[1];
    let pending = [(); 2].map(|()| session.ask_with(&frame.boxes, &filtered(rules)));
    for pending in pending {
        assert_eq!(check(pending, frame), ServedBy::Daemon);
    }
}

#[test]
fn a_daemon_that_has_dropped_rules_is_sent_them_again() {
    let daemon = TestDaemon::of_cores();
    let frame = FilteredFrame::drawn(700, KINDS[6], 8);
    let rules = Arc::new(frame.rules.clone());
    let mut sessions = [Backend::Daemon, Backend::Auto]
        .map(|backend| daemon.session().backend(backend).connect().unwrap());
    for session in &mut sessions {
        check(session.ask_with(&frame.boxes, &filtered(&rules)), &frame);
    }
    // Longer than a daemon keeps what no frame asks for.
    std::thread::sleep(Duration::from_secs(13));
    for session in &mut sessions {
        // The first of three frames that hold all places brings the rules, in its own place.
        let pending = [(); 3].map(|()| session.ask_with(&frame.boxes, &filtered(&rules)));
        for pending in pending {
            assert_eq!(check(pending, &frame), ServedBy::Daemon);
        }
        check(session.ask_with(&frame.boxes, &filtered(&rules)), &frame);
    }
    let status = daemon.connect().daemon_status().unwrap();
    assert_eq!(status.errors, 6, "each of those under way was refused once");
}
