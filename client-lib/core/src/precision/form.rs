//! Precisions that a client asks for, and the forms of boxes in shared memory that belong to them.

use std::fmt;

use super::bounds::Bounds;
use super::narrow::{BoxF16, BoxQ8, BoxQ16, Encoder};
use super::quantize::Quantizer;
use super::widening::Widening;
use crate::aabb::{AABB_BYTES, Aabb};
use crate::units::BoxCount;

/// The form of the boxes of a frame: the number and the meaning of their bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BoxForm {
    /// Six f32, 24 bytes: [`Aabb`](crate::aabb::Aabb).
    #[default]
    F32,
    /// Six u16 cells, 12 bytes: [`BoxQ16`].
    Q16,
    /// Six u8 cells, 6 bytes: [`BoxQ8`].
    Q8,
    /// Six halves, 12 bytes: [`BoxF16`].
    F16,
}

impl BoxForm {
    /// Every form.
    pub const ALL: [Self; 4] = [Self::F32, Self::Q16, Self::Q8, Self::F16];

    /// The name in reports.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::Q16 => "q16",
            Self::Q8 => "q8",
            Self::F16 => "f16",
        }
    }

    /// Bytes of one box.
    pub const fn box_bytes(self) -> usize {
        match self {
            Self::F32 => AABB_BYTES,
            Self::Q16 => size_of::<BoxQ16>(),
            Self::Q8 => size_of::<BoxQ8>(),
            Self::F16 => size_of::<BoxF16>(),
        }
    }

    /// Bytes of `n` boxes. Fits u64 for every count.
    pub const fn bytes(self, n: BoxCount) -> u64 {
        n.get() as u64 * self.box_bytes() as u64
    }

    /// Whether the form is one that daemons of wire version 1.0 do not know.
    pub const fn is_narrow(self) -> bool {
        !matches!(self, Self::F32)
    }
}

impl fmt::Display for BoxForm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

/// The precision of the boxes of a frame. No mode misses a pair.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Precision {
    /// f32, no extra pair.
    #[default]
    Exact,
    /// 65,536 cells on each axis of the bounds.
    Q16(Bounds),
    /// 256 cells on each axis of the bounds.
    Q8(Bounds),
    /// Halves: precise near the origin, none beyond ±65,504.
    F16,
}

impl Precision {
    /// The form of the boxes.
    pub const fn form(&self) -> BoxForm {
        match self {
            Self::Exact => BoxForm::F32,
            Self::Q16(_) => BoxForm::Q16,
            Self::Q8(_) => BoxForm::Q8,
            Self::F16 => BoxForm::F16,
        }
    }

    /// Writes boxes in this form, large scenes on the rayon pool. Sessions do this by themselves;
    /// this function is for programs that implement the wire contract.
    ///
    /// # Panics
    /// When `bytes` are not [`BoxForm::bytes`] of as many boxes, or not aligned to 4 bytes.
    pub fn write(&self, boxes: &[Aabb], bytes: &mut [u8]) {
        assert_eq!(bytes.len(), boxes.len() * self.form().box_bytes(), "room for the boxes");
        Encoder::new(self).write(boxes, bytes);
    }

    /// How far apart two boxes may be that are reported as a pair: [`Widening::gap_limit`].
    pub fn widening(&self) -> Widening {
        match self {
            Self::Exact => Widening::None,
            Self::Q16(bounds) => Self::cells(Quantizer::q16_of, *bounds),
            Self::Q8(bounds) => Self::cells(Quantizer::q8_of, *bounds),
            Self::F16 => Widening::HALVES,
        }
    }

    fn cells(quantizer_of: fn(&Bounds) -> Quantizer, bounds: Bounds) -> Widening {
        Widening::Cells { size: quantizer_of(&bounds).cell_size(), bounds }
    }
}
