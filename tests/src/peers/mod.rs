//! The comparison with other broad phases: same boxes, same frames, one process, pair sets
//! compared.
//!
//! The other libraries are optional dependencies behind the feature `peers`. The modules without
//! the feature need none of them, so that their tests run with all others. The bench is `cargo
//! bench --workspace --features pairmask-tests/peers --bench peers -- --help`.

pub mod contender;
pub mod line;
pub mod ours;
pub mod pair_sets;
pub mod peer_name;
pub mod report;
pub mod spread;
pub mod svg;
pub mod tally;

#[cfg(feature = "peers")]
pub mod obvhs;
#[cfg(feature = "peers")]
pub mod parry;
#[cfg(feature = "peers")]
pub mod parry_scene;
#[cfg(feature = "peers")]
pub mod rapier;
#[cfg(feature = "peers")]
pub mod rstar;

#[cfg(all(test, feature = "peers"))]
mod tests;
