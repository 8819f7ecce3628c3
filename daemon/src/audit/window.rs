//! A window of a mask: some rows, some columns, and the engine's bits of their pairs.

use std::ops::Range;
use std::sync::Arc;

use pairmask_core::filters::FilterData;
use pairmask_core::mask::{MaskShape, Span};
use pairmask_core::objects::Objects;
use pairmask_core::{Aabb, BoxCount, ObjectForm, Sphere, pair_index};
use pairmask_wire::SentRules;

use super::{AuditedScene, NotedName};
use crate::scene::Random;

/// How much of a frame a window may hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reach {
    pub tests: u64,
    /// Most columns of a window, a multiple of 32.
    columns: u32,
    /// Largest frame of which every pair is checked, objects: it has at most `tests` pairs.
    whole_frame: u32,
}

impl Reach {
    /// Limits for boxes: 256 KiB of bits, 0.8 MB of columns, and about 10 ms of the oracle.
    pub const BOXES: Self = Self { tests: 1 << 21, columns: 1 << 15, whole_frame: 2048 };
    /// Limits for spheres, whose oracle takes a microsecond a pair: about 30 ms of it.
    pub const SPHERES: Self = Self { tests: 1 << 15, columns: 1 << 12, whole_frame: 256 };

    pub const fn of(form: ObjectForm) -> Self {
        match form {
            ObjectForm::Boxes(_) => Self::BOXES,
            ObjectForm::Spheres => Self::SPHERES,
        }
    }
}

/// Rows and columns, as positions in the mask's order; as indices of objects where it has none.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Span2 {
    pub rows: Range<u32>,
    /// Columns; the first is a multiple of 32.
    pub columns: Range<u32>,
}

impl Span2 {
    /// Draws rows and columns of n positions; of a frame of two sets whose mask has no order, rows of the first.
    /// Engines that sort boxes put most pairs near the diagonal, so every other window of one set starts there.
    pub fn draw(first: Option<BoxCount>, n: u32, reach: Reach, random: &mut Random) -> Self {
        if n <= reach.whole_frame {
            return Self { rows: 0..n, columns: 0..n };
        }
        let row_end = first.map_or(n, |first| first.get().min(n));
        let least_column = first.map_or(0, |_| row_end / 32 * 32);
        let columns = (n - least_column).min(reach.columns);
        let rows = (reach.tests / u64::from(columns.max(1))).min(u64::from(row_end)) as u32;
        let first_row = random.below(u64::from(row_end - rows) + 1) as u32;
        let last = n - columns;
        let (least, near) = match first {
            Some(_) => (least_column, false),
            None => (first_row, random.below(2) == 0),
        };
        let first_column = if near || least >= last {
            least.min(last)
        } else {
            least + random.below(u64::from(last - least) + 1) as u32
        };
        let first_column = first_column / 32 * 32;
        let end = (first_column + columns).min(n);
        Self { rows: first_row..first_row + rows, columns: first_column..end }
    }

    fn row_words(&self) -> usize {
        (self.columns.len()).div_ceil(32)
    }
}

/// A window to be checked. Its memory is reused.
#[derive(Debug, Default)]
pub struct Window {
    pub(super) span: Span2,
    /// A bit for each row and column, rows padded to words; unspecified for columns not after it.
    bits: Vec<u32>,
    /// Index of the object at each row, then at each column.
    indices: Vec<u32>,
    /// The boxes at `indices`; none in a frame of spheres.
    pub(super) boxes: Vec<Aabb>,
    /// The spheres at `indices`; none in a frame of boxes.
    pub(super) spheres: Vec<Sphere>,
    /// The rules of the frame; `None` where all objects may meet.
    pub(super) rules: Option<Arc<SentRules>>,
    /// Boxes of the first set, where the frame is of two: those of one set do not meet.
    pub(super) first_set: Option<BoxCount>,
    /// The scene that is asked, where the window is of the answer to a query.
    pub(super) scene: Option<AuditedScene>,
    /// Of each query, where they have filter data.
    pub(super) filter_data: Option<Vec<FilterData>>,
    pub(super) client_token: u64,
    pub(super) frame: u64,
}

impl Window {
    pub(super) const fn name(&self) -> NotedName {
        NotedName::Request { client_token: self.client_token, frame: self.frame }
    }

    /// Whether a window can hold the bits of such a mask: other encodings are not audited.
    pub const fn holds(shape: &MaskShape) -> bool {
        matches!(shape, MaskShape::Dense { .. } | MaskShape::Sparse { .. } | MaskShape::List { .. })
    }

