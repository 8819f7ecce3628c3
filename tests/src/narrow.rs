//! Boxes in narrow forms, and engines that read them.

use pairmask_core::engine::{CullError, CullInput, CullReport, Engine, EngineName, ReplyBuffer};
use pairmask_core::precision::BoxSlice;
use pairmask_core::{Aabb, BoxForm, Precision};

/// Boxes of one form in memory of their own.
#[derive(Clone, Debug)]
pub struct NarrowMemory {
    form: BoxForm,
    /// Narrow boxes are aligned to more than a byte.
    words: Vec<u32>,
    bytes: usize,
}

impl NarrowMemory {
    /// Boxes as a client writes them in a precision.
    pub fn write(precision: &Precision, boxes: &[Aabb]) -> Self {
        let mut memory = Self::zeroed(precision.form(), boxes.len());
        precision.write(boxes, memory.bytes_mut());
        memory
    }

    /// Boxes of a form from the low bits of `boxes`' coordinates.
    pub fn of_bits(form: BoxForm, boxes: &[[u32; 6]]) -> Self {
        let mut memory = Self::zeroed(form, boxes.len());
        let width = form.box_bytes() / 6;
        let places = memory.bytes_mut().chunks_exact_mut(width);
        for (place, bits) in places.zip(boxes.iter().flatten()) {
            place.copy_from_slice(&bits.to_le_bytes()[..width]);
        }
        memory
    }

    fn zeroed(form: BoxForm, n: usize) -> Self {
        let bytes = n * form.box_bytes();
        Self { form, words: vec![0; bytes.div_ceil(4)], bytes }
    }

    /// The boxes.
    pub fn boxes(&self) -> BoxSlice<'_> {
        let bytes: &[u8] = bytemuck::cast_slice(&self.words);
        BoxSlice::new(self.form, &bytes[..self.bytes]).expect("whole boxes, aligned")
    }

    /// Their bytes, writable.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        &mut bytemuck::cast_slice_mut(&mut self.words)[..self.bytes]
    }
}

/// A function that passes boxes of any form to an engine.
pub type CullNarrow<E> =
    fn(&mut E, &CullInput<'_>, &mut dyn ReplyBuffer) -> Result<CullReport, CullError>;

/// An engine that gets boxes in a precision's form, as an [`Engine`] of f32 boxes.
pub struct Narrowed<E> {
    /// The engine.
    pub engine: E,
    /// The call of the engine.
    pub cull: CullNarrow<E>,
    /// The precision of the boxes.
    pub precision: Precision,
}

impl<E: Engine> Engine for Narrowed<E> {
    fn name(&self) -> EngineName {
        self.engine.name()
    }

    fn cull(
        &mut self,
        input: &CullInput<'_>,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let (boxes, _) = input.f32_boxes(self.name())?;
        let memory = NarrowMemory::write(&self.precision, boxes);
        (self.cull)(&mut self.engine, &input.with_objects(memory.boxes()), reply)
    }
}
