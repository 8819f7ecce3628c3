//! The constants of the cost model: what each kind of work takes on one machine.

use super::{Term, Work};
use crate::engine::{EngineName, Isa};

/// What more than one thread gives an engine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThreadCost {
    /// Share of the engine's time on one thread that further threads do not shorten, 0 to 1.
    pub serial_share: f64,
    /// Handing work to a further thread and waiting for it, ns a frame: threads wake one after the
    /// other.
    pub fan_out_ns: f64,
}

impl ThreadCost {
    /// Time on `threads` threads of what takes `one_ns` on one (Amdahl's law).
    pub fn on(&self, threads: usize, one_ns: f64) -> f64 {
        let threads = threads.max(1) as f64;
        let shared = one_ns * (self.serial_share + (1.0 - self.serial_share) / threads);
        shared + self.fan_out_ns * (threads - 1.0)
    }
}

/// What this machine takes for what. Built-in figures are the default; a daemon beside a GPU scales them at its start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// ns a unit of every [`Term`], in the order of [`Term::ALL`].
    pub ns: [f64; Term::ALL.len()],
    /// What threads give each of [`EngineName::CPU`].
    pub threads: [ThreadCost; EngineName::CPU.len()],
    /// What threads give a client that visits the pairs of a mask.
    pub visit_threads: ThreadCost,
}

/// What threads give an engine on one core of an AMD EPYC 9004: a guess, held to be fair for two idle
/// cores.
const BUILT_IN_THREADS: ThreadCost = ThreadCost { serial_share: 0.1, fan_out_ns: 8_000.0 };

impl Calibration {
    /// Figures for an instruction set, those that engines and encodings declare: of a Zen 4 core,
    /// tests of pairs scaled by the lanes of narrower sets.
    pub fn built_in(isa: Isa) -> Self {
        let ns = Term::ALL.map(|term| term.built_in_ns(isa));
        let threads = [BUILT_IN_THREADS; EngineName::CPU.len()];
        Self { ns, threads, visit_threads: BUILT_IN_THREADS }
    }

    /// ns a unit of a term.
    pub const fn ns(&self, term: Term) -> f64 {
        self.ns[term.index()]
    }

    /// What work takes on one thread, ns.
    pub fn time_ns(&self, work: &Work) -> f64 {
        work.times(&self.ns)
    }

    /// What threads give an engine; a GPU's engine is not divided.
    pub fn threads_of(&self, engine: EngineName) -> ThreadCost {
        let index = EngineName::CPU.iter().position(|e| *e == engine);
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
        assert_eq!(cost.on(4, 1000.0), 467.5);
        assert_eq!(cost.on(0, 1000.0), 1000.0);
    }
}
