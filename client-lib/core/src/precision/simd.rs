//! The conversion loops, compiled for each instruction set of x86-64. The code is the same, and so
//! are the results: no step of it rounds differently anywhere.
#![allow(unsafe_code)]

use super::exact::{GROUP, Group, is_solid_group};
use super::narrow::NarrowBox;
use crate::aabb::Aabb;
use crate::floats;
use crate::isa::{AvailableIsa, Isa};

#[inline(always)]
fn narrow_loop<B: NarrowBox>(boxes: &[Aabb], encoder: &B::Encoder, out: &mut [B]) {
    let lanes = B::lanes(encoder);
    let (groups, rest) = boxes.as_chunks::<GROUP>();
    let (out_groups, out_rest) = out.as_chunks_mut::<GROUP>();
    for (out, boxes) in out_groups.iter_mut().zip(groups) {
        let group: &Group = bytemuck::cast_ref(boxes);
        if is_solid_group(group) {
            *out = B::narrow_group(group, &lanes);
        } else {
            *out = boxes.map(|b| B::narrow(&b, encoder));
        }
    }
    for (out, b) in out_rest.iter_mut().zip(rest) {
        *out = B::narrow(b, encoder);
    }
}

#[inline(always)]
fn expand_loop<B: NarrowBox>(boxes: &[B], out: &mut [Aabb]) {
    for (out, b) in out.iter_mut().zip(boxes) {
        *out = b.expand();
    }
}

/// Writes the narrow form of each box, independent of the thread's flags. Both slices are of one
/// length.
pub(super) fn narrow<B: NarrowBox>(boxes: &[Aabb], encoder: &B::Encoder, out: &mut [B]) {
    floats::with_default(|| narrow_with_default_flags(boxes, encoder, out));
}

fn narrow_with_default_flags<B: NarrowBox>(boxes: &[Aabb], encoder: &B::Encoder, out: &mut [B]) {
    match AvailableIsa::best().get() {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: an `AvailableIsa` of AVX-512 exists only where the CPU reported these features.
        Isa::Avx512 => unsafe { narrow_avx512(boxes, encoder, out) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above, for AVX2.
        Isa::Avx2 => unsafe { narrow_avx2(boxes, encoder, out) },
        _ => narrow_loop(boxes, encoder, out),
    }
}

/// Writes the box that stands for each narrow one. Cells and halves become f32 exactly, so that no flag
/// of the thread changes one.
pub(super) fn expand<B: NarrowBox>(boxes: &[B], out: &mut [Aabb]) {
    match AvailableIsa::best().get() {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as in `narrow`.
        Isa::Avx512 => unsafe { expand_avx512(boxes, out) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as in `narrow`.
        Isa::Avx2 => unsafe { expand_avx2(boxes, out) },
        _ => expand_loop(boxes, out),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
fn narrow_avx512<B: NarrowBox>(boxes: &[Aabb], encoder: &B::Encoder, out: &mut [B]) {
    narrow_loop(boxes, encoder, out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn narrow_avx2<B: NarrowBox>(boxes: &[Aabb], encoder: &B::Encoder, out: &mut [B]) {
    narrow_loop(boxes, encoder, out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl")]
fn expand_avx512<B: NarrowBox>(boxes: &[B], out: &mut [Aabb]) {
    expand_loop(boxes, out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn expand_avx2<B: NarrowBox>(boxes: &[B], out: &mut [Aabb]) {
    expand_loop(boxes, out);
}
