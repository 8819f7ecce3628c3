//! The kernel of an instruction set, chosen at run time.
#![allow(unsafe_code)]

use std::ops::Range;

use super::bitmaps::Bitmaps;
use super::candidates::Candidates;
#[cfg(target_arch = "aarch64")]
use super::neon::Neon;
use super::portable::Portable;
use super::search::{self, Scene};
use super::words::WordList;
#[cfg(target_arch = "x86_64")]
use super::{avx2, avx512};
use crate::engine::ingest::ColumnWords;
use crate::engine::{AvailableIsa, Isa};

/// [`search::find`] with the kernel of `isa`.
pub(super) fn find(
    scene: &Scene<'_>,
    rows: Range<usize>,
    candidates: &mut Candidates,
    found: &mut WordList,
    isa: AvailableIsa,
) -> u64 {
    match isa.get() {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => avx512::find(scene, rows, candidates, found, isa),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => avx2::find(scene, rows, candidates, found, isa),
        #[cfg(target_arch = "aarch64")]
        // SAFETY: every aarch64 has NEON.
        Isa::Neon => unsafe { search::find::<Neon>(scene, rows, candidates, found) },
        // SAFETY: plain Rust needs no instruction set.
        _ => unsafe { search::find::<Portable>(scene, rows, candidates, found) },
    }
}

/// [`Bitmaps::build`] with the kernel of `isa`.
pub(super) fn build(bitmaps: &mut Bitmaps, columns: &ColumnWords<'_>, n: usize, isa: AvailableIsa) {
    match isa.get() {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => avx512::build(bitmaps, columns, n, isa),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => avx2::build(bitmaps, columns, n, isa),
        #[cfg(target_arch = "aarch64")]
        // SAFETY: every aarch64 has NEON.
        Isa::Neon => unsafe { bitmaps.build::<Neon>(columns, n) },
        // SAFETY: plain Rust needs no instruction set.
        _ => unsafe { bitmaps.build::<Portable>(columns, n) },
    }
}
