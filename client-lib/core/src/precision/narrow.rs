//! Boxes of narrow forms as they lie in shared memory, and their conversion from and to f32. One file,
//! since every form goes through the same trait and loops; a fifth of it is tests.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::exact::{GROUP, GROUP_WORDS, Group, without_points};
use super::form::{BoxForm, Precision};
use super::quantize::{Lanes, Quantizer};
use super::{f16, simd};
use crate::aabb::{AABB_BYTES, Aabb};
use crate::aligned::AlignedBuffer;
use crate::write::{BoxSource, par_write_boxes};

/// Fewest boxes of a conversion task: fewer take less time (10 to 40 µs) than a task costs.
const TASK_BOXES: usize = 16_384;

/// Six 16-bit cells: `min.x min.y min.z max.x max.y max.z`.
///
/// `min > max` on an axis means empty, as in f32. Of those boxes the ones with `min.x` 65,535 and
/// `max.x` 0 are invalid (the sender's box had a NaN).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct BoxQ16 {
    /// Cell of the smallest coordinate on each axis.
    pub min: [u16; 3],
    /// Cell of the largest coordinate on each axis.
    pub max: [u16; 3],
}

/// Six 8-bit cells, as [`BoxQ16`] with 255 in place of 65,535.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct BoxQ8 {
    /// Cell of the smallest coordinate on each axis.
    pub min: [u8; 3],
    /// Cell of the largest coordinate on each axis.
    pub max: [u8; 3],
}

/// Six IEEE halves, as bits. Empty and invalid are defined as in f32.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct BoxF16 {
    /// Half at or below the smallest coordinate on each axis.
    pub min: [u16; 3],
    /// Half at or above the largest coordinate on each axis.
    pub max: [u16; 3],
}

const _: () = assert!(size_of::<BoxQ16>() == 12 && align_of::<BoxQ16>() == 2);
const _: () = assert!(size_of::<BoxQ8>() == 6 && align_of::<BoxQ8>() == 1);
const _: () = assert!(size_of::<BoxF16>() == 12 && align_of::<BoxF16>() == 2);

impl BoxF16 {
    /// The form of empty boxes: from +∞ to −∞.
    pub const EMPTY: Self = Self { min: [0x7c00; 3], max: [0xfc00; 3] };
    /// The form of invalid boxes: NaN throughout.
    pub const INVALID: Self = Self { min: [0x7e00; 3], max: [0x7e00; 3] };
}

impl From<&Aabb> for BoxF16 {
    #[inline]
    fn from(b: &Aabb) -> Self {
        f16::narrow(b)
    }
}

/// Boxes that are made before they are narrowed, or narrowed before they are expanded: they stay in the
/// first-level cache (6 KiB).
const STAGED_BOXES: usize = 256;

pub(super) trait NarrowBox: Pod + Send + Sync {
    /// The data that the conversion to this form needs.
    type Encoder: Copy + Send + Sync;
    /// The encoder's data, laid out for groups.
    type Lanes;
    /// Lays an encoder out for groups.
    fn lanes(encoder: &Self::Encoder) -> Self::Lanes;
    /// The forms of a group of valid boxes.
    fn narrow_group(group: &Group, lanes: &Self::Lanes) -> [Self; GROUP];
    /// The form of a box.
    fn narrow(b: &Aabb, encoder: &Self::Encoder) -> Self;
    /// The f32 box that stands for it: of the same class, and with the same overlaps. Exact.
    fn expand(&self) -> Aabb;
}

/// Cells as f32. Integers up to 65,535 are f32 exactly.
#[inline(always)]
fn expand_cells<T: Copy + Into<f32>>(min: [T; 3], max: [T; 3], invalid: bool) -> Aabb {
    let mut b = Aabb { min: min.map(Into::into), max: max.map(Into::into) };
    b.min[0] = if invalid { f32::NAN } else { b.min[0] };
    b
}

