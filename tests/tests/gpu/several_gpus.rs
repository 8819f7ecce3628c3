//! A daemon with several GPUs: frames are spread over them, and none is lost with one of them.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use pairmask_tests::gpu::{begin, end, executor, pairs_by_cpu, pairs_of};
use pairmask_tests::prelude::*;
use pairmaskd::execute::{Executor, Owner};

/// Held by each test: devices of a software adapter that start side by side keep each other waiting.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

#[test]
fn sessions_have_homes_on_each_gpu_in_turn() {
    let _alone = alone();
    let model = executor(2);
    let boxes = stress_scenes::named("uniform").boxes(500, 1);
    let options = culled_by(EngineName::GpuGrid);
    let slots: Vec<usize> = (0..4)
        .map(|_| model.beside().plan(BoxSlice::from(&boxes), &options, u64::MAX).gpu_index())
        .collect();
    assert_eq!(slots.iter().filter(|slot| **slot == 0).count(), 2, "{slots:?}");
    assert_eq!((slots[0], slots[1]), (slots[2], slots[3]), "{slots:?}");
    assert_ne!(slots[0], slots[1]);
}

#[test]
fn a_frame_behind_another_takes_the_gpu_that_is_free() {
    let _alone = alone();
    let mut executor = executor(2);
    let boxes = stress_scenes::named("uniform").boxes(33_001, 3);
    let (first, first_index, _) = begin(&mut executor, 1, &boxes, &Precision::Exact);
    let (second, second_index, _) = begin(&mut executor, 1, &boxes, &Precision::Exact);
    assert_ne!(first_index, second_index);
    let [(one, words), (other, same)] = [first, second].map(|frame| end(&mut executor, frame));
    assert_eq!([one.engine, other.engine], [EngineName::GpuGrid; 2]);
    assert_eq!(one.report.shape, other.report.shape);
    let used = one.report.shape.extent_words() as usize;
    assert_eq!(words[..used], same[..used], "the same bytes on each");
    let found = pairs_of(boxes.len(), &one, &words);
    assert!(found == pairs_by_cpu(&boxes, &Precision::Exact), "{} pairs", found.len());
    // Both are free again: the home has it.
    let (_, again, _) = begin(&mut executor, 1, &boxes, &Precision::Exact);
    assert_eq!(again, first_index);
}

#[test]
fn a_frame_whose_gpu_is_lost_under_way_is_answered_by_the_other() {
    let _alone = alone();
    let mut executor = executor(2);
    let boxes = stress_scenes::named("ground plane").boxes(33_001, 3);
    let expected = pairs_by_cpu(&boxes, &Precision::Exact);
    let (frame, slot, _) = begin(&mut executor, 1, &boxes, &Precision::Exact);
    let lost = executor.gpus().device(slot);
    lost.expect("its device").destroy();
    let (answer, words) = end(&mut executor, frame);
    assert!(answer.engine.is_gpu(), "by {}", answer.engine);
    assert!(pairs_of(boxes.len(), &answer, &words) == expected);
}

fn devices_are_lost_under_load(rounds: usize) {
    let model = executor(2);
    let boxes = stress_scenes::named("uniform").boxes(1_234, 3);
    let expected = oracle::truth(&boxes).pairs;
    let (stop, answered) = (AtomicBool::new(false), AtomicUsize::new(0));
    let by_cores = AtomicUsize::new(0);
    let client = |id: u64, mut engines: Executor| {
        let mut reply = HeapReply::new();
        let encodings = [Encoding::Sparse, Encoding::List, Encoding::Dense];
        for encoding in encodings.into_iter().cycle() {
            let (boxes, options) = (BoxSlice::from(&boxes), culled(EngineName::GpuGrid, encoding));
            let answer = engines.cull(boxes, Owner::Client(id), &options, &mut reply);
            let answer = answer.expect("an answer");
            let are_right = pairs_of(boxes.len(), &answer, reply.words()) == expected;
            assert!(are_right, "{encoding}, by {}", answer.engine);
            answered.fetch_add(1, Ordering::Relaxed);
            by_cores.fetch_add(usize::from(!answer.engine.is_gpu()), Ordering::Relaxed);
            if stop.load(Ordering::Relaxed) {
                break;
            }
        }
    };
    std::thread::scope(|scope| {
        let client = &client;
        let engines = [1, 2].map(|id| (id, model.beside()));
        let clients = engines.map(|(id, engines)| scope.spawn(move || client(id, engines)));
        for round in 0..rounds {
            let slot = round % 2;
            let began = Instant::now();
            // One is there at any time: the one that was lost before is back first.
            let device = loop {
                let devices = [0, 1].map(|at| model.gpus().device(at));
                let all_there = model.gpus().iter().all(|gpu| gpu.is_there());
                if let ([Some(first), Some(second)], true) = (devices, all_there) {
                    break if slot == 0 { first } else { second };
                }
                if began.elapsed() > Duration::from_secs(120) || stops(&clients) {
                    stop.store(true, Ordering::Relaxed);
                    panic!("the device does not come back, or a client has ended");
                }
                model.gpus().iter().for_each(|gpu| gpu.tidy(&[]));
                std::thread::sleep(Duration::from_millis(1));
            };
            let before = answered.load(Ordering::Relaxed);
            device.destroy();
            drop(device);
            while answered.load(Ordering::Relaxed) < before + 4 && !stops(&clients) {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
        stop.store(true, Ordering::Relaxed);
    });
    let (all, by_cores) = (answered.into_inner(), by_cores.into_inner());
    assert!(all >= 4 * rounds, "{all} answers");
    assert!(by_cores < all / 2, "{by_cores} of {all} answers by cores beside a GPU");
}

fn stops(clients: &[std::thread::ScopedJoinHandle<'_, ()>]) -> bool {
    clients.iter().any(std::thread::ScopedJoinHandle::is_finished)
}

#[test]
#[ignore = "takes minutes: `.ci/run nightly`"]
fn one_of_two_devices_is_lost_under_load_a_hundred_times() {
    let _alone = alone();
    devices_are_lost_under_load(100);
}
