//! The conversion loops, compiled for each instruction set. The results are the same: no step of them
//! rounds differently anywhere.

use super::exact::{GROUP, Group, is_valid_group};
use super::narrow::NarrowBox;
use crate::aabb::Aabb;
use crate::floats;
use crate::isa::AvailableIsa;
use crate::simd::per_isa;

/// Writes the narrow form of each box, independent of the thread's flags. Both slices are of one
/// length.
pub(super) fn narrow<B: NarrowBox>(boxes: &[Aabb], encoder: &B::Encoder, out: &mut [B]) {
    floats::with_default(|| narrow_all(boxes, encoder, out, AvailableIsa::best()));
}

/// Writes the box that stands for each narrow one. Cells and halves become f32 exactly, so that no flag
/// of the thread changes one.
pub(super) fn expand<B: NarrowBox>(boxes: &[B], out: &mut [Aabb]) {
    expand_all(boxes, out, AvailableIsa::best());
}

per_isa! {
    fn narrow_all<simd: S, B: NarrowBox>(boxes: &[Aabb], encoder: &B::Encoder, out: &mut [B]) {
        let (_, lanes) = (simd, B::lanes(encoder));
        let (groups, rest) = boxes.as_chunks::<GROUP>();
        let (out_groups, out_rest) = out.as_chunks_mut::<GROUP>();
        for (out, boxes) in out_groups.iter_mut().zip(groups) {
            let group: &Group = bytemuck::cast_ref(boxes);
            if is_valid_group(group) {
                *out = B::narrow_group(group, &lanes);
            } else {
                *out = boxes.map(|b| B::narrow(&b, encoder));
            }
        }
        for (out, b) in out_rest.iter_mut().zip(rest) {
            *out = B::narrow(b, encoder);
        }
    }
}

per_isa! {
    fn expand_all<simd: S, B: NarrowBox>(boxes: &[B], out: &mut [Aabb]) {
        let _ = simd;
        for (out, b) in out.iter_mut().zip(boxes) {
            *out = b.expand();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::precision::{Bounds, BoxF16, BoxQ8, BoxQ16, Quantizer};

    /// Boxes are narrowed in groups; each has the form that it has alone.
    #[test]
    fn a_box_of_a_group_has_the_form_of_one_alone() {
        fn check<B: NarrowBox + PartialEq + std::fmt::Debug>(boxes: &[Aabb], encoder: &B::Encoder) {
            let mut out = vec![B::narrow(&Aabb::EMPTY, encoder); boxes.len()];
            narrow(boxes, encoder, &mut out);
            let alone: Vec<B> = boxes.iter().map(|b| B::narrow(b, encoder)).collect();
            assert_eq!(out, alone);
        }
        let bounds = Bounds::new([-3.0; 3], [97.0; 3]).expect("bounds");
        let of = |i: u32| {
            let at = |axis: u32| (i * 7919 + axis * 104_729) % 99_991;
            let min: [f32; 3] = std::array::from_fn(|axis| at(axis as u32) as f32 / 1000.0 - 3.0);
            Aabb::new(min, min.map(|x| x + at(7) as f32 / 50_000.0))
        };
        for n in [0, GROUP, 1000 * GROUP + 3] {
            let boxes: Vec<Aabb> = (0..n as u32).map(of).collect();
            check::<BoxQ16>(&boxes, &Quantizer::q16_of(&bounds));
            check::<BoxQ8>(&boxes, &Quantizer::q8_of(&bounds));
            check::<BoxF16>(&boxes, &());
        }
    }
}