/// Forms of cells.
macro_rules! cells {
    ($($form:ident of $cell:ident;)+) => {$(
        impl $form {
            /// What empty boxes are written as.
            pub const EMPTY: Self = Self { min: [1; 3], max: [0; 3] };
            /// What invalid boxes are written as.
            pub const INVALID: Self = Self { min: [$cell::MAX; 3], max: [0; 3] };
        }

        impl NarrowBox for $form {
            type Encoder = Quantizer;
            type Lanes = Lanes;
            fn lanes(encoder: &Quantizer) -> Lanes {
                Lanes::new(encoder)
            }
            #[inline(always)]
            fn narrow_group(group: &Group, lanes: &Lanes) -> [Self; GROUP] {
                let cells = lanes.cells(group);
                let mut narrow = [0; GROUP_WORDS];
                for at in 0..GROUP_WORDS {
                    narrow[at] = cells[at] as $cell;
                }
                bytemuck::cast(narrow)
            }
            #[inline(always)]
            fn narrow(b: &Aabb, encoder: &Quantizer) -> Self {
                let Some([min, max]) = encoder.cells(b) else {
                    return without_points(b, Self::EMPTY, Self::INVALID);
                };
                Self { min: min.map(|cell| cell as $cell), max: max.map(|cell| cell as $cell) }
            }
            #[inline(always)]
            fn expand(&self) -> Aabb {
                expand_cells(self.min, self.max, self.min[0] == $cell::MAX && self.max[0] == 0)
            }
        }
    )+};
}

cells! {
    BoxQ16 of u16;
    BoxQ8 of u8;
}

impl NarrowBox for BoxF16 {
    type Encoder = ();
    type Lanes = ();
    fn lanes((): &()) {}
    #[inline(always)]
    fn narrow_group(group: &Group, (): &()) -> [Self; GROUP] {
        bytemuck::cast(f16::narrow_group(group))
    }
    #[inline(always)]
    fn narrow(b: &Aabb, (): &()) -> Self {
        f16::narrow(b)
    }
    #[inline(always)]
    fn expand(&self) -> Aabb {
        Aabb { min: self.min.map(f16::expand), max: self.max.map(f16::expand) }
    }
}

