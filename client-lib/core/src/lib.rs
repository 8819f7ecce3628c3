//! The core of pairmask: boxes and spheres, masks, precision modes, engines, and the plan. It shares
//! no memory and speaks to nobody; the crate `pairmask` has the sessions that do.

pub mod aabb;
pub mod awake_pool;
pub mod engine;
pub mod floats;
mod interop;
pub mod mask;
pub mod objects;
pub mod oracle;
pub mod pair_index;
pub mod plan;
pub mod precision;
pub mod sphere;
pub mod spinner;
pub mod units;
pub mod update;

pub use aabb::{Aabb, BoxClass};
pub use awake_pool::AwakePool;
pub use engine::{EngineChoice, EngineName};
pub use mask::{Encoding, EncodingChoice, MaskView};
pub use objects::ObjectForm;
pub use precision::{Bounds, BoxForm, Precision};
pub use sphere::Sphere;
pub use units::{BoxCount, MaskWord, PairIndex};
