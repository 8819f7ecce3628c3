//! Scenes against a naive model: random edits over all verbs, in process, by a daemon with cores and with a GPU, when
//! the daemon is killed, and by several members of one scene. Where one differs, the smallest script is printed.
//!
//! Every `cargo test` runs for seconds; with the nightly tier some run longer, and those that are ignored run as well.
//! `PAIRMASK_MODEL_SEED` and `PAIRMASK_MODEL_EDITS` say from which seed on, and how many.

use std::cell::{Cell, RefCell};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

use pairmask_core::filters::{FilterData, FilterId, Owner, World};
use pairmask_core::scene::{EditError, FilterDataSets, Scene};
use pairmask_tests::gpu;
use pairmask_tests::prelude::*;
use pairmask_tests::scene_model::{
    AtEnd, Bare, CoreScene, EndReason, Event, Fate, Kind, Mode, Model, Moment, Op, Received, Scope,
    Script, SessionScene, Sessions, SharedMembers, Subject, Turn, at, check, hold, hold_all,
    hold_without_rules, one, options, script_of, turn,
};
use pairmaskd::execute::gpu::{EngineOptions, GpuScene};

fn given(variable: &str, usual: usize) -> usize {
    std::env::var(variable).map_or(usual, |text| text.parse().unwrap())
}

/// Edits of each kind: most of small scripts.
fn of_kinds(edits: usize) -> [(Kind, usize); 3] {
    let (crowds, large) = (edits / 20, edits / 100);
    [(Kind::Small, edits - crowds - large), (Kind::Crowd, crowds), (Kind::Large, large)]
}

/// A script for the nightly tier: a seed that no quick test has, and so many edits.
fn nightly(edits: usize) -> (u64, [(Kind, usize); 3]) {
    let seed = given("PAIRMASK_MODEL_SEED", 1_000_000) as u64;
    (seed, of_kinds(given("PAIRMASK_MODEL_EDITS", edits)))
}

#[test]
fn scenes_of_one_thread_are_those_of_the_model() {
    let kinds = [(Kind::Small, 8_000), (Kind::Crowd, 100), (Kind::Large, 60)];
    hold_all(script_of, 0, kinds, |script| CoreScene::new(script, 1));
}

#[test]
fn scenes_of_several_threads_are_those_of_the_model() {
    let kinds = [(Kind::Small, 1_000), (Kind::Crowd, 100), (Kind::Large, 60)];
    pool(3).install(|| hold_all(script_of, 10_000, kinds, |script| CoreScene::new(script, 3)));
}

#[test]
fn scenes_of_sessions_in_process_are_those_of_the_model() {
    let mut session = in_process();
    let kinds = [(Kind::Small, 2_000), (Kind::Crowd, 30), (Kind::Large, 30)];
    hold_all(script_of, 20_000, kinds, |script| {
        SessionScene::of(&mut session, script, ServedBy::InProcess, EngineName::CpuGrid)
    });
}

#[test]
fn scenes_of_a_daemon_are_those_of_the_model() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--audit", "1/1"]);
    let mut session = daemon.connect();
    let mut scene = |script: &Script| {
        SessionScene::of(&mut session, script, ServedBy::Daemon, EngineName::CpuGrid)
    };
    let kinds = [(Kind::Small, 2_000), (Kind::Crowd, 30), (Kind::Large, 30)];
    hold_all(script_of, 30_000, kinds, &mut scene);
    let mut seed = 31_000;
    daemon.audit_is_clean(|audit| {
        // The auditor gives up a scene that is edited faster than it follows: then there are others.
        seed += 100;
        hold(Kind::Small, seed, 200, &mut scene);
        audit.frames > 100 && audit.pairs > 1_000
    });
}

/// In the nightly tier an hour on a software driver.
#[test]
fn scenes_of_a_gpu_are_those_of_the_model() {
    let usual = (40_000, [(Kind::Small, 400), (Kind::Crowd, 20), (Kind::Large, 20)]);
    let (seed, kinds) = tier::nightly_or(nightly(100_000), usual);
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let engine = EngineName::GpuGrid;
    let mut session = daemon.connect_to(engine);
    hold_all(script_of, seed, kinds, |script| {
        SessionScene::of(&mut session, script, ServedBy::Daemon, engine)
    });
}

