//! The accuracy study: run time against error, over scenes, sizes, precision modes and engines.
//!
//! A mode that is faster than the exact one pays with extra pairs; none may pay with a missed one,
//! and a missed pair disqualifies it.

pub mod clients;
pub mod measure;
pub mod mode;
pub mod report;
pub mod truth;
