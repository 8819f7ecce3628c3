//! User data of shared scenes: members learn those of others, whichever answers they receive.

use pairmask::{AtEnd, Scene, SceneEdit, SceneOptions, Scope};
use pairmask_tests::prelude::*;

use super::shared_scenes::LONG;

fn join(session: &mut Session, at_end: AtEnd) -> Scene {
    let options = SceneOptions::default().with_tick_deadline(LONG).with_scope(Scope::All);
    session.scene(options.with_at_end(at_end).with_shared("town")).unwrap()
}

/// A tick of a writer, and of members that have no lease.
fn tick<'a>(
    writer: &mut Scene,
    others: &mut [&mut Scene],
    edit: impl for<'s> Fn(SceneEdit<'s, 'a>) -> SceneEdit<'s, 'a>,
) {
    // The writer's commit ends the tick.
    let report = Report::Changes;
    let commits = others.iter_mut().map(|scene| scene.edit().submit(report).unwrap());
    let commits: Vec<_> = commits.collect();
    drop(edit(writer.edit()).commit(report).unwrap());
    for pending in commits {
        drop(pending.wait().unwrap());
    }
}

#[test]
fn members_learn_each_change_however_many_answers_they_miss() {
    let daemon = TestDaemon::of_cores();
    let mut sessions = [(); 3].map(|()| daemon.connect());
    let [one, two, three] = &mut sessions;
    let (mut writer, mut other) = (join(one, AtEnd::Keep), join(two, AtEnd::Keep));
    writer.lease(0..10).unwrap();
    tick(&mut writer, &mut [&mut other], |edit| edit.set(3, at(0.0)).set_user_data(3, 77));
    assert_eq!((writer.user_data(3), other.user_data(3)), (77, 77));

    // Ticks of which it has no part, and one whose answer it drops.
    tick(&mut writer, &mut [], |edit| edit.set(4, at(1.0)).set_user_data(4, u64::MAX));
    let dropped = other.edit().submit(Report::Changes).unwrap();
    tick(&mut writer, &mut [], |edit| edit.set_user_data(3, 78));
    drop(dropped);
    assert_eq!(other.user_data(4), 0, "as of the last answer");
    tick(&mut writer, &mut [&mut other], |edit| edit);
    assert_eq!([3, 4, 5].map(|index| other.user_data(index)), [78, u64::MAX, 0]);

    // One that joins later learns all; a box that takes an index has none, and a removed one keeps it.
    let mut late = join(three, AtEnd::Keep);
    tick(&mut writer, &mut [&mut late], |edit| edit.remove(4).remove(3).set(3, at(2.0)));
    assert_eq!([3, 4].map(|index| late.user_data(index)), [0, u64::MAX]);
    tick(&mut writer, &mut [&mut other, &mut late], |edit| edit.set_user_data(3, 5));
    assert_eq!([&other, &late].map(|scene| scene.user_data(3)), [5, 5]);

    // Another daemon is sent what the last one had.
    daemon.signal_worker(Signal::KILL);
    eventually("the members join again", || {
        // One without a lease is answered when the writer commits.
        let pending = other.edit().submit(Report::Nothing).ok()?;
        drop(writer.edit().commit(Report::Nothing).ok()?);
        pending.wait().ok().map(drop)
    });
    tick(&mut writer, &mut [&mut other], |edit| edit);
    assert_eq!([3, 4].map(|index| other.user_data(index)), [5, 0], "of boxes alone");
}

#[test]
fn boxes_that_remain_keep_their_user_data_until_another_writer_sets_them() {
    let daemon = TestDaemon::of_cores();
    let mut sessions = [(); 2].map(|()| daemon.connect());
    let [one, two] = &mut sessions;
    let (mut writer, mut other) = (join(one, AtEnd::Keep), join(two, AtEnd::Keep));
    writer.lease(0..10).unwrap();
    tick(&mut writer, &mut [&mut other], |edit| {
        edit.set(3, at(0.0)).set(4, at(9.0)).set_user_data(3, 77).set_user_data(4, 78)
    });
    drop(writer);
    eventually("the lease is free", || other.lease(0..10).ok());
    let mut third = join(one, AtEnd::Keep);
    tick(&mut other, &mut [&mut third], |edit| edit);
    assert_eq!([3, 4].map(|index| third.user_data(index)), [77, 78]);
    tick(&mut other, &mut [&mut third], |edit| edit.set(3, at(0.0)));
    assert_eq!([3, 4].map(|index| third.user_data(index)), [0, 78]);
    // Its new writer, who has not set box 4, knows of it as the others do.
    assert_eq!([3, 4].map(|index| other.user_data(index)), [0, 78]);
}

#[test]
fn pairs_that_ended_have_the_user_data_of_their_boxes() {
    let daemon = TestDaemon::of_cores();
    for session in &mut [in_process(), daemon.connect()] {
        let mut scene = session.scene(SceneOptions::default()).unwrap();
        let boxes: Vec<Aabb> = (0..3_000).map(|index| at(0.9 * index as f32)).collect();
        let user_data: Vec<u64> = (0..3_000).map(|index| index + 7).collect();
        let edit = scene.edit().set_all(0..3_000, &boxes).set_all_user_data(0..3_000, &user_data);
        assert_eq!(edit.commit(Report::Changes).unwrap().begun().len(), 2_999);
        // So many at the end are removed that the scene gives their memory back.
        let answer = scene.edit().remove_all(100..3_000).commit(Report::Changes).unwrap();
        let ended: Vec<Pair> = answer.ended().map(|ended| ended.pair).collect();
        assert_eq!(ended.len(), 2_900);
        let of = |index: &u32| answer.scene().user_data(*index) == u64::from(*index) + 7;
        assert!(ended.iter().flatten().all(of));
    }
}
