//! Strips: one row against up to 16 columns in sequence. What `cpu-grid` and `cpu-sap` share.
//!
//! Both engines bring the boxes into an order of their own ([`OrderedBoxes`]) in which the
//! candidates of a row are a few runs of consecutive positions. A run is cut into [`StripBatch`]
//! entries; a kernel tests a whole batch without a branch, 16 columns a step, and the compare mask
//! is the output bits; what is not zero becomes mask words ([`WordSink`]).
//!
//! Where rows share their strips, as in a line of the grid, a [`RowBlock`] takes 16 of them together.
//!
//! The stages are apart because of the branch predictor: whether a strip has a hit is a coin toss,
//! and one wrong guess costs more than the test of the strip.

// `&` instead of `&&`: see above, a branch costs more than the second operand.
#![allow(clippy::needless_bitwise_bool)]

mod batch;
mod block;
#[cfg(target_arch = "x86_64")]
mod block_avx512;
mod hits;
mod ordered;
mod sink;
mod task;
mod words;

pub(crate) use batch::{BATCH_STRIPS, GROUP, STRIP_COLUMNS, StripBatch, StripGroup};
pub(crate) use block::{BLOCK_LANES, RowBlock, RowSet};
pub(crate) use ordered::{KeyArraysMut, NOTHING, OrderedBoxes, split_keys};
pub(crate) use sink::WordSink;
pub(crate) use task::StripTask;
