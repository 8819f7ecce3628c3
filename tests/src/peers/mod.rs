//! What the benches `peers` and `skip` share: other broad phases, and the rows that compare Pairmask with them. Both
//! compare all pairs.
//!
//! The other libraries are optional dependencies behind the feature `peers`, of the benches:
//! `cargo bench --workspace --features pairmask-tests/peers --bench peers -- --help`.

pub mod contender;
pub mod line;
pub mod report;

#[cfg(feature = "peers")]
pub mod parry_scene;
#[cfg(feature = "peers")]
pub mod rapier;