/// The daemon is killed between edits and during them, the worker alone or all of it.
#[test]
fn scenes_outlive_a_daemon_that_is_killed() {
    let usual = (50_000, [(Kind::Small, 300), (Kind::Crowd, 30), (Kind::Large, 30)]);
    let (seed, kinds) = tier::nightly_or(nightly(5_000), usual);
    let daemon = RefCell::new(TestDaemon::of_cores());
    let mut session = daemon.borrow().session().backend(Backend::Auto).connect().unwrap();
    let (served, killed_at, kills) = (Cell::new(0), Cell::new(0), Cell::new(0));
    let kill = || {
        killed_at.set(served.get());
        kills.set(kills.get() + 1);
        std::thread::sleep(Duration::from_micros(kills.get() as u64 * 37 % 300));
        if kills.get() % 4 == 0 {
            daemon.borrow_mut().kill();
            daemon.borrow_mut().restart();
        } else {
            daemon.borrow().signal_worker(Signal::KILL);
        }
    };
    hold_all(script_of, seed, kinds, |script| {
        SessionScene::disturbed(&mut session, script, |moment| match moment {
            // Time to come back.
            Moment::Answered(ServedBy::InProcess, _) => {
                std::thread::sleep(Duration::from_millis(20));
            }
            Moment::Answered(ServedBy::Daemon, _) => {
                served.set(served.get() + 1);
                if served.get() % 25 == 0 {
                    kill();
                }
            }
            Moment::UnderWay if served.get() % 25 == 12 && served.get() != killed_at.get() => {
                kill();
            }
            Moment::UnderWay => {}
        })
    });
    let kills = kills.get();
    assert!(kills > tier::nightly_or(200, 5), "{kills} kills");
}

#[test]
fn shared_scenes_are_those_of_the_model() {
    let daemon = TestDaemon::start(&["--gpu", "none", "--audit", "1/1"]);
    let sessions = Sessions::new(&daemon.session());
    let mut seed = 60_000;
    let mut hold_shared = |edits| {
        seed += 500;
        hold(Kind::Shared, seed, edits, |script| SharedMembers::new(&sessions, script, None))
    };
    let seen = hold_shared(2_000);
    assert!(seen.ended.iter().all(|count| *count > 0) && seen.resyncs > 0, "{seen:?}");
    daemon.audit_is_clean(|audit| {
        hold_shared(100);
        audit.frames > 100 && audit.pairs > 100
    });
}

#[test]
fn shared_scenes_of_a_gpu_are_those_of_the_model() {
    let daemon = TestDaemon::start(&["--gpu", "software"]);
    let engine = EngineName::GpuGrid;
    let builder = daemon.session().engine(EngineChoice::Only(engine));
    let sessions = Sessions::new(&builder);
    hold(Kind::Shared, 70_000, 200, |script| SharedMembers::new(&sessions, script, Some(engine)));
}

#[test]
#[ignore = "minutes: the nightly tier runs it"]
fn a_million_edits_are_those_of_the_model() {
    let (seed, kinds) = nightly(1_000_000);
    pool(3).install(|| {
        let threads = Cell::new(0);
        hold_all(script_of, seed, kinds, |script| {
            threads.set(threads.get() % 3 + 1);
            CoreScene::new(script, threads.get())
        });
    });
}

#[test]
#[ignore = "minutes: the nightly tier runs it"]
fn a_hundred_thousand_edits_of_a_daemon_are_those_of_the_model() {
    let (seed, kinds) = nightly(100_000);
    let (daemon, mut session) = served();
    hold_all(script_of, seed, kinds, |script| {
        SessionScene::of(&mut session, script, ServedBy::Daemon, EngineName::CpuGrid)
    });
    let sessions = Sessions::new(&daemon.session());
    let edits = kinds[0].1;
    hold(Kind::Shared, seed, edits, |script| SharedMembers::new(&sessions, script, None));
}

