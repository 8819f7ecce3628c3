//! Small frames of several clients in one submission to the GPU: each has its own pairs, also where the
//! device is lost between.

use std::sync::Arc;

use pairmask_tests::frame_memory::TestFrame;
use pairmask_tests::gpu::{self, pairs_of};
use pairmask_tests::prelude::*;
use pairmaskd::execute::{BUNDLE_FRAMES, Executor, Owner};

/// Scenes of the clients, of which each begins at another one.
const SIZES: [u32; 7] = [2, 63, 70, 257, 1_000, 3, 1_025];
const ROUNDS: usize = 3;

fn scene(n: u32, seed: u64) -> (Vec<Aabb>, Vec<[u32; 2]>) {
    let boxes = stress_scenes::named("uniform").boxes(n, seed);
    let pairs = oracle::truth(&boxes).pairs;
    (boxes, pairs)
}

#[test]
fn small_frames_of_several_clients_do_not_mix() {
    small_frames_by("software");
    // Spread over two GPUs, which may be two devices of one adapter.
    small_frames_by(&format!("{},{}", gpu::name_at(0), gpu::name_at(1)));
}

fn small_frames_by(gpus: &str) {
    let daemon = TestDaemon::start(&["--gpu", gpus, "--audit", "1/1"]);
    let clients = BUNDLE_FRAMES + 2;
    std::thread::scope(|scope| {
        for client in 0..clients {
            let encoding = [Encoding::Sparse, Encoding::List][client % 2];
            let builder = daemon.session().engine(EngineChoice::Only(EngineName::GpuGrid));
            let mut session = builder.encoding(EncodingChoice::Only(encoding)).connect().unwrap();
            scope.spawn(move || {
                for turn in 0..ROUNDS * SIZES.len() {
                    let (boxes, expected) =
                        scene(SIZES[(turn + client) % SIZES.len()], turn as u64);
                    let mask = session.answer(&boxes);
                    assert_eq!(mask.info().engine, EngineName::GpuGrid);
                    let pairs = mask.sorted();
                    assert!(pairs == expected, "client {client}: wrong pairs of {}", boxes.len());
                }
            });
        }
    });
    let frames = (clients * ROUNDS * SIZES.len()) as u64;
    let mut session = daemon.connect();
    let status = session.daemon_status().unwrap();
    assert_eq!((status.frames, status.errors), (frames, 0));
    daemon.audit_is_clean(|audit| audit.frames > 0 && audit.frames + audit.skipped == frames);
}

/// The pairs of a bundle of frames whose device is destroyed between, or not, and by whom they were found.
fn bundle(executor: &mut Executor, is_lost: bool, sizes: &[u32]) -> Vec<EngineName> {
    let options = culled(EngineName::GpuGrid, Encoding::Sparse);
    let scenes: Vec<_> = sizes.iter().zip(7..).map(|(n, seed)| scene(*n, seed)).collect();
    let mut tokens = Vec::new();
    let joining = scenes.iter().zip(0..).map(|((boxes, _), owner)| {
        let memory = TestFrame::on_heap(&Precision::Exact, boxes);
        tokens.push(Arc::clone(&memory.token));
        let planned = executor.plan(memory.boxes.boxes(), &options, u64::MAX);
        Executor::join(planned, Owner::Client(owner), memory)
    });
    let joining = joining.collect();
    let begun = executor.gpus().iter().next().expect("a GPU").begin_bundle(joining);
    if is_lost {
        executor.device().expect("the device is there").destroy();
    }
    let mut engines = Vec::new();
    for (frame, (boxes, expected)) in begun.into_iter().zip(&scenes) {
        let (answer, memory) = match frame {
            Ok(frame) => executor.end(frame),
            Err(unserved) => executor.answer(unserved),
        };
        let (answer, memory) = (answer.unwrap(), memory.unwrap());
        let pairs = pairs_of(boxes.len(), &answer, memory.reply.words());
        assert!(pairs == *expected, "{} boxes by {}", boxes.len(), answer.engine);
        engines.push(answer.engine);
    }
    assert!(tokens.iter().all(|token| Arc::strong_count(token) == 1));
    engines
}

#[test]
fn a_device_that_is_lost_under_a_bundle_costs_no_answer() {
    let mut executor = gpu::executor(1);
    let sizes = &SIZES[..BUNDLE_FRAMES];
    let (boxes, _) = scene(sizes[0], 1);
    let options = culled(EngineName::GpuGrid, Encoding::Sparse);
    let planned = executor.plan((&boxes).into(), &options, u64::MAX);
    assert!(executor.can_join(&planned));
    assert_eq!(bundle(&mut executor, false, sizes), [EngineName::GpuGrid; BUNDLE_FRAMES]);
    bundle(&mut executor, true, sizes);
    // Now the CPU serves, or the device that was opened again.
    until("the device is opened again", || {
        bundle(&mut executor, false, sizes) == [EngineName::GpuGrid; BUNDLE_FRAMES]
    });
}
