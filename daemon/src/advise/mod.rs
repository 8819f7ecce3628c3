//! Advice: which session serves a program's work soonest on this machine, measured.
//!
//! ```text
//! workload   what is done in a tick, out of a recording or a file of boxes   (pure)
//! stream     the requests of a recording that are one work                   (pure)
//! options    the ways that can serve it                                      (pure)
//! hosts      the daemons
//! measure    what a tick takes
//! rounds     which way is measured when, and for how long
//! choose     what follows from the figures                                   (pure)
//! code       the lines to write; `printed` compiles those of each kind       (pure)
//! ```
//!
//! `cli/advise` shows it, as text, JSON and a picture.

mod choose;
mod code;
mod hosts;
mod measure;
mod options;
#[cfg(test)]
#[rustfmt::skip]
mod printed;
mod rounds;
mod stream;
mod workload;

pub use choose::{Figures, Sample, Sizes, Takeover, take_overs};
pub use code::lines;
pub use hosts::Hosts;
pub use measure::MeasureError;
pub use options::{Host, Means, Way, ways};
pub use rounds::{Advice, Effort, advise, measure_all};
pub use workload::{Answer, Workload, WorkloadError};
