//! Spheres under stress: tangent by construction, all magnitudes, all classes; every sphere engine
//! against exact rational arithmetic.

use std::sync::Arc;

use pairmask_core::dispatch::{CullOptions, SphereEngines};
use pairmask_core::engine::{CullError, CullInput, CullReport, EngineChoice, HeapReply, Isa};
use pairmask_core::oracle::Pair;
use pairmask_core::oracle::naive_decoder::decode;
use pairmask_core::sphere::{Sphere, SphereAllPairs};
use pairmask_core::{Encoding, EncodingChoice, EngineName};
use pairmaskd::explain::Explanation;
use pairmaskd::scene::Random;
use rayon::ThreadPool;

use super::case::Case;
use super::flags::MixedFlags;
use super::subject::{Finding, Outcome, Subject, compare};
use crate::sabotage::lose_a_pair;
use crate::study::spheres::{families, oracle};

/// The spheres of a case and their pairs.
#[derive(Clone, Debug)]
pub struct SphereCase {
    /// The spheres.
    pub spheres: Vec<Sphere>,
    /// By the oracle.
    pub pairs: Vec<Pair>,
}

/// Makes the random numbers of spheres independent of those of boxes.
const STREAM: u64 = 0x5048_4552_4553;

impl SphereCase {
    /// The spheres of a case seed: few, since the oracle takes a microsecond a pair.
    pub fn new(seed: u64) -> Self {
        let mut random = Random::new(seed ^ STREAM);
        let n = match random.below(8) {
            0..6 => random.below(71),
            6 => 126 + random.below(5),
            // Enough spheres for the engines to look for candidates first.
            _ => 255 + random.below(10),
        } as usize;
        let mut spheres: Vec<Sphere> = match random.below(3) {
            0 => lattice(n, &mut random),
            1 => of_families(n, &mut random),
            _ => {
                let any =
                    |_| Sphere::from(std::array::from_fn(|_| f32::from_bits(random.bits() as u32)));
                (0..n).map(any).collect()
            }
        };
        if random.below(3) == 0 {
            spoil(&mut spheres, &mut random);
        }
        let pairs = oracle::pairs(&spheres);
        Self { spheres, pairs }
    }
}

/// Whole centres and radii, times a power of two: many touch.
fn lattice(n: usize, random: &mut Random) -> Vec<Sphere> {
    let scale = f32::from_bits((1 + random.below(250) as u32) << 23);
    let side = 2 + random.below(30);
    let one = |_| {
        let center = std::array::from_fn(|_| (random.below(side) as f32 - 8.0) * scale);
        Sphere::new(center, random.below(6) as f32 * scale)
    };
    (0..n).map(one).collect()
}

/// Pairs of the families, one after the other.
fn of_families(n: usize, random: &mut Random) -> Vec<Sphere> {
    let mut spheres = Vec::with_capacity(n + 1);
    while spheres.len() < n {
        let family = families::ALL[random.below(families::ALL.len() as u64) as usize];
        let (a, b) = (family.make)(random);
        spheres.extend([a, b]);
    }
    spheres.truncate(n);
    spheres
}

/// Replaces some spheres by empty, invalid, infinite and point-like ones.
fn spoil(spheres: &mut [Sphere], random: &mut Random) {
    for sphere in spheres {
        let axis = random.below(3) as usize;
        match random.below(24) {
            0 => sphere.radius = -sphere.radius,
            1 => sphere.radius = f32::INFINITY,
            2 => sphere.radius = f32::NEG_INFINITY,
            3 => sphere.radius = f32::NAN,
            4 => sphere.center[axis] = f32::NAN,
            5 => sphere.center[axis] = f32::INFINITY,
            6 => sphere.radius = -0.0,
            7 => sphere.center[axis] = -0.0,
            8 => *sphere = Sphere::EMPTY,
            _ => {}
        }
    }
}

/// A way to find pairs of spheres.
pub enum Way {
    /// All pairs with one instruction set.
    AllPairs(Isa, SphereAllPairs),
    /// Through the engine that a frame's options names.
    Engines(EngineChoice, Box<SphereEngines>),
}

/// A sphere engine that must answer exactly.
pub struct SphereSubject {
    name: String,
    way: Way,
    encoding: Encoding,
    pool: Arc<ThreadPool>,
    reply: HeapReply,
    broken: bool,
}

