//! Pairmask: broad-phase collision culling through shared memory.

pub mod aabb;
pub mod awake_pool;
pub mod engine;
pub mod floats;
pub mod mask;
pub mod oracle;
pub mod pair_index;
pub mod plan;
pub mod precision;
pub mod session;
pub mod sphere;
pub mod transport;
pub mod units;
pub mod update;
pub mod wire;

pub use aabb::{Aabb, BoxClass};
pub use awake_pool::AwakePool;
pub use engine::{EngineChoice, EngineName};
pub use glam;
pub use mask::{Encoding, EncodingChoice, MaskView};
pub use precision::{Bounds, BoxForm, Precision};
pub use session::{Backend, Frame, PairMask, PendingFrame, ServedBy, Session};
pub use sphere::Sphere;
pub use units::{BoxCount, MaskWord, PairIndex};
pub use wire::ObjectForm;
