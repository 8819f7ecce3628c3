//! Pairmask: broad-phase collision culling through shared memory.

pub mod aabb;
pub mod engine;
pub mod mask;
pub mod pair_index;
pub mod units;

pub use aabb::{Aabb, BoxClass};
pub use engine::{EngineChoice, EngineName};
pub use mask::{Encoding, EncodingChoice, MaskView};
pub use units::{BoxCount, MaskWord, PairIndex};