impl SphereSubject {
    /// One way with an encoding, on a pool whose threads it may use.
    pub fn new(way: Way, encoding: Encoding, pool: &Arc<ThreadPool>, broken: bool) -> Self {
        let threads = pool.current_num_threads();
        let plural = if threads == 1 { "" } else { "s" };
        let what = match &way {
            Way::AllPairs(isa, _) => format!("all pairs {isa}"),
            Way::Engines(choice, _) => format!("through {choice}"),
        };
        Self {
            name: format!("spheres {what}, {encoding}, {threads} thread{plural}"),
            way,
            encoding,
            pool: Arc::clone(pool),
            reply: HeapReply::new(),
            broken,
        }
    }

    /// Every way on every pool.
    ///
    /// # Errors
    /// [`CullError`]; never for instruction sets that the machine has.
    pub fn all(
        pools: &[Arc<ThreadPool>],
        broken: bool,
    ) -> Result<Vec<Box<dyn Subject>>, CullError> {
        let mut subjects: Vec<Box<dyn Subject>> = Vec::new();
        for pool in pools {
            for encoding in Encoding::ALL {
                let mut add = |way| {
                    subjects.push(Box::new(Self::new(way, encoding, pool, broken)));
                };
                for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
                    add(Way::AllPairs(isa, SphereAllPairs::with_isa(isa)?));
                }
                // `cpu-brute` is all pairs, as above.
                let others = |name: &EngineName| *name != EngineName::CpuBrute;
                for name in EngineName::CPU.into_iter().filter(others) {
                    add(Way::Engines(EngineChoice::Only(name), Box::default()));
                }
                add(Way::Engines(EngineChoice::Auto, Box::default()));
            }
        }
        Ok(subjects)
    }

    fn answer(&mut self, spheres: &[Sphere], flags: &MixedFlags) -> Result<CullReport, CullError> {
        let Self { way, encoding, pool, reply, .. } = self;
        let threads = pool.current_num_threads();
        let input = CullInput::spheres(spheres).encoding(*encoding).threads(threads);
        flags.install(pool, || match way {
            Way::AllPairs(_, engine) => engine.cull(&input, reply),
            Way::Engines(engine, engines) => {
                let encoding = EncodingChoice::Only(*encoding);
                let options = CullOptions {
                    engine: *engine,
                    encoding,
                    threads: Some(threads),
                    ..CullOptions::default()
                };
                engines.cull(spheres, &options, reply).map(|answer| answer.report)
            }
        })
    }
}

impl Subject for SphereSubject {
    fn name(&self) -> &str {
        &self.name
    }

    fn engine(&self) -> &'static str {
        "spheres"
    }

    fn check(&mut self, case: &Case) -> Result<Outcome, Finding> {
        let SphereCase { spheres, pairs } = case.spheres();
        let mut report =
            self.answer(spheres, &case.flags).map_err(|error| Finding::other(&error))?;
        let mut words = self.reply.words().to_vec();
        if self.broken {
            lose_a_pair(&mut words, &mut report);
        }
        let got = decode(&words, &report.shape, spheres.len() as u32)
            .map_err(|error| Finding::other(&error))?;
        compare(&got, pairs, pairs).map_err(|mut finding| {
            if let Some((a, b)) = finding.first {
                let (a, b) = (&spheres[a as usize], &spheres[b as usize]);
                finding.what = format!("{}: {a:?} and {b:?}", finding.what);
            }
            finding
        })?;
        if report.pair_count != got.len() as u64 {
            return Err(Finding::other(&format!(
                "the report counts {} pairs, the mask has {}",
                report.pair_count,
                got.len()
            )));
        }
        Ok(Outcome::Right)
    }

    fn scene(&self, case: &Case) -> (usize, String) {
        (case.spheres().spheres.len(), "spheres".to_owned())
    }

    /// An explanation is about boxes.
    fn explain(&self, _: &Case, _: Pair) -> Option<Explanation> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_hold_pairs_that_touch() {
        // An ulp less of every radius must lose pairs, else the scene does not test touching.
        let mut lost = 0;
        for seed in 0..40 {
            let SphereCase { spheres, pairs } = SphereCase::new(seed);
            let smaller: Vec<Sphere> = spheres
                .iter()
                .map(|s| {
                    Sphere::new(
                        s.center,
                        if s.radius > 0.0 { s.radius.next_down() } else { s.radius },
                    )
                })
                .collect();
            lost += pairs.len() - oracle::pairs(&smaller).len();
        }
        assert!(lost > 100, "{lost} pairs were on the edge");
    }
}
