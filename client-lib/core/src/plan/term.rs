//! All terms of the cost model: those of every CPU engine, then those of every encoding, to be written
//! and to be visited.

use std::fmt;

use crate::engine::{CostTerm, EngineName, encoding_cost};
use crate::isa::Isa;
use crate::mask::Encoding;

/// A kind of work with a constant of its own, ns a unit on one thread. Engines and encodings declare
/// them ([`CostTerm`]); this is the place of one among all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Term(usize);

/// A term, and the engine that declares it; `None` for an encoding.
#[derive(Clone, Copy)]
struct Declared {
    term: CostTerm,
    owner: Option<EngineName>,
}

/// Terms of all engines and encodings.
const COUNT: usize = first_of_encoding(Encoding::ALL.len(), Side::Write);

/// All terms, by their places.
const DECLARED: [Declared; COUNT] = {
    let none = Declared { term: CostTerm::new("", 0.0), owner: None };
    let mut all = [none; COUNT];
    let (mut at, mut i) = (0, 0);
    while i < EngineName::ALL.len() {
        let (terms, mut t) = (terms_of_engine(i), 0);
        while t < terms.len() {
            all[at] = Declared { term: terms[t], owner: Some(EngineName::ALL[i]) };
            (at, t) = (at + 1, t + 1);
        }
        i += 1;
    }
    i = 0;
    while i < Encoding::ALL.len() {
        let cost = encoding_cost(Encoding::ALL[i]);
        let mut t = 0;
        while t < cost.write.terms.len() {
            all[at] = Declared { term: cost.write.terms[t], owner: None };
            (at, t) = (at + 1, t + 1);
        }
        t = 0;
        while t < cost.visit.terms.len() {
            all[at] = Declared { term: cost.visit.terms[t], owner: None };
            (at, t) = (at + 1, t + 1);
        }
        i += 1;
    }
    all
};

/// Who has work with a mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    /// The engine, which writes it.
    Write,
    /// The client, which visits its pairs.
    Visit,
}

/// Terms of engine `i` of the list; a GPU's has none.
const fn terms_of_engine(i: usize) -> &'static [CostTerm] {
    match EngineName::ALL[i].descriptor().cpu() {
        Some(cpu) => cpu.terms,
        None => &[],
    }
}

/// Place of the first term of each engine. Plans of small scenes look here, where every ns counts.
const FIRST_OF_ENGINES: [usize; EngineName::ALL.len()] = {
    let mut firsts = [0; EngineName::ALL.len()];
    let mut i = 0;
    while i < firsts.len() {
        firsts[i] = first_of_engine(i);
        i += 1;
    }
    firsts
};

/// Places of the first terms of each encoding, for either side.
const FIRST_OF_ENCODINGS: [[usize; 2]; Encoding::ALL.len()] = {
    let mut firsts = [[0; 2]; Encoding::ALL.len()];
    let mut i = 0;
    while i < firsts.len() {
        firsts[i] = [first_of_encoding(i, Side::Write), first_of_encoding(i, Side::Visit)];
        i += 1;
    }
    firsts
};

/// Place of the first term of engine `i` of the list.
const fn first_of_engine(i: usize) -> usize {
    let (mut first, mut before) = (0, 0);
    while before < i {
        first += terms_of_engine(before).len();
        before += 1;
    }
    first
}

/// Place of the first term of encoding `i` of the list, for a side.
const fn first_of_encoding(i: usize, side: Side) -> usize {
    let (mut first, mut before) = (first_of_engine(EngineName::ALL.len()), 0);
    while before < i {
        let cost = encoding_cost(Encoding::ALL[before]);
        first += cost.write.terms.len() + cost.visit.terms.len();
        before += 1;
    }
    match side {
        Side::Write => first,
        Side::Visit => first + encoding_cost(Encoding::ALL[i]).write.terms.len(),
    }
}

impl Term {
    /// Every term, in the order of their places.
    pub const ALL: [Self; COUNT] = {
        let mut all = [Self(0); COUNT];
        let mut i = 0;
        while i < COUNT {
            all[i] = Self(i);
            i += 1;
        }
        all
    };

    /// Its place among all.
    pub const fn index(self) -> usize {
        self.0
    }

    /// Its name.
    pub const fn as_str(self) -> &'static str {
        DECLARED[self.0].term.name
    }

    /// The term of a name, if there is one.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|term| term.as_str() == name)
    }

    /// The engine whose work it counts; `None` for the work of masks, which all engines share.
    pub const fn owner(self) -> Option<EngineName> {
        DECLARED[self.0].owner
    }

    /// Built-in ns a unit on one thread.
    pub fn built_in_ns(self, isa: Isa) -> f64 {
        DECLARED[self.0].term.built_in_ns(isa)
    }

    /// Place of the first term of an engine.
    pub(super) const fn first_of(engine: EngineName) -> usize {
        FIRST_OF_ENGINES[engine.place()]
    }

    /// Place of the first term of an encoding, for a side.
    pub(super) const fn first_of_mask(encoding: Encoding, side: Side) -> usize {
        FIRST_OF_ENCODINGS[encoding.place()][side as usize]
    }
}

impl fmt::Display for Term {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn terms_are_numbered_and_named_apart() {
        for (number, term) in Term::ALL.into_iter().enumerate() {
            assert_eq!(term.index(), number);
            assert_eq!(Term::from_name(term.as_str()), Some(term));
        }
        assert_eq!(Term::from_name("no-such-term"), None);
    }

    /// Files that were written before hold them, and the fit adds them up in this order.
    #[test]
    fn names_and_built_in_constants_are_those_that_files_hold() {
        let declared = Term::ALL.map(|term| (term.as_str(), term.built_in_ns(Isa::Avx512)));
        let expected = [
            ("brute-frame", 366.0),
            ("brute-box", 11.9),
            ("brute-test", 0.17),
            ("sap-frame", 390.0),
            ("sap-box", 14.8),
            ("sap-spill", 6.56),
            ("sap-test", 0.465),
            ("grid-frame", 1_300.0),
            ("grid-sample", 13.0),
            ("grid-levels", 13.1),
            ("grid-box", 25.5),
            ("grid-spill", 2.93),
            ("grid-doubling", 2.98),
            ("grid-elongation", 0.938),
            ("dense-byte", 0.0178),
            ("dense-pair", 1.16),
            ("scattered-pair", 1.54),
            ("sparse-pair", 0.395),
            ("list-pair", 1.26),
            ("dense-visit-byte", 0.0351),
            ("sparse-visit-pair", 1.15),
            ("ordered-visit-pair", 0.486),
            ("list-visit-pair", 0.365),
        ];
        for term in expected {
            assert!(declared.contains(&term), "{term:?}");
        }
        assert_eq!(Term::from_name("sap-test").and_then(Term::owner), Some(EngineName::CpuSap));
        assert_eq!(Term::from_name("dense-pair").and_then(Term::owner), None);
    }

    #[test]
    fn narrower_instruction_sets_are_not_faster() {
        for term in Term::ALL {
            let ns = Isa::ALL.map(|isa| term.built_in_ns(isa));
            assert!(ns.is_sorted() && ns[0] > 0.0, "{term}: {ns:?}");
        }
    }
}