/// As large as scenes get by random edits, in the core and on a GPU.
#[test]
#[ignore = "minutes: the nightly tier runs it"]
fn huge_scenes_are_those_of_the_model() {
    pool(3).install(|| hold(Kind::Huge, 90_000, 60, |script| CoreScene::new(script, 3)));
    let tools = gpu::scene_tools(0, &EngineOptions::default());
    hold_without_rules(Kind::Huge, 91_000, 20, |script| {
        Bare::of(GpuScene::new(&tools, options(script)))
    });
}

struct Liar<F>(CoreScene, F);

impl<F: FnMut(&mut Received)> Subject for Liar<F> {
    fn tick(&mut self, turns: &[Turn]) -> Result<Vec<(u64, Option<Received>)>, String> {
        let mut reported = self.0.tick(turns)?;
        reported.iter_mut().filter_map(|(_, received)| received.as_mut()).for_each(&mut self.1);
        Ok(reported)
    }

    fn invalidate(&mut self) {
        self.0.invalidate();
    }
}

fn three() -> Script {
    let boxes = [0, 1, 2].map(|index| Op::Set(index, unit()));
    let away = Op::Set(2, at([9.0, 0.0, 0.0, 10.0, 1.0, 1.0]));
    let events = vec![
        one(&boxes, Mode::Changes, Fate::Acknowledged),
        one(&[away], Mode::Changes, Fate::Acknowledged),
        one(&[Op::Enable(0, true)], Mode::Moved, Fate::Acknowledged),
        one(&[], Mode::All, Fate::Acknowledged),
        Event::Invalidate,
        one(&[], Mode::Changes, Fate::Acknowledged),
    ];
    Script { limit: 3, shared: None, events }
}

