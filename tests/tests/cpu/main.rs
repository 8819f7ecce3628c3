//! Engines, masks and documents: nothing here needs a daemon or a GPU.
#![allow(clippy::unwrap_used)]

mod brute_force;
mod conformance_can_fail;
mod documents;
mod engine_list;
mod engines_agree;
mod float_flags;
mod float_flags_attack;
mod grid;
mod layers;
mod masks;
mod oracle;
mod sweep_and_prune;
