//! Engines: boxes in, pair mask out.
//!
//! Every engine implements [`Engine`], passes one conformance suite against one naive oracle, and
//! reports what it skipped. An engine reads each box where it lies, copies it once into its own
//! keys, and writes its mask straight into memory that the caller hands out ([`ReplyBuffer`]):
//! shared memory in the daemon, a pooled buffer in process.

pub(crate) mod aligned;
pub mod brute_force;
pub(crate) mod gather;
pub mod grid;
mod heap_reply;
pub mod ingest;
mod isa;
mod scratch;
mod set;
pub(crate) mod strips;
pub mod sweep_and_prune;
pub(crate) mod word_budget;

use std::fmt;
use std::str::FromStr;

pub use brute_force::BruteForce;
pub use grid::{Grid, GridPlace, GridView};
pub use heap_reply::HeapReply;
pub use ingest::KeyColumns;
pub use isa::{AvailableIsa, Isa};
pub use scratch::RecentNeed;
pub use set::{CpuEngines, CullAnswer, CullWish, StageTimes, nanoseconds_since};
pub use sweep_and_prune::SweepAndPrune;

use crate::aabb::{Aabb, BoxClass};
use crate::mask::{Encoding, MaskShape};
use crate::units::BoxCount;

/// The engines by name. The names are part of the command line's contract.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum EngineName {
    /// All pairs on the CPU, SIMD.
    CpuBrute = 1,
    /// Sweep and prune on the CPU.
    CpuSap = 2,
    /// Uniform grid with levels on the CPU.
    CpuGrid = 3,
    /// All pairs on the GPU.
    GpuBrute = 4,
    /// Uniform grid with levels on the GPU.
    GpuGrid = 5,
}

impl EngineName {
    /// Every engine, in the order of their numbers.
    pub const ALL: [Self; 5] =
        [Self::CpuBrute, Self::CpuSap, Self::CpuGrid, Self::GpuBrute, Self::GpuGrid];

    /// The name on the command line and in reports.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::CpuBrute => "cpu-brute",
            Self::CpuSap => "cpu-sap",
            Self::CpuGrid => "cpu-grid",
            Self::GpuBrute => "gpu-brute",
            Self::GpuGrid => "gpu-grid",
        }
    }

    /// The engine of a wire number, if there is one.
    pub fn from_wire(value: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|e| *e as u32 == value)
    }

    /// Whether the engine needs a GPU.
    pub const fn is_gpu(self) -> bool {
        matches!(self, Self::GpuBrute | Self::GpuGrid)
    }
}

impl fmt::Display for EngineName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// The engine that answered a frame: a later daemon may have one that this build does not know.
/// Its masks are as good.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum EngineId {
    /// One that this build knows.
    Known(EngineName),
    /// The wire number of another.
    Unknown(u32),
}

impl EngineId {
    /// The engine of a wire number.
    pub fn from_wire(value: u32) -> Self {
        EngineName::from_wire(value).map_or(Self::Unknown(value), Self::Known)
    }

    /// The engine, where this build knows it.
    pub const fn known(self) -> Option<EngineName> {
        match self {
            Self::Known(name) => Some(name),
            Self::Unknown(_) => None,
        }
    }
}

impl From<EngineName> for EngineId {
    fn from(name: EngineName) -> Self {
        Self::Known(name)
    }
}

impl PartialEq<EngineName> for EngineId {
    fn eq(&self, name: &EngineName) -> bool {
        self.known() == Some(*name)
    }
}

impl fmt::Display for EngineId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Known(name) => name.fmt(f),
            Self::Unknown(number) => write!(f, "engine {number}"),
        }
    }
}

/// A client's wish: one engine, or whichever the plan finds fastest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum EngineChoice {
    /// The plan chooses.
    #[default]
    Auto,
    /// This engine and no other.
    Only(EngineName),
}

impl FromStr for EngineChoice {
    type Err = UnknownName;

    fn from_str(s: &str) -> Result<Self, UnknownName> {
        if s == "auto" {
            return Ok(Self::Auto);
        }
        EngineName::ALL.into_iter().find(|e| e.as_str() == s).map(Self::Only).ok_or_else(|| {
            UnknownName {
                name: s.to_owned(),
                known: "auto, cpu-brute, cpu-sap, cpu-grid, gpu-brute, gpu-grid",
            }
        })
    }
}

impl fmt::Display for EngineChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Only(name) => name.fmt(f),
        }
    }
}

/// A name that is none of the known ones.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("unknown name '{name}': choose one of {known}")]
pub struct UnknownName {
    /// What was given.
    pub name: String,
    /// What may be given.
    pub known: &'static str,
}

/// What an engine is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CullJob {
    /// Encoding of the mask.
    pub encoding: Encoding,
    /// Threads that the engine may use, at least 1. With more than one, the engine runs on the
    /// rayon pool of the calling thread.
    pub threads: usize,
}

/// Memory for a mask, handed out by whoever publishes it.
pub trait ReplyBuffer {
    /// The most words that [`Self::reserve`] ever lends; `u64::MAX` where memory is the only limit.
    /// It is known before a frame and stays the same throughout it: engines stop looking for pairs
    /// when what they found cannot be lent any more.
    fn limit_words(&self) -> u64;

    /// At least `words` u32 words, aligned to 64 bytes, contents unspecified. A second call
    /// replaces the first; nothing of the first is kept.
    ///
    /// # Errors
    /// [`ReserveError`] when so much memory is not to be had.
    fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError>;
}

