//! Sections: named byte ranges of a payload.

use bytemuck::{CheckedBitPattern, Pod, Zeroable};
#[cfg(feature = "transport")]
use iceoryx2::prelude::ZeroCopySend;
use pairmask_core::mask::{Encoding, MaskShape, Span};
use pairmask_core::objects::ObjectForm;
use pairmask_core::precision::BoxForm;
use pairmask_core::units::BoxCount;

use crate::page::Page;

/// Section slots in a header. At most five are in use; the rest is room for later kinds.
pub const SECTION_COUNT: usize = 8;

/// A byte range of the payload and the kind of its contents.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
#[cfg_attr(feature = "transport", derive(ZeroCopySend), type_name("pairmask.Section"))]
pub struct Section {
    /// A [`SectionKind`], or 0 for an unused slot.
    pub kind: u32,
    /// [`Section::REQUIRED`] or 0.
    pub flags: u32,
    /// Offset from the start of the payload, bytes, a multiple of 4.
    pub offset: u64,
    /// Length in bytes.
    pub bytes: u64,
}

const _: () = assert!(size_of::<Section>() == 24 && align_of::<Section>() == 8);

/// The kind of a section's contents.
#[derive(Clone, Copy, Debug, PartialEq, Eq, CheckedBitPattern)]
#[repr(u32)]
pub enum SectionKind {
    /// Boxes, f32, 24 bytes each, in object order.
    Boxes = 1,
    /// Words of a dense mask.
    DenseWords = 2,
    /// Row of each sparse word.
    SparseRows = 3,
    /// Column block of each sparse word.
    SparseBlocks = 4,
    /// Bits of each sparse word.
    SparseBits = 5,
    /// Box index at each position of a sparse mask.
    Order = 6,
    /// One `StatusBody`.
    Status = 7,
    /// Boxes, six u16 cells, 12 bytes each, in object order.
    BoxesQ16 = 8,
    /// Boxes, six u8 cells, 6 bytes each, in object order.
    BoxesQ8 = 9,
    /// Boxes, six IEEE halves, 12 bytes each, in object order.
    BoxesF16 = 10,
    /// Spheres, four f32, 16 bytes each, in object order.
    Spheres = 11,
    /// Pairs of box indices of a list.
    ListPairs = 12,
    /// Steps of an edit of a scene.
    SceneSteps = 13,
    /// Words of an edit: lists and bitmasks of indices.
    SceneIndices = 14,
    /// Pairs that began.
    BegunPairs = 15,
    /// Pairs that ended.
    EndedPairs = 16,
    /// Why they ended, a byte each.
    EndReasons = 17,
    /// Tags of boxes, 12 bytes each, in object order.
    RuleTags = 18,
    /// The table of filters, 24 bytes each.
    RuleFilters = 19,
    /// Pairs of the include list.
    IncludedPairs = 20,
    /// Pairs of the exclude list.
    ExcludedPairs = 21,
    /// How many pairs of a list each world has.
    WorldRanges = 22,
    /// Tags of the queries of a scene, 12 bytes each: one for all, or one for each.
    QueryTags = 23,
    /// The name of a shared scene.
    SceneName = 24,
    /// Ranges of indices whose writers were late, two u32 each.
    LateRanges = 25,
    /// Nothing: the rules of a frame are those that the daemon keeps under the number in the header.
    KeptRules = 26,
}

impl SectionKind {
    /// The kind of a wire number, if there is one.
    pub fn from_wire(value: u32) -> Option<Self> {
        bytemuck::checked::try_cast(value).ok()
    }

    /// The kind of the section that holds objects of a form.
    pub const fn of(form: ObjectForm) -> Self {
        match form {
            ObjectForm::Boxes(BoxForm::F32) => Self::Boxes,
            ObjectForm::Boxes(BoxForm::Q16) => Self::BoxesQ16,
            ObjectForm::Boxes(BoxForm::Q8) => Self::BoxesQ8,
            ObjectForm::Boxes(BoxForm::F16) => Self::BoxesF16,
            ObjectForm::Spheres => Self::Spheres,
        }
    }
}

impl Section {
    /// Flag: a reader that does not know the section's kind refuses the whole message. Without the
    /// flag, such a reader ignores the section: that is how later minor versions add things.
    pub const REQUIRED: u32 = 1;

    /// A section that every reader must understand.
    pub const fn required(kind: SectionKind, offset: u64, bytes: u64) -> Self {
        Self { kind: kind as u32, flags: Self::REQUIRED, offset, bytes }
    }

    /// Whether the slot is in use.
    pub const fn is_used(&self) -> bool {
        self.kind != 0
    }

    /// The bytes of the section; `None` where they are not all in the payload.
    pub(crate) fn bytes_in<'a>(&self, pages: &'a [Page]) -> Option<&'a [u8]> {
        let all: &[u8] = bytemuck::cast_slice(pages);
        all.get(usize::try_from(self.offset).ok()?..)?.get(..usize::try_from(self.bytes).ok()?)
    }

    /// Writes bytes to where the section begins. Returns `false` where the pages are too few.
    pub(crate) fn put(&self, from: &[u8], pages: &mut [Page]) -> bool {
        let all: &mut [u8] = bytemuck::cast_slice_mut(pages);
        let place = all.get_mut(self.offset as usize..).and_then(|to| to.get_mut(..from.len()));
        place.map(|to| to.copy_from_slice(from)).is_some()
    }

    /// Whether the range lies within a payload and is aligned for u32 words.
    pub fn fits(&self, payload_bytes: u64) -> bool {
        self.offset.is_multiple_of(4)
            && self.offset.checked_add(self.bytes).is_some_and(|end| end <= payload_bytes)
    }
}

