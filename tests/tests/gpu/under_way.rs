//! Frames under way on a GPU own their memory: it is given back when the GPU is done and not
//! before, regardless of what is dropped or lost meanwhile.

use std::sync::Arc;
use std::time::Duration;

use pairmask_tests::frame_memory::{SharedReply, TestFrame, Watcher};
use pairmask_tests::gpu::open;
use pairmask_tests::naive_decoder::sections;
use pairmask_tests::prelude::*;
use pairmaskd::execute::gpu::{EngineOptions, Gpu, Grid, GridUnderWay, HostImport, SharedImports};

/// Boxes of a frame that takes a software adapter some milliseconds.
const MANY: u32 = 20_000;
const PAGES: usize = 1024;
/// Pattern that is written over a reply that was given back.
const OURS: u32 = 0x6d69_6e65;
/// Longer than a frame of [`MANY`] boxes takes on a busy machine.
const A_WHILE: Duration = Duration::from_millis(300);

/// A frame under way, its pages, and whether its memory is still there.
type Begun = (GridUnderWay<TestFrame<SharedReply>>, Watcher, Arc<()>);

/// Frames in submissions of their own, and in one.
const WAYS: [(usize, bool); 2] = [(2, false), (3, true)];

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
        let options = EngineOptions { imports: imports.clone(), ..EngineOptions::default() };
        let grid = Grid::new(&gpu, &options).unwrap();
        let scene = stress_scenes::named("uniform").boxes(MANY, 5);
        Self { gpu, grid, imports, scene }
    }

    /// Memory of a frame whose reply the GPU writes itself.
    fn memory(&self) -> (TestFrame<SharedReply>, Watcher, Arc<()>) {
        let (reply, watcher) = SharedReply::new(&self.gpu, &self.imports, PAGES);
        // Before the GPU writes, however fast it is.
        watcher.fill(OURS);
        let boxes = NarrowMemory::write(&Precision::Exact, &self.scene);
        let token = Arc::default();
        (TestFrame { boxes, reply, token: Arc::clone(&token) }, watcher, token)
    }

    /// Begins frames, each in a submission of its own or all in one.
    fn begin(&mut self, frames: usize, is_bundle: bool) -> Vec<Begun> {
        let memories: Vec<_> = (0..frames).map(|_| self.memory()).collect();
        let (mut all, mut watched) = (Vec::new(), Vec::new());
        for (memory, watcher, token) in memories {
            all.push((memory, Encoding::Sparse));
            watched.push((watcher, token));
        }
        let begun = if is_bundle {
            self.grid.begin_bundle(all)
        } else {
            #[allow(clippy::result_large_err)] // The error holds the frame.
            all.into_iter().map(|(memory, encoding)| self.grid.begin(memory, encoding)).collect()
        };
        let begun = begun.into_iter().map(|frame| frame.map_err(|(error, _)| error).unwrap());
        begun.zip(watched).map(|(frame, (watcher, token))| (frame, watcher, token)).collect()
    }

    /// A frame in memory of its own: its report, and the words of its mask.
    fn alone(&mut self, boxes: &[Aabb], encoding: Encoding) -> (CullReport, Vec<u32>) {
        let memory = TestFrame::on_heap(&Precision::Exact, boxes);
        let frame = self.grid.begin(memory, encoding).map_err(|(error, _)| error).unwrap();
        let (report, memory) = self.grid.end(frame);
        let report = report.unwrap();
        let used = report.shape.extent_words() as usize;
        (report, memory.unwrap().reply.words()[..used].to_vec())
    }

    fn serves(&mut self) {
        let boxes = stress_scenes::named("uniform").boxes(345, 5);
        let (report, words) = self.alone(&boxes, Encoding::Sparse);
        let truth = oracle::truth(&boxes);
        assert_eq!(check_reply(&words, &report, 345, Encoding::Sparse, &truth), Ok(()));
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
fn a_reply_is_written_where_it_lies_with_the_bytes_of_a_staged_one() {
    let mut rig = Rig::new();
    for encoding in [Encoding::Sparse, Encoding::List] {
        let (memory, watcher, _) = rig.memory();
        let frame = rig.grid.begin(memory, encoding).map_err(|(error, _)| error).unwrap();
        let scene = rig.scene.clone();
        let (staged_report, staged) = rig.alone(&scene, encoding);
        let (report, memory) = rig.grid.end(frame);
        assert!(!watcher.is_all(OURS), "written where it lies");
        let report = report.unwrap();
        assert!(report.pair_count > 0 && report.shape == staged_report.shape);
        let [ours, theirs] = [memory.unwrap().reply.words(), &staged]
            .map(|words| sections(words, &report.shape).unwrap());
        assert!(ours == theirs, "{encoding}");
    }
}

#[test]
fn a_frame_that_is_dropped_waits_and_gives_its_memory_and_its_workspace_back() {
    let mut rig = Rig::new();
    for (frames, is_bundle) in [WAYS, WAYS].concat() {
        let mut watchers = Vec::new();
        for (frame, watcher, token) in rig.begin(frames, is_bundle) {
            assert_eq!(Arc::strong_count(&token), 2);
            drop(frame);
            assert_eq!(Arc::strong_count(&token), 1);
            watchers.push(watcher);
        }
        stays_ours(&watchers);
    }
    rig.serves();
}

#[test]
fn frames_outlive_their_engine() {
    for (frames, is_bundle) in WAYS {
        let mut rig = Rig::new();
        let mut begun = rig.begin(frames, is_bundle);
        drop(rig);
        let (first, watcher, token) = begun.remove(0);
        let memory = first.give_up();
        assert!(memory.is_some() && Arc::strong_count(&token) == 2);
        let mut watchers = vec![watcher];
        for (frame, watcher, token) in begun {
            drop(frame);
            assert_eq!(Arc::strong_count(&token), 1);
            watchers.push(watcher);
        }
        stays_ours(&watchers);
        drop(memory);
        assert_eq!(Arc::strong_count(&token), 1);
    }
}

#[test]
fn a_device_lost_in_mid_frame_gives_the_memory_back_when_it_stops() {
    for (frames, is_bundle) in WAYS {
        let mut rig = Rig::new();
        let mut begun = rig.begin(frames, is_bundle);
        rig.gpu.destroy();
        let (dropped, watcher, token) = begun.remove(0);
        let mut watchers = vec![watcher];
        for (frame, watcher, token) in begun {
            let (report, memory) = rig.grid.end(frame);
            assert!(matches!(report, Err(CullError::DeviceLost { .. })), "{report:?}");
            assert!(memory.is_some() && Arc::strong_count(&token) == 2);
            watchers.push(watcher);
        }
        drop(dropped);
        assert_eq!(Arc::strong_count(&token), 1);
        stays_ours(&watchers);
        let memory = TestFrame::on_heap(&Precision::Exact, &rig.scene);
        let refused = rig.grid.begin_bundle(vec![(memory, Encoding::Sparse)]);
        assert!(matches!(refused[..], [Err((CullError::DeviceLost { .. }, Some(_)))]));
    }
}

#[test]
fn a_frame_of_another_engine_is_given_up() {
    let (mut rig, mut other) = (Rig::new(), Rig::new());
    let (frame, watched, _) = rig.begin(1, false).remove(0);
    let (report, memory) = other.grid.end(frame);
    assert!(matches!(report, Err(CullError::DeviceLost { .. })), "{report:?}");
    assert!(memory.is_some());
    stays_ours(&[watched]);
    rig.serves();
    other.serves();
}

/// Two places: a bundle takes one, as a frame does.
#[test]
fn frames_that_are_dropped_keep_their_memory_and_their_workspace() {
    for (frames, is_bundle) in [(1, false), (3, true)] {
        let mut rig = Rig::new();
        let mut tokens = Vec::new();
        for slot in 0..2 {
            for (frame, _, token) in rig.begin(frames, is_bundle) {
                std::mem::forget(frame);
                tokens.push(token);
            }
            if slot == 0 {
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
            let (alone, alone_words) = rig.alone(boxes, *encoding);
            assert_eq!(alone.shape, report.shape);
            assert!(words[..alone_words.len()] == alone_words);
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
