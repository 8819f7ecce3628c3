//! Sections: named byte ranges of a payload.

use bytemuck::{AnyBitPattern, CheckedBitPattern, Pod, Zeroable};
use pairmask_core::bytes;
use pairmask_core::mask::Span;
use pairmask_core::objects::ObjectForm;
use pairmask_core::precision::BoxForm;

use crate::page::Page;

/// Section slots in a header. At most five are in use; the rest is room for later kinds.
pub const SECTION_COUNT: usize = 8;

/// A byte range of the payload and the kind of its contents.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
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
    /// Filter data of boxes, 12 bytes each, in object order.
    RuleFilterData = 18,
    /// The table of filters, 24 bytes each.
    RuleFilters = 19,
    /// Pairs of the include list.
    IncludedPairs = 20,
    /// Pairs of the exclude list.
    ExcludedPairs = 21,
    /// How many pairs of a list each world has.
    WorldRanges = 22,
    /// Filter data of the queries of a scene, 12 bytes each: one for all, or one for each.
    QueryFilterData = 23,
    /// The name of a shared scene.
    SceneName = 24,
    /// Ranges of indices whose writers were late, two u32 each.
    LateRanges = 25,
    /// Nothing: the rules of a frame are those that the daemon keeps under the number in the header.
    CachedRules = 26,
    /// Rays, ten f32 each: origin, direction, most, half extents.
    Rays = 27,
    /// Hits: query u32, index u32, distance f32.
    Hits = 28,
    /// User data of boxes of a shared scene: index u32, user data u64, without alignment.
    UserData = 29,
    /// Boxes of a shared scene that changed, 56 bytes each.
    ObservedBoxes = 30,
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
    /// flag, such a reader ignores the section: that is how later minor versions add sections.
    pub const REQUIRED: u32 = 1;

    /// A section that every reader must understand.
    pub const fn required(kind: SectionKind, offset: u64, bytes: u64) -> Self {
        Self { kind: kind as u32, flags: Self::REQUIRED, offset, bytes }
    }

    /// The same of a span of words.
    pub(crate) const fn of_words(kind: SectionKind, span: Span) -> Self {
        Self::required(kind, 4 * span.start, 4 * span.len)
    }

    /// The words that begin in the section.
    pub(crate) const fn span(&self) -> Span {
        Span { start: self.offset / 4, len: self.bytes.div_ceil(4) }
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

    /// The items of the section; `None` where they are not whole, or not all in the payload.
    pub(crate) fn entries_in<'a, T: AnyBitPattern>(&self, pages: &'a [Page]) -> Option<&'a [T]> {
        bytemuck::try_cast_slice(self.bytes_in(pages)?).ok()
    }

    /// As [`entries_in`](Self::items_in), to be written.
    pub(crate) fn entries_in_mut<'a, T: Pod>(&self, pages: &'a mut [Page]) -> Option<&'a mut [T]> {
        let all: &mut [u8] = bytemuck::cast_slice_mut(pages);
        let all = all.get_mut(usize::try_from(self.offset).ok()?..)?;
        bytemuck::try_cast_slice_mut(all.get_mut(..usize::try_from(self.bytes).ok()?)?).ok()
    }

    /// Writes bytes to where the section begins, where they `are_many` on the calling thread's pool. Returns `false`
    /// where the pages are too few.
    pub(crate) fn put(&self, from: &[u8], pages: &mut [Page], are_many: bool) -> bool {
        let all: &mut [u8] = bytemuck::cast_slice_mut(pages);
        let position = all.get_mut(self.offset as usize..).and_then(|to| to.get_mut(..from.len()));
        position.map(|to| bytes::copy(from, to, are_many)).is_some()
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

/// Whether there is a section of `kind`.
pub(crate) fn has(sections: &[Section; SECTION_COUNT], kind: SectionKind) -> bool {
    sections.iter().any(|section| section.kind == kind as u32)
}

/// The one section of `kind`, or `None` where it is missing or named twice, leaves the payload, or holds other than
/// whole items of so many bytes.
pub(crate) fn find(
    sections: &[Section; SECTION_COUNT],
    kind: SectionKind,
    entry_bytes: u64,
    payload_bytes: u64,
) -> Option<Section> {
    let mut found = sections.iter().filter(|section| section.kind == kind as u32);
    let only = found.next().filter(|_| found.next().is_none())?;
    (only.fits(payload_bytes) && only.bytes.is_multiple_of(entry_bytes)).then_some(*only)
}

/// The first required section of a kind that this build does not know.
pub(crate) fn find_unknown(sections: &[Section; SECTION_COUNT]) -> Option<u32> {
    let is_unknown = |s: &&Section| {
        s.is_used() && s.flags & Section::REQUIRED != 0 && SectionKind::from_wire(s.kind).is_none()
    };
    sections.iter().find(is_unknown).map(|s| s.kind)
}
