//! What goes over the wire: golden bytes, round trips, and arbitrary bytes from the other side.
#![allow(clippy::unwrap_used, clippy::missing_panics_doc)]

use pairmask_core::Aabb;
use pairmask_wire::{Page, page_count};

mod casts;
mod frames;
mod rules;
mod scenes;
mod shared_scenes;

/// The token of the client in golden bytes.
const TOKEN: u64 = 0x1122_3344_5566_7788;

/// Little-endian bytes of u32 and u64 fields, as the drawing in WIRE.md has them.
#[derive(Default)]
struct Bytes(Vec<u8>);

impl Bytes {
    /// Those of a header, up to its version.
    fn of_magic(magic: &[u8]) -> Self {
        Self([magic, b"\x01\x00\x0f\x00"].concat())
    }

    fn u32(mut self, values: &[u32]) -> Self {
        self.0.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        self
    }

    fn u64(mut self, values: &[u64]) -> Self {
        self.0.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        self
    }

    fn section(self, (kind, offset, bytes): (u32, u64, u64)) -> Self {
        self.u32(&[kind, 1]).u64(&[offset, bytes])
    }

    fn zeros_to(mut self, end: usize) -> Self {
        self.0.resize(end, 0);
        self
    }
}

/// A header that another process has changed.
fn forged<H: Copy>(mut header: H, change: impl FnOnce(&mut H)) -> H {
    change(&mut header);
    header
}

fn at(x: f32) -> Aabb {
    Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0])
}

fn pages(bytes: u64) -> Vec<Page> {
    vec![bytemuck::Zeroable::zeroed(); page_count(bytes) as usize]
}
