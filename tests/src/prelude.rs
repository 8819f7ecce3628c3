//! What most tests and benches name.

pub use pairmask::{
    Backend, ConnectError, Error, PairMask, Pending, ServedBy, Session, SessionBuilder,
};
pub use pairmask_core::dispatch::{CpuEngines, CullOptions};
pub use pairmask_core::engine::{
    CullError, CullInput, CullReport, Engine, HeapReply, Isa, ReplyBuffer, ReserveError, cpu_engine,
};
pub use pairmask_core::mask::{MaskShape, MaskView};
pub use pairmask_core::oracle::Pair;
pub use pairmask_core::precision::{BoxSlice, Widening};
pub use pairmask_core::scene::{
    Edit, QueryFilterData, Report, SceneError, SceneOptions, Sets, Step,
};
pub use pairmask_core::{
    Aabb, Bounds, BoxClass, BoxCount, BoxForm, Encoding, EncodingChoice, EngineChoice, EngineName,
    Precision, Sphere,
};
pub use rustix::process::Signal;

pub use crate::conformance::{
    Mismatch, Suite, best_engine, check_frame, check_pairs, check_reply, conform, cpu_engines, pool,
};
pub use crate::daemon::{TIMEOUT, TestDaemon, eventually, served, served_or_here, until};
pub use crate::frames::{Frames, Sorted, at, culled, culled_by, in_process, sets, sets_all};
pub use crate::narrow::NarrowMemory;
pub use crate::{naive_decoder, oracle, stress_scenes, tier};
