//! Non-temporal copies.
#![allow(unsafe_code)]

use bytemuck::{Pod, Zeroable};

use crate::aabb::Aabb;
use crate::isa::{AvailableIsa, Isa};

/// A cache line, which non-temporal stores write whole.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
struct Line([f32; LINE_FLOATS]);

/// f32 of a cache line on x86-64.
const LINE_FLOATS: usize = 16;

/// Memory that is filled from its beginning on, past the caches.
///
/// Non-temporal stores are not ordered with other accesses of the thread. The stream therefore
/// borrows the memory until it is dropped, and the drop orders the stores before all that follows:
/// what other threads and processes learn after it, they learn after the boxes. A panic drops
/// it too.
pub struct Stream<'a> {
    rest: &'a mut [Aabb],
    isa: AvailableIsa,
}

impl<'a> Stream<'a> {
    /// Fills `out` by the widest stores of an instruction set.
    pub fn new(out: &'a mut [Aabb], isa: AvailableIsa) -> Self {
        Self { rest: out, isa }
    }

    /// Writes the next boxes.
    ///
    /// # Panics
    /// When there is no room for them.
    pub fn put(&mut self, boxes: &[Aabb]) {
        let (out, rest) = std::mem::take(&mut self.rest).split_at_mut(boxes.len());
        self.rest = rest;
        let from: &[f32] = bytemuck::cast_slice(boxes);
        let (head, lines, tail) =
            bytemuck::pod_align_to_mut::<f32, Line>(bytemuck::cast_slice_mut(out));
        let (from_head, from) = from.split_at(head.len());
        let (from_lines, from_tail) = from.split_at(LINE_FLOATS * lines.len());
        head.copy_from_slice(from_head);
        tail.copy_from_slice(from_tail);
        self.put_lines(from_lines.as_chunks().0, lines);
    }

    #[cfg(target_arch = "x86_64")]
    fn put_lines(&self, from: &[[f32; LINE_FLOATS]], to: &mut [Line]) {
        match self.isa.get() {
            // SAFETY: an `AvailableIsa` of AVX-512 exists only where the processor reports it.
            Isa::Avx512 => unsafe { x86::copy_avx512(from, to) },
            // SAFETY: as above, for AVX2, which includes AVX.
            Isa::Avx2 => unsafe { x86::copy_avx(from, to) },
            Isa::Portable => x86::copy_sse(from, to),
        }
    }

    #[cfg(not(target_arch = "x86_64"))]
    fn put_lines(&self, from: &[[f32; LINE_FLOATS]], to: &mut [Line]) {
        for (to, from) in to.iter_mut().zip(from) {
            to.0 = *from;
        }
    }
}

#[cfg(target_arch = "x86_64")]
impl Drop for Stream<'_> {
    fn drop(&mut self) {
        // SAFETY: SSE, which every x86-64 has.
        unsafe { std::arch::x86_64::_mm_sfence() };
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::{
        _mm_loadu_ps, _mm_stream_ps, _mm256_loadu_ps, _mm256_stream_ps, _mm512_loadu_ps,
        _mm512_stream_ps,
    };

    use super::{LINE_FLOATS, Line};

    #[target_feature(enable = "avx512f")]
    pub fn copy_avx512(from: &[[f32; LINE_FLOATS]], to: &mut [Line]) {
        for (Line(to), from) in to.iter_mut().zip(from) {
            // SAFETY: both arrays are 64 bytes, and that of a `Line` is on a border of 64 and
            // borrowed mutably until the fence of `Stream::drop`.
            unsafe { _mm512_stream_ps(to.as_mut_ptr(), _mm512_loadu_ps(from.as_ptr())) };
        }
    }

    #[target_feature(enable = "avx")]
    pub fn copy_avx(from: &[[f32; LINE_FLOATS]], to: &mut [Line]) {
        for (Line(to), from) in to.iter_mut().zip(from) {
            for (to, from) in to.as_chunks_mut::<8>().0.iter_mut().zip(from.as_chunks::<8>().0) {
                // SAFETY: as in `copy_avx512`, by halves of a line.
                unsafe { _mm256_stream_ps(to.as_mut_ptr(), _mm256_loadu_ps(from.as_ptr())) };
            }
        }
    }

    pub fn copy_sse(from: &[[f32; LINE_FLOATS]], to: &mut [Line]) {
        for (Line(to), from) in to.iter_mut().zip(from) {
            for (to, from) in to.as_chunks_mut::<4>().0.iter_mut().zip(from.as_chunks::<4>().0) {
                // SAFETY: as in `copy_avx512`, by quarters of a line. Every x86-64 has SSE.
                unsafe { _mm_stream_ps(to.as_mut_ptr(), _mm_loadu_ps(from.as_ptr())) };
            }
        }
    }
}
