//! Soak: a mixed load on one daemon for minutes to hours, and what its worker takes of the machine meanwhile.
//!
//! The clients are those of `stress --clients` at a pace that leaves most of a core alone. `Turnover` ends each
//! after some seconds to minutes, `Probe` is one client that stays, `Watch` reads what the worker takes, and
//! `growth` decides whether that grew.

mod growth;
mod probe;
mod sample;
mod turnover;

pub(crate) use growth::{Growth, Verdict, growths};
pub(crate) use probe::{Probe, ProbeReport};
pub(crate) use sample::{Sample, Watch, restarts};
pub(crate) use turnover::Turnover;
