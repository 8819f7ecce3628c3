//! Engines: boxes in, pair mask out.
//!
//! Every engine implements [`Engine`], passes one conformance suite against one naive oracle, and
//! reports what it skipped. An engine reads each box where it lies, copies it once into its own
//! keys, and writes its mask straight into memory that the caller hands out ([`ReplyBuffer`]):
//! shared memory in the daemon, a pooled buffer in process.
//!
//! `list.rs` names them all. All code that chooses among engines, names or measures them, goes through that
//! list and their [descriptors](EngineDescriptor): the command line, plan, calibration, `stress`, the
//! conformance suite. A new engine is a folder with a descriptor, and a line of the list.

pub(crate) mod brute_force;
mod census;
mod choice;
mod cost;
mod descriptor;
pub(crate) mod encode;
mod error;
pub(crate) mod gather;
mod gpu;
pub mod grid;
mod heap_reply;
pub mod ingest;
mod input;
mod list;
mod name;
mod ordered;
mod reply;
mod report;
mod rules;
mod scratch;
pub(crate) mod strips;
mod sure_pairs;
mod sweep_and_prune;
mod tree;
pub(crate) mod word_budget;

pub use census::{Census, NAMED_INVALID};
pub use choice::{EngineChoice, EngineId};
pub use cost::CostTerm;
pub(crate) use cost::built_in_ns;
pub use descriptor::{CpuEngine, EngineDescriptor, EngineSide, GpuEngine, cpu_engine};
pub(crate) use encode::encoding_cost;
pub use encode::write_no_pairs;
pub use error::CullError;
pub use gpu::GpuCost;
pub use heap_reply::HeapReply;
pub(crate) use ingest::KeyColumns;
pub use input::CullInput;
pub(crate) use input::counted;
pub use list::EngineName;
pub(crate) use name::cpu_engines;
pub(crate) use ordered::publish;
pub use reply::{ReplyBuffer, ReserveError};
pub use report::{CullReport, EngineTimes, PairSkips, SkipMeter, StageClock};
pub(crate) use rules::{PairRules, PairTest, Prepared, sift_each};
pub use scratch::RecentNeed;
pub(crate) use sure_pairs::Body;
pub(crate) use tree::order_by_tree;

pub use crate::isa::{AvailableIsa, Isa, IsaError};
pub use crate::unknown_name::UnknownName;

/// `isa` for an engine that was asked to use it.
///
/// # Errors
/// [`CullError::Unavailable`] when this machine does not have it.
pub(crate) fn available(isa: Isa, engine: EngineName) -> Result<AvailableIsa, CullError> {
    let why = "this processor lacks the instruction set asked for";
    AvailableIsa::new(isa).ok_or(CullError::Unavailable { engine, why })
}

/// A way to find all overlapping pairs.
pub trait Engine: Send {
    /// Which one it is.
    fn name(&self) -> EngineName;

    /// Writes the pair mask of the objects of `input` into memory of `reply`.
    ///
    /// The answer depends on the objects alone: not on threads, earlier frames or the machine. A mask
    /// that `reply` has no room for is refused: a dense one before any pair is tested, a sparse one soon
    /// after the first word beyond [`ReplyBuffer::limit_words`] was found.
    ///
    /// A box that changes while it is read (a hostile writer) may give a wrong answer for that
    /// box; it never harms the process.
    ///
    /// # Errors
    /// [`CullError`]; nothing is published then.
    fn cull(
        &mut self,
        input: &CullInput<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError>;

    /// Bytes of scratch that the engine keeps from frame to frame, beside boxes and replies: 0 for one
    /// that keeps nothing.
    fn scratch_bytes(&self) -> usize {
        0
    }

    /// Gives the scratch back. Answers do not depend on it; the next frame takes longer.
    fn give_back(&mut self) {}
}
