//! What requests of a session take, judged by its last ones.

use std::time::Duration;

use pairmask_wire::RequestHeader;

/// Work that is expected of an object where nothing is known of its session: what the engines take
/// on one core where boxes overlap few others, or less. A scene that takes longer is known after a frame.
const WORK_AN_OBJECT: Duration = Duration::from_nanos(100);
/// What a request takes whatever it carries, in objects: an edit of one box takes about as long as one of a hundred.
const FIXED_OBJECTS: f64 = 256.0;
/// Kinds of requests of a session that are remembered: a game's frames, and edits and queries of a few scenes.
const MOST_KINDS: usize = 8;

/// Requests of a session that are alike: what they ask for, of which scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct RequestKind {
    operation: u32,
    scene: u32,
}

impl RequestKind {
    /// Of a request with this header, whatever it holds.
    pub(crate) const fn of(header: &RequestHeader) -> Self {
        Self { operation: header.operation, scene: header.scene }
    }
}

/// What a frame took.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FrameWork {
    /// Objects.
    pub(crate) objects: u32,
    /// Time on one core.
    pub(crate) work: Duration,
    /// Its need of the GPU.
    pub(crate) gpu: GpuNeed,
}

/// Whether a frame is to be left to the GPU.
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
pub(super) struct LastWork(Vec<(RequestKind, FrameWork)>);

impl LastWork {
    /// Notes what a request took. The kind that was silent longest makes room.
    pub(super) fn note(&mut self, kind: RequestKind, work: FrameWork) {
        if let Some(at) = self.0.iter().position(|(known, _)| *known == kind) {
            self.0.remove(at);
        } else if self.0.len() == MOST_KINDS {
            self.0.remove(0);
        }
        self.0.push((kind, work));
    }

    /// What is expected of a request with so many objects: as the last one of its kind, and more or less by how many
    /// objects it has.
    pub(super) fn expected(&self, kind: RequestKind, objects: u32) -> FrameWork {
        let last = self.0.iter().find(|(known, _)| *known == kind).map(|(_, last)| *last);
        let Some(last) = last else {
            return FrameWork { objects, work: WORK_AN_OBJECT * objects, gpu: GpuNeed::None };
        };
        let size = |objects: u32| f64::from(objects) + FIXED_OBJECTS;
        let work = last.work.mul_f64(size(objects) / size(last.objects));
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
