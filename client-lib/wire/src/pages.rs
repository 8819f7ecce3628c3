//! Pages as boxes, spheres and words.

use bytemuck::{AnyBitPattern, Pod};
use pairmask_core::units::BoxCount;

use crate::Page;

/// The boxes or spheres at the start of a payload, or `None` where they are not all within it.
pub fn entries_in<T: AnyBitPattern>(pages: &[Page], n: BoxCount) -> Option<&[T]> {
    let bytes: &[u8] = bytemuck::cast_slice(pages);
    bytemuck::try_cast_slice(bytes.get(..n.len().checked_mul(size_of::<T>())?)?).ok()
}

/// As [`entries_in`], to be written.
pub fn entries_in_mut<T: Pod>(pages: &mut [Page], n: BoxCount) -> Option<&mut [T]> {
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(pages);
    bytemuck::try_cast_slice_mut(bytes.get_mut(..n.len().checked_mul(size_of::<T>())?)?).ok()
}

/// The first bytes of a payload, to be written.
pub fn bytes_in_mut(pages: &mut [Page], bytes: u64) -> Option<&mut [u8]> {
    let all: &mut [u8] = bytemuck::cast_slice_mut(pages);
    all.get_mut(..usize::try_from(bytes).ok()?)
}

/// A payload as u32 words.
pub fn words_in(pages: &[Page]) -> &[u32] {
    bytemuck::cast_slice(pages)
}

/// A payload as u32 words, to be written.
pub fn words_in_mut(pages: &mut [Page]) -> &mut [u32] {
    bytemuck::cast_slice_mut(pages)
}