/// The mask does not fit into the memory that may be used for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReserveError {
    /// Larger than the largest reply of this instance.
    #[error(
        "the mask needs {at_least_bytes} bytes or more and a reply holds at most {limit_bytes}: leave the encoding open, or serve with a larger --max-reply-mib"
    )]
    TooLarge {
        /// Bytes that the mask needs at the least. A search ends when it has found more than a reply
        /// holds, so that nobody knows how many more it needs.
        at_least_bytes: u64,
        /// Bytes of the largest reply.
        limit_bytes: u64,
    },
    /// The system has no memory left (a full /dev/shm, for one).
    #[error(
        "no memory for a mask of {needed_bytes} bytes: free space in /dev/shm or make it larger"
    )]
    OutOfMemory {
        /// Bytes of the mask.
        needed_bytes: u64,
    },
}

/// Why an engine gave no answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CullError {
    /// No memory for the mask.
    #[error(transparent)]
    Reserve(#[from] ReserveError),
    /// The engine is not to be had here.
    #[error("engine {engine} is not available: {why}")]
    Unavailable {
        /// The engine.
        engine: EngineName,
        /// What is missing.
        why: &'static str,
    },
    /// More boxes than the engine can take.
    #[error("{n} boxes are more than {engine} takes ({limit})")]
    TooManyBoxes {
        /// The engine.
        engine: EngineName,
        /// Boxes given.
        n: u64,
        /// Boxes allowed.
        limit: u64,
    },
    /// The scene is beyond what the engine was made for: too many boxes in one place. Another engine
    /// can serve it; this one stays usable.
    #[error("too many boxes in one place for {engine}: let another engine serve the scene")]
    TooCrowded {
        /// The engine.
        engine: EngineName,
    },
    /// The GPU is gone. Another engine can serve the same boxes; this one needs a new device.
    #[error("{engine} lost its GPU: let a CPU engine serve until the device is rebuilt")]
    DeviceLost {
        /// The engine.
        engine: EngineName,
    },
    /// The GPU has no memory for the scene. Another engine can serve it; this one stays usable.
    #[error("{engine} needs {needed_bytes} bytes of GPU memory that are not to be had")]
    DeviceMemory {
        /// The engine.
        engine: EngineName,
        /// Bytes of the block that was refused.
        needed_bytes: u64,
    },
}

/// The number of boxes, as every engine can index them.
fn counted(boxes: &[Aabb], engine: EngineName) -> Result<BoxCount, CullError> {
    let limit = u64::from(u32::MAX);
    BoxCount::of_len(boxes.len()).ok_or(CullError::TooManyBoxes {
        engine,
        n: boxes.len() as u64,
        limit,
    })
}

/// How many indices of invalid boxes a reply names.
pub const NAMED_INVALID: usize = 8;

/// Boxes that overlap nothing, and why.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Census {
    /// Boxes with a NaN.
    pub invalid: u32,
    /// Boxes with `min > max` on some axis.
    pub empty: u32,
    /// The lowest indices of invalid boxes, the first `min(invalid, 8)` of them.
    pub first_invalid: [u32; NAMED_INVALID],
}

impl Census {
    /// Counts box `index`. Call with rising indices.
    #[inline]
    pub fn note(&mut self, index: u32, class: BoxClass) {
        match class {
            BoxClass::Solid => {}
            BoxClass::Empty => self.empty += 1,
            BoxClass::Invalid => {
                if let Some(slot) = self.first_invalid.get_mut(self.invalid as usize) {
                    *slot = index;
                }
                self.invalid += 1;
            }
        }
    }

    /// Joins the census of a later range of boxes to this one.
    #[must_use]
    pub fn then(mut self, later: &Self) -> Self {
        for slot in later.named_invalid() {
            if let Some(free) = self.first_invalid.get_mut(self.invalid as usize) {
                *free = *slot;
            }
            self.invalid += 1;
        }
        self.invalid += later.invalid - later.named_invalid().len() as u32;
        self.empty += later.empty;
        self
    }

    /// The indices that were kept.
    pub fn named_invalid(&self) -> &[u32] {
        &self.first_invalid[..(self.invalid as usize).min(NAMED_INVALID)]
    }
}

/// What an engine did not have to do. All counts are of this frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SkipMeter {
    /// Empty and invalid boxes, left out before any pair is tested.
    pub boxes: u64,
    /// Pairs that were never compared, of n(n − 1)/2.
    pub pairs: u64,
    /// Mask words that are zero and were therefore not sent (sparse encoding only).
    pub zero_words: u64,
}

/// Time of an engine's stages, ns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EngineTimes {
    /// Boxes read and turned into the engine's own form (keys, order, cells).
    pub ingest_ns: u64,
    /// Pairs tested.
    pub execute_ns: u64,
    /// Mask written into the reply.
    pub publish_ns: u64,
}

/// What an engine says of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CullReport {
    /// Where the mask lies in the reserved memory.
    pub shape: MaskShape,
    /// Boxes that overlap nothing.
    pub census: Census,
    /// Pairs in the mask.
    pub pair_count: u64,
    /// Work left out.
    pub skipped: SkipMeter,
    /// Time by stage.
    pub times: EngineTimes,
}

/// A way to find all overlapping pairs.
pub trait Engine: Send {
    /// Which one it is.
    fn name(&self) -> EngineName;

    /// Writes the pair mask of `boxes` into memory of `reply`.
    ///
    /// The answer depends on `boxes` alone: not on threads, earlier frames or the machine. A mask that
    /// `reply` has no room for is refused: a dense one before any pair is tested, a sparse one soon
    /// after the first word beyond [`ReplyBuffer::limit_words`] was found.
    ///
    /// A box that changes while it is read (a hostile writer) may give a wrong answer for that
    /// box; it never harms the process.
    ///
    /// # Errors
    /// [`CullError`]; nothing is published then.
    fn cull(
        &mut self,
        boxes: &[Aabb],
        job: &CullJob,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError>;
}
