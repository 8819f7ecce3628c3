//! Observers of shared scenes: every change is reported to them, regardless of who made it.

use std::collections::BTreeMap;

use pairmask::filters::{Filter, FilterData, FilterTable, Owner, World};
use pairmask::{Aabb, AtEnd, Error, Pending, Scene, SceneAnswer, SceneOptions};
use pairmask_tests::prelude::*;

use super::shared_scenes::LONG;

/// A box as an observer or its writer knows it: whether it is enabled, filter data, user data.
type Known = (Aabb, bool, FilterData, u64);

fn join(session: &mut Session, at_end: AtEnd) -> Scene {
    let options = SceneOptions::default().with_tick_deadline(LONG).with_at_end(at_end);
    session.scene(options.with_shared("observed")).unwrap()
}

/// Brings what an observer knows up to date. Whether all boxes were reported.
fn observe(observer: &mut Scene, known: &mut BTreeMap<u32, (u32, Known)>) -> bool {
    let observed = observer.observe().unwrap();
    if observed.is_whole {
        known.clear();
    }
    for of in &observed.boxes {
        if of.is_present() {
            let state = (of.aabb, of.is_enabled(), of.filter_data, of.user_data);
            known.insert(of.index, (of.incarnation, state));
        } else {
            known.remove(&of.index);
        }
    }
    observed.is_whole
}

/// xorshift.
struct Random(u64);

impl Random {
    fn below(&mut self, n: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) % n
    }
}

fn boxes(known: &BTreeMap<u32, (u32, Known)>) -> BTreeMap<u32, Known> {
    known.iter().map(|(index, (_, state))| (*index, *state)).collect()
}

/// Commits random steps of a writer of 50 indices. Each index is named once: the order of steps is for other tests.
fn commit_any<'s>(
    scene: &'s mut Scene,
    own: u32,
    tick: u32,
    random: &mut Random,
    right: &mut BTreeMap<u32, Known>,
) -> Pending<SceneAnswer<'s>> {
    let mut edit = scene.edit();
    for index in own..own + 50 {
        let state = right.get(&index).copied();
        match (random.below(40), state) {
            (0, Some(_)) => {
                edit = edit.remove(index);
                right.remove(&index);
            }
            (1 | 2, _) => {
                let to = at(random.below(1_000) as f32);
                let fresh = (to, true, FilterData::default(), 0_u64);
                edit = edit.set(index, to);
                let now = state.map_or(fresh, |state| (to, state.1, state.2, state.3));
                right.insert(index, now);
            }
            (3, Some(state)) => {
                edit = edit.set_enabled(index, !state.1);
                right.insert(index, (state.0, !state.1, state.2, state.3));
            }
            (4, Some(state)) => {
                let filter_data =
                    FilterData::default().with_world(World(3)).with_owner(Owner(tick));
                edit = edit.set_filter(index, filter_data);
                let of = filter_data.with_static(state.2.is_static());
                right.insert(index, (state.0, state.1, of, state.3));
            }
            (5, Some(state)) => {
                edit = edit.make_static(index, true);
                right.insert(index, (state.0, state.1, state.2.with_static(true), state.3));
            }
            (6, Some(state)) => {
                edit = edit.set_user_data(index, tick.into());
                right.insert(index, (state.0, state.1, state.2, tick.into()));
            }
            _ => {}
        }
    }
    edit.submit(Report::Nothing).unwrap()
}

#[test]
fn observers_know_every_box_after_any_edits() {
    let daemon = TestDaemon::of_cores();
    let mut sessions = [(); 4].map(|()| daemon.connect());
    let [one, two, often, rarely] = &mut sessions;
    let mut writers = [join(one, AtEnd::Remove), join(two, AtEnd::Remove)];
    writers[0].lease(0..50).unwrap();
    writers[1].lease(50..100).unwrap();
    let mut observers = [join(often, AtEnd::Remove), join(rarely, AtEnd::Remove)];
    let mut known = [BTreeMap::new(), BTreeMap::new()];
    let mut right: BTreeMap<u32, Known> = BTreeMap::new();
    let mut random = Random(17);
    for tick in 0..200_u32 {
        let [first, second] = &mut writers;
        let commits = [
            commit_any(first, 0, tick, &mut random, &mut right),
            commit_any(second, 50, tick, &mut random, &mut right),
        ];
        for commit in commits {
            drop(commit.wait().unwrap());
        }
        let is_whole = observe(&mut observers[0], &mut known[0]);
        assert_eq!(is_whole, tick == 0);
        assert_eq!(boxes(&known[0]), right, "tick {tick}");
        if tick % 7 == 6 {
            assert_eq!(observe(&mut observers[1], &mut known[1]), tick == 6);
            assert_eq!(boxes(&known[1]), right, "tick {tick}");
        }
    }
    assert!(right.len() > 10);
    // Also of writers that end: one gives its lease back, one dies.
    writers[0].give_back(0).unwrap();
    right.retain(|index, _| *index >= 50);
    observe(&mut observers[0], &mut known[0]);
    assert_eq!(boxes(&known[0]), right);
    let [_, second] = writers;
    drop(second);
    eventually("the boxes of the other are removed", || {
        observe(&mut observers[0], &mut known[0]);
        known[0].is_empty().then_some(())
    });
}