/// The boxes of a frame in memory, in any form. What else each box has for all engines to honour
/// belongs here beside its numbers: wherever boxes go, it goes with them.
#[derive(Clone, Copy, Debug)]
pub enum BoxSlice<'a> {
    /// f32.
    F32(&'a [Aabb]),
    /// u16 cells.
    Q16(&'a [BoxQ16]),
    /// u8 cells.
    Q8(&'a [BoxQ8]),
    /// IEEE halves.
    F16(&'a [BoxF16]),
}

/// Does the same with boxes of any form.
macro_rules! of_each {
    ($slice:expr, $boxes:ident => $what:expr) => {
        match $slice {
            BoxSlice::F32($boxes) => $what,
            BoxSlice::Q16($boxes) => $what,
            BoxSlice::Q8($boxes) => $what,
            BoxSlice::F16($boxes) => $what,
        }
    };
}

/// f32 boxes, used where they lie.
impl<'a, B: AsRef<[Aabb]> + ?Sized> From<&'a B> for BoxSlice<'a> {
    fn from(boxes: &'a B) -> Self {
        Self::F32(boxes.as_ref())
    }
}

impl Default for BoxSlice<'_> {
    fn default() -> Self {
        Self::F32(&[])
    }
}

impl<'a> BoxSlice<'a> {
    /// Bytes as boxes of a form; `None` where they are no whole number of boxes, or not aligned
    /// for them.
    pub fn new(form: BoxForm, bytes: &'a [u8]) -> Option<Self> {
        match form {
            BoxForm::F32 => bytemuck::try_cast_slice(bytes).ok().map(Self::F32),
            BoxForm::Q16 => bytemuck::try_cast_slice(bytes).ok().map(Self::Q16),
            BoxForm::Q8 => bytemuck::try_cast_slice(bytes).ok().map(Self::Q8),
            BoxForm::F16 => bytemuck::try_cast_slice(bytes).ok().map(Self::F16),
        }
    }

    /// The form.
    pub const fn form(&self) -> BoxForm {
        match self {
            Self::F32(_) => BoxForm::F32,
            Self::Q16(_) => BoxForm::Q16,
            Self::Q8(_) => BoxForm::Q8,
            Self::F16(_) => BoxForm::F16,
        }
    }

    /// Number of boxes.
    pub const fn len(&self) -> usize {
        of_each!(self, boxes => boxes.len())
    }

    /// Whether there are no boxes.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The boxes where they lie, if they are of f32.
    pub const fn as_f32(&self) -> Option<&'a [Aabb]> {
        match self {
            Self::F32(boxes) => Some(boxes),
            _ => None,
        }
    }

    /// Their bytes: [`BoxForm::bytes`] of as many boxes.
    pub fn as_bytes(&self) -> &'a [u8] {
        of_each!(self, boxes => bytemuck::cast_slice(boxes))
    }

    /// The f32 box that stands for one of them, as [`BoxSlice::expand`] has it; `None` beyond
    /// the last.
    pub fn get(&self, index: usize) -> Option<Aabb> {
        match self {
            Self::F32(boxes) => boxes.get(index).copied(),
            Self::Q16(boxes) => boxes.get(index).map(NarrowBox::expand),
            Self::Q8(boxes) => boxes.get(index).map(NarrowBox::expand),
            Self::F16(boxes) => boxes.get(index).map(NarrowBox::expand),
        }
    }

    /// The same boxes in f32, whose overlaps define the answer to the frame: cells as they are
    /// numbered, halves by their value. f32 boxes are used where they lie; others are converted
    /// into `scratch`, large scenes on the rayon pool if `parallel`.
    ///
    /// # Panics
    /// When the system has no memory for 24 bytes a box; `scratch` grows when more boxes come than
    /// before.
    #[must_use]
    pub fn expand(self, scratch: &'a mut ExpandScratch, parallel: bool) -> Self {
        if self.as_f32().is_some() {
            return self;
        }
        scratch.0.resize(AABB_WORDS * self.len());
        let out: &mut [Aabb] = bytemuck::cast_slice_mut(scratch.0.as_mut_slice());
        match self {
            Self::F32(_) => {}
            Self::Q16(boxes) => expand_all(boxes, out, parallel),
            Self::Q8(boxes) => expand_all(boxes, out, parallel),
            Self::F16(boxes) => expand_all(boxes, out, parallel),
        }
        Self::F32(bytemuck::cast_slice(scratch.0.as_slice()))
    }
}

/// Memory for expanded boxes, kept from frame to frame.
#[derive(Default)]
pub struct ExpandScratch(AlignedBuffer<f32>);

impl ExpandScratch {
    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.0.allocated_bytes()
    }
}

/// f32 of a box.
const AABB_WORDS: usize = AABB_BYTES / size_of::<f32>();

fn expand_all<B: NarrowBox>(boxes: &[B], out: &mut [Aabb], parallel: bool) {
    if !parallel || boxes.len() < 2 * TASK_BOXES {
        return simd::expand(boxes, out);
    }
    let tasks = boxes.par_chunks(TASK_BOXES).zip(out.par_chunks_mut(TASK_BOXES));
    tasks.for_each(|(boxes, out)| simd::expand(boxes, out));
}

/// Converts as many boxes as both hold, large scenes on the rayon pool.
fn convert_all<S: BoxSource + Sync + ?Sized, T: Send>(
    source: &S,
    out: &mut [T],
    convert: impl Fn(&[Aabb], &mut [T]) + Sync,
) {
    let n = source.len().min(out.len());
    let task_boxes = TASK_BOXES.min(S::TASK_BOXES).max(1);
    if n < 2 * task_boxes {
        return convert_part(source, 0, &mut out[..n], &convert);
    }
    out[..n]
        .par_chunks_mut(task_boxes)
        .enumerate()
        .for_each(|(task, out)| convert_part(source, task * task_boxes, out, &convert));
}

/// Converts the boxes from `first` on: where they lie, or as they are made.
fn convert_part<S: BoxSource + ?Sized, T>(
    source: &S,
    first: usize,
    out: &mut [T],
    convert: &impl Fn(&[Aabb], &mut [T]),
) {
    if let Some(boxes) = source.as_boxes() {
        return convert(&boxes[first..][..out.len()], out);
    }
    let mut boxes = [Aabb::EMPTY; STAGED_BOXES];
    for (k, out) in out.chunks_mut(STAGED_BOXES).enumerate() {
        let boxes = &mut boxes[..out.len()];
        source.write_range(first + k * STAGED_BOXES, boxes);
        convert(boxes, out);
    }
}

