//! The accuracy study: run time against error, over scenes, sizes, precision modes and engines.
//!
//! A mode that is faster than the exact one pays with extra pairs; none may pay with a missed one,
//! and a missed pair disqualifies it.
//!
//! The parts: [`measure`] runs a row, [`truth`] says what the pairs are, [`rows`] holds the
//! figures, [`assertion`] and [`comparison`] judge them, [`table`] and [`report`] write
//! them down.

pub mod assertion;
pub mod comparison;
pub mod measure;
pub mod report;
pub mod rows;
pub mod table;
pub mod truth;
