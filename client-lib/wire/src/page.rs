//! The payload element: a page, so that payloads are page-aligned in both processes.
//!
//! Host-pointer import on the GPU needs that alignment. A smaller element with page alignment would
//! take a page each.

use bytemuck::{Pod, Zeroable};
#[cfg(feature = "transport")]
use iceoryx2::prelude::ZeroCopySend;

/// Bytes of a payload page: the page size of x86-64 and the alignment that GPU drivers ask for.
pub const PAGE_BYTES: usize = 4096;

/// One page of payload.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
#[repr(align(4096))]
#[cfg_attr(feature = "transport", derive(ZeroCopySend), type_name("pairmask.Page"))]
pub struct Page([u8; PAGE_BYTES]);

const _: () = assert!(size_of::<Page>() == PAGE_BYTES && align_of::<Page>() == PAGE_BYTES);

impl std::fmt::Debug for Page {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Page")
    }
}

/// Pages for `bytes` bytes, at least one: the transport has no empty payload.
pub const fn page_count(bytes: u64) -> u64 {
    let pages = bytes.div_ceil(PAGE_BYTES as u64);
    if pages == 0 { 1 } else { pages }
}
