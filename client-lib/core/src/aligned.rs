//! A reusable, 64-byte-aligned buffer of plain words.
//!
//! A `Vec<u32>` is aligned to 4 bytes only, and a SIMD load that straddles two cache lines costs
//! twice. This one is a `Vec` of cache lines that lends itself out as words.

use bytemuck::{AnyBitPattern, NoUninit, Pod, Zeroable};

/// One cache line, which is also one AVX-512 register.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C, align(64))]
struct CacheLine([u8; LINE_BYTES]);

/// Bytes of a cache line on every machine that the engines have kernels for.
const LINE_BYTES: usize = 64;

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no memory for {0} bytes")]
pub(crate) struct NoMemory(pub u64);

/// Words of type `T` on a 64-byte border. Grows and never shrinks, so that steady frames allocate
/// nothing.
pub(crate) struct AlignedBuffer<T> {
    lines: Vec<CacheLine>,
    len: usize,
    words: std::marker::PhantomData<T>,
}

impl<T> Default for AlignedBuffer<T> {
    fn default() -> Self {
        Self { lines: Vec::new(), len: 0, words: std::marker::PhantomData }
    }
}

impl<T: NoUninit + AnyBitPattern> AlignedBuffer<T> {
    /// Makes room for `len` words. What they hold is unspecified: old words or zeroes.
    ///
    /// # Errors
    /// [`NoMemory`] when the allocator has none; the buffer is then empty.
    pub fn try_resize(&mut self, len: usize) -> Result<(), NoMemory> {
        let line_count = len.checked_mul(size_of::<T>()).ok_or(NoMemory(u64::MAX))?;
        let line_count = line_count.div_ceil(LINE_BYTES);
        if line_count > self.lines.len() {
            // The old words are not worth copying: free them first, so that the two never
            // stand in memory together.
            self.len = 0;
            self.lines = Vec::new();
            self.lines
                .try_reserve_exact(line_count)
                .map_err(|_| NoMemory((line_count as u64).saturating_mul(LINE_BYTES as u64)))?;
            self.lines.resize(line_count, CacheLine::zeroed());
        }
        self.len = len;
        Ok(())
    }

    /// [`Self::try_resize`] for scratch whose size follows from boxes that are in memory already.
    ///
    /// # Panics
    /// When the system has no memory left, as `Vec` does.
    pub fn resize(&mut self, len: usize) {
        if let Err(NoMemory(bytes)) = self.try_resize(len) {
            panic!("no memory for {bytes} bytes of scratch");
        }
    }

    pub fn as_slice(&self) -> &[T] {
        &bytemuck::cast_slice(&self.lines)[..self.len]
    }

    /// The words, to be written.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut bytemuck::cast_slice_mut(&mut self.lines)[..self.len]
    }

    pub fn allocated_bytes(&self) -> usize {
        self.lines.len() * LINE_BYTES
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_aligned_and_room_is_kept() {
        let mut buffer = AlignedBuffer::<u32>::default();
        assert!(buffer.as_slice().is_empty());
        buffer.resize(100);
        let first = buffer.as_slice().as_ptr();
        assert_eq!(first.addr() % LINE_BYTES, 0);
        assert_eq!(buffer.as_slice().len(), 100);
        buffer.resize(3);
        assert_eq!(buffer.as_slice().len(), 3);
        buffer.resize(112);
        assert_eq!(buffer.as_slice().as_ptr(), first, "100 words fill 7 lines, as 112 do");
        assert_eq!(buffer.allocated_bytes(), 448);
    }

    #[test]
    fn more_than_the_address_space_is_an_error() {
        let mut buffer = AlignedBuffer::<u32>::default();
        assert!(buffer.try_resize(usize::MAX).is_err());
        assert!(buffer.try_resize(usize::MAX / 8).is_err());
        assert!(buffer.as_slice().is_empty());
    }
}
