//! Precision modes: fewer bytes or fewer requests for extra pairs, and never a missed one.
//!
//! Exact is the default. The other modes, each with what it promises:
//!
//! | mode | bytes a box | a pair may be reported although it has a gap of |
//! |---|---|---|
//! | [`Precision::Exact`] | 24 | none |
//! | [`Precision::Q16`] | 12 | less than one cell, 1/65,536 of the bounds, on each axis |
//! | [`Precision::Q8`] | 6 | less than one cell, 1/256 of the bounds, on each axis |
//! | [`Precision::F16`] | 12 | less than 1/512 of the larger coordinate's magnitude, or 2⁻²³ |
//! | [`Aabb::outward_from_f64`] | 24 | less than two units in the last place of the f32 |
//! | [`Margined`](crate::session::Margined) | any | twice the margin, and what the form adds |
//!
//! # Why no pair is lost
//!
//! Two boxes overlap on an axis when `a.min <= b.max` and `b.min <= a.max`. Send every min through
//! one function f and every max through one function g, both monotone (x <= y gives f(x) <= f(y)),
//! with f(x) <= g(x) for every x. Then `a.min <= b.max` gives f(a.min) <= f(b.max) <= g(b.max), so
//! whatever overlaps still does. Every mode here is such a pair of functions, and each says why its
//! are monotone. It follows that the whole frame must use the same ones: the same bounds, the same
//! origin.
//!
//! A box keeps its class in every form: an empty box stays empty and an invalid one invalid, so
//! that the census is that of the boxes that were given.

mod bounds;
mod exact;
mod f16;
mod form;
mod narrow;
mod origin;
mod quantize;
mod simd;

pub use bounds::{Bounds, BoundsError};
pub use form::{BoxForm, Precision, Widening};
pub(crate) use narrow::Encoder;
pub use narrow::{BoxF16, BoxQ8, BoxQ16, ExpandScratch, NarrowBoxes};
pub use quantize::Quantizer;

#[cfg(doc)]
use crate::aabb::Aabb;