/// The slots of a header that begin with some sections.
pub(crate) fn slots(used: impl IntoIterator<Item = Section>) -> [Section; SECTION_COUNT] {
    let mut sections = [Section::default(); SECTION_COUNT];
    sections.iter_mut().zip(used).for_each(|(slot, section)| *slot = section);
    sections
}

/// The one section of `kind`, or `None` where it is missing or named twice.
pub(crate) fn find(sections: &[Section; SECTION_COUNT], kind: SectionKind) -> Option<Section> {
    let mut found = sections.iter().filter(|s| s.kind == kind as u32);
    let first = found.next()?;
    found.next().is_none().then_some(*first)
}

/// The first required section of a kind that this build does not know.
pub(crate) fn find_unknown(sections: &[Section; SECTION_COUNT]) -> Option<u32> {
    let is_unknown = |s: &&Section| {
        s.is_used() && s.flags & Section::REQUIRED != 0 && SectionKind::from_wire(s.kind).is_none()
    };
    sections.iter().find(is_unknown).map(|s| s.kind)
}

pub(crate) fn mask_sections(shape: &MaskShape) -> [Section; SECTION_COUNT] {
    let section = |(kind, span): (_, Span)| Section::required(kind, 4 * span.start, 4 * span.len);
    match *shape {
        MaskShape::Dense { words } => slots([(SectionKind::DenseWords, words)].map(section)),
        MaskShape::Sparse { rows, blocks, bits, order } => {
            let words = [
                (SectionKind::SparseRows, rows),
                (SectionKind::SparseBlocks, blocks),
                (SectionKind::SparseBits, bits),
            ];
            let order = order.map(|order| (SectionKind::Order, order));
            slots(words.into_iter().chain(order).map(section))
        }
        MaskShape::List { pairs } => slots([(SectionKind::ListPairs, pairs)].map(section)),
        // An encoding of the core that the wire contract does not have: readers find no mask.
        _ => slots([]),
    }
}

/// Why sections are refused as a mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BadSections {
    /// The wire contract does not have the encoding.
    UnknownEncoding,
    /// The section that is missing, doubled, of a wrong length or outside of the payload.
    Malformed(&'static str),
}

/// Where the mask of `n` boxes lies in a payload, by sections that another process has written.
pub(crate) fn mask_shape(
    encoding: Encoding,
    sections: &[Section; SECTION_COUNT],
    n: BoxCount,
    payload_bytes: u64,
) -> Result<MaskShape, BadSections> {
    let span = |kind, field| {
        let section = find(sections, kind).ok_or(BadSections::Malformed(field))?;
        if !section.bytes.is_multiple_of(4) || !section.fits(payload_bytes) {
            return Err(BadSections::Malformed(field));
        }
        Ok(Span { start: section.offset / 4, len: section.bytes / 4 })
    };
    match encoding {
        Encoding::Dense => {
            let words = span(SectionKind::DenseWords, "dense words")?;
            if words.len != n.dense_words() {
                return Err(BadSections::Malformed("dense words"));
            }
            Ok(MaskShape::Dense { words })
        }
        Encoding::Sparse => {
            let rows = span(SectionKind::SparseRows, "sparse rows")?;
            let blocks = span(SectionKind::SparseBlocks, "sparse blocks")?;
            let bits = span(SectionKind::SparseBits, "sparse bits")?;
            if rows.len != blocks.len || rows.len != bits.len {
                return Err(BadSections::Malformed("sparse word count"));
            }
            let has_order = sections.iter().any(|s| s.kind == SectionKind::Order as u32);
            let order = has_order.then(|| span(SectionKind::Order, "order")).transpose()?;
            if order.is_some_and(|order| order.len != u64::from(n.get())) {
                return Err(BadSections::Malformed("order"));
            }
            Ok(MaskShape::Sparse { rows, blocks, bits, order })
        }
        Encoding::List => {
            let pairs = span(SectionKind::ListPairs, "list pairs")?;
            if !pairs.len.is_multiple_of(2) {
                return Err(BadSections::Malformed("list pairs"));
            }
            Ok(MaskShape::List { pairs })
        }
        _ => Err(BadSections::UnknownEncoding),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_encoding_has_sections_that_are_read_as_they_were_written() {
        let n = BoxCount::new(100);
        for encoding in Encoding::ALL {
            for with_order in [false, true] {
                let shape = MaskShape::exact(encoding, n, 7, with_order);
                let sections = mask_sections(&shape);
                assert_eq!(find_unknown(&sections), None);
                let payload_bytes = 4 * shape.extent_words();
                assert_eq!(mask_shape(encoding, &sections, n, payload_bytes), Ok(shape));
                let short = mask_shape(encoding, &sections, n, payload_bytes - 4);
                assert!(matches!(short, Err(BadSections::Malformed(_))), "{encoding}");
            }
        }
    }
}
