//! Scenes of a session: the edit as it is written, and answers that are taken or dropped.

use pairmask::{Aabb, Backend, EditError, EndReason, Error, Report, Scene, SceneOptions, Session};
use pairmask_core::scene::Indices;

fn scene() -> Scene {
    let session = Session::builder().backend(Backend::InProcess).connect();
    session
        .expect("no daemon is needed")
        .scene(SceneOptions::default().with_most_boxes(50))
        .expect("a scene")
}

fn at(x: f32) -> Aabb {
    Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0])
}

#[test]
fn an_answer_that_nobody_waits_for_is_made_up_for() {
    let mut scene = scene();
    drop(scene.edit().set(1, at(0.0)).set(2, at(0.5)).submit(Report::Changes).expect("an edit"));
    let answer = scene.edit().set(3, at(1.2)).commit(Report::Changes).expect("an answer");
    assert_eq!(answer.begun(), [[1, 2], [2, 3]], "nobody waited for the first one");
    let answer = scene.edit().commit(Report::Changes).expect("an answer");
    assert!(answer.begun().is_empty() && answer.ended().next().is_none(), "it was waited for");
    drop(answer);
    // Begun and ended again in answers that nobody waited for: nothing to report.
    drop(scene.edit().set(1, at(9.0)).submit(Report::Changes).expect("an edit"));
    let reported = scene.edit().set(1, at(0.0)).commit(Report::Changes).expect("an answer");
    assert!(reported.begun().is_empty() && reported.ended().next().is_none());
}

#[test]
fn an_edit_that_is_not_committed_does_nothing() {
    let mut scene = scene();
    let _ = scene.edit().set(1, at(0.0));
    assert!(scene.is_empty());
    let answer = scene.edit().set(2, at(0.0)).commit(Report::All).expect("an answer");
    assert_eq!(answer.pair_count(), Some(0));
    drop(answer);
    assert_eq!((scene.len(), scene.get(1), scene.get(2)), (1, None, Some(at(0.0))));
}

#[test]
fn every_step_is_applied() {
    let mut scene = scene();
    let row = [0, 1, 2, 3].map(|i| at(0.6 * i as f32));
    let edit = scene.edit().set_all(0..2, &row[..2]);
    let edit = edit.set_all(Indices::Mask { first: 2, words: &[0b11] }, &row[2..]);
    let reported = edit.commit(Report::Changes).expect("an answer");
    assert_eq!(reported.begun(), [[0, 1], [1, 2], [2, 3]]);

    let edit = scene.edit().set_enabled(0, false).make_all_static(&[1, 2], true).remove(3);
    let reported = edit.commit(Report::Changes).expect("an answer");
    let ended: Vec<_> = reported.ended().map(|ended| (ended.pair, ended.reason)).collect();
    let filtered = EndReason::Filtered;
    assert_eq!(ended, [([0, 1], filtered), ([1, 2], filtered), ([2, 3], EndReason::Removed)]);

    let edit = scene.edit().set_all_enabled(0..1, true).make_static(2, false).remove_all(&[1]);
    let reported = edit.set(1, at(0.6)).commit(Report::Moved).expect("an answer");
    assert_eq!(reported.pairs(), [[0, 1], [1, 2]]);
    let reported = scene.edit().commit(Report::Changes).expect("an answer");
    assert_eq!(reported.begun(), [[0, 1], [1, 2]], "moved pairs are not reported: the changes are");

    scene.resync();
    let reported = scene.edit().commit(Report::Changes).expect("an answer");
    assert!(reported.is_resync());
    assert_eq!(reported.pairs(), [[0, 1], [1, 2]]);
}

#[test]
fn boxes_by_a_function_are_those_of_an_array() {
    let (mut by_array, mut by_function) = (scene(), scene());
    let masks = [0b1011_0001, 1 << 17];
    for step in 0..40u32 {
        let x = |index: u32| at(((index * 7 + step * 3) % 23) as f32 * 0.4);
        let list = [(step + 9) % 20, step % 9];
        let forms: [Indices<'_>; 4] = [
            (&list).into(),
            (20..20 + step % 13).into(),
            Indices::Mask { first: 33, words: &masks[..1] },
            Indices::Mask { first: 0, words: &[] },
        ];
        let arrays = forms.map(|indices| {
            let mut boxes = Vec::new();
            indices.for_each(|_, index| boxes.push(x(index)));
            boxes
        });
        let (mut one, mut other) = (by_array.edit(), by_function.edit());
        for (indices, boxes) in forms.into_iter().zip(&arrays) {
            one = one.set_all(indices, boxes);
            let mut order = Vec::new();
            other = other.set_with(indices, |index| {
                order.push(x(index));
                x(index)
            });
            assert_eq!(order, *boxes, "once each, in order");
        }
        let (one, other) = (one.set(49, x(49)), other.set(49, x(49)));
        let expected = one.commit(Report::Changes).expect("an answer");
        let reported = other.commit(Report::Changes).expect("an answer");
        assert_eq!(reported.begun().to_vec(), expected.begun().to_vec());
        assert!(reported.ended().eq(expected.ended()));
        assert_eq!(reported.pair_count(), expected.pair_count());
        drop((reported, expected));
        assert!((0..50).all(|index| by_array.get(index) == by_function.get(index)));
    }
    assert!(by_array.len() > 20);
}

#[test]
fn no_box_is_asked_for_an_index_that_the_scene_cannot_have() {
    let mut scene = scene();
    let wrong = [
        (Indices::from(49..51), 50),
        ((0..u32::MAX).into(), u64::from(u32::MAX) - 1),
        (Indices::Range { first: u32::MAX, count: 2 }, u64::from(u32::MAX) + 1),
        (Indices::Mask { first: u32::MAX, words: &[0b110] }, u64::from(u32::MAX) + 2),
    ];
    for (indices, index) in wrong {
        let edit = scene.edit().set(1, at(0.0)).set_with(indices, |i| panic!("asked for {i}"));
        let refused = edit.commit(Report::Changes).map(drop);
        let beyond = EditError::BeyondLimit { index, limit: 50 };
        assert!(matches!(refused, Err(Error::Edit(error)) if error == beyond));
        assert!(beyond.to_string().contains("50"), "{beyond}");
        assert!(scene.is_empty());
    }
    let refused = scene.edit().set(50, at(0.0)).commit(Report::Changes).map(drop);
    let beyond = EditError::BeyondLimit { index: 50, limit: 50 };
    assert!(matches!(refused, Err(Error::Edit(error)) if error == beyond));
    let twice = scene.edit().set_with(&[3, 3], |_| at(0.0)).commit(Report::Changes).map(drop);
    assert!(matches!(twice, Err(Error::Edit(EditError::SetTwice { index: 3 }))));
}

#[test]
fn threads_of_a_session_are_those_of_its_scenes() {
    for threads in [1, 2, 3] {
        let builder = Session::builder().backend(Backend::InProcess).threads(threads);
        let mut scene =
            builder.connect().expect("a session").scene(SceneOptions::default()).expect("a scene");
        let boxes: Vec<Aabb> = (0..5_000).map(|i| at(0.7 * i as f32)).collect();
        let answer = scene.edit().set_all(0..5_000, &boxes).commit(Report::Changes);
        assert_eq!(answer.expect("an answer").begun().len(), 4_999);
    }
}
