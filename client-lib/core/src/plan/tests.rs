//! The plan's choices on made-up statistics. That they are the right ones is measured by the
//! laboratory: `pairmask-lab plan`.

use super::*;
use crate::dispatch::CpuEngines;
use crate::engine::{AvailableIsa, Isa};
use crate::precision::{BoxForm, BoxSlice};
use crate::units::BoxCount;

pub(crate) const GPU: GpuCost = GpuCost {
    fixed_ns: 30_000.0,
    ns_a_box: 0.5,
    ns_a_test: 1.0e-3,
    grid_fixed_ns: 10_000.0,
    grid_ns_a_box: Some(0.2),
    ns_a_reply_byte: 0.05,
    ns_a_read_byte: 0.05,
};

fn stats(n: u32, window_share: f32) -> SceneStats {
    SceneStats {
        n: BoxCount::new(n),
        is_looked_at: true,
        valid_share: 1.0,
        median_size: 1.0,
        large_size: 1.2,
        window_share,
        elongation: 1.1,
        last_pairs: Some(u64::from(n)),
    }
}

fn chosen(stats: &SceneStats, gpu: Option<GpuCost>, options: CullOptions) -> Plan {
    let capabilities = Capabilities { threads: 2, gpu };
    plan(stats, &capabilities, &Calibration::built_in(Isa::Avx512), &options)
}

#[test]
fn tiny_scenes_are_swept_or_compared_and_large_ones_go_to_the_grid() {
    for n in [0, 1, 64] {
        assert_ne!(
            chosen(&stats(n, 0.1), None, CullOptions::default()).engine,
            EngineName::CpuGrid
        );
    }
    for n in [10_000, 1_000_000] {
        let plan = chosen(&stats(n, 0.02), None, CullOptions::default());
        assert_eq!(plan.engine, EngineName::CpuGrid);
        assert_ne!(plan.encoding, Encoding::Dense);
        assert_eq!(plan.threads, 2);
    }
}

#[test]
fn a_scene_in_a_row_is_swept() {
    let mut stats = stats(20_000, 0.0001);
    stats.elongation = 80.0;
    assert_eq!(chosen(&stats, None, CullOptions::default()).engine, EngineName::CpuSap);
}

#[test]
fn wishes_win_even_where_nothing_can_fulfil_them() {
    let engine = EngineChoice::Only(EngineName::CpuBrute);
    let options = CullOptions {
        engine,
        encoding: EncodingChoice::Only(Encoding::Dense),
        ..CullOptions::default()
    };
    let plan = chosen(&stats(100_000, 0.02), None, options);
    assert_eq!((plan.engine, plan.encoding), (EngineName::CpuBrute, Encoding::Dense));
    let engine = EngineChoice::Only(EngineName::GpuGrid);
    let plan = chosen(&stats(10, 0.02), None, CullOptions { engine, ..options });
    assert_eq!((plan.engine, plan.encoding), (EngineName::GpuGrid, Encoding::Dense));
}

#[test]
fn what_does_not_fit_is_tried_in_another_encoding() {
    use crate::engine::{CullError, ReserveError};
    let too_large =
        CullError::Reserve(ReserveError::TooLarge { at_least_bytes: 9, limit_bytes: 8 });
    let other = CullError::Reserve(ReserveError::OutOfMemory { needed_bytes: 9 });
    let open = CullOptions::default();
    let dense = BoxCount::new(1_000).dense_words();
    let after = |options: CullOptions, tried, error: &CullError, limit| {
        options.after(tried, error, 1_000, limit).map(|options| options.encoding)
    };
    let only = |encoding| Some(EncodingChoice::Only(encoding));
    for tried in [Encoding::Sparse, Encoding::List] {
        assert_eq!(after(open, tried, &too_large, dense), only(Encoding::Dense));
        assert_eq!(after(open, tried, &other, dense), None);
        let asked = CullOptions { encoding: EncodingChoice::Only(tried), ..open };
        assert_eq!(after(asked, tried, &too_large, dense), None);
    }
    let small = open.within(1_000, dense - 1);
    assert!(small.no_dense && small.encoding == EncodingChoice::Auto);
    assert_eq!(open.within(1_000, dense), open);
    assert_eq!(after(small, Encoding::List, &too_large, dense - 1), only(Encoding::Sparse));
    assert_eq!(after(small, Encoding::Sparse, &too_large, dense - 1), None);
}

#[test]
fn a_gpu_is_taken_where_it_is_faster_and_only_there() {
    let gpu = Some(GPU);
    assert!(!chosen(&stats(500, 0.1), gpu, CullOptions::default()).engine.is_gpu());
    assert_eq!(
        chosen(&stats(1_000_000, 0.01), gpu, CullOptions::default()).engine,
        EngineName::GpuGrid
    );
    let grid =
        CullOptions { engine: EngineChoice::Only(EngineName::GpuGrid), ..CullOptions::default() };
    for n in [2, 64, 1_000] {
        assert_ne!(chosen(&stats(n, 1.0), gpu, grid).encoding, Encoding::Dense, "{n}");
    }
}

