//! What is reported of an edit: lists of pairs, in the memory of the daemon's answer or of the scene.

use std::ops::Range;

use pairmask_core::engine::{AvailableIsa, EngineId, EngineName};
use pairmask_core::mask::{MaskShape, MaskView, PairList, Span};
use pairmask_core::scene::{Ended, Reported, SceneSkips};
use pairmask_core::units::BoxCount;
use pairmask_wire::{SceneReply, TickMarks, words_in};

use crate::session::link::Answer;
use crate::session::pairs::ServedBy;

/// An answer in the daemon's memory.
pub(super) struct FromDaemon {
    pub answer: Answer,
    pub reply: SceneReply,
    /// The tick, of a scene that several processes write.
    pub tick: Option<TickMarks>,
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
            Self::Here(reported) => reported.begun().into(),
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
            Self::Here(reported) => reported.pairs().into(),
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

    /// The tick, and leases of writers that had not committed when it ended.
    pub fn tick(&self) -> Option<(u64, Vec<Range<u32>>)> {
        let Self::Daemon(from) = self else { return None };
        let marks = from.tick.as_ref()?;
        Some((marks.tick, marks.late_in(from.words())))
    }

    pub fn engine(&self) -> EngineId {
        match self {
            Self::Daemon(from) => from.reply.engine,
            Self::Here(_) => EngineName::CpuGrid.into(),
        }
    }
}

impl FromDaemon {
    pub fn words(&self) -> &[u32] {
        words_in(self.answer.memory.pages())
    }

    fn list(&self, span: &Span) -> PairList<'_> {
        let shape = MaskShape::List { pairs: *span };
        let view = MaskView::new(BoxCount::new(self.index_end), &shape, self.words());
        // The span was validated: it lies within the words, and holds whole pairs.
        view.map_or(PairList::default(), |view| view.with_isa(self.isa).into())
    }
}
