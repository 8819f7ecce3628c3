//! Where the pairs of each world stand in a list.

use pairmask_core::dispatch::WorldRange;
use pairmask_core::filters::World;
use pairmask_core::mask::{MaskShape, Span};

use crate::reply::{ReplyError, ResponseHeader};
use crate::section::{Section, SectionKind, find, has};

/// Words of a world: its number, and the number of its pairs in two halves, the lower first.
pub const WORLD_RANGE_WORDS: usize = 3;

impl ResponseHeader {
    /// Says where the ranges of worlds lie.
    pub fn put_world_ranges(&mut self, span: Span) {
        if let Some(free) = self.sections.iter_mut().find(|section| !section.is_used()) {
            *free = Section::of_words(SectionKind::WorldRanges, span);
        }
    }
}

/// Writes ranges that stand side by side into as many times [`WORLD_RANGE_WORDS`].
pub fn write_world_ranges(ranges: &[WorldRange], words: &mut [u32]) {
    for (range, words) in ranges.iter().zip(words.as_chunks_mut::<WORLD_RANGE_WORDS>().0) {
        let pairs = range.pairs.len() as u64;
        *words = [range.world.0.cast_unsigned(), pairs as u32, (pairs >> 32) as u32];
    }
}

/// The ranges of worlds that a response has: none where it names none. They are copied once, and then
/// stand side by side in the list that `shape` describes, by rising world.
///
/// # Errors
/// [`ReplyError::Malformed`].
pub fn world_ranges_in(
    header: &ResponseHeader,
    shape: &MaskShape,
    words: &[u32],
) -> Result<Vec<WorldRange>, ReplyError> {
    let malformed = ReplyError::Malformed { field: "world ranges" };
    if !has(&header.sections, SectionKind::WorldRanges) {
        return Ok(Vec::new());
    }
    let MaskShape::List { pairs } = shape else { return Err(malformed) };
    let (range_bytes, payload_bytes) = (4 * WORLD_RANGE_WORDS as u64, 4 * words.len() as u64);
    let section = find(&header.sections, SectionKind::WorldRanges, range_bytes, payload_bytes);
    let words = section.and_then(|section| section.span().of(words)).ok_or(malformed)?;
    let (mut ranges, mut end) = (Vec::with_capacity(words.len() / WORLD_RANGE_WORDS), 0u64);
    for [world, low, high] in words.as_chunks::<WORLD_RANGE_WORDS>().0 {
        let start = end;
        let count = u64::from(*low) | u64::from(*high) << 32;
        end = start.checked_add(count).filter(|end| *end <= pairs.len / 2).ok_or(malformed)?;
        let slot = |at: u64| usize::try_from(at).map_err(|_| malformed);
        let world = World(world.cast_signed());
        ranges.push(WorldRange::new(world, slot(start)?..slot(end)?));
    }
    let is_whole = end == pairs.len / 2 && ranges.is_sorted_by(|a, b| a.world < b.world);
    if is_whole { Ok(ranges) } else { Err(malformed) }
}
