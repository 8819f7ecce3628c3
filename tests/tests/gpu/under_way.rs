//! Frames under way on a GPU own their memory: it is given back when the GPU is done and not
//! before, whatever is dropped, lost or forgotten meanwhile.

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
        // Before the GPU writes, however fast it is.
        watcher.fill(OURS);
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
fn a_frame_that_is_dropped_waits_and_gives_its_memory_and_its_workspace_back() {
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
fn a_frame_that_is_forgotten_keeps_its_memory_and_its_workspace() {
    let mut rig = Rig::new();
    let mut tokens = Vec::new();
    for place in 0..2 {
        let (frame, _, token) = rig.begin();
        std::mem::forget(frame);
        tokens.push(token);
        if place == 0 {
            rig.serves();
        }
    }
    assert!(tokens.iter().all(|token| Arc::strong_count(token) == 2));
    let memory: TestFrame<HeapReply> = TestFrame::on_heap(&Precision::Exact, &rig.scene);
    let Err((error, memory)) = rig.grid.begin(memory, Encoding::Sparse) else {
        panic!("both places are taken")
    };
    assert!(matches!(error, CullError::Unavailable { .. }), "{error}");
    assert!(memory.is_some(), "nothing is under way");
}

/// Scenes of several clients: alike, small, empty places, and more than a large scene's share.
fn scenes() -> Vec<(Vec<Aabb>, Encoding)> {
    [
        ("uniform", 700),
        ("clustered", 345),
        ("uniform", 2),
        ("ground plane", 1025),
        ("sizes over 20 octaves", 513),
    ]
    .into_iter()
    .enumerate()
    .map(|(i, (name, n))| {
        let encoding = if i % 2 == 0 { Encoding::Sparse } else { Encoding::List };
        (stress_scenes::named(name).boxes(n, i as u64), encoding)
    })
    .collect()
}

#[test]
fn frames_of_a_bundle_have_the_bytes_that_they_have_alone() {
    let mut rig = Rig::new();
    // Workspaces are used again, by frames of other sizes.
    for round in 0..4 {
        let mut scenes = scenes();
        scenes.rotate_left(round);
        let frames = scenes
            .iter()
            .map(|(boxes, encoding)| (TestFrame::on_heap(&Precision::Exact, boxes), *encoding));
        let begun = rig.grid.begin_bundle(frames.collect());
        assert_eq!(begun.len(), scenes.len());
        let mut ended = Vec::new();
        for frame in begun {
            let frame = frame.map_err(|(error, _)| error).unwrap();
            let (report, memory) = rig.grid.end(frame);
            ended.push((report.unwrap(), memory.unwrap()));
        }
        for ((boxes, encoding), (report, memory)) in scenes.iter().zip(&ended) {
            let (n, truth, words) =
                (boxes.len() as u32, oracle::truth(boxes), memory.reply.words());
            assert_eq!(check_reply(words, report, n, *encoding, &truth), Ok(()));
            let alone = TestFrame::on_heap(&Precision::Exact, boxes);
            let alone = rig.grid.begin(alone, *encoding).map_err(|(error, _)| error).unwrap();
            let (alone_report, alone) = rig.grid.end(alone);
            assert_eq!(alone_report.unwrap().shape, report.shape);
            let used = report.shape.extent_words() as usize;
            assert!(words[..used] == alone.unwrap().reply.words()[..used]);
        }
    }
}

#[test]
fn a_frame_of_a_bundle_that_is_refused_leaves_the_others_to_go() {
    let mut rig = Rig::new();
    let scenes = scenes();
    let frames = scenes.iter().enumerate().map(|(i, (boxes, encoding))| {
        let encoding = if i == 1 { Encoding::Dense } else { *encoding };
        (TestFrame::on_heap(&Precision::Exact, boxes), encoding)
    });
    let begun = rig.grid.begin_bundle(frames.collect());
    for (i, frame) in begun.into_iter().enumerate() {
        match frame {
            Ok(frame) => assert!(i != 1 && rig.grid.end(frame).0.is_ok()),
            Err((error, memory)) => {
                assert!(matches!(error, CullError::Unavailable { .. }), "{error}");
                assert!(i == 1 && memory.is_some());
            }
        }
    }
    rig.serves();
}

impl Rig {
    /// Begins frames in one submission, each with the reply of [`Rig::begin`].
    fn begin_bundle(
        &mut self,
        frames: usize,
    ) -> Vec<(GridUnderWay<TestFrame<SharedReply>>, Watcher, Arc<()>)> {
        let (mut memories, mut watched) = (Vec::new(), Vec::new());
        for _ in 0..frames {
            let (reply, watcher) = SharedReply::new(&self.gpu, &self.imports, PAGES);
            let boxes = NarrowMemory::write(&Precision::Exact, &self.scene);
            let token = Arc::default();
            let memory = TestFrame { boxes, reply, token: Arc::clone(&token) };
            memories.push((memory, Encoding::Sparse));
            watched.push((watcher, token));
        }
        let begun = self.grid.begin_bundle(memories).into_iter();
        let begun = begun.map(|frame| frame.map_err(|(error, _)| error).unwrap());
        begun.zip(watched).map(|(frame, (watcher, token))| (frame, watcher, token)).collect()
    }
}

#[test]
fn frames_of_a_bundle_give_their_memory_back_when_all_of_it_has_ended() {
    let mut rig = Rig::new();
    for _ in 0..2 {
        let mut watchers = Vec::new();
        for (frame, watcher, token) in rig.begin_bundle(3) {
            drop(frame);
            assert_eq!(Arc::strong_count(&token), 1);
            watchers.push(watcher);
        }
        stays_ours(&watchers);
    }
    rig.serves();
}

#[test]
fn a_device_lost_in_mid_bundle_gives_all_memory_back() {
    let mut rig = Rig::new();
    let bundle = rig.begin_bundle(3);
    rig.gpu.destroy();
    let mut watchers = Vec::new();
    for (frame, watcher, token) in bundle {
        let (report, memory) = rig.grid.end(frame);
        assert!(matches!(report, Err(CullError::DeviceLost { .. })), "{report:?}");
        assert!(memory.is_some() && Arc::strong_count(&token) == 2);
        watchers.push(watcher);
    }
    stays_ours(&watchers);
    let memory = TestFrame::on_heap(&Precision::Exact, &rig.scene);
    let refused = rig.grid.begin_bundle(vec![(memory, Encoding::Sparse)]);
    assert!(matches!(refused[..], [Err((CullError::DeviceLost { .. }, Some(_)))]));
}

#[test]
fn bundles_outlive_their_engine_and_a_forgotten_one_keeps_its_place() {
    let mut rig = Rig::new();
    let mut bundle = rig.begin_bundle(3).into_iter();
    std::mem::forget(bundle.next());
    for (frame, watcher, token) in bundle {
        drop(frame);
        assert_eq!(Arc::strong_count(&token), 1);
        stays_ours(&[watcher]);
    }
    rig.serves();
    let others = rig.begin_bundle(2);
    let memory = TestFrame::on_heap(&Precision::Exact, &rig.scene);
    let refused = rig.grid.begin_bundle(vec![(memory, Encoding::Sparse)]);
    assert!(matches!(refused[..], [Err((CullError::Unavailable { .. }, Some(_)))]));
    drop(rig);
    for (frame, watcher, token) in others {
        assert!(frame.give_up().is_some());
        assert_eq!(Arc::strong_count(&token), 1);
        stays_ours(&[watcher]);
    }
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
