//! Boxes in quanta of a level: four lanes at a time, of which three count.
#![allow(unsafe_code)]

use crate::aabb::Aabb;
use crate::floats;

/// Largest magnitude of a quantum, so that differences stay below 2^31.
pub(super) const QUANTUM_LIMIT: f32 = 536_870_912.0;

/// A box in quanta. The last lane is 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Quanta {
    pub min: [i32; 4],
    pub max: [i32; 4],
}

/// From coordinates to quanta, on three axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    pub origin: [f32; 4],
    /// Quanta of a unit of length, finite and above 0; 0 in the last lane.
    pub per_unit: [f32; 4],
}

impl Scale {
    /// A valid box in quanta. Each coordinate's map is monotone: subtraction of a constant,
    /// multiplication with a positive one, clamping and cutting off the fraction are.
    #[inline(always)]
    pub fn quanta(&self, b: &Aabb) -> Quanta {
        debug_assert!(floats::are_default(), "quanta are computed with the default flags");
        let [min, max] = [b.min, b.max].map(|[x, y, z]| self.quantize([x, y, z, 0.0]));
        Quanta { min, max }
    }

    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    fn quantize(&self, x: [f32; 4]) -> [i32; 4] {
        use std::arch::x86_64::{
            __m128, __m128i, _mm_cvttps_epi32, _mm_max_ps, _mm_min_ps, _mm_mul_ps, _mm_set1_ps,
            _mm_sub_ps,
        };
        let [x, origin, per_unit] =
            [x, self.origin, self.per_unit].map(|lanes| -> __m128 { bytemuck::cast(lanes) });
        // SAFETY: every x86-64 processor has SSE2.
        let quanta: __m128i = unsafe {
            let all = _mm_mul_ps(_mm_sub_ps(x, origin), per_unit);
            let clamped = _mm_min_ps(all, _mm_set1_ps(QUANTUM_LIMIT));
            _mm_cvttps_epi32(_mm_max_ps(clamped, _mm_set1_ps(-QUANTUM_LIMIT)))
        };
        bytemuck::cast(quanta)
    }

    #[cfg(not(target_arch = "x86_64"))]
    #[inline(always)]
    fn quantize(&self, x: [f32; 4]) -> [i32; 4] {
        std::array::from_fn(|lane| {
            let quanta = (x[lane] - self.origin[lane]) * self.per_unit[lane];
            quanta.min(QUANTUM_LIMIT).max(-QUANTUM_LIMIT) as i32
        })
    }
}

impl Quanta {
    /// What holds both.
    #[inline(always)]
    pub fn hull(&self, other: &Self) -> Self {
        Self {
            min: std::array::from_fn(|axis| self.min[axis].min(other.min[axis])),
            max: std::array::from_fn(|axis| self.max[axis].max(other.max[axis])),
        }
    }

    /// What both have in common; `min` above `max` where that is nothing.
    #[inline(always)]
    pub fn common(&self, other: &Self) -> Self {
        Self {
            min: std::array::from_fn(|axis| self.min[axis].max(other.min[axis])),
            max: std::array::from_fn(|axis| self.max[axis].min(other.max[axis])),
        }
    }

    #[inline(always)]
    pub fn lengths(&self) -> [i32; 4] {
        std::array::from_fn(|axis| self.max[axis] - self.min[axis])
    }
}
