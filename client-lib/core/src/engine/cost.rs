//! What work costs: the terms of the plan's cost model, beside the engines and encodings whose work
//! they count.

use crate::isa::Isa;

/// A kind of work with a constant of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CostTerm {
    /// The name. It begins with that of the engine, or of what else has it.
    pub name: &'static str,
    /// Built-in ns a unit on one thread, for each of [`Isa::ALL`].
    ns: [f64; Isa::ALL.len()],
}

/// How much longer than AVX-512 an instruction set takes for what it does a register at a time, for
/// each of [`Isa::ALL`].
const BY_LANES: [f64; Isa::ALL.len()] = [1.0, 1.6, 6.0];

// Built-in figures are those of one core of an AMD EPYC 9004 (Zen 4, AVX-512) at 2.6 GHz, fitted to the times of
// many scenes.
impl CostTerm {
    /// Work that takes `ns` a unit with every instruction set.
    pub const fn new(name: &'static str, ns: f64) -> Self {
        Self { name, ns: [ns; Isa::ALL.len()] }
    }

    /// Work that takes `ns` a unit with AVX-512, and longer with fewer lanes.
    pub const fn by_lanes(name: &'static str, ns: f64) -> Self {
        let [avx512, avx2, portable] = BY_LANES;
        Self { name, ns: [avx512 * ns, avx2 * ns, portable * ns] }
    }

    /// Work that takes `ns` a unit with AVX-512, and `narrow_ns` with all others.
    pub const fn avx512_or(name: &'static str, ns: f64, narrow_ns: f64) -> Self {
        Self { name, ns: [ns, narrow_ns, narrow_ns] }
    }

    /// Built-in ns a unit on one thread.
    pub fn built_in_ns(&self, isa: Isa) -> f64 {
        Isa::ALL
            .into_iter()
            .zip(self.ns)
            .find_map(|(of, ns)| (of == isa).then_some(ns))
            .unwrap_or(0.0)
    }
}

/// Declares the terms of an engine or an encoding: the place of each in the list, under its own name,
/// and the list, `TERMS`.
macro_rules! terms {
    ($($(#[$doc:meta])* $name:ident = $term:expr;)+) => {
        #[allow(clippy::upper_case_acronyms, non_camel_case_types)]
        enum Place { $($name),+ }
        $($(#[$doc])* const $name: usize = Place::$name as usize;)+
        pub(super) const TERMS: &[$crate::engine::CostTerm] = &[$($term),+];
    };
}
pub(super) use terms;

/// Boxes whose keys and order the caches of one core hold.
const CACHED_BOXES: f64 = 65_536.0;

/// Doublings of a scene above what the caches hold.
pub(super) fn spills(n: f64) -> f64 {
    (n / CACHED_BOXES).max(1.0).log2()
}