#[test]
fn boxes_take_a_gpu_the_time_of_their_bytes() {
    let n = 300;
    let memory = vec![0u32; 6 * n];
    let boxes = |form: BoxForm| {
        let bytes: &[u8] = bytemuck::cast_slice(&memory);
        BoxSlice::new(form, &bytes[..n * form.box_bytes()]).expect("whole boxes")
    };
    // No box is looked at, so that all but the way up is the same.
    let mut engines = CpuEngines::on(AvailableIsa::best(), Calibration::built_in(Isa::Avx512));
    let mut predicted = |form| {
        let options =
            CullOptions { engine: EngineChoice::Only(EngineName::GpuGrid), ..Default::default() };
        let plan = engines.plan(boxes(form), &options, Some(GPU));
        plan.candidates.into_iter().flatten().find(|c| c.engine == plan.engine)
    };
    let exact = predicted(BoxForm::F32).expect("there is a GPU").predicted_ns;
    for (form, saved_share) in [(BoxForm::Q16, 0.5), (BoxForm::F16, 0.5), (BoxForm::Q8, 0.75)] {
        let saved = exact - predicted(form).expect("there is a GPU").predicted_ns;
        let expected = saved_share * GPU.ns_a_box * n as f64;
        assert!((saved - expected).abs() < 1e-6, "{form}: {saved} ns");
    }
}

#[test]
fn the_encoding_is_the_cheaper_one() {
    let capabilities = Capabilities { threads: 1, gpu: None };
    let encoding = |n, dear: &[Encoding]| {
        let mut calibration = Calibration::built_in(Isa::Avx512);
        for encoding in dear {
            calibration.masks[encoding.ordinal()] = 50.0;
        }
        plan(&stats(n, 0.1), &capabilities, &calibration, &CullOptions::default()).encoding
    };
    for n in [4096, 1_000_000] {
        assert_eq!(encoding(n, &[Encoding::List]), Encoding::Sparse);
        assert_eq!(encoding(n, &[Encoding::Sparse]), Encoding::List);
    }
    let both = [Encoding::List, Encoding::Sparse];
    assert_eq!(encoding(64, &both), Encoding::Dense);
    assert_ne!(encoding(1_000_000, &both), Encoding::Dense, "62 GB of zeros");
}

/// What is planned without a look must be what a look would have planned.
#[test]
fn a_look_that_is_spared_would_have_changed_nothing() {
    let calibration = Calibration::built_in(Isa::Avx512);
    let capabilities = Capabilities { threads: 16, gpu: Some(GPU) };
    let options = CullOptions::default();
    let mut spared = 0;
    for n in [10, 1_000, 10_000, 30_000, 100_000, 1_000_000] {
        let at_best = SceneStats::at_best(BoxCount::new(n), Some(u64::from(n)));
        let at_best = plan(&at_best, &capabilities, &calibration, &options);
        if !at_best.engine.is_gpu() {
            continue;
        }
        spared += 1;
        for (window_share, valid_share, large_size, elongation) in
            [(0.0, 0.0, 1.0, 1.0), (0.0001, 1.0, 1.0, 80.0), (0.5, 0.1, 1.0e6, 1.0)]
        {
            let seen = SceneStats { valid_share, large_size, elongation, ..stats(n, window_share) };
            let planned = plan(&seen, &capabilities, &calibration, &options);
            let chosen = |plan: &Plan| (plan.engine, plan.encoding, plan.threads);
            assert_eq!(chosen(&planned), chosen(&at_best), "{n}");
        }
    }
    assert!(spared >= 2, "{spared} of six");
}

/// What a client does by itself counts as what an engine does: with more threads, it prefers what they
/// iterate over sooner.
#[test]
fn threads_that_iterate_pairs_count() {
    let many = stats(1_000_000, 0.01);
    let iterate_ns = |iterate_threads: Option<usize>| {
        let sparse = EncodingChoice::Only(Encoding::Sparse);
        let options = CullOptions { iterate_threads, encoding: sparse, ..CullOptions::default() };
        let plan = chosen(&many, Some(GPU), options);
        let candidate = plan.candidates.into_iter().flatten().find(|c| c.engine == plan.engine);
        let Candidate { predicted_ns, iterate_ns, .. } = candidate.expect("the chosen one");
        assert!(iterate_ns > 0.0 && iterate_ns < predicted_ns);
        iterate_ns
    };
    assert_eq!(iterate_ns(None).to_bits(), iterate_ns(Some(1)).to_bits());
    assert!(iterate_ns(Some(8)) < 0.3 * iterate_ns(Some(1)));
    let of = |gpu| {
        let engine = EngineChoice::Only(EngineName::GpuGrid);
        chosen(&many, Some(gpu), CullOptions { engine, ..CullOptions::default() })
    };
    let far = GpuCost { ns_a_read_byte: 5.0, ..GPU };
    assert!(of(far).candidates[4].expect("asked for").iterate_ns > 0.0);
    assert_eq!(of(far).encoding, Encoding::List, "fewest bytes");
}

#[test]
fn the_explanation_names_every_candidate_and_the_choice() {
    let text = chosen(&stats(5000, 0.1), None, CullOptions::default()).explain().to_string();
    for part in ["cpu-brute", "cpu-sap", "cpu-grid", "-> cpu-grid", "5000 boxes", "least predicted"]
    {
        assert!(text.contains(part), "{text}");
    }
    assert!(!text.contains("gpu"), "{text}");
}
