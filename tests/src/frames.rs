//! Frames of sessions, as most tests ask for them.

use std::sync::Arc;

use pairmask::filters::Rules;
use pairmask::{Backend, FrameOptions, PairMask, PendingFrame, ServedBy, Session};
use pairmask_core::Aabb;
use pairmask_core::mask::MaskView;
use pairmask_core::oracle::Pair;

use crate::daemon::eventually;

/// A box of one unit.
pub fn at(x: f32) -> Aabb {
    Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0])
}

pub fn in_process() -> Session {
    Session::builder().backend(Backend::InProcess).connect().expect("no daemon is needed")
}

pub trait Frames {
    fn ask(&mut self, boxes: &[Aabb]) -> PendingFrame;

    fn answer(&mut self, boxes: &[Aabb]) -> PairMask;
}

impl Frames for Session {
    fn ask(&mut self, boxes: &[Aabb]) -> PendingFrame {
        let mut frame = self.frame(boxes.len()).expect("memory for a frame");
        frame.write(boxes).expect("as many boxes as asked for");
        frame.submit().expect("a frame is sent")
    }

    fn answer(&mut self, boxes: &[Aabb]) -> PairMask {
        self.ask(boxes).wait().expect("a frame is answered")
    }
}

pub fn filtered(rules: &Arc<Rules>) -> FrameOptions {
    FrameOptions { filters: Some(Arc::clone(rules)), split_at: None }
}

pub fn two_sets(first: usize) -> FrameOptions {
    FrameOptions { filters: None, split_at: Some(first) }
}

/// Asks until the expected side answers. A session of `Backend::Auto` answers by itself where the machine
/// is so busy that the daemon's heartbeat stands still; it has a daemon's answer again soon after. All answers have as
/// many pairs.
pub fn served_by(expected: ServedBy, mut ask: impl FnMut() -> PairMask) -> PairMask {
    let mut count = None;
    eventually("the expected side answers", || {
        let mask = ask();
        assert_eq!(*count.get_or_insert(mask.count()), mask.count(), "from either side");
        Some(mask).filter(|mask| mask.info().served_by == expected)
    })
}

pub trait Sorted {
    fn sorted(&self) -> Vec<Pair>;
}

impl Sorted for MaskView<'_> {
    fn sorted(&self) -> Vec<Pair> {
        let mut pairs = self.to_vec();
        pairs.sort_unstable();
        pairs
    }
}

impl Sorted for PairMask {
    fn sorted(&self) -> Vec<Pair> {
        self.view().sorted()
    }
}
