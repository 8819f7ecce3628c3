//! The constants of the cost model: what each kind of work takes on one machine.

use super::work::{Term, Work};
use crate::engine::{EngineName, Isa};

/// What more than one thread gives an engine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThreadCost {
    /// Share of the engine's time on one thread that further threads do not shorten, 0 to 1.
    pub serial_share: f64,
    /// Handing work to a second thread and waiting for it, ns a frame; as much again for every
    /// doubling of the threads.
    pub fan_out_ns: f64,
}

impl ThreadCost {
    /// Time on `threads` threads of what takes `one_ns` on one (Amdahl's law).
    pub fn on(&self, threads: usize, one_ns: f64) -> f64 {
        let threads = threads.max(1) as f64;
        let shared = one_ns * (self.serial_share + (1.0 - self.serial_share) / threads);
        shared + self.fan_out_ns * threads.log2()
    }
}

/// The CPU engines, in the order in which a calibration holds their threads.
pub const CPU_ENGINES: [EngineName; 3] =
    [EngineName::CpuBrute, EngineName::CpuSap, EngineName::CpuGrid];

/// What this machine takes for what. Built-in figures are the default; `pairmaskd calibrate`
/// measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// ns a unit of every [`Term`], in the order of [`Term::ALL`].
    pub ns: [f64; Term::ALL.len()],
    /// What threads give each of [`CPU_ENGINES`].
    pub threads: [ThreadCost; CPU_ENGINES.len()],
}

/// ns a unit on one core of an AMD EPYC 9004 (Zen 4, AVX-512) at 2.6 GHz, as `pairmaskd calibrate
/// --dry-run` prints them.
const ZEN_4: [(Term, f64); Term::ALL.len()] = [
    (Term::BruteFrame, 366.0),
    (Term::BruteBox, 11.9),
    (Term::BruteDirectTest, 0.396),
    (Term::BruteBitmapFrame, 2_414.0),
    (Term::BruteBitmapBox, 7.13),
    (Term::BruteBitmapTest, 0.0177),
    (Term::BruteCandidate, 0.261),
    (Term::SapFrame, 390.0),
    (Term::SapBox, 17.2),
    (Term::SapSpill, 6.56),
    (Term::SapTest, 0.465),
    (Term::GridFrame, 2_228.0),
    (Term::GridSample, 36.1),
    (Term::GridLevels, 13.1),
    (Term::GridBox, 26.5),
    (Term::GridSpill, 2.93),
    (Term::GridDoubling, 2.98),
    (Term::GridElongation, 0.938),
    (Term::SparsePair, 1.01),
    (Term::OrderedPair, 0.0971),
    (Term::DenseByte, 0.0479),
    (Term::DensePair, 4.5),
    (Term::ScatteredPair, 0.931),
];
/// [`Term::OrderedPair`] without the decoder by words, which needs AVX-512 VBMI2; measured on that
/// core before there was one.
const ORDERED_PAIR_LOOKED_UP: f64 = 0.77;
/// The same for threads: a guess, held to be fair for two idle cores, until a calibration measures.
const ZEN_4_THREADS: [ThreadCost; CPU_ENGINES.len()] =
    [ThreadCost { serial_share: 0.1, fan_out_ns: 8_000.0 }; CPU_ENGINES.len()];

/// Whether narrower instruction sets take longer for a term, by their lanes.
const fn is_by_lanes(term: Term) -> bool {
    matches!(
        term,
        Term::BruteDirectTest
            | Term::BruteBitmapTest
            | Term::BruteCandidate
            | Term::SapTest
            | Term::GridBox
            | Term::GridDoubling
            | Term::GridElongation
    )
}

impl Calibration {
    /// Figures for an instruction set: those of a Zen 4 core, tests of pairs scaled by the lanes of
    /// narrower sets.
    pub fn built_in(isa: Isa) -> Self {
        let lanes = match isa {
            Isa::Avx512 => 1.0,
            Isa::Avx2 => 1.6,
            Isa::Neon => 3.0,
            Isa::Portable => 6.0,
        };
        let of = |term: Term| {
            let ns = ZEN_4.iter().find(|(of, _)| *of == term).map_or(0.0, |(_, ns)| *ns);
            match term {
                Term::OrderedPair if isa != Isa::Avx512 => ORDERED_PAIR_LOOKED_UP,
                _ if is_by_lanes(term) => lanes * ns,
                _ => ns,
            }
        };
        Self { ns: Term::ALL.map(of), threads: ZEN_4_THREADS }
    }

    /// ns a unit of a term.
    pub const fn ns(&self, term: Term) -> f64 {
        self.ns[term as usize]
    }

    /// What work takes on one thread, ns.
    pub fn time_ns(&self, work: &Work) -> f64 {
        work.amounts().iter().zip(&self.ns).map(|(amount, ns)| amount * ns).sum()
    }

    /// What threads give an engine; a GPU's engine is not divided.
    pub fn threads_of(&self, engine: EngineName) -> ThreadCost {
        let index = CPU_ENGINES.iter().position(|e| *e == engine);
        index.map_or(ThreadCost { serial_share: 1.0, fan_out_ns: 0.0 }, |i| self.threads[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_thread_halves_what_is_not_serial_and_costs_the_fan_out() {
        let cost = ThreadCost { serial_share: 0.25, fan_out_ns: 10.0 };
        assert_eq!(cost.on(1, 1000.0), 1000.0);
        assert_eq!(cost.on(2, 1000.0), 635.0);
        assert_eq!(cost.on(4, 1000.0), 457.5);
        assert_eq!(cost.on(0, 1000.0), 1000.0);
    }

    #[test]
    fn narrower_instruction_sets_are_not_faster() {
        let built_in = Isa::ALL.map(|isa| Calibration::built_in(isa).ns);
        for term in Term::ALL {
            let ns = built_in.map(|table| table[term as usize]);
            assert!(ns.is_sorted() && ns[0] > 0.0, "{term}: {ns:?}");
        }
        for (term, (of, ns)) in Term::ALL.into_iter().zip(ZEN_4) {
            assert_eq!((term, built_in[0][term as usize]), (of, ns), "in the order of the terms");
        }
    }
}
