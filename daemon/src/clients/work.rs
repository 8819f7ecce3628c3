//! What requests of a session take, judged by its last ones.

use std::time::Duration;

use pairmask_wire::{Operation, RequestHeader};

/// Work that is expected of an object where nothing is known of its session: what the engines take
/// on one core where boxes overlap few others, or less. A scene that takes longer is known after a frame.
const WORK_AN_OBJECT: Duration = Duration::from_nanos(100);
/// What a request takes regardless of what it carries, in objects: an edit of one box takes about as long as one of a hundred.
const FIXED_OBJECTS: f64 = 256.0;
/// The most work for a pair of boxes of a frame, on one core: a test by the slowest engine, portable and with
/// collision filters, and its part of the answer. Regardless of what was measured, a frame is not judged to be more than a test
/// of all its pairs: one of 200 boxes is never a large one.
const MOST_WORK_A_PAIR: Duration = Duration::from_nanos(5);
/// Kinds of requests of a session that are remembered: a game's frames, and edits and queries of a few scenes.
const MOST_KINDS: usize = 8;

/// Requests of a session that are alike: what they ask for, of which scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RequestKind {
    operation: u32,
    scene: u32,
}

impl RequestKind {
    pub(crate) const fn of(header: &RequestHeader) -> Self {
        Self { operation: header.operation, scene: header.scene }
    }

    /// The most work that a request with so many objects is judged to be: all their pairs, where it asks for those.
    /// `None` where that does not follow from its objects: an edit of one box may concern a scene of a million.
    pub(crate) fn most_work(self, objects: u32) -> Option<Duration> {
        let is_cull =
            [Operation::Cull, Operation::CullBetween].iter().any(|o| *o as u32 == self.operation);
        let n = f64::from(objects);
        let fixed = WORK_AN_OBJECT.mul_f64(n + FIXED_OBJECTS);
        is_cull.then(|| fixed + MOST_WORK_A_PAIR.mul_f64(n * (n - 1.0).max(0.0) / 2.0))
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FrameWork {
    pub(crate) objects: u32,
    /// CPU time on one core.
    pub(crate) work: Duration,
    pub(crate) gpu: GpuNeed,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GpuNeed {
    /// A core serves it about as soon, or sooner.
    None,
    /// A core would take much longer, and it fills a submission.
    Alone,
    /// A core would take much longer, and it is small enough to share a submission with others.
    Shared,
}

/// What the last request of each kind took, the latest kind last.
#[derive(Debug, Default)]
pub(crate) struct LastWork(Vec<(RequestKind, FrameWork)>);

impl LastWork {
    /// Notes what a request took. The kind that was silent longest makes room.
    pub(crate) fn note(&mut self, kind: RequestKind, work: FrameWork) {
        if let Some(at) = self.0.iter().position(|(known, _)| *known == kind) {
            self.0.remove(at);
        } else if self.0.len() == MOST_KINDS {
            self.0.remove(0);
        }
        self.0.push((kind, work));
    }

    /// As the last one of its kind took, and more or less by how many objects it has.
    pub(super) fn expected(&self, kind: RequestKind, objects: u32) -> FrameWork {
        let last = self.0.iter().find(|(known, _)| *known == kind).map(|(_, last)| *last);
        let Some(last) = last else {
            return FrameWork { objects, work: WORK_AN_OBJECT * objects, gpu: GpuNeed::None };
        };
        let size = |objects: u32| f64::from(objects) + FIXED_OBJECTS;
        let work = last.work.mul_f64(size(objects) / size(last.objects));
        let work = kind.most_work(objects).map_or(work, |most| work.min(most));
        FrameWork { objects, work, ..last }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn kind(operation: u32, scene: u32) -> RequestKind {
        RequestKind { operation, scene }
    }

    fn took(objects: u32, work: Duration) -> FrameWork {
        FrameWork { objects, work, gpu: GpuNeed::Shared }
    }

    #[test]
    fn each_kind_of_request_is_judged_by_its_own_last_one() {
        let mut last = LastWork::default();
        assert_eq!(last.expected(kind(1, 0), 10_000).work, MS, "nothing is known");
        last.note(kind(1, 0), took(1_000, MS));
        last.note(kind(3, 0), took(1_000, 9 * MS));
        last.note(kind(3, 1), took(1_000, 20 * MS));
        last.note(kind(1, 0), took(1_000, 2 * MS));
        let expected = |operation, scene| last.expected(kind(operation, scene), 1_000);
        assert_eq!(expected(1, 0), took(1_000, 2 * MS));
        assert_eq!(expected(3, 0), took(1_000, 9 * MS));
        assert_eq!(expected(3, 1), took(1_000, 20 * MS));
        assert_eq!(expected(5, 1).gpu, GpuNeed::None, "no query was asked");
    }

    #[test]
    fn more_objects_are_more_work_and_a_few_are_no_less_than_one_request() {
        let mut last = LastWork::default();
        last.note(kind(3, 0), took(1, MS));
        let times = |objects| last.expected(kind(3, 0), objects).work.as_secs_f64() * 1e3;
        assert!(times(100) < 1.5 && (3.0..6.0).contains(&times(1_000)), "{}", times(1_000));
        let mut last = LastWork::default();
        last.note(kind(1, 0), took(100_000, 10 * MS));
        assert!(
            (19.0..21.0).contains(&(last.expected(kind(1, 0), 200_000).work.as_secs_f64() * 1e3))
        );
    }

    #[test]
    fn a_frame_is_judged_to_be_no_more_than_all_its_pairs() {
        let mut last = LastWork::default();
        let (frame, edit) = (kind(Operation::Cull as u32, 0), kind(Operation::EditScene as u32, 0));
        // The worker thread was interrupted.
        last.note(frame, took(200, 45 * MS));
        last.note(edit, took(200, 45 * MS));
        let expected = |kind| last.expected(kind, 200).work;
        assert!(expected(frame) < MS / 5, "{:?}", expected(frame));
        assert_eq!(expected(edit), 45 * MS, "its scene may be a large one");
        let most = |n| frame.most_work(n).unwrap_or_default();
        assert!(most(0) < most(1) && most(1) < MS / 20 && most(1000) < 3 * MS);
        assert!(most(1_000_000) > 1000 * 1000 * MS && most(u32::MAX) > most(1_000_000));
    }

    #[test]
    fn a_client_of_many_scenes_is_remembered_in_part() {
        let mut last = LastWork::default();
        for scene in 0..1000 {
            last.note(kind(3, 7), took(10, 3 * MS));
            last.note(kind(3, 1000 + scene), took(10, MS));
            assert!(last.0.len() <= MOST_KINDS);
        }
        assert_eq!(last.expected(kind(3, 7), 10).work, 3 * MS, "it was asked for again and again");
    }
}
