use proptest::prelude::*;

use super::*;
use crate::dispatch::{CullOptions, SphereEngines};
use crate::engine::{CullInput, EngineChoice, EngineName, HeapReply, Isa};
use crate::mask::{Encoding, EncodingChoice};
use crate::oracle::naive_decoder::decode;
use crate::random::Random;

/// Spheres that are hard to decide: tangent ones by construction, all magnitudes, and all classes.
fn hard_spheres(n: usize, seed: u64) -> Vec<Sphere> {
    let mut random = Random(seed << 40 | 1);
    let mut next = |bound: u64| random.below(bound);
    (0..n)
        .map(|_| match next(8) {
            0 => Sphere::from(std::array::from_fn(|_| f32::from_bits(next(1 << 32) as u32))),
            1 => Sphere::from(std::array::from_fn(|_| f32::from_bits(next(9) as u32))),
            2 => Sphere::new([0.0; 3], f32::MAX),
            // Centres and radii whole numbers: many touch.
            _ => Sphere::from(std::array::from_fn(|_| next(7) as f32)),
        })
        .collect()
}

fn truth(spheres: &[Sphere]) -> Vec<[u32; 2]> {
    let n = spheres.len() as u32;
    let all = (0..n).flat_map(|a| (a + 1..n).map(move |b| [a, b]));
    all.filter(|[a, b]| spheres[*a as usize].overlaps(&spheres[*b as usize])).collect()
}

#[test]
fn the_rules_of_the_module_hold() {
    let unit = Sphere::new([0.0; 3], 1.0);
    let all = Sphere::new([1e30, 0.0, 0.0], f32::INFINITY);
    let point = Sphere::new([1.0, -0.0, 0.0], -0.0);
    for (other, class, overlaps) in [
        (unit, BoxClass::Valid, true),
        (all, BoxClass::Valid, true),
        (point, BoxClass::Valid, true),
        (Sphere::new([1.0, 1e-45, 0.0], 0.0), BoxClass::Valid, false),
        (Sphere::new([2.0, 0.0, 0.0], 1.0), BoxClass::Valid, true),
        (Sphere::new([2.0, 1e-45, 0.0], 1.0), BoxClass::Valid, false),
        (Sphere::new([f32::MAX, 0.0, 0.0], f32::MAX), BoxClass::Valid, true),
        (Sphere::new([0.0; 3], -1e-45), BoxClass::Empty, false),
        (Sphere::new([0.0; 3], f32::NEG_INFINITY), BoxClass::Empty, false),
        (Sphere::EMPTY, BoxClass::Empty, false),
        (Sphere::new([0.0; 3], f32::NAN), BoxClass::Invalid, false),
        (Sphere::new([0.0, f32::NAN, 0.0], -1.0), BoxClass::Invalid, false),
        (Sphere::new([f32::INFINITY, 0.0, 0.0], f32::INFINITY), BoxClass::Invalid, false),
    ] {
        assert_eq!(other.class(), class, "{other:?}");
        assert_eq!(unit.overlaps(&other), overlaps, "{other:?}");
        assert_eq!(other.overlaps(&unit), overlaps, "{other:?}");
        assert_eq!(all.overlaps(&other), class == BoxClass::Valid, "{other:?}");
    }
}

#[test]
fn an_overflow_or_underflow_of_f32_changes_nothing() {
    // The squares of all of these are infinite or 0 in f32.
    let far = Sphere::new([3e38, 0.0, 0.0], 1e38);
    assert!(far.overlaps(&Sphere::new([0.0; 3], 3e38)));
    assert!(!far.overlaps(&Sphere::new([-1e38, 0.0, 0.0], 2.9e38)));
    let near = Sphere::new([3e-44, 0.0, 0.0], 1e-44);
    assert!(near.overlaps(&Sphere::new([0.0; 3], 3e-44)));
    assert!(!near.overlaps(&Sphere::new([-1e-44, 0.0, 0.0], 1e-44)));
}

#[test]
fn every_engine_finds_the_pairs_of_the_definition() {
    let mut engines = SphereEngines::new();
    let mut reply = HeapReply::new();
    let kernels: Vec<SphereAllPairs> =
        Isa::ALL.into_iter().filter_map(|isa| SphereAllPairs::with_isa(isa).ok()).collect();
    let mut kernels = kernels;
    for n in (0..40).chain([64, 65, 130, 345, 700]) {
        let spheres = hard_spheres(n, 7 + n as u64);
        let expected = truth(&spheres);
        let census = |class| spheres.iter().filter(|s| s.class() == class).count() as u32;
        for encoding in Encoding::ALL {
            let named = EngineName::CPU.map(EngineChoice::Only);
            for engine in [EngineChoice::Auto].into_iter().chain(named) {
                let encoding_choice = EncodingChoice::Only(encoding);
                let options =
                    CullOptions { engine, encoding: encoding_choice, ..CullOptions::default() };
                let answer = engines.cull(&spheres, &options, &mut reply).expect("memory");
                let got = decode(reply.words(), &answer.report.shape, n as u32);
                assert_eq!(got.as_ref(), Ok(&expected), "{engine}, {encoding}, {n}");
                assert_eq!(answer.report.pair_count, expected.len() as u64);
                let counted = answer.report.census;
                assert_eq!(counted.invalid, census(BoxClass::Invalid), "{engine}, {n}");
                assert_eq!(counted.empty, census(BoxClass::Empty), "{engine}, {n}");
            }
            for kernel in &mut kernels {
                for threads in [1, 4] {
                    let report = kernel
                        .cull(
                            &CullInput::spheres(&spheres).encoding(encoding).threads(threads),
                            &mut reply,
                        )
                        .expect("memory");
                    let got = decode(reply.words(), &report.shape, n as u32);
                    assert_eq!(got.as_ref(), Ok(&expected), "{encoding}, {n}, {threads}");
                }
            }
        }
    }
}

#[test]
fn a_gpu_is_not_to_be_had_here() {
    let engine = EngineChoice::Only(EngineName::GpuBrute);
    let options = CullOptions { engine, ..CullOptions::default() };
    let spheres = [Sphere::EMPTY; 2];
    let refused = SphereEngines::new().cull(&spheres, &options, &mut HeapReply::new());
    assert!(matches!(refused, Err(crate::engine::CullError::Unavailable { .. })));
}

proptest! {
    /// Bounds of spheres that overlap, overlap.
    #[test]
    fn bounds_lose_no_pair(
        a in prop::array::uniform4(any::<u32>()),
        b in prop::array::uniform4(any::<u32>()),
        near in any::<bool>(),
    ) {
        let a = Sphere::from(a.map(f32::from_bits));
        let mut b = Sphere::from(b.map(f32::from_bits));
        if near {
            // The radius that makes them touch, about.
            let d = (0..3).map(|x| (f64::from(a.center[x]) - f64::from(b.center[x])).powi(2));
            b.radius = (d.sum::<f64>().sqrt() - f64::from(a.radius)) as f32;
        }
        prop_assert!(!a.overlaps(&b) || a.bounds().overlaps(&b.bounds()), "{:?} {:?}", a, b);
        for sphere in [a, b] {
            let bounds = sphere.bounds();
            prop_assert_eq!(bounds.class(), sphere.class());
        }
    }
}
