//! The accuracy study: run time against error, over scenes, sizes, precision modes and engines.
//!
//! A mode that is faster than the exact one pays with extra pairs; none may pay with a missed one,
//! and a missed pair disqualifies it.
//!
//! The parts: [`mode`] names the subject of a row, [`clients`] answer its frames, [`measure`] runs the row,
//! [`truth`] finds the right pairs. [`judge`] says what rows are worth, [`report`] writes them down.

pub mod clients;
pub mod judge;
pub mod measure;
pub mod mode;
pub mod report;
pub mod truth;
