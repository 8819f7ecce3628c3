//! What is told of an edit: lists of pairs, in the memory of the daemon's answer or of the scene.

use std::slice;

use pairmask_core::engine::{AvailableIsa, EngineId, EngineName};
use pairmask_core::mask::{MaskShape, MaskView, Pairs, Span};
use pairmask_core::scene::{Ended, Reported, SceneSkips};
use pairmask_core::units::BoxCount;
use pairmask_wire::{SceneReply, words_in};

use crate::session::ServedBy;
use crate::session::exchange::Answer;

/// An answer in the daemon's memory.
pub(super) struct FromDaemon {
    pub answer: Answer,
    pub reply: SceneReply,
    /// Indices of the scene are below this.
    pub index_end: u32,
    pub isa: AvailableIsa,
}

/// Where an answer lies.
pub(super) enum Source<'a> {
    Daemon(&'a FromDaemon),
    Here(&'a Reported),
}

impl<'a> Source<'a> {
    pub fn begun(&self) -> PairList<'a> {
        match self {
            Self::Daemon(from) => from.list(&from.reply.layout.begun),
            Self::Here(reported) => PairList(List::Own(reported.begun())),
        }
    }

    pub fn ended(&self) -> impl Iterator<Item = Ended> + Clone + std::fmt::Debug + use<'a> {
        let (own, shared) = match self {
            Self::Daemon(from) => {
                (&[][..], Some(from.reply.layout.ended_in(from.words(), from.index_end)))
            }
            Self::Here(reported) => (reported.ended(), None),
        };
        own.iter().copied().chain(shared.into_iter().flatten())
    }

    pub fn pairs(&self) -> PairList<'a> {
        match self {
            Self::Daemon(from) => from.list(&from.reply.layout.pairs),
            Self::Here(reported) => PairList(List::Own(reported.pairs())),
        }
    }

    pub const fn is_resync(&self) -> bool {
        match self {
            Self::Daemon(from) => from.reply.is_resync,
            Self::Here(reported) => reported.is_resync(),
        }
    }

    pub fn pair_count(&self) -> Option<u64> {
        match self {
            Self::Daemon(from) => from.reply.pair_count,
            Self::Here(reported) => reported.pair_count(),
        }
    }

    pub const fn skipped(&self) -> &'a SceneSkips {
        match self {
            Self::Daemon(from) => &from.reply.skipped,
            Self::Here(reported) => reported.skipped(),
        }
    }

    pub const fn served_by(&self) -> ServedBy {
        match self {
            Self::Daemon(_) => ServedBy::Daemon,
            Self::Here(_) => ServedBy::InProcess,
        }
    }

    pub fn engine(&self) -> EngineId {
        match self {
            Self::Daemon(from) => from.reply.engine,
            Self::Here(_) => EngineName::CpuGrid.into(),
        }
    }
}

impl FromDaemon {
    fn words(&self) -> &[u32] {
        words_in(self.answer.response.pages())
    }

    fn list(&self, span: &Span) -> PairList<'_> {
        let shape = MaskShape::List { pairs: *span };
        let view = MaskView::new(BoxCount::new(self.index_end), &shape, self.words());
        // The span was validated: it lies within the words, and holds whole pairs.
        PairList(view.map_or(List::Own(&[]), |view| List::Shared(view.with_isa(self.isa))))
    }
}

/// Pairs of a scene, smaller index first, sorted. A list in the daemon's memory is checked as it is
/// read: whatever another process writes there, no index is one that the scene cannot have.
#[derive(Clone, Copy)]
pub struct PairList<'a>(List<'a>);

#[derive(Clone, Copy)]
enum List<'a> {
    Own(&'a [[u32; 2]]),
    Shared(MaskView<'a>),
}

impl<'a> PairList<'a> {
    /// How many.
    pub fn len(&self) -> usize {
        match &self.0 {
            List::Own(pairs) => pairs.len(),
            List::Shared(view) => view.count() as usize,
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.iter().next().is_none()
    }

    /// The pairs one by one.
    pub fn iter(&self) -> PairListIter<'a> {
        PairListIter(match &self.0 {
            List::Own(pairs) => Pass::Own(pairs.iter()),
            List::Shared(view) => Pass::Shared(view.pairs()),
        })
    }

    /// The pairs in slices: the fastest way to visit all.
    pub fn for_each_slice(&self, mut f: impl FnMut(&[[u32; 2]])) {
        match &self.0 {
            List::Own([]) => {}
            List::Own(pairs) => f(pairs),
            List::Shared(view) => view.for_each_slice(f),
        }
    }

    /// The pairs where they lie, if that is this process's own memory; `None` for those in a daemon's answer.
    pub fn own_list(&self) -> Option<&'a [[u32; 2]]> {
        match &self.0 {
            List::Own(pairs) => Some(pairs),
            List::Shared(_) => None,
        }
    }

    /// The pairs.
    pub fn to_vec(&self) -> Vec<[u32; 2]> {
        let mut pairs = Vec::with_capacity(self.len());
        self.for_each_slice(|some| pairs.extend_from_slice(some));
        pairs
    }
}

impl std::fmt::Debug for PairList<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}

impl<const N: usize> PartialEq<[[u32; 2]; N]> for PairList<'_> {
    fn eq(&self, pairs: &[[u32; 2]; N]) -> bool {
        self.iter().eq(*pairs)
    }
}

impl<'a> IntoIterator for &PairList<'a> {
    type Item = [u32; 2];
    type IntoIter = PairListIter<'a>;

    fn into_iter(self) -> PairListIter<'a> {
        self.iter()
    }
}

impl<'a> IntoIterator for PairList<'a> {
    type Item = [u32; 2];
    type IntoIter = PairListIter<'a>;

    fn into_iter(self) -> PairListIter<'a> {
        self.iter()
    }
}

/// The pairs of a [`PairList`], one by one.
pub struct PairListIter<'a>(Pass<'a>);

impl std::fmt::Debug for PairListIter<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("PairListIter")
    }
}

#[allow(clippy::large_enum_variant)] // A pass over a list in shared memory has a buffer.
enum Pass<'a> {
    Own(slice::Iter<'a, [u32; 2]>),
    Shared(Pairs<'a>),
}

impl Iterator for PairListIter<'_> {
    type Item = [u32; 2];

    fn next(&mut self) -> Option<[u32; 2]> {
        match &mut self.0 {
            Pass::Own(pairs) => pairs.next().copied(),
            Pass::Shared(pairs) => pairs.next(),
        }
    }
}
