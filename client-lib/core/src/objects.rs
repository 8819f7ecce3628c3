//! What a scene is made of, and how it lies in memory.

use std::fmt;

use crate::engine::word_budget::WordBudget;
use crate::engine::{CullError, ReplyBuffer};
use crate::mask::Encoding;
use crate::precision::{BoxForm, BoxSlice};
use crate::sphere::{SPHERE_BYTES, Sphere};
use crate::units::BoxCount;

/// What the objects of a frame are, and in which form they lie in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ObjectForm {
    /// Boxes in one of their forms.
    Boxes(BoxForm),
    /// Spheres: four f32, 16 bytes.
    Spheres,
}

impl ObjectForm {
    /// Every form.
    pub const ALL: [Self; 5] = [
        Self::Boxes(BoxForm::F32),
        Self::Boxes(BoxForm::Q16),
        Self::Boxes(BoxForm::Q8),
        Self::Boxes(BoxForm::F16),
        Self::Spheres,
    ];

    /// The name in reports: that of the boxes' form, or `spheres`.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Boxes(form) => form.as_str(),
            Self::Spheres => "spheres",
        }
    }

    /// Bytes of one object.
    pub const fn object_bytes(self) -> usize {
        match self {
            Self::Boxes(form) => form.box_bytes(),
            Self::Spheres => SPHERE_BYTES,
        }
    }

    /// Bytes of `n` objects. Fits u64 for every count.
    pub const fn bytes(self, n: BoxCount) -> u64 {
        n.get() as u64 * self.object_bytes() as u64
    }
}

impl From<BoxForm> for ObjectForm {
    fn from(form: BoxForm) -> Self {
        Self::Boxes(form)
    }
}

impl fmt::Display for ObjectForm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

/// The objects of a frame where they lie.
#[derive(Clone, Copy, Debug)]
pub enum Objects<'a> {
    /// Boxes in one of their forms.
    Boxes(BoxSlice<'a>),
    /// Spheres.
    Spheres(&'a [Sphere]),
}

impl<'a> From<BoxSlice<'a>> for Objects<'a> {
    fn from(boxes: BoxSlice<'a>) -> Self {
        Self::Boxes(boxes)
    }
}

impl<'a> From<&'a [Sphere]> for Objects<'a> {
    fn from(spheres: &'a [Sphere]) -> Self {
        Self::Spheres(spheres)
    }
}

impl<'a> Objects<'a> {
    /// Bytes as objects of a form; `None` where they are no whole number of objects, or not aligned
    /// for them.
    pub fn new(form: ObjectForm, bytes: &'a [u8]) -> Option<Self> {
        match form {
            ObjectForm::Boxes(form) => BoxSlice::new(form, bytes).map(Self::Boxes),
            ObjectForm::Spheres => bytemuck::try_cast_slice(bytes).ok().map(Self::Spheres),
        }
    }

    /// Which form.
    pub const fn form(&self) -> ObjectForm {
        match self {
            Self::Boxes(boxes) => ObjectForm::Boxes(boxes.form()),
            Self::Spheres(_) => ObjectForm::Spheres,
        }
    }

    /// How many.
    pub const fn len(&self) -> usize {
        match self {
            Self::Boxes(boxes) => boxes.len(),
            Self::Spheres(spheres) => spheres.len(),
        }
    }

    /// Refuses a mask of all their pairs that is sure to be larger than the reply, before any pair is looked for.
    ///
    /// # Errors
    /// [`ReserveError::TooLarge`](crate::engine::ReserveError::TooLarge); [`CullError::Cancelled`].
    pub fn check_room(&self, encoding: Encoding, reply: &dyn ReplyBuffer) -> Result<(), CullError> {
        let Some(n) = BoxCount::of_len(self.len()) else { return Ok(()) };
        let budget = WordBudget::new(n, encoding, false, reply)?;
        match self {
            Self::Boxes(boxes) => budget.look_at(|index| boxes.get(index), None)?,
            Self::Spheres(spheres) => budget.look_at(|index| spheres.get(index).copied(), None)?,
        };
        Ok(())
    }

    /// Their bytes.
    pub fn as_bytes(&self) -> &'a [u8] {
        match self {
            Self::Boxes(boxes) => boxes.as_bytes(),
            Self::Spheres(spheres) => bytemuck::cast_slice(spheres),
        }
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odd_lengths_and_addresses_are_no_objects() {
        let words = [0u32; 30];
        let bytes: &[u8] = bytemuck::cast_slice(&words);
        for form in ObjectForm::ALL {
            let two = 2 * form.object_bytes();
            assert!(Objects::new(form, &bytes[..two - 1]).is_none(), "{form}");
            let objects = Objects::new(form, &bytes[..two]).expect("two objects");
            assert_eq!((objects.form(), objects.len()), (form, 2));
            assert_eq!(form.bytes(BoxCount::new(2)), two as u64);
        }
        assert!(Objects::new(ObjectForm::Spheres, &bytes[2..34]).is_none(), "not aligned");
    }
}
