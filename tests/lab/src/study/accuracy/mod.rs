//! The accuracy study: run time against error, over scenes, sizes, precision modes and engines.
//!
//! A mode that is faster than the exact one pays with extra pairs; none may pay with a missed one,
//! and a missed pair disqualifies it.
//!
//! The parts: [`mode`] names the subject of a row, a [`contender`] answers its frames ([`world`] and
//! [`spheres`] are two), [`measure`] runs the row, [`truth`] finds the right pairs. [`rows`] holds
//! the figures, [`setting`] groups those that answer one question, [`pareto`], [`assertion`] and
//! [`comparison`] judge them, [`table`] and [`report`] write them down. [`variants`] is speed
//! against error of the papers' mapping functions, in the same report.

pub mod assertion;
pub mod comparison;
pub mod contender;
pub mod measure;
pub mod mode;
pub mod pareto;
pub mod report;
pub mod rows;
pub mod setting;
pub mod spheres;
pub mod table;
pub mod truth;
pub mod variants;
pub mod world;