fn narrow_all<B: NarrowBox>(
    source: &(impl BoxSource + Sync + ?Sized),
    encoder: &B::Encoder,
    out: &mut [B],
) {
    convert_all(source, out, |boxes, out| simd::narrow(boxes, encoder, out));
}

/// Narrows boxes and expands them again, as client and daemon do together.
fn round_all<B: NarrowBox>(
    source: &(impl BoxSource + Sync + ?Sized),
    encoder: &B::Encoder,
    out: &mut [Aabb],
) {
    convert_all(source, out, |boxes, out| {
        let mut narrow = [B::zeroed(); STAGED_BOXES];
        for (boxes, out) in boxes.chunks(STAGED_BOXES).zip(out.chunks_mut(STAGED_BOXES)) {
            let narrow = &mut narrow[..boxes.len()];
            simd::narrow(boxes, encoder, narrow);
            simd::expand(narrow, out);
        }
    });
}

/// Writes boxes in the form of a precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Encoder {
    /// As they are.
    F32,
    /// As u16 cells.
    Q16(Quantizer),
    /// As u8 cells.
    Q8(Quantizer),
    /// As IEEE halves.
    F16,
}

impl Encoder {
    /// The writer of a precision's form.
    pub fn new(precision: &Precision) -> Self {
        match precision {
            Precision::Exact => Self::F32,
            Precision::Q16(bounds) => Self::Q16(Quantizer::q16_of(bounds)),
            Precision::Q8(bounds) => Self::Q8(Quantizer::q8_of(bounds)),
            Precision::F16 => Self::F16,
        }
    }

    /// Writes boxes into memory of their form, as many as both hold.
    ///
    /// `bytes` are the boxes' whole memory: of the length, and aligned, as the form asks.
    pub fn write(&self, boxes: &(impl BoxSource + Sync + ?Sized), bytes: &mut [u8]) {
        match self {
            Self::F32 => copy(boxes, bytemuck::cast_slice_mut(bytes)),
            Self::Q16(q) => narrow_all::<BoxQ16>(boxes, q, bytemuck::cast_slice_mut(bytes)),
            Self::Q8(q) => narrow_all::<BoxQ8>(boxes, q, bytemuck::cast_slice_mut(bytes)),
            Self::F16 => narrow_all::<BoxF16>(boxes, &(), bytemuck::cast_slice_mut(bytes)),
        }
    }

    /// Writes one box into the memory of one.
    #[inline]
    pub fn write_one(&self, b: &Aabb, bytes: &mut [u8]) {
        match self {
            Self::F32 => bytes.copy_from_slice(bytemuck::bytes_of(b)),
            Self::Q16(q) => bytes.copy_from_slice(bytemuck::bytes_of(&q.q16(b))),
            Self::Q8(q) => bytes.copy_from_slice(bytemuck::bytes_of(&q.q8(b))),
            Self::F16 => bytes.copy_from_slice(bytemuck::bytes_of(&f16::narrow(b))),
        }
    }

    /// Writes the boxes that stand for them ([`BoxSlice::expand`]), as many as both hold.
    pub fn write_expanded(&self, boxes: &(impl BoxSource + Sync + ?Sized), out: &mut [Aabb]) {
        match self {
            Self::F32 => copy(boxes, out),
            Self::Q16(q) => round_all::<BoxQ16>(boxes, q, out),
            Self::Q8(q) => round_all::<BoxQ8>(boxes, q, out),
            Self::F16 => round_all::<BoxF16>(boxes, &(), out),
        }
    }
}

