//! What a client asks for, and the form in which its boxes then lie in shared memory.

use std::fmt;

use super::bounds::Bounds;
use super::narrow::{BoxF16, BoxQ8, BoxQ16, Encoder};
use super::quantize::Quantizer;
use crate::aabb::{AABB_BYTES, Aabb};
use crate::units::BoxCount;
use crate::wire::SectionKind;

/// The form of the boxes of a frame: how many bytes, and what they mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BoxForm {
    /// Six f32, 24 bytes: [`Aabb`](crate::Aabb).
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

    /// The section that holds boxes of this form.
    pub const fn section(self) -> SectionKind {
        match self {
            Self::F32 => SectionKind::Boxes,
            Self::Q16 => SectionKind::BoxesQ16,
            Self::Q8 => SectionKind::BoxesQ8,
            Self::F16 => SectionKind::BoxesF16,
        }
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

/// How precisely the boxes of a frame are told apart. No mode misses a pair.
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
    /// The form that boxes take.
    pub const fn form(&self) -> BoxForm {
        match self {
            Self::Exact => BoxForm::F32,
            Self::Q16(_) => BoxForm::Q16,
            Self::Q8(_) => BoxForm::Q8,
            Self::F16 => BoxForm::F16,
        }
    }

    /// Writes boxes in this form, large scenes on the rayon pool. Sessions do so by themselves; this
    /// is for those who speak the wire contract on their own.
    ///
    /// # Panics
    /// When `bytes` are not [`BoxForm::bytes`] of as many boxes, or not aligned to 4 bytes.
    pub fn write(&self, boxes: &[Aabb], bytes: &mut [u8]) {
        assert_eq!(bytes.len(), boxes.len() * self.form().box_bytes(), "room for the boxes");
        Encoder::new(self).write(boxes, bytes);
    }

    /// How far apart two boxes may be that are reported as a pair.
    pub fn widening(&self) -> Widening {
        match self {
            Self::Exact => Widening::None,
            Self::Q16(bounds) => Widening::Cells(Quantizer::q16_of(bounds).cell_size()),
            Self::Q8(bounds) => Widening::Cells(Quantizer::q8_of(bounds).cell_size()),
            Self::F16 => Widening::HALVES,
        }
    }
}

/// The gap, in units of the boxes, below which a pair that does not overlap may be reported.
///
/// Such a pair overlaps or has a smaller gap on *every* axis.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Widening {
    /// No extra pair.
    #[default]
    None,
    /// A cell on each axis, for boxes within the bounds. Boxes outside on one side count as
    /// overlapping on that axis, whatever their gap.
    Cells([f64; 3]),
    /// A share of the larger coordinate's magnitude, and no less than so many units near zero.
    /// Magnitudes above `beyond` count as infinite.
    Relative {
        /// Share of the magnitude.
        share: f64,
        /// Units, near zero.
        least: f64,
        /// Units.
        beyond: f64,
    },
}

impl Widening {
    /// Halves have 11 significant bits and are multiples of 2⁻²⁴; both faces may move by one step.
    const HALVES: Self =
        Self::Relative { share: 1.0 / 512.0, least: 1.0 / 8_388_608.0, beyond: 65_504.0 };
}

impl fmt::Display for Widening {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => f.write_str("no extra pair"),
            Self::Cells([x, y, z]) => write!(f, "gaps below {x:.4} x {y:.4} x {z:.4} units"),
            Self::Relative { share, least, beyond } => {
                write!(
                    f,
                    "gaps below {share} of the coordinate, or {least}; none seen beyond {beyond}"
                )
            }
        }
    }
}
