//! Engines, masks and layers: nothing here needs a daemon or a GPU.
#![allow(clippy::unwrap_used)]

mod cancelled;
mod casts;
mod cliffs;
mod conformance_can_fail;
mod engine_list;
mod engines;
mod engines_agree;
mod float_flags;
mod layers;
mod masks;
mod memory_model;