const fn unit() -> Aabb {
    at([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
}

#[test]
fn the_model_finds_the_pairs_of_the_oracle() {
    for (kind, seeds) in [(Kind::Small, 0..200), (Kind::Large, 0..4)] {
        for script in seeds.map(|seed| script_of(kind, seed)) {
            let (mut model, mut boxes) =
                (Model::default(), vec![Aabb::EMPTY; script.limit as usize]);
            for op in script.turns().flat_map(|turn| &turn.ops) {
                if let Op::Set(index, b) = op {
                    model.apply(0, std::slice::from_ref(op));
                    boxes[*index as usize] = *b;
                }
            }
            let truth = oracle::truth(&boxes).pairs.into_iter();
            assert!(model.pairs().into_keys().eq(truth), "{script}");
        }
    }
}

type Lie = fn(&mut Received);

#[test]
fn the_model_notices_each_falsified_answer() {
    let reported = check(&three(), &mut CoreScene::new(&three(), 1)).unwrap();
    assert_eq!((reported.edits, reported.ended, reported.resyncs), (5, [0, 0, 2], 1));
    let lies: [(&str, Lie); 9] = [
        ("begun", |received| received.begun.truncate(received.begun.len().saturating_sub(1))),
        ("begun", |received| received.begun.extend(received.begun.first().copied())),
        ("begun", |received| received.begun.reverse()),
        ("ended", |received| received.ended.truncate(received.ended.len().saturating_sub(1))),
        ("ended", |received| received.ended.iter_mut().for_each(|e| e.reason = EndReason::Removed)),
        ("pairs", |received| received.pairs.truncate(received.pairs.len().saturating_sub(1))),
        ("pairs", |received| received.pairs.push([1, 2])),
        ("resync", |received| received.is_resync = false),
        ("count", |received| received.pair_count = received.pair_count.map(|count| count + 1)),
    ];
    for (number, (kind, lie)) in lies.into_iter().enumerate() {
        let failure = check(&three(), &mut Liar(CoreScene::new(&three(), 1), lie)).unwrap_err();
        assert_eq!(failure.kind, kind, "lie {number}: {failure:?}");
    }
}

#[test]
fn a_script_that_fails_is_printed_as_small_as_it_can_be() {
    // Ends by a static flag are never reported.
    let lie = |received: &mut Received| received.ended.retain(|e| e.reason != EndReason::Filtered);
    let held = catch_unwind(AssertUnwindSafe(|| {
        hold(Kind::Small, 0, 10_000, |script| Liar(CoreScene::new(script, 1), lie))
    }));
    let text = held.unwrap_err().downcast::<String>().unwrap();
    assert!(text.contains("ended: None for Some(Ended"), "{text}");
    let ops = [
        "Set(",
        "Enable(",
        "Static(",
        "FilterData(",
        "Filters(",
        "Include(",
        "Exclude(",
        "Remove(",
    ];
    let count: usize = ops.iter().map(|op| text.matches(op).count()).sum();
    assert!(count <= 6, "two boxes, and what keeps them apart: {text}");
}

/// Plays a script that was found once, as the shrinker printed it.
fn plays(limit: u32, events: Vec<Event>) {
    let script = Script { limit, shared: None, events };
    let reported = check(&script, &mut CoreScene::new(&script, 1));
    assert!(reported.is_ok(), "{}", reported.unwrap_err().text);
}

fn takes(ops: &[Op]) -> Event {
    one(ops, Mode::Changes, Fate::Acknowledged)
}

#[test]
fn a_pair_ends_that_becomes_static_in_the_first_edit_that_lists_pairs() {
    let boxes = [Op::Set(0, unit()), Op::Set(1, unit()), Op::Set(2, unit()), Op::Static(0, true)];
    for list in [Op::Exclude([1, 2], true), Op::Include([2, 1], false)] {
        plays(3, vec![takes(&boxes), takes(&[list, Op::Static(2, true)])]);
    }
}

#[test]
fn a_removal_is_reported_that_no_answer_reported_before_the_first_rules() {
    let boxes = [Op::Set(0, unit()), Op::Set(1, unit())];
    let filter_data = Op::FilterData(0, FilterData::new(World(0), Owner(1), FilterId(0)));
    let renewed = [Op::Remove(1), Op::Set(1, unit())];
    for removed in [&renewed[..], &renewed[..1]] {
        for (mode, fate) in [(Mode::Changes, Fate::Unread), (Mode::Nothing, Fate::Acknowledged)] {
            let rules = takes(std::slice::from_ref(&filter_data));
            plays(2, vec![takes(&boxes), one(removed, mode, fate), rules]);
        }
    }
}

#[test]
fn a_listed_pair_ends_with_either_of_its_boxes() {
    let boxes = [Op::Set(0, unit()), Op::Set(1, unit())];
    for list in [Op::Exclude([0, 1], true), Op::Include([0, 1], true)] {
        let kept_apart = Op::Filters(vec![pairmask::filters::Filter::NONE]);
        let is_included = matches!(list, Op::Include(..));
        let first = if is_included { vec![list, kept_apart] } else { vec![list] };
        // It waits for boxes that are not there yet.
        let renewed = [Op::Remove(1), Op::Set(1, unit())];
        plays(2, vec![takes(&first), takes(&boxes), takes(&renewed), takes(&[])]);
    }
}

/// Plays scripts of two members, as the shrinker printed them.
fn plays_shared(at_end: AtEnd, scripts: Vec<Vec<Event>>) {
    let daemon = TestDaemon::of_cores();
    let sessions = Sessions::new(&daemon.session());
    for events in scripts {
        let script = Script { limit: 2, shared: Some(at_end), events };
        let reported = check(&script, &mut SharedMembers::new(&sessions, &script, None));
        assert!(reported.is_ok(), "{}\n{script}", reported.unwrap_err().text);
    }
}

#[test]
fn a_wrong_edit_of_rules_changes_nothing() {
    let mut scene = Scene::new(SceneOptions::default().with_most_boxes(10));
    let boxes = [Aabb::new([0.0; 3], [1.0; 3]); 3];
    let set = sets(0..3, &boxes);
    scene.edit(Edit { steps: &[set] }, Report::Changes).expect("an answer");
    scene.acknowledge();
    let filter_data = [FilterData::default().with_world(World(1)); 3];
    let filter_data = |indices, count: usize| {
        Step::FilterData(FilterDataSets { indices, filter_data: &filter_data[..count] })
    };
    let wrong: [(&[Step<'_>], EditError); 6] = [
        (&[filter_data((0..3).into(), 2)], EditError::Lengths { indices: 3, boxes: 2 }),
        (&[filter_data((2..4).into(), 2)], EditError::Absent { index: 3 }),
        (&[filter_data((9..12).into(), 3)], EditError::BeyondLimit { index: 11, limit: 10 }),
        (&[Step::Include(&[[1, 10]], true)], EditError::BeyondLimit { index: 10, limit: 10 }),
        (
            &[Step::Remove((1..2).into()), filter_data((1..2).into(), 1)],
            EditError::Absent { index: 1 },
        ),
        (
            &[filter_data((0..1).into(), 1), Step::Remove((5..6).into())],
            EditError::Absent { index: 5 },
        ),
    ];
    for (steps, expected) in wrong {
        let refused = scene.edit(Edit { steps }, Report::Changes).map(drop);
        assert_eq!(refused, Err(SceneError::Edit(expected)), "{steps:?}");
        let reported = scene.edit(Edit::NONE, Report::Changes).expect("an answer");
        assert!(reported.begun().is_empty() && reported.ended().is_empty(), "{steps:?}");
    }
}

/// A tick of the host and of another member, who may be late.
fn tick(host: &[Op], other: Option<(&[Op], Fate)>) -> Event {
    let host = turn(0, host, Mode::Changes, Fate::Acknowledged);
    let other = other.map(|(ops, fate)| turn(1, ops, Mode::Changes, fate));
    Event::Tick(std::iter::once(host).chain(other).collect())
}

/// Boxes 0 and 1 are the host's, 3 and 4 the other member's.
fn joined(host: &[Op], other: &[Op]) -> Vec<Event> {
    let joins = [Event::Join(0, Scope::All), Event::Join(1, Scope::All)];
    let first = tick(host, Some((other, Fate::Acknowledged)));
    joins.into_iter().chain([first]).collect()
}

#[test]
fn a_removal_that_a_member_has_missed_is_reported() {
    let away = Op::Set(0, at([9.0, 0.0, 0.0, 10.0, 1.0, 1.0]));
    let scripts = [&[Op::Set(0, unit())][..], &[]].map(|last| {
        let mut events = joined(&[Op::Set(0, unit())], &[Op::Set(3, unit())]);
        events.push(tick(std::slice::from_ref(&away), Some((&[], Fate::Unread))));
        events.push(tick(&[Op::Remove(0), away.clone()], None));
        events.push(tick(&[], None));
        events.push(tick(last, Some((&[], Fate::Acknowledged))));
        events
    });
    plays_shared(AtEnd::Remove, scripts.into());
}

#[test]
fn remaining_boxes_are_what_their_next_member_says() {
    // An owner keeps two static boxes apart as well: the host has what the flag needs.
    let host = |flag: &Op| match flag {
        Op::FilterData(..) => [Op::Set(0, unit()), Op::FilterData(0, owned())],
        _ => [Op::Set(0, unit()), Op::Static(0, true)],
    };
    let flags = [Op::Static(3, true), Op::Enable(3, false), Op::FilterData(3, owned())];
    let plain =
        [Op::Static(3, false), Op::Enable(3, true), Op::FilterData(3, FilterData::default())];
    let mut scripts = Vec::new();
    for (flag, plain) in flags.into_iter().zip(plain) {
        for (says, is_first) in [(true, true), (false, true), (false, false)] {
            let mut events = joined(&host(&flag), &[Op::Set(3, unit()), flag.clone()]);
            events.extend([Event::Leave(1), Event::Join(1, Scope::All)]);
            if !is_first {
                events.push(tick(&[], Some((&[], Fate::Acknowledged))));
            }
            let set = Op::Set(3, unit());
            let ops = if says { vec![set, plain.clone()] } else { vec![set] };
            events.push(tick(&[], Some((&ops, Fate::Acknowledged))));
            scripts.push(events);
        }
    }
    plays_shared(AtEnd::Keep, scripts);
}

fn owned() -> FilterData {
    FilterData::new(World(0), Owner(1), FilterId(0))
}
