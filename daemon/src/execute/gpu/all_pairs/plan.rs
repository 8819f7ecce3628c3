//! How all pairs are cut up: tile shapes and bands. Pure, and tested without a GPU.

use pairmask_core::engine::ReserveError;
use pairmask_core::mask::MaskShape;
use pairmask_core::pair_index::row_start;
use pairmask_core::{BoxCount, Encoding};
use pairmask_shaders::constants::{BATCH_BOXES, PADDING, WORD_BITS};
use pairmask_shaders::{Found, RowsPerThread};

use crate::execute::gpu::grid::plan::most_entries;

const WORD_BYTES: u64 = size_of::<u32>() as u64;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Tuning {
    pub rows: RowsPerThread,
    pub strip_blocks: u32,
}

impl Tuning {
    /// The shape that was fastest on an H200 (`tests/records`). A dense mask of a small scene gets
    /// small tiles, so that all of a large GPU works; a large one large tiles, so that each column
    /// read serves more tests. A sparse mask always gets wide strips: writing it takes a step a
    /// strip (14 µs with strips of one block at 1,000 boxes, 7 with eight).
    pub const fn for_frame(n: BoxCount, encoding: Encoding) -> Self {
        let (rows, strip_blocks) = match (encoding, n.get()) {
            (Encoding::Dense, 0..2048) => (RowsPerThread::One, 1),
            (Encoding::Dense, 2048..8192) => (RowsPerThread::Two, 2),
            (Encoding::Dense, 8192..20_000) => (RowsPerThread::Four, 4),
            (_, 20_000..) => (RowsPerThread::Four, 8),
            (_, 0..20_000) => (RowsPerThread::One, 8),
        };
        Self { rows, strip_blocks }
    }

    /// The shapes that [`Self::for_frame`] chooses among.
    pub fn all() -> impl Iterator<Item = Self> {
        let of = |n, encoding| Self::for_frame(BoxCount::new(n), encoding);
        let dense = [0, 2048, 8192, 20_000].into_iter().map(move |n| of(n, Encoding::Dense));
        dense.chain([of(0, Encoding::Sparse)])
    }

    const fn strip_columns(self) -> u32 {
        self.strip_blocks * WORD_BITS
    }
}

/// Rows whose matrix is in video memory at one time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Band {
    /// First row, a multiple of a batch.
    pub row0: u32,
    pub owned_rows: u32,
    /// Rows of the matrix, whole batches: a dense band also needs the rows after its own, whose
    /// first pairs share a word with its last ones.
    pub matrix_rows: u32,
    /// First strip with a column after the first row.
    pub strip0: u32,
    pub strip_end: u32,
    pub blocks: u32,
}

impl Band {
    pub const fn matrix_words(&self) -> u64 {
        self.blocks as u64 * self.matrix_rows as u64
    }

    pub const fn mask_words(&self) -> u64 {
        (self.strip_end - self.strip0) as u64 * self.matrix_rows as u64
    }

    pub const fn first_pair(&self, n: BoxCount) -> u64 {
        row_start(n, self.row0)
    }

    /// Words of the bit string that start in the band.
    pub const fn dense_words(&self, n: BoxCount) -> std::ops::Range<u64> {
        let end = row_start(n, self.row0 + self.owned_rows);
        self.first_pair(n).div_ceil(32)..end.div_ceil(32)
    }
}

/// Pairs of a dense band stay below this, so that their indices, counted from the band's first,
/// and the doubled products on the way to them fit in u32.
const DENSE_BAND_PAIRS: u64 = 1 << 31;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BandLimits {
    pub matrix_words: u64,
    /// Words of a dense band's part of the reply.
    pub output_words: u64,
    pub binding_bytes: u64,
}

/// Words of a key plane: n rounded up to the padding.
pub const fn plane_words(n: BoxCount) -> u64 {
    (n.get() as u64).next_multiple_of(PADDING as u64)
}

/// Most boxes that any device takes: batches are numbered along one dimension of a dispatch.
pub const MAX_BOXES: u64 = 65_535 * BATCH_BOXES as u64 / PADDING as u64 * PADDING as u64;

/// Most boxes that fit the limits: keys in one binding, and one batch of rows in a matrix.
pub fn max_boxes(encoding: Encoding, limits: &BandLimits) -> u64 {
    let batch = u64::from(BATCH_BOXES);
    let keys = limits.binding_bytes / 24;
    // A dense matrix holds a batch more than its own.
    let matrix_batches = if encoding == Encoding::Dense { 2 } else { 1 };
    let matrix = limits.matrix_words / (batch * matrix_batches) * u64::from(WORD_BITS);
    let dense = match encoding {
        Encoding::Dense => {
            (DENSE_BAND_PAIRS / batch).min(limits.output_words * u64::from(WORD_BITS) / batch)
        }
        _ => u64::MAX,
    };
    let most = keys.min(matrix).min(dense).min(MAX_BOXES);
    most / u64::from(PADDING) * u64::from(PADDING)
}

