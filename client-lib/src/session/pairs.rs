//! The answer to a frame: a pair mask in the memory it was written to, and facts about the frame.

use std::sync::Arc;

use pairmask_core::dispatch::{StageTimes, WorldRange};
use pairmask_core::engine::{AvailableIsa, Census, EngineId, HeapReply, SkipMeter};
use pairmask_core::filters::World;
use pairmask_core::mask::{Encoding, MaskShape, MaskView, Pairs, ParPairs, Words};
use pairmask_core::objects::ObjectForm;
use pairmask_core::precision::Widening;
use pairmask_core::units::BoxCount;
use pairmask_wire::{Reply, words_in};

use super::link::AnswerMemory;
use super::spares::Spares;
use super::written::Written;

/// What answered a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ServedBy {
    /// The daemon, through shared memory.
    Daemon,
    /// This process.
    InProcess,
}

impl ServedBy {
    /// The name in reports.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Daemon => "daemon",
            Self::InProcess => "in-process",
        }
    }
}

/// Facts about an answered frame beside its pairs.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct FrameInfo {
    /// What answered.
    pub served_by: ServedBy,
    /// The engine. It may be one of a later daemon that this build does not know.
    pub engine: EngineId,
    /// Threads that the engine could use.
    pub threads: usize,
    /// Boxes that overlap nothing.
    pub census: Census,
    /// Work that the engine skipped.
    pub skipped: SkipMeter,
    /// Time by stage, without the way to the daemon and back.
    pub times: StageTimes,
    /// Bytes of the mask.
    pub mask_bytes: u64,
    /// What the objects are, boxes or spheres, and their form.
    pub form: ObjectForm,
    /// Bytes of the boxes or spheres in that form: what a daemon reads.
    pub box_bytes: u64,
    /// How far apart two boxes may be and still be a pair of this mask.
    pub widening: Widening,
}

/// Where the words of a mask lie.
pub(super) enum Storage {
    Shared(AnswerMemory),
    Own { memory: HeapReply, home: Arc<Spares> },
}

/// The overlapping pairs of a frame. Holds the memory that the mask lies in until dropped.
pub struct PairMask {
    n: BoxCount,
    shape: MaskShape,
    pair_count: u64,
    info: FrameInfo,
    /// Decodes the mask.
    isa: AvailableIsa,
    storage: Storage,
    worlds: Vec<WorldRange>,
}

impl std::fmt::Debug for PairMask {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PairMask")
            .field("n", &self.n)
            .field("encoding", &self.encoding())
            .field("pairs", &self.to_vec())
            .finish_non_exhaustive()
    }
}

impl Drop for PairMask {
    fn drop(&mut self) {
        if let Storage::Own { memory, home } = &mut self.storage {
            home.replies.give(std::mem::take(memory));
        }
    }
}

impl PairMask {
    /// A mask of a reply whose shape was checked against this storage.
    pub(super) fn new(
        storage: Storage,
        reply: &Reply,
        served_by: ServedBy,
        written: Written,
        isa: AvailableIsa,
    ) -> Self {
        let Reply { box_count, engine, threads, report, times } = *reply;
        Self {
            n: box_count,
            shape: report.shape,
            pair_count: report.pair_count,
            info: FrameInfo {
                served_by,
                engine,
                threads,
                census: report.census,
                skipped: report.skipped,
                times,
                mask_bytes: report.shape.mask_bytes(),
                form: written.form,
                box_bytes: written.form.bytes(box_count),
                widening: written.widening,
            },
            isa,
            storage,
            worlds: Vec::new(),
        }
    }

    /// The same mask, a list whose pairs are ordered by world.
    pub(super) fn with_worlds(self, worlds: Vec<WorldRange>) -> Self {
        // The mask is not taken apart: it gives its memory back when it is dropped.
        let mut mask = self;
        mask.worlds = worlds;
        mask
    }

    /// Where the sections of the mask lie in [`reply_words`](Self::reply_words).
    pub const fn shape(&self) -> &MaskShape {
        &self.shape
    }

    /// The reply as it lies in memory: the sections of the mask, and gaps whose contents are
    /// unspecified.
    pub fn reply_words(&self) -> &[u32] {
        match &self.storage {
            Storage::Shared(memory) => words_in(memory.pages()),
            Storage::Own { memory, .. } => memory.words(),
        }
    }

    /// The mask as a view, for other ways to decode it than the methods of this type.
    ///
    /// # Panics
    /// Never: the shape was checked against the memory when the mask was made, and neither changes.
    pub fn view(&self) -> MaskView<'_> {
        MaskView::new(self.n, &self.shape, self.reply_words())
            .expect("the shape was checked when the mask was made")
            .with_isa(self.isa)
    }

    /// Boxes or spheres of the frame.
    pub const fn n(&self) -> BoxCount {
        self.n
    }

    /// Facts about the frame beside its pairs.
    pub const fn info(&self) -> &FrameInfo {
        &self.info
    }

    /// How the mask is written.
    pub const fn encoding(&self) -> Encoding {
        self.shape.encoding()
    }

    /// Number of pairs, as counted by the engine.
    pub const fn count(&self) -> u64 {
        self.pair_count
    }

    /// Where the pairs of each world stand in the list, by rising world. Empty unless the frame had
    /// [rules](super::Frame::submit_with) with boxes of several worlds, and the mask is a list.
    pub fn worlds(&self) -> &[WorldRange] {
        &self.worlds
    }

    /// The pairs of a world, smaller index first. `None` where [`worlds`](Self::worlds) does not have it.
    pub fn pairs_of_world(&self, world: World) -> Option<&[[u32; 2]]> {
        let range = WorldRange::of(&self.worlds, world)?;
        match self.view() {
            MaskView::List(list) => list.as_pairs().get(range),
            _ => None,
        }
    }

    /// Whether boxes (or spheres) `a` and `b` overlap. One AND in a dense mask; a search in a sparse one
    /// and in a list.
    pub fn contains(&self, a: u32, b: u32) -> bool {
        self.view().contains(a, b)
    }

    /// All pairs (a, b), a < b, one at a time.
    pub fn pairs(&self) -> Pairs<'_> {
        self.view().pairs()
    }

    /// Calls `f(a, b)` for each pair, a < b: the fastest way through a mask on one thread.
    pub fn for_each(&self, f: impl FnMut(u32, u32)) {
        self.view().for_each(f);
    }

    /// Calls `f` with slices of pairs [a, b], a < b, until all were seen: see
    /// [`MaskView::for_each_slice`]. Those of a list in this process's own memory are not copied.
    pub fn for_each_slice(&self, f: impl FnMut(&[[u32; 2]])) {
        match (&self.storage, self.view()) {
            (Storage::Own { .. }, MaskView::List(list)) => list.for_each_slice_in_place(f),
            (_, view) => view.for_each_slice(f),
        }
    }

    /// The pairs [a, b], a < b, where they lie: for a mask that is a list in this process's own memory, as
    /// its engines write it. `None` for any other.
    pub fn own_list(&self) -> Option<&[[u32; 2]]> {
        match (&self.storage, self.view()) {
            (Storage::Own { .. }, MaskView::List(list)) => Some(list.as_pairs()),
            _ => None,
        }
    }

    /// All pairs, on the rayon pool.
    pub fn par_pairs(&self) -> ParPairs<'_> {
        self.view().par_pairs()
    }

    /// The non-zero words of the mask with their addresses.
    pub fn words(&self) -> Words<'_> {
        self.view().words()
    }

    /// All pairs in a vector.
    pub fn to_vec(&self) -> Vec<[u32; 2]> {
        self.view().to_vec()
    }
}
