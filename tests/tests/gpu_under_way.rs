//! Frames under way on a GPU own their memory: it is given back when the GPU is done and not
//! before, whatever is dropped, lost or forgotten meanwhile.
#![allow(clippy::unwrap_used)]

use std::sync::Arc;
use std::time::Duration;

use pairmask_core::engine::{CullError, HeapReply};
use pairmask_core::{Aabb, Encoding, Precision};
use pairmask_tests::conformance::check_reply;
use pairmask_tests::frame_memory::{SharedReply, TestFrame, Watcher};
use pairmask_tests::gpu::open;
use pairmask_tests::narrow::NarrowMemory;
use pairmask_tests::{oracle, stress_scenes};
use pairmaskd::execute::gpu::{Gpu, Grid, GridOptions, GridUnderWay, HostImport, SharedImports};

/// Boxes of a frame that takes a software adapter some milliseconds.
const MANY: u32 = 20_000;
/// Pages that hold its reply.
const PAGES: usize = 1024;
/// Pattern that is written over a reply that was given back.
const OURS: u32 = 0x6d69_6e65;
/// Longer than a frame of [`MANY`] boxes takes on a busy machine.
const A_WHILE: Duration = Duration::from_millis(300);

/// A device, an engine on it, and the imports that both use.
struct Rig {
    gpu: Arc<Gpu>,
    grid: Grid,
    imports: SharedImports,
    scene: Vec<Aabb>,
}

impl Rig {
    fn new() -> Self {
        let gpu = open(HostImport::IfPossible);
        let imports = SharedImports::default();
        let options = GridOptions { imports: imports.clone(), ..GridOptions::default() };
        let grid = Grid::new(&gpu, &options).unwrap();
        let scene = stress_scenes::named("uniform").boxes(MANY, 5);
        Self { gpu, grid, imports, scene }
    }

    /// Begins a frame whose reply the GPU writes itself.
    fn begin(&mut self) -> (GridUnderWay<TestFrame<SharedReply>>, Watcher, Arc<()>) {
        self.begin_in(Encoding::Sparse)
    }

    fn begin_in(
        &mut self,
        encoding: Encoding,
    ) -> (GridUnderWay<TestFrame<SharedReply>>, Watcher, Arc<()>) {
        let (reply, watcher) = SharedReply::new(&self.gpu, &self.imports, PAGES);
        let boxes = NarrowMemory::write(&Precision::Exact, &self.scene);
        let token = Arc::default();
        let memory = TestFrame { boxes, reply, token: Arc::clone(&token) };
        let frame = self.grid.begin(memory, encoding);
        (frame.map_err(|(error, _)| error).unwrap(), watcher, token)
    }

    /// Checks a frame of few boxes against the oracle.
    fn serves(&mut self) {
        let boxes = stress_scenes::named("uniform").boxes(345, 5);
        let memory = TestFrame::on_heap(&Precision::Exact, &boxes);
        let frame = self.grid.begin(memory, Encoding::Sparse).map_err(|(error, _)| error).unwrap();
        let (report, memory) = self.grid.end(frame);
        let (report, memory) = (report.unwrap(), memory.unwrap());
        let truth = oracle::truth(&boxes);
        let words = memory.reply.words();
        assert_eq!(check_reply(words, &report, 345, Encoding::Sparse, &truth), Ok(()));
    }
}

/// A reply that was given back is not written to.
fn stays_ours(watchers: &[Watcher]) {
    for watcher in watchers {
        watcher.fill(OURS);
    }
    std::thread::sleep(A_WHILE);
    assert!(watchers.iter().all(|watcher| watcher.is_all(OURS)), "the GPU still writes");
}

#[test]
fn the_gpu_writes_a_reply_that_is_imported_and_the_comparator_notices() {
    let mut rig = Rig::new();
    let (frame, watcher, _) = rig.begin();
    watcher.fill(OURS);
    let (report, memory) = rig.grid.end(frame);
    assert!(!watcher.is_all(OURS), "written where it lies");
    let (report, memory) = (report.unwrap(), memory.unwrap());
    let words = memory.reply.words();
    let last = report.shape.extent_words() as usize - 1;
    assert!(words[..=last].iter().any(|word| *word != OURS));
}

