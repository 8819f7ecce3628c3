//! Shared scenes whose members move with margins, come and go, die, or lose their daemon.

use std::ops::Range;
use std::time::{Duration, Instant};

use pairmask::{AtEnd, EndReason, Margin, Pending, SceneOptions, Scope};
use pairmask_tests::fault_client::FaultClient;
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::Received;
use pairmaskd::scene::Random;

use super::shared_scenes::{LONG, Member, found};

/// To members with margins and to one without, the pairs of fat AABBs are reported, those that overlap among them.
#[test]
fn pairs_of_members_with_margins_are_near_ones() {
    let daemon = TestDaemon::of_cores();
    let options = SceneOptions::default().with_tick_deadline(LONG).with_scope(Scope::All);
    let margined = |units| options.clone().with_margin(Margin::new(units).unwrap());
    let mut members = [(0..30, margined(0.3)), (30..60, margined(1.0)), (60..80, options.clone())]
        .map(|(own, options)| Member::join(&daemon, "margins", own, &options));
    let mut random = Random::new(7);
    let mut boxes: Vec<Aabb> = (0..80).map(|index| at((index * 37 % 80) as f32)).collect();
    let sent_of = |members: &[Member]| -> Vec<Aabb> {
        let own = members.iter().flat_map(|member| member.own.clone().map(move |i| (member, i)));
        own.map(|(member, index)| member.scene.inflated(index).unwrap()).collect()
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
                Received::from(&answer).teach(known);
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

#[test]
fn members_commit_join_and_leave_side_by_side() {
    const TICKS: u32 = 30;
    let daemon = TestDaemon::of_cores();
    let options = SceneOptions::default().with_tick_deadline(Duration::from_millis(200));
    let all_at = |tick: u32, own: &Range<u32>| -> Vec<Aabb> {
        own.clone().map(|index| at((index * 7 % 50 + tick % 3) as f32)).collect()
    };
    let writers: Vec<Member> = (0..3)
        .map(|which| Member::join(&daemon, "side", which * 600..(which + 1) * 600, &options))
        .collect();
    let mut last = Member::join(&daemon, "side", 0..0, &options.clone().with_scope(Scope::All));
    let writers: Vec<Member> = std::thread::scope(|scope| {
        let guests = (0..2).map(|which| {
            let (daemon, options) = (&daemon, &options);
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
                    Received::from(&answer).teach(&mut member.known);
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
    let daemon = TestDaemon::of_cores();
    let options = SceneOptions::default().with_tick_deadline(LONG).with_scope(Scope::All);
    let mut one = Member::join(&daemon, "left", 0..10, &options);
    for round in 0..5 {
        let mut other = Member::join(&daemon, "left", 10..20, &options);
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
    let daemon = TestDaemon::of_cores();
    let deadline = Duration::from_millis(50);
    let options = SceneOptions::default().with_tick_deadline(deadline).with_at_end(at_end);
    let mut member = Member::join(&daemon, "killed", 0..1, &options);
    let mut random = Random::new(times as u64);
    let mut tick = |edit: bool| {
        let start = Instant::now();
        let mut next = member.scene.edit();
        if edit {
            next = next.set(0, at(0.0));
        }
        let answer = next.commit(Report::Changes).unwrap();
        assert!(start.elapsed() < deadline + Duration::from_secs(2), "a tick is stuck");
        Received::from(&answer).teach(&mut member.known);
        let ended = answer.ended().collect::<Vec<_>>();
        drop(answer);
        (member.known.len(), ended, found(&mut member.scene, at(0.0)).len())
    };
    tick(true);
    for _ in 0..times {
        // A writer of another process: boxes 10 to 19 of the scene, all around the origin.
        let mut writer = FaultClient::start(&daemon, &["shared", "auto", "killed"]);
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
fn boxes_of_killed_writers_are_removed_or_kept() {
    kill_writers(tier::nightly_or(200, 14), AtEnd::Remove);
    kill_writers(6, AtEnd::Keep);
}

#[test]
fn a_restarted_daemon_is_joined_again() {
    let mut daemon = TestDaemon::of_cores();
    let deadline = Duration::from_millis(300);
    let options = SceneOptions::default().with_tick_deadline(deadline).with_scope(Scope::All);
    let mut one = Member::join(&daemon, "again", 0..10, &options);
    let mut other = Member::join(&daemon, "again", 10..20, &options);
    for round in 0..6 {
        let x = round as f32;
        // Both commit, until a tick has both.
        eventually("a tick of both", || {
            let first = one.scene.edit().set(2, at(x)).set(3, at(9.0)).submit(Report::All);
            let second = other.scene.edit().set(12, at(x)).commit(Report::Changes);
            let answered = first.and_then(Pending::wait);
            if let Ok(second) = &second {
                Received::from(second).teach(&mut other.known);
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