#[test]
fn an_observer_knows_the_table_of_filters() {
    let daemon = TestDaemon::of_cores();
    let mut sessions = [(); 2].map(|()| daemon.connect());
    let [one, two] = &mut sessions;
    let (mut writer, mut observer) = (join(one, AtEnd::Remove), join(two, AtEnd::Remove));
    writer.lease(0..10).unwrap();
    drop(writer.edit().set(3, at(0.0)).commit(Report::Nothing).unwrap());
    assert_eq!(observer.observe().unwrap().filters, Some(FilterTable::default()), "all is asked");
    for mask in 1..4 {
        let table = FilterTable::new(&[Filter::new(1, mask), Filter::ALL.with_group(-7)]).unwrap();
        drop(writer.edit().filter_table(&table).commit(Report::Nothing).unwrap());
        let observed = observer.observe().unwrap();
        assert_eq!(
            (observed.boxes.len(), observed.filters),
            (1, Some(table)),
            "its filter changed"
        );
        drop(writer.edit().set(3, at(mask as f32)).commit(Report::Nothing).unwrap());
        assert_eq!(observer.observe().unwrap().filters, None, "it did not change");
    }
    let [_, mut late] = [daemon.connect(), daemon.connect()];
    let filters = join(&mut late, AtEnd::Remove).observe().unwrap().filters;
    assert_eq!(filters.expect("all is asked").filters().len(), 2);
}

#[test]
fn another_box_at_an_index_has_another_incarnation() {
    let daemon = TestDaemon::of_cores();
    let mut sessions = [(); 2].map(|()| daemon.connect());
    let [one, two] = &mut sessions;
    let (mut writer, mut observer) = (join(one, AtEnd::Remove), join(two, AtEnd::Remove));
    writer.lease(0..10).unwrap();
    let mut known = BTreeMap::new();
    drop(writer.edit().set(3, at(0.0)).commit(Report::Nothing).unwrap());
    observe(&mut observer, &mut known);
    let (first, _) = known[&3];
    drop(writer.edit().set(3, at(1.0)).commit(Report::Nothing).unwrap());
    observe(&mut observer, &mut known);
    assert_eq!(known[&3].0, first, "it moved");
    drop(writer.edit().remove(3).set(3, at(1.0)).commit(Report::Nothing).unwrap());
    observe(&mut observer, &mut known);
    assert_ne!(known[&3].0, first);
}

#[test]
fn all_is_reported_to_an_observer_where_the_daemon_has_lost_the_scene() {
    let daemon = TestDaemon::of_cores();
    let mut sessions = [(); 2].map(|()| daemon.connect());
    let [one, two] = &mut sessions;
    let (mut writer, mut observer) = (join(one, AtEnd::Remove), join(two, AtEnd::Remove));
    writer.lease(0..10).unwrap();
    let mut known = BTreeMap::new();
    for x in 0..5 {
        drop(writer.edit().set(3, at(x as f32)).commit(Report::Nothing).unwrap());
    }
    assert!(observe(&mut observer, &mut known));
    daemon.signal_worker(Signal::KILL);
    eventually("the writer joins again", || writer.edit().commit(Report::Nothing).ok().map(drop));
    let is_whole = eventually("the observer joins again", || {
        let observed = observer.observe().ok()?;
        (!observed.boxes.is_empty()).then_some(observed.is_whole)
    });
    assert!(is_whole);
}

#[test]
fn only_a_shared_scene_is_observed() {
    let daemon = TestDaemon::of_cores();
    let mut session = daemon.connect();
    let mut alone = session.scene(SceneOptions::default()).unwrap();
    assert!(matches!(alone.observe(), Err(Error::NotShared)));
}
