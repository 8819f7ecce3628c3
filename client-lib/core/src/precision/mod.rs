//! Precision modes: they save bytes or requests, may add extra pairs, and never miss a pair.
//!
//! Exact is the default. The modes and their guarantees:
//!
//! | mode | bytes a box | a pair may be reported although it has a gap of |
//! |---|---|---|
//! | [`Precision::Exact`] | 24 | none |
//! | [`Precision::Q16`] | 12 | one cell, 1/65,536 of the bounds, on each axis; any gap beyond the bounds |
//! | [`Precision::Q8`] | 6 | one cell, 1/256 of the bounds, on each axis; any gap beyond the bounds |
//! | [`Precision::F16`] | 12 | 1/512 of the larger coordinate's magnitude, or 2⁻²³; any gap beyond ±65,504 |
//! | [`Aabb::outward_from_f64`] | 24 | a step of f32 at each face, at its distance from the origin |
//! | [`Margin`] | any | twice the margin, two steps of f32 at each face, and what the form adds |
//!
//! A step of f32 at x is 2⁻²³ of x at most: 0.12 at 10⁶ units. [`Widening::gap_limit`] and
//! [`Margin::gap_limit`] give the gap for two faces, all of that
//! included; `pairmask-lab stress` holds every extra pair of every mode to it.
//!
//! # Why no pair is lost
//!
//! Two boxes overlap on an axis when `a.min <= b.max` and `b.min <= a.max`. Send every min through
//! one function f and every max through one function g, both monotone (x <= y gives f(x) <= f(y)),
//! with f(x) <= g(x) for every x. Then `a.min <= b.max` gives f(a.min) <= f(b.max) <= g(b.max), so
//! boxes that overlap still do. Every mode here is such a pair of functions, and the docs of each
//! prove that they are monotone. It follows that the whole frame must use the same ones: the same
//! bounds, the same origin.
//!
//! The functions are also the same for threads of different floating-point flags, which may write
//! one frame. Functions in floats are computed with the default flags ([`crate::floats`]); the
//! others use integers, or float arithmetic that no flag changes.
//!
//! A box keeps its class in every form: an empty box stays empty and an invalid one invalid, so
//! that the census is that of the boxes that were given.

mod bounds;
mod exact;
mod f16;
mod form;
mod margin;
mod narrow;
mod origin;
mod quantize;
mod simd;
mod widening;

pub use bounds::{Bounds, BoundsError};
pub(crate) use exact::widen;
pub use form::{BoxForm, Precision};
pub use margin::{Margin, MarginError};
pub use narrow::{BoxF16, BoxQ8, BoxQ16, BoxSlice, Encoder, ExpandScratch};
pub use quantize::Quantizer;
pub use widening::Widening;

#[cfg(doc)]
use crate::aabb::Aabb;
