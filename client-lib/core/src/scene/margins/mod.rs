//! Margins a box: a scene holds boxes that are inflated when they are sent, and a box is sent again only
//! when it has left its inflated self.
//!
//! While each box lies within its inflated self, every pair that overlaps is a pair of the inflated boxes:
//! two boxes that share a point share it inside their inflated selves. These pairs are called **near**.
//! Whether a box lies within is decided by integer keys (`fit`), so that rounding has no part in the proof.
//!
//! The boxes of now are in a [`SceneCopy`](super::SceneCopy), which checks edits as scenes do. [`Outgoing`]
//! finds what of an edit is to be sent. [`ExactPairs`] keeps the near pairs (`rows`), tests those around
//! boxes that changed, and reports what a scene of the boxes of now would report. [`Margined`] is all of it for one scene.

mod exact;
mod fit;
mod margined;
mod outgoing;
mod rows;

pub use self::exact::ExactPairs;
pub use self::margined::{MarginStats, Margined};
pub use self::outgoing::Outgoing;

use super::edit::{Indices, Sets, Step};
use super::error::EditError;
use crate::aabb::Aabb;
use crate::precision::Margin;

/// Margins of some boxes.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Margins<'a> {
    /// The same for all.
    Same(Margin),
    /// One for each.
    Each(&'a [Margin]),
}

impl Margins<'_> {
    /// Whether all are 0.
    pub fn are_zero(&self) -> bool {
        match self {
            Self::Same(margin) => margin.is_zero(),
            Self::Each(margins) => margins.iter().all(|margin| margin.is_zero()),
        }
    }

    /// The margin of the box at a place.
    #[inline]
    fn at(&self, at: usize) -> Margin {
        match self {
            Self::Same(margin) => *margin,
            Self::Each(margins) => margins[at],
        }
    }
}

impl From<Margin> for Margins<'_> {
    fn from(margin: Margin) -> Self {
        Self::Same(margin)
    }
}

impl<'a> From<&'a [Margin]> for Margins<'a> {
    fn from(margins: &'a [Margin]) -> Self {
        Self::Each(margins)
    }
}

impl<'a> From<&'a Vec<Margin>> for Margins<'a> {
    fn from(margins: &'a Vec<Margin>) -> Self {
        Self::Each(margins)
    }
}

impl<'a, const N: usize> From<&'a [Margin; N]> for Margins<'a> {
    fn from(margins: &'a [Margin; N]) -> Self {
        Self::Each(margins)
    }
}

/// Boxes of now, where they belong, and how far each may move before it is sent again.
#[derive(Clone, Copy, Debug)]
pub struct MarginedSets<'a> {
    /// The indices.
    pub indices: Indices<'a>,
    /// A box for each.
    pub boxes: &'a [Aabb],
    /// Their margins. A box with a margin of 0 is sent whenever it changes, as it is.
    pub margins: Margins<'a>,
}

impl<'a> MarginedSets<'a> {
    /// The step that sets the boxes of now.
    pub const fn step(&self) -> Step<'a> {
        Step::Set(Sets { indices: self.indices, boxes: self.boxes })
    }

    /// Whether there is a margin for each box.
    ///
    /// # Errors
    /// [`EditError::Margins`].
    pub const fn check(&self) -> Result<(), EditError> {
        match self.margins {
            Margins::Each(margins) if margins.len() != self.boxes.len() => {
                Err(EditError::Margins { boxes: self.boxes.len(), margins: margins.len() })
            }
            _ => Ok(()),
        }
    }
}
