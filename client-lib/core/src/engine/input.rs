//! What an engine gets for a frame.

use super::{CullError, EngineName, PairRules};
use crate::aabb::Aabb;
use crate::mask::Encoding;
use crate::precision::BoxSlice;
use crate::units::BoxCount;

/// What an engine gets for a frame: objects, what counts as a pair of them, and how to answer.
///
/// An engine for boxes takes them in any form ([`BoxSlice`]). Engines for other objects take
/// those: the type says which.
///
/// An attribute of the objects that every engine has to honour (a group for each box, for one) is a
/// field of `PairRules`. These go on to the tasks of a frame with the words' budget, in `Gather`, and
/// each word passes them there.
#[derive(Clone, Copy)]
#[non_exhaustive]
pub struct CullInput<'a, Objects = BoxSlice<'a>> {
    /// What is culled.
    pub objects: Objects,
    /// Encoding of the mask.
    pub encoding: Encoding,
    /// Threads that the engine may use, at least 1. With more than one, the engine runs on the
    /// rayon pool of the calling thread.
    pub threads: usize,
    /// Whether the engine may stop where another one takes less time, with [`CullError::TooCrowded`].
    pub(crate) may_hand_over: bool,
    /// Which pairs count, beyond those whose boxes overlap.
    pub(crate) rules: PairRules<'a>,
}

impl<'a> CullInput<'a> {
    /// Boxes in any form: a slice of [`Aabb`], or narrow ones. The mask is sparse, and the engine has
    /// one thread, unless set otherwise.
    pub fn boxes(boxes: impl Into<BoxSlice<'a>>) -> Self {
        CullInput::of(boxes.into())
    }

    /// The boxes, for an engine that tests pairs by nothing else. What it does not list in its
    /// descriptor is refused.
    ///
    /// # Errors
    /// [`CullError::Unavailable`] for rules that pairs have to pass, and for forms and encodings that
    /// the engine does not have.
    pub fn boxes_alone(&self, engine: EngineName) -> Result<BoxSlice<'a>, CullError> {
        let unavailable = |why| Err(CullError::Unavailable { engine, why });
        let descriptor = engine.descriptor();
        if !descriptor.encodings.contains(&self.encoding) {
            return unavailable("it does not write masks of this encoding");
        }
        if !descriptor.forms.contains(&self.objects.form()) {
            return unavailable("it does not read boxes of this form");
        }
        if !self.rules.pass_all() {
            return unavailable("it tests pairs by their boxes alone");
        }
        Ok(self.objects)
    }

    /// The boxes, for an engine that reads them in f32 alone, and their number.
    ///
    /// # Errors
    /// [`CullError::Unavailable`] for narrow boxes; [`CullError::TooManyBoxes`].
    pub fn f32_boxes(&self, engine: EngineName) -> Result<(&'a [Aabb], BoxCount), CullError> {
        let Some(boxes) = self.objects.as_f32() else {
            let why = "it reads boxes in f32 alone";
            return Err(CullError::Unavailable { engine, why });
        };
        Ok((boxes, counted(boxes, engine)?))
    }
}

impl<'a, Objects> CullInput<'a, Objects> {
    /// Objects of a kind, with what [`CullInput::boxes`] has for the rest.
    pub(crate) const fn of(objects: Objects) -> Self {
        let rules = PairRules::NONE;
        Self { objects, encoding: Encoding::Sparse, threads: 1, may_hand_over: false, rules }
    }

    /// The same objects, answered in this encoding.
    #[must_use]
    pub fn encoding(self, encoding: Encoding) -> Self {
        Self { encoding, ..self }
    }

    /// The same objects, for so many threads.
    #[must_use]
    pub fn threads(self, threads: usize) -> Self {
        Self { threads, ..self }
    }

    /// The same objects, for an engine that may hand them over to another.
    #[must_use]
    pub(crate) fn may_hand_over(self, may_hand_over: bool) -> Self {
        Self { may_hand_over, ..self }
    }

    /// The same objects, of whose pairs only those count that the rules let pass.
    #[must_use]
    pub(crate) fn rules(self, rules: PairRules<'a>) -> Self {
        Self { rules, ..self }
    }

    /// Other objects in the place of these: one for one, since all else stays.
    #[must_use]
    pub fn with_objects<'b, Others>(&self, objects: Others) -> CullInput<'b, Others>
    where
        'a: 'b,
    {
        let Self { encoding, threads, may_hand_over, rules, .. } = *self;
        CullInput { objects, encoding, threads, may_hand_over, rules }
    }
}

/// The number of objects, as every engine can index them.
///
/// # Errors
/// [`CullError::TooManyBoxes`].
pub(crate) fn counted<T>(objects: &[T], engine: EngineName) -> Result<BoxCount, CullError> {
    let (n, limit) = (objects.len() as u64, u64::from(u32::MAX));
    BoxCount::of_len(objects.len()).ok_or(CullError::TooManyBoxes { engine, n, limit })
}