fn copy(source: &(impl BoxSource + Sync + ?Sized), out: &mut [Aabb]) {
    if source.len() == out.len() {
        return par_write_boxes(source, out);
    }
    let n = source.len().min(out.len());
    source.write_range(0, &mut out[..n]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aabb::BoxClass;
    use crate::precision::Bounds;
    use crate::write::MinMax;

    #[test]
    fn reserved_patterns_expand_to_their_class() {
        for (b, class) in [
            (BoxQ16::EMPTY.expand(), BoxClass::Empty),
            (BoxQ8::EMPTY.expand(), BoxClass::Empty),
            (BoxF16::EMPTY.expand(), BoxClass::Empty),
            (BoxQ16::INVALID.expand(), BoxClass::Invalid),
            (BoxQ8::INVALID.expand(), BoxClass::Invalid),
            (BoxF16::INVALID.expand(), BoxClass::Invalid),
            (BoxQ16 { min: [u16::MAX; 3], max: [u16::MAX; 3] }.expand(), BoxClass::Valid),
            (BoxQ16 { min: [0; 3], max: [0; 3] }.expand(), BoxClass::Valid),
            (BoxQ8 { min: [255, 0, 0], max: [255; 3] }.expand(), BoxClass::Valid),
        ] {
            assert_eq!(b.class(), class, "{b:?}");
        }
    }

    #[test]
    fn every_way_to_write_gives_the_same_boxes() {
        let bounds = Bounds::new([-10.0; 3], [10.0; 3]).expect("bounds");
        let mut boxes: Vec<Aabb> = (0..70_001)
            .map(|i| {
                let x = (i * 37 % 1000) as f32 * 0.0213 - 11.0;
                Aabb::from([x, -x, 0.5 * x, x + 0.7, 0.1 - x, 0.5 * x + 3.0])
            })
            .collect();
        boxes[7] = Aabb::EMPTY;
        boxes[40_000].max[1] = f32::NAN;
        boxes[70_000].min[0] = f32::NEG_INFINITY;
        let mut scratch = ExpandScratch::default();
        for precision in
            [Precision::Exact, Precision::Q16(bounds), Precision::Q8(bounds), Precision::F16]
        {
            let (form, encoder) = (precision.form(), Encoder::new(&precision));
            for n in [0, 1, 7, 33, 1000, 70_001] {
                let mut bytes = vec![0u8; n * form.box_bytes()];
                // A `Vec<u8>` is not always aligned for wider words.
                let mut words = vec![0u32; bytes.len().div_ceil(4)];
                let all: &mut [u8] = bytemuck::cast_slice_mut(&mut words);
                let memory = &mut all[..bytes.len()];
                encoder.write(&boxes[..n], memory);
                bytes.copy_from_slice(memory);
                let mut direct = vec![Aabb::default(); n];
                encoder.write_expanded(&boxes[..n], &mut direct);
                // The same from a source that makes its boxes.
                let [min, max] = [|b: &Aabb| b.min, |b: &Aabb| b.max]
                    .map(|corner| boxes[..n].iter().map(corner).collect::<Vec<_>>());
                let source = MinMax::points(&min, &max);
                memory.fill(0xa5);
                encoder.write(&source, memory);
                assert_eq!(memory, bytes, "{form}, {n} boxes of a source");
                let mut from_source = vec![Aabb::default(); n];
                encoder.write_expanded(&source, &mut from_source);
                assert!(
                    bytemuck::cast_slice::<_, u8>(&from_source)
                        == bytemuck::cast_slice::<_, u8>(&direct)
                );
                for parallel in [false, true] {
                    let view = BoxSlice::new(form, memory).expect("whole boxes");
                    assert_eq!((view.form(), view.len()), (form, n));
                    assert_eq!(view.as_bytes(), bytes);
                    let expanded = view.expand(&mut scratch, parallel);
                    let expanded = expanded.as_f32().expect("of f32 now");
                    let bits = |boxes: &[Aabb]| bytemuck::cast_slice::<Aabb, u32>(boxes).to_vec();
                    assert_eq!(bits(expanded), bits(&direct), "{form}, {n} boxes");
                    let alone: Vec<Aabb> = (0..n).filter_map(|i| view.get(i)).collect();
                    assert_eq!(bits(&alone), bits(&direct), "{form}, {n} boxes one by one");
                    for (i, (b, e)) in boxes.iter().zip(expanded).enumerate() {
                        assert_eq!(b.class(), e.class(), "{form}, box {i}");
                    }
                }
            }
        }
    }
}
