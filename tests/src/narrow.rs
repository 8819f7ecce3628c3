//! Boxes in narrow forms.

use pairmask_core::precision::BoxSlice;
use pairmask_core::{Aabb, BoxForm, Precision};

#[derive(Clone, Debug)]
pub struct NarrowMemory {
    form: BoxForm,
    /// Narrow boxes are aligned to more than a byte.
    words: Vec<u32>,
    bytes: usize,
}

impl NarrowMemory {
    pub fn write(precision: &Precision, boxes: &[Aabb]) -> Self {
        let mut memory = Self::zeroed(precision.form(), boxes.len());
        precision.write(boxes, memory.bytes_mut());
        memory
    }

    /// Boxes of a form from the low bits of `boxes`' coordinates.
    pub fn of_bits(form: BoxForm, boxes: &[[u32; 6]]) -> Self {
        let mut memory = Self::zeroed(form, boxes.len());
        let width = form.box_bytes() / 6;
        let slots = memory.bytes_mut().chunks_exact_mut(width);
        for (slot, bits) in slots.zip(boxes.iter().flatten()) {
            slot.copy_from_slice(&bits.to_le_bytes()[..width]);
        }
        memory
    }

    fn zeroed(form: BoxForm, n: usize) -> Self {
        let bytes = n * form.box_bytes();
        Self { form, words: vec![0; bytes.div_ceil(4)], bytes }
    }

    pub fn boxes(&self) -> BoxSlice<'_> {
        let bytes: &[u8] = bytemuck::cast_slice(&self.words);
        BoxSlice::new(self.form, &bytes[..self.bytes]).expect("whole boxes, aligned")
    }

    pub fn bytes_mut(&mut self) -> &mut [u8] {
        &mut bytemuck::cast_slice_mut(&mut self.words)[..self.bytes]
    }
}
