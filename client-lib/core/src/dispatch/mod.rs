//! From a client's options to an answer: the plan, the engine that it names, and the times of both.

mod answer;
mod boxes;
mod crowded;
mod filtered;
mod learned;
mod spheres;

pub use answer::{CullAnswer, StageTimes, nanoseconds_since};
pub use boxes::CpuEngines;
pub use filtered::{
    BadMask, FilteredAnswer, MARKED_KINDS, Marks, MaskFilter, RANK_SHIFT, WorldRange,
};
pub use spheres::{SphereEngines, SphereWays};

pub use crate::plan::CullOptions;