    /// Copies the bits of a span from a mask of `n` objects, one that a window [holds](Self::holds).
    pub fn take_mask(&mut self, n: u32, span: Span2, shape: &MaskShape, reply: &[u32]) {
        self.span = span;
        self.bits.clear();
        self.bits.resize(self.span.rows.len() * self.span.row_words(), 0);
        let order = match shape {
            MaskShape::Sparse { order: Some(order), .. } => Some(section(reply, order)),
            _ => None,
        };
        // A position beyond a too short order becomes an index without an object.
        let index =
            |p: u32| order.map_or(p, |order| order.get(p as usize).copied().unwrap_or(u32::MAX));
        self.indices.clear();
        self.indices.extend(self.span.rows.clone().chain(self.span.columns.clone()).map(index));
        match shape {
            MaskShape::Dense { words } => self.take_dense(BoxCount::new(n), section(reply, words)),
            MaskShape::Sparse { rows, blocks, bits, .. } => {
                self.take_sparse([rows, blocks, bits].map(|span| section(reply, span)));
            }
            MaskShape::List { pairs } => self.take_list(section(reply, pairs)),
            _ => {}
        }
    }

    /// Copies the objects. An index without an object counts as empty.
    pub fn take_objects(&mut self, objects: Objects<'_>) {
        self.boxes.clear();
        self.spheres.clear();
        let indices = self.indices.iter().map(|index| *index as usize);
        match objects {
            Objects::Boxes(boxes) => {
                self.boxes.extend(indices.map(|i| boxes.get(i).unwrap_or(Aabb::EMPTY)));
            }
            Objects::Spheres(spheres) => {
                let one = |i: usize| spheres.get(i).copied().unwrap_or(Sphere::EMPTY);
                self.spheres.extend(indices.map(one));
            }
        }
    }

    fn take_dense(&mut self, n: BoxCount, mask: &[u32]) {
        let word = |k: u64| u64::from(mask.get((k / 32) as usize).copied().unwrap_or(0));
        let stride = self.span.row_words();
        for (row, bits) in self.span.rows.clone().zip(self.bits.chunks_mut(stride.max(1))) {
            let start = pair_index::row_start(n, row);
            for (first, bits) in self.span.columns.clone().step_by(32).zip(bits) {
                let last = (first + 31).min(n.get() - 1);
                let from = first.max(row + 1);
                if from > last {
                    continue;
                }
                // Up to 32 bits from two words of the bit string, shifted to the columns' places.
                let k = start + u64::from(from - row - 1);
                let two = word(k) | word(k + 32) << 32;
                let count = last - from + 1;
                let kept = (two >> (k % 32)) & ((1u64 << count) - 1);
                *bits = (kept << (from - first)) as u32;
            }
        }
    }

    fn take_sparse(&mut self, [rows, blocks, bits]: [&[u32]; 3]) {
        let stride = self.span.row_words();
        let first_block = self.span.columns.start / 32;
        let from = rows.partition_point(|row| *row < self.span.rows.start);
        let until = rows.partition_point(|row| *row < self.span.rows.end);
        for i in from..until.max(from) {
            let (Some(&row), Some(&block), Some(&bits)) = (rows.get(i), blocks.get(i), bits.get(i))
            else {
                continue;
            };
            let column = block.wrapping_sub(first_block) as usize;
            if column < stride && self.span.rows.contains(&row) {
                self.bits[(row - self.span.rows.start) as usize * stride + column] |= bits;
            }
        }
    }

    /// A list says nothing of where a pair of the span stands, so all of it is looked at: at some tenths
    /// of a nanosecond a pair, less than the oracle takes for the window.
    fn take_list(&mut self, list: &[u32]) {
        let stride = self.span.row_words();
        for &[row, column] in list.as_chunks().0 {
            if self.span.rows.contains(&row) && self.span.columns.contains(&column) {
                let (row, column) = (row - self.span.rows.start, column - self.span.columns.start);
                self.bits[row as usize * stride + column as usize / 32] |= 1 << (column % 32);
            }
        }
    }

    /// Puts boxes, counted from 0, in the places of the second set. Returns the number of the first.
    pub(super) fn fill_second_set(&mut self, box_at: impl Fn(u32) -> Aabb) -> u32 {
        let first = self.first_set.map_or(0, BoxCount::get);
        for (index, to) in self.indices.iter().zip(&mut self.boxes) {
            if let Some(index) = index.checked_sub(first) {
                *to = box_at(index);
            }
        }
        first
    }

    /// Whether rules and sets let two objects meet, the lower index first.
    pub(super) fn meet(&self, a: u32, b: u32) -> bool {
        let first = self.first_set.map(BoxCount::get);
        first.is_none_or(|first| a < first && b >= first)
            && self.rules.as_ref().is_none_or(|sent| sent.rules().meet(a, b))
    }

    /// Whether the mask had the pair of the `row`-th row and the `column`-th column of the window.
    pub(super) fn has(&self, row: usize, column: usize) -> bool {
        let word = self.bits[row * self.span.row_words() + column / 32];
        word >> (column % 32) & 1 == 1
    }

    /// The objects of a pair of the window, lower index first.
    pub(super) fn pair(&self, row: usize, column: usize) -> [u32; 2] {
        let (a, b) = (self.indices[row], self.indices[self.span.rows.len() + column]);
        [a.min(b), a.max(b)]
    }
}

fn section<'a>(reply: &'a [u32], span: &Span) -> &'a [u32] {
    span.of(reply).unwrap_or_default()
}