#[test]
fn a_list_is_written_where_its_reply_lies_with_the_bytes_of_a_staged_one() {
    let mut rig = Rig::new();
    let (frame, _, _) = rig.begin_in(Encoding::List);
    let staged = TestFrame::on_heap(&Precision::Exact, &rig.scene);
    let staged = rig.grid.begin(staged, Encoding::List).map_err(|(error, _)| error).unwrap();
    let (report, memory) = rig.grid.end(frame);
    let (staged_report, staged) = rig.grid.end(staged);
    let (report, staged_report) = (report.unwrap(), staged_report.unwrap());
    assert!(report.pair_count > 0 && report.shape == staged_report.shape);
    let (memory, staged) = (memory.unwrap(), staged.unwrap());
    let used = report.shape.extent_words() as usize;
    assert!(memory.reply.words()[..used] == staged.reply.words()[..used]);
}

#[test]
fn a_frame_that_is_dropped_waits_and_gives_its_memory_and_its_lane_back() {
    let mut rig = Rig::new();
    for _ in 0..3 {
        let (first, watched, one) = rig.begin();
        let (second, watched_too, other) = rig.begin();
        drop(first);
        assert_eq!((Arc::strong_count(&one), Arc::strong_count(&other)), (1, 2));
        drop(second);
        assert_eq!(Arc::strong_count(&other), 1);
        stays_ours(&[watched, watched_too]);
    }
    rig.serves();
}

#[test]
fn a_frame_outlives_its_engine() {
    let mut rig = Rig::new();
    let (first, watched, one) = rig.begin();
    let (second, watched_too, other) = rig.begin();
    drop(rig);
    let memory = first.give_up();
    assert!(memory.is_some() && Arc::strong_count(&one) == 2);
    drop(second);
    assert_eq!(Arc::strong_count(&other), 1);
    stays_ours(&[watched, watched_too]);
    drop(memory);
    assert_eq!(Arc::strong_count(&one), 1);
}

#[test]
fn a_device_lost_in_mid_frame_gives_the_memory_back_when_it_stops() {
    let mut rig = Rig::new();
    let (first, watched, one) = rig.begin();
    let (second, watched_too, other) = rig.begin();
    rig.gpu.destroy();
    let (report, memory) = rig.grid.end(second);
    assert!(matches!(report, Err(CullError::DeviceLost { .. })), "{report:?}");
    assert!(memory.is_some() && Arc::strong_count(&other) == 2);
    drop(first);
    assert_eq!(Arc::strong_count(&one), 1);
    stays_ours(&[watched, watched_too]);
}

#[test]
fn a_frame_of_another_engine_is_given_up() {
    let (mut rig, mut other) = (Rig::new(), Rig::new());
    let (frame, watched, _) = rig.begin();
    let (report, memory) = other.grid.end(frame);
    assert!(matches!(report, Err(CullError::DeviceLost { .. })), "{report:?}");
    assert!(memory.is_some());
    stays_ours(&[watched]);
    rig.serves();
    other.serves();
}

#[test]
fn a_frame_that_is_forgotten_keeps_its_memory_and_its_lane() {
    let mut rig = Rig::new();
    let mut tokens = Vec::new();
    for lane in 0..2 {
        let (frame, _, token) = rig.begin();
        std::mem::forget(frame);
        tokens.push(token);
        if lane == 0 {
            rig.serves();
        }
    }
    assert!(tokens.iter().all(|token| Arc::strong_count(token) == 2));
    let memory: TestFrame<HeapReply> = TestFrame::on_heap(&Precision::Exact, &rig.scene);
    let Err((error, memory)) = rig.grid.begin(memory, Encoding::Sparse) else {
        panic!("both lanes are taken")
    };
    assert!(matches!(error, CullError::Unavailable { .. }), "{error}");
    assert!(memory.is_some(), "nothing is under way");
}

#[test]
fn a_refused_frame_gives_its_memory_back() {
    let mut rig = Rig::new();
    let memory = TestFrame::on_heap(&Precision::Exact, &rig.scene);
    let refused = rig.grid.begin(memory, Encoding::Dense);
    let Err((CullError::Unavailable { .. }, Some(memory))) = refused else {
        panic!("dense masks are all pairs'")
    };
    assert_eq!(memory.boxes.boxes().len(), MANY as usize);
    rig.serves();
}
