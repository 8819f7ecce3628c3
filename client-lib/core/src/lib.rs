//! The core of pairmask: boxes and spheres, masks, precision modes, engines, and the plan. It shares
//! no memory with other processes; the sessions that do are in the crate `pairmask`.

pub mod aabb;
mod aligned;
mod backoff;
pub mod bytes;
pub mod cancel;
pub mod cast;
pub mod dispatch;
pub mod engine;
mod fetch;
pub mod filters;
pub mod floats;
mod huge_pages;
mod interop;
mod isa;
pub mod mask;
pub mod objects;
pub mod oracle;
pub mod pacing;
pub mod pair_index;
pub mod plan;
pub mod precision;
#[cfg(test)]
mod random;
pub mod repeat;
pub mod scene;
mod simd;
pub mod sphere;
pub mod spinner;
mod stats;
mod team;
mod test_budget;
pub mod units;
mod unknown_name;
pub mod update;
pub mod usable_memory;
pub mod write;

pub use aabb::{Aabb, BoxClass};
pub use engine::{EngineChoice, EngineName};
pub use mask::{Encoding, EncodingChoice, MaskView};
pub use objects::ObjectForm;
pub use precision::{Bounds, BoxForm, Precision};
pub use sphere::Sphere;
pub use units::{BoxCount, MaskWord, PairIndex};
