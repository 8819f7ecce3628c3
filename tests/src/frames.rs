//! Frames of sessions, as most tests ask for them.

use std::sync::Arc;

use pairmask::filters::Rules;
use pairmask::{Backend, FrameInfo, FrameOptions, PairMask, Pending, ServedBy, Session};
use pairmask_core::dispatch::CullOptions;
use pairmask_core::engine::{CullReport, EngineTimes};
use pairmask_core::mask::MaskView;
use pairmask_core::oracle::Pair;
use pairmask_core::scene::{Indices, Sets, Step};
use pairmask_core::{Aabb, Encoding, EncodingChoice, EngineChoice, EngineName, Precision, Sphere};

use crate::daemon::eventually;

/// A box of one unit.
pub fn at(x: f32) -> Aabb {
    Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0])
}

/// The step that sets boxes.
pub fn sets<'a>(indices: impl Into<Indices<'a>>, boxes: &'a [Aabb]) -> Step<'a> {
    Step::Set(Sets { indices: indices.into(), boxes })
}

/// Sets all boxes, from index 0 on.
pub fn sets_all(boxes: &[Aabb]) -> [Step<'_>; 1] {
    [sets(0..boxes.len() as u32, boxes)]
}

/// By one engine.
pub fn culled_by(engine: EngineName) -> CullOptions {
    CullOptions { engine: EngineChoice::Only(engine), ..CullOptions::default() }
}

/// By one engine, in one encoding.
pub fn culled(engine: EngineName, encoding: Encoding) -> CullOptions {
    CullOptions { encoding: EncodingChoice::Only(encoding), ..culled_by(engine) }
}

pub fn in_process() -> Session {
    Session::builder().backend(Backend::InProcess).connect().expect("no daemon is needed")
}

pub trait Frames {
    fn ask_with(&mut self, boxes: &[Aabb], options: &FrameOptions) -> Pending<PairMask>;

    fn ask_narrow(&mut self, boxes: &[Aabb], precision: Precision) -> Pending<PairMask>;

    fn ask_spheres(&mut self, spheres: &[Sphere]) -> Pending<PairMask>;

    fn ask(&mut self, boxes: &[Aabb]) -> Pending<PairMask> {
        self.ask_with(boxes, &FrameOptions::default())
    }

    fn answer(&mut self, boxes: &[Aabb]) -> PairMask {
        self.ask(boxes).wait().expect("a frame is answered")
    }
}

impl Frames for Session {
    fn ask_with(&mut self, boxes: &[Aabb], options: &FrameOptions) -> Pending<PairMask> {
        let mut frame = self.frame(boxes.len()).expect("memory for a frame");
        frame.write(boxes).expect("as many boxes as asked for");
        frame.submit_with(options).expect("a frame is sent")
    }

    fn ask_narrow(&mut self, boxes: &[Aabb], precision: Precision) -> Pending<PairMask> {
        let mut frame = self.narrow_frame(boxes.len(), precision).expect("memory for a frame");
        frame.write(boxes).expect("as many boxes as asked for");
        frame.submit().expect("a frame is sent")
    }

    fn ask_spheres(&mut self, spheres: &[Sphere]) -> Pending<PairMask> {
        let mut frame = self.sphere_frame(spheres.len()).expect("memory for a frame");
        frame.spheres_mut().copy_from_slice(spheres);
        frame.submit().expect("a frame is sent")
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

/// What an engine would have reported of an answer.
pub fn report_of(mask: &PairMask) -> CullReport {
    let FrameInfo { census, skipped, times, .. } = *mask.info();
    let times = EngineTimes {
        ingest_ns: times.ingest_ns,
        execute_ns: times.execute_ns,
        publish_ns: times.publish_ns,
    };
    CullReport { shape: *mask.shape(), census, pair_count: mask.count(), skipped, times }
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
