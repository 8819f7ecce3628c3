//! `gpu-brute` through the conformance suite, in every form that its frames can take.

use pairmask_shaders::{Found, RowsPerThread};
use pairmask_tests::gpu::{cull, engine};
use pairmask_tests::prelude::*;
use pairmaskd::execute::gpu::{AllPairs, Checks, EngineOptions, Tuning, Upload, first_capacity};

/// Encodings in which the device writes a mask of so many pairs: the list is one binding.
fn encodings_of(engine: &AllPairs, pairs: u64) -> impl Iterator<Item = Encoding> + use<> {
    let is_bound = 8 * pairs <= engine.gpu().limits().storage_binding_bytes;
    Encoding::ALL.into_iter().filter(move |encoding| *encoding != Encoding::List || is_bound)
}

#[test]
fn conforms_at_every_small_and_at_odd_sizes() {
    conform(&mut engine(EngineOptions::default()), &Suite::of_tier());
}

#[test]
fn conforms_around_tile_borders_and_at_large_sizes() {
    let sizes = if tier::is_nightly() {
        vec![255, 256, 257, 511, 513, 2047, 2049, 4096]
    } else {
        vec![256, 257, 2049]
    };
    let suite = Suite { sizes, quadratic_limit: 2049, seed: 3, ..Suite::default() };
    conform(&mut engine(EngineOptions::default()), &suite);
}

#[test]
fn conforms_with_checked_stages() {
    let sizes = vec![2, 31, 33, 70, 345, 1234];
    let checked = EngineOptions { checks: Checks::On, ..EngineOptions::default() };
    conform(&mut engine(checked), &Suite { sizes, ..Suite::default() });
}

#[test]
fn conforms_in_many_bands() {
    // One batch of rows a band, and so several submissions at the largest size.
    let matrix_bytes = Some(2 * 256 * 4 * 6144 / 32);
    let mut narrow = engine(EngineOptions { matrix_bytes, ..Default::default() });
    let mut usual = engine(EngineOptions::default());
    let suite = Suite { sizes: vec![70, 257, 700, 1234], ..Suite::default() };
    conform(&mut narrow, &suite);
    for scene in [&stress_scenes::ALL[0], stress_scenes::named("uniform")] {
        let boxes = scene.boxes(6000, 9);
        let truth = oracle::truth(&boxes);
        for engine in [&mut narrow, &mut usual] {
            for encoding in encodings_of(engine, truth.pairs.len() as u64) {
                let mut reply = HeapReply::new();
                let input = CullInput::boxes(&boxes).encoding(encoding);
                check_frame(engine, &input, &truth, &mut reply)
                    .unwrap_or_else(|mismatch| panic!("{scene:?}, {encoding}: {mismatch}"));
            }
        }
    }
}

#[test]
fn conforms_with_every_tile_shape_and_upload() {
    let sizes = if tier::is_nightly() { vec![33, 700] } else { vec![700] };
    let suite = Suite { sizes, ..Suite::default() };
    for rows in RowsPerThread::ALL {
        for strip_blocks in [1, 4, 16] {
            let tuning = Some(Tuning { rows, strip_blocks });
            conform(&mut engine(EngineOptions { tuning, ..Default::default() }), &suite);
        }
    }
    for upload in [Upload::KernelReads, Upload::MappedVideo] {
        let upload = Some(upload);
        conform(&mut engine(EngineOptions { upload, ..Default::default() }), &suite);
    }
}

#[test]
fn a_mask_larger_than_the_first_capacity_is_complete() {
    let boxes = vec![Aabb { min: [0.0; 3], max: [1.0; 3] }; 1248];
    let n = BoxCount::new(1248);
    assert!(n.sparse_words_max() > first_capacity(Found::Words, n), "or the test shows nothing");
    let mut engine = engine(EngineOptions::default());
    let truth = oracle::truth(&boxes);
    for encoding in [Encoding::Sparse, Encoding::List] {
        let (report, reply) = cull(&mut engine, &boxes, encoding);
        assert_eq!(check_reply(reply.words(), &report, 1248, encoding, &truth), Ok(()));
        assert_eq!((report.pair_count, report.skipped.zero_words), (n.pair_count(), 0));
    }
}

/// Every word of a batch is full, so that a batch has several windows of words.
#[test]
fn a_list_of_full_words_has_the_bytes_of_the_cpu() {
    let mut gpu = engine(EngineOptions::default());
    let mut cpu = best_engine(EngineName::CpuBrute);
    for n in [33, 256, 257, 1233, 3001, 5_001] {
        let boxes = vec![Aabb { min: [0.0; 3], max: [1.0; 3] }; n];
        let (report, reply) = cull(&mut gpu, &boxes, Encoding::List);
        let (truth, expected) = cull(cpu.as_mut(), &boxes, Encoding::List);
        assert_eq!(report.shape, truth.shape, "{n} boxes");
        let words =
            |reply: &HeapReply| reply.words()[..report.shape.extent_words() as usize].to_vec();
        assert!(words(&reply) == words(&expected), "{n} boxes");
    }
}

/// The oracle is too slow here; `cpu-brute` is fast enough, and tested against the oracle.
#[test]
#[ignore = "slow: the nightly tier runs it"]
fn large_masks_of_every_stress_scene_are_those_of_the_cpu_bit_by_bit() {
    let mut gpu = engine(EngineOptions::default());
    let mut cpu = best_engine(EngineName::CpuBrute);
    for n in [4096, 10_000] {
        for scene in stress_scenes::ALL {
            let boxes = scene.boxes(n, 13);
            let sparse = cull(&mut gpu, &boxes, Encoding::Sparse).0;
            for encoding in encodings_of(&gpu, sparse.pair_count) {
                let (report, reply) = cull(&mut gpu, &boxes, encoding);
                let (truth, expected) = cull(cpu.as_mut(), &boxes, encoding);
                assert_eq!(report.census, truth.census, "{scene:?}, {n} boxes, {encoding}");
                assert_eq!(report.pair_count, truth.pair_count, "{scene:?}, {n} boxes");
                let ours = naive_decoder::sections(reply.words(), &report.shape);
                let theirs = naive_decoder::sections(expected.words(), &truth.shape);
                assert!(ours.is_some() && ours == theirs, "{scene:?}, {n} boxes, {encoding}");
            }
        }
    }
}
