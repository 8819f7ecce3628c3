//! The constants of the cost model: what each kind of work takes on one machine.

use super::{Term, Work};
use crate::engine::Isa;

/// What this machine takes for what. Built-in figures are the default; a daemon beside a GPU scales them at its start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// ns a unit of every [`Term`], in the order of [`Term::ALL`].
    pub ns: [f64; Term::ALL.len()],
}

impl Calibration {
    /// Figures for an instruction set, those that engines and encodings declare: of a Zen 4 core,
    /// tests of pairs scaled by the lanes of narrower sets.
    pub fn built_in(isa: Isa) -> Self {
        Self { ns: Term::ALL.map(|term| term.built_in_ns(isa)) }
    }

    /// ns a unit of a term.
    pub const fn ns(&self, term: Term) -> f64 {
        self.ns[term.index()]
    }

    /// What work takes on one thread, ns.
    pub fn time_ns(&self, work: &Work) -> f64 {
        work.times(&self.ns)
    }
}
