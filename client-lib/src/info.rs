//! What a frame's [`FrameInfo`](crate::FrameInfo) is made of.

pub use pairmask_core::dispatch::StageTimes;
pub use pairmask_core::engine::{Census, PairSkips, SkipMeter};
pub use pairmask_core::objects::ObjectForm;
pub use pairmask_core::precision::{BoxForm, Widening};

pub use crate::session::MarginStats;