/// Cuts `n` boxes into bands, in order of rows. `n` must not exceed [`max_boxes`].
pub fn bands(n: BoxCount, tuning: Tuning, encoding: Encoding, limits: &BandLimits) -> Vec<Band> {
    let batch = u64::from(BATCH_BOXES);
    let strip_end = n.get().div_ceil(tuning.strip_columns());
    let mut bands = Vec::new();
    let mut row0 = 0;
    while row0 < n.get() {
        let left = u64::from(n.get() - row0);
        let strip0 = row0 / tuning.strip_columns();
        let blocks = (strip_end - strip0) * tuning.strip_blocks;
        let fitting = limits.matrix_words / u64::from(blocks) / batch * batch;
        let rows = match encoding {
            // All rows at once need no row after them; otherwise leave room for a batch of them.
            Encoding::Dense => {
                let fitting = if fitting >= left { fitting } else { fitting - batch };
                let pairs = (DENSE_BAND_PAIRS - 1).min((limits.output_words - 1) * 32);
                fitting.min(pairs / left / batch * batch)
            }
            _ => fitting,
        };
        let owned_rows = rows.max(batch).min(left) as u32;
        let after = if encoding == Encoding::Dense && u64::from(owned_rows) < left {
            BATCH_BOXES
        } else {
            0
        };
        bands.push(Band {
            row0,
            owned_rows,
            matrix_rows: owned_rows.next_multiple_of(BATCH_BOXES) + after,
            strip0,
            strip_end,
            blocks,
        });
        row0 += owned_rows;
    }
    bands
}

/// A mask of a kind with room for `capacity` items (mask words without an order, pairs), of which `entries` are used.
pub const fn shape(found: Found, n: BoxCount, capacity: u64, entries: u64) -> MaskShape {
    match found {
        Found::Words => MaskShape::sparse(n, capacity, entries, false),
        Found::Pairs => MaskShape::list(entries),
    }
}

/// Words of a reply that a mask of so many items takes.
pub fn words(found: Found, n: BoxCount, entries: u64) -> u64 {
    shape(found, n, entries, entries).extent_words()
}

/// Items that a reply has room for before the mask's size is known, less where the reply holds less: a
/// function of n and that limit alone, so that the same boxes give the same bytes. Scenes with at
/// most a few neighbours a box fit; others cost a second run.
pub fn first_capacity(found: Found, n: BoxCount) -> u64 {
    (8 * u64::from(n.get())).min(most_entries(n, found)).max(1)
}

/// Items that a mask may have, at least 1.
pub fn room(found: Found, n: BoxCount, limit_words: u64) -> Result<u64, ReserveError> {
    let room = match found {
        Found::Words => MaskShape::sparse_words_within(n, limit_words, false),
        Found::Pairs => Some(limit_words / 2),
    };
    room.filter(|room| *room > 0).ok_or_else(|| refusal(words(found, n, 1), limit_words))
}

pub const fn refusal(words: u64, limit_words: u64) -> ReserveError {
    ReserveError::TooLarge {
        at_least_bytes: words.saturating_mul(WORD_BYTES),
        limit_bytes: limit_words.saturating_mul(WORD_BYTES),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAVAPIPE: BandLimits =
        BandLimits { matrix_words: 32 << 20, output_words: 32 << 20, binding_bytes: 128 << 20 };
    const TINY: BandLimits =
        BandLimits { matrix_words: 1 << 16, output_words: 1 << 12, binding_bytes: 1 << 20 };

    fn check(n: u32, encoding: Encoding, limits: &BandLimits) {
        let count = BoxCount::new(n);
        if u64::from(n) > max_boxes(encoding, limits) {
            return;
        }
        let tuning = Tuning::for_frame(count, encoding);
        let bands = bands(count, tuning, encoding, limits);
        let mut next_row = 0;
        let mut next_word = 0;
        for band in &bands {
            assert_eq!(band.row0, next_row, "{n} {encoding}");
            assert!(band.row0.is_multiple_of(BATCH_BOXES) && band.owned_rows > 0);
            assert!(band.matrix_words() <= limits.matrix_words, "{n} {encoding} {band:?}");
            assert!(u64::from(band.row0 + band.matrix_rows) <= plane_words(count), "{band:?}");
            assert!(band.strip0 * tuning.strip_columns() <= band.row0);
            assert!(band.strip_end * tuning.strip_columns() >= n);
            assert!(u64::from(band.strip_end * tuning.strip_columns()) <= plane_words(count));
            next_row += band.owned_rows;
            if encoding == Encoding::Dense {
                let words = band.dense_words(count);
                assert_eq!(words.start, next_word, "{n} {band:?}");
                assert!(words.end - words.start < limits.output_words + 1);
                assert!(u64::from(band.owned_rows) * u64::from(n - band.row0) < DENSE_BAND_PAIRS);
                next_word = words.end;
            }
        }
        assert_eq!(next_row, n);
        if encoding == Encoding::Dense {
            assert_eq!(next_word, count.dense_words());
        }
    }

    #[test]
    fn bands_cover_every_row_and_word_once_within_the_limits() {
        for encoding in Encoding::ALL {
            for n in (1..70).chain([255, 256, 257, 345, 511, 513, 1234, 2047, 4096]) {
                check(n, encoding, &TINY);
                check(n, encoding, &LAVAPIPE);
            }
            for n in [10_000, 92_681, 92_683, 100_000, 1_000_000] {
                check(n, encoding, &LAVAPIPE);
            }
            for limits in [LAVAPIPE, TINY] {
                let most = max_boxes(encoding, &limits);
                assert!(most > 0);
                check(most.min(3_000_000) as u32, encoding, &limits);
            }
        }
    }

    #[test]
    fn the_first_capacity_depends_on_the_count_alone_and_fits_the_triangle() {
        for found in Found::ALL {
            let first = |n| first_capacity(found, BoxCount::new(n));
            assert_eq!(first(0), 1, "an empty section cannot be bound");
            assert_eq!(first(10_000), 80_000);
            assert_eq!(first(16), most_entries(BoxCount::new(16), found));
        }
    }
}
