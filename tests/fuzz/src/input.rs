//! Input as short numbers, from which targets make what has to fit together.

use pairmask_core::Aabb;
use pairmask_core::filters::{Filter, FilterData, FilterId, Owner, World};
use pairmask_wire::{PAGE_BYTES, Page};

/// The rest of an input. Behind its end all is zero.
#[derive(Clone, Debug)]
pub struct Input<'a>(pub &'a [u8]);

/// Numbers that the last values of a byte stand for.
const EXTREMES: [u32; 8] =
    [63, 64, 1 << 16, i32::MAX as u32, 1 << 31, u32::MAX - 31, u32::MAX - 1, u32::MAX];
const FIRST_EXTREME: u8 = u8::MAX - EXTREMES.len() as u8 + 1;

/// Coordinates that the last values of a byte stand for.
const ODD_COORDINATES: [f32; 8] = [
    -0.0,
    f32::from_bits(1),
    f32::MIN_POSITIVE,
    f32::MAX,
    f32::MIN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::NAN,
];

impl Input<'_> {
    pub const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }

    /// A number below another one that is not 0.
    pub fn below(&mut self, end: u32) -> u32 {
        u32::from(self.byte()) % end
    }

    pub fn flag(&mut self) -> bool {
        self.byte() & 1 != 0
    }

    /// A small number, or an extreme one.
    pub fn number(&mut self) -> u32 {
        let byte = self.byte();
        match byte.checked_sub(FIRST_EXTREME) {
            Some(extreme) => EXTREMES[usize::from(extreme)],
            None => byte.into(),
        }
    }

    /// A byte or eight.
    pub fn long(&mut self) -> u64 {
        match self.byte() {
            u8::MAX => u64::from_le_bytes([0; 8].map(|_: u8| self.byte())),
            small => small.into(),
        }
    }

    /// Four bytes.
    pub fn word(&mut self) -> u32 {
        u32::from_le_bytes([0; 4].map(|_: u8| self.byte()))
    }

    /// A quarter of a small whole number, or an odd value.
    pub fn coordinate(&mut self) -> f32 {
        let byte = self.byte();
        match byte.checked_sub(FIRST_EXTREME) {
            Some(odd) => ODD_COORDINATES[usize::from(odd)],
            None => f32::from(byte) / 4.0,
        }
    }

    /// Three coordinates and what is added to them; now and then two unrelated corners.
    pub fn aabb(&mut self) -> Aabb {
        let min = [0; 3].map(|_: u8| self.coordinate());
        let edges = [0; 3].map(|_: u8| self.coordinate());
        if self.byte() == u8::MAX {
            return Aabb { min, max: edges };
        }
        Aabb { min, max: [0, 1, 2].map(|axis| min[axis] + edges[axis] / 4.0) }
    }

    pub fn filter_data(&mut self) -> FilterData {
        let (world, owner, filter) = (self.number(), self.number(), self.number());
        let filter_data = FilterData::new(
            World(world.cast_signed().wrapping_sub(1)),
            Owner(owner),
            FilterId(filter as u16),
        );
        filter_data.with_static(self.flag())
    }

    pub fn filter(&mut self) -> Filter {
        let (category, mask, group) = (self.long(), self.long(), self.number().cast_signed());
        let flags = self.byte();
        let filter = Filter::new(category, mask).with_group(group.wrapping_sub(1));
        filter.with_static(flags & 1 != 0).with_either(flags & 2 != 0)
    }

    /// So many of a kind, but no more than the input holds bytes for.
    pub fn some<T>(&mut self, count: u32, mut of: impl FnMut(&mut Self) -> T) -> Vec<T> {
        let mut entries = Vec::new();
        while entries.len() < count as usize && !self.is_empty() {
            entries.push(of(self));
        }
        entries
    }
}

/// The largest payload of a target, pages.
const MOST_PAGES: usize = 4;

/// The pages that bytes fill, as a payload.
pub fn pages_of(bytes: &[u8]) -> Vec<Page> {
    let bytes = &bytes[..bytes.len().min(MOST_PAGES * PAGE_BYTES)];
    let mut pages = vec![bytemuck::Zeroable::zeroed(); bytes.len().div_ceil(PAGE_BYTES).max(1)];
    bytemuck::cast_slice_mut(&mut pages)[..bytes.len()].copy_from_slice(bytes);
    pages
}
