//! Pages as boxes, spheres and words.

use bytemuck::{AnyBitPattern, Pod};
use pairmask_core::aabb::Aabb;
use pairmask_core::objects::{ObjectForm, Objects};
use pairmask_core::precision::{BoxForm, BoxSlice};
use pairmask_core::sphere::Sphere;
use pairmask_core::units::BoxCount;

use crate::Page;

/// The boxes at `offset` bytes into a payload, or `None` where they are not all within it.
pub fn boxes_in(pages: &[Page], offset: usize, n: BoxCount) -> Option<&[Aabb]> {
    plain_in(pages, offset, n)
}

/// As [`boxes_in`] from the start of the payload, to be written.
pub fn boxes_in_mut(pages: &mut [Page], n: BoxCount) -> Option<&mut [Aabb]> {
    plain_in_mut(pages, n)
}

/// The spheres at `offset` bytes into a payload, or `None` where they are not all within it.
pub fn spheres_in(pages: &[Page], offset: usize, n: BoxCount) -> Option<&[Sphere]> {
    plain_in(pages, offset, n)
}

/// As [`spheres_in`] from the start of the payload, to be written.
pub fn spheres_in_mut(pages: &mut [Page], n: BoxCount) -> Option<&mut [Sphere]> {
    plain_in_mut(pages, n)
}

fn plain_in<T: AnyBitPattern>(pages: &[Page], offset: usize, n: BoxCount) -> Option<&[T]> {
    let bytes: &[u8] = bytemuck::cast_slice(pages);
    let end = offset.checked_add(n.len().checked_mul(size_of::<T>())?)?;
    bytemuck::try_cast_slice(bytes.get(offset..end)?).ok()
}

fn plain_in_mut<T: Pod>(pages: &mut [Page], n: BoxCount) -> Option<&mut [T]> {
    let bytes: &mut [u8] = bytemuck::cast_slice_mut(pages);
    bytemuck::try_cast_slice_mut(bytes.get_mut(..n.len().checked_mul(size_of::<T>())?)?).ok()
}

/// As [`boxes_in`], for boxes of any form.
pub fn box_slice_in(
    pages: &[Page],
    offset: usize,
    form: BoxForm,
    n: BoxCount,
) -> Option<BoxSlice<'_>> {
    match objects_in(pages, offset, form.into(), n)? {
        Objects::Boxes(boxes) => Some(boxes),
        Objects::Spheres(_) => None,
    }
}

/// As [`boxes_in`], for boxes of any form, or spheres.
pub fn objects_in(
    pages: &[Page],
    offset: usize,
    form: ObjectForm,
    n: BoxCount,
) -> Option<Objects<'_>> {
    let bytes: &[u8] = bytemuck::cast_slice(pages);
    let end = offset.checked_add(usize::try_from(form.bytes(n)).ok()?)?;
    Objects::new(form, bytes.get(offset..end)?)
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
