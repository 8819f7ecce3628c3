//! Hits to mask words: sorted by (row, block), none of them zero, each address once.

use super::hits::Hits;
use super::{RowBlock, StripBatch, words};
use crate::engine::encode::FoundWords;
use crate::engine::gather::Gather;
use crate::engine::word_budget::Tests;

/// Words of a chunk, 12 KiB: large enough that [`STEP_ROOM`] left empty is a twentieth of it, small
/// enough that the last, half empty one of each task is nothing against the boxes of the task.
const CHUNK_WORDS: usize = 1024;

/// Room that a chunk must have for a step: the words of 16 hits, or of a row of a block, and a
/// register that is stored whole behind them.
const STEP_ROOM: usize = 48;

/// An address that no word has. It stands before the first word, so that every word has one before
/// it to be compared with.
const NO_ADDRESS: u32 = u32::MAX;

/// Words in the three arrays of the sparse encoding.
pub(super) struct WordChunk {
    pub rows: Vec<u32>,
    /// Columns 32·block to 32·block + 31.
    pub blocks: Vec<u32>,
    /// Bit t: column 32·block + t.
    pub bits: Vec<u32>,
    /// End of the words, at least 1. The last one may still get more bits.
    pub len: usize,
    /// The first one: 1 where [`NO_ADDRESS`] stands before it.
    start: usize,
    /// Those before it have passed the frame's test.
    sifted: usize,
}

impl WordChunk {
    fn new() -> Self {
        let array = || vec![0; CHUNK_WORDS];
        Self { rows: array(), blocks: array(), bits: array(), len: 0, start: 0, sifted: 0 }
    }

    /// Whether the words of 16 hits fit.
    #[inline(always)]
    pub fn has_room(&self) -> bool {
        self.len + STEP_ROOM <= CHUNK_WORDS
    }

    /// Adds bits at an address, which is that of the last word or a later one. No bits are no word.
    #[inline(always)]
    pub fn push(&mut self, row: u32, block: u32, bits: u32) {
        let last = self.len - 1;
        let same = (self.rows[last] == row) & (self.blocks[last] == block);
        let at = self.len - usize::from(same);
        self.rows[at] = row;
        self.blocks[at] = block;
        self.bits[at] = bits | if same { self.bits[last] } else { 0 };
        self.len = at + usize::from(same | (bits != 0));
    }

    /// Puts the first word, or what stands before it.
    fn open(&mut self, [row, block, bits]: [u32; 3], start: usize) {
        (self.rows[0], self.blocks[0], self.bits[0]) = (row, block, bits);
        (self.len, self.start, self.sifted) = (1, start, start);
    }

    /// Puts a word that was taken away back.
    fn put(&mut self, [row, block, bits]: [u32; 3]) {
        (self.rows[self.len], self.blocks[self.len], self.bits[self.len]) = (row, block, bits);
        self.len += 1;
    }

    /// Takes the last word away.
    fn pop(&mut self) -> [u32; 3] {
        self.len -= 1;
        [self.rows[self.len], self.blocks[self.len], self.bits[self.len]]
    }

    /// Keeps the words that pass; returns how many pairs went.
    fn sift(&mut self, gather: &Gather<'_>) -> u64 {
        let words = self.sifted..self.len;
        let arrays = [&mut self.rows, &mut self.blocks, &mut self.bits];
        let (kept, ended) = gather.sift(arrays.map(|array| &mut array[words.clone()]));
        self.len = self.sifted + kept;
        self.sifted = self.len;
        ended
    }

    /// Rows, blocks and bits.
    fn arrays(&self) -> [&[u32]; 3] {
        [&self.rows, &self.blocks, &self.bits].map(|array| &array[self.start..self.len])
    }
}

/// The words of one task's rows. Memory is kept from frame to frame.
#[derive(Default)]
pub(crate) struct WordSink {
    chunks: Vec<WordChunk>,
    /// Chunks that hold words.
    used: usize,
    hits: Hits,
    pair_count: u64,
    tests: Tests,
}

impl WordSink {
    /// Drops all words and keeps the memory, up to twice of what was just in use: a task that had
    /// all rows while there was one thread does not hold on to that.
    pub fn clear(&mut self) {
        self.chunks.truncate(2 * self.used);
        self.used = 0;
        self.pair_count = 0;
        self.tests = Tests::default();
    }

    /// Drops all words and gives their memory back: after a refusal, the next frame is not
    /// expected to have as many.
    pub fn give_back(&mut self) {
        self.chunks = Vec::new();
        self.used = 0;
        self.pair_count = 0;
    }

    /// Adds the hits of a tested batch. Batches must come in rising order of (row, start).
    ///
    /// Full chunks, and tests, count against the budget. A task that searches on after it is spent wastes time.
    pub fn take(&mut self, batch: &StripBatch, gather: &Gather<'_>) {
        let isa = gather.isa;
        let pairs = self.hits.collect(batch, isa);
        self.note_tests(batch.tested_columns(), pairs, gather);
        self.pair_count += pairs;
        let mut done = 0;
        while done < self.hits.len() {
            self.make_room(gather);
            let chunk = &mut self.chunks[self.used - 1];
            done = words::append(&self.hits, done, chunk, isa);
        }
    }

    /// Adds what was found in a tested block. Blocks must come in rising order of rows, which no batch
    /// that was taken before may have.
    pub fn take_block(&mut self, block: &RowBlock, gather: &Gather<'_>) {
        let mut row = 0;
        while row < block.row_count {
            self.make_room(gather);
            let chunk = &mut self.chunks[self.used - 1];
            let (next, pairs) = block.append(row, chunk, gather.isa);
            (row, self.pair_count) = (next, self.pair_count + pairs);
        }
    }

    /// Notes tests, and the pairs that they found, which may make another engine the better one.
    #[inline]
    pub fn note_tests(&mut self, tests: u64, pairs: u64, gather: &Gather<'_>) {
        gather.budget.note_tests(&mut self.tests, tests, pairs);
    }

    /// Adds a word. Its address is that of the last word or a later one; no bits are no word.
    pub fn push(&mut self, row: u32, block: u32, bits: u32, gather: &Gather<'_>) {
        self.make_room(gather);
        self.chunks[self.used - 1].push(row, block, bits);
        self.pair_count += u64::from(bits.count_ones());
    }

    /// Ends the words of a task.
    pub fn finish(&mut self, gather: &Gather<'_>) {
        if let Some(chunk) = self.chunks[..self.used].last_mut() {
            self.pair_count -= chunk.sift(gather);
        }
    }

    /// Sees to it that the last chunk in use has room for a step.
    #[inline(always)]
    fn make_room(&mut self, gather: &Gather<'_>) {
        if self.used == 0 || !self.chunks[self.used - 1].has_room() {
            self.open_chunk(gather);
        }
    }

    /// The next chunk, with the last word of the one before it, which may get more bits.
    fn open_chunk(&mut self, gather: &Gather<'_>) {
        let (mut word, mut start) = ([NO_ADDRESS, NO_ADDRESS, 0], 1);
        if let Some(full) = self.chunks[..self.used].last_mut() {
            (word, start) = (full.pop(), 0);
            self.pair_count -= full.sift(gather);
            if full.len <= CHUNK_WORDS / 2 {
                // Few passed: it is filled up, so that what few words take stays little.
                full.put(word);
                return;
            }
            gather.budget.take(full.arrays()[2]);
            if !gather.keeps {
                full.open(word, start);
                return;
            }
        }
        if self.chunks.len() == self.used {
            self.chunks.push(WordChunk::new());
        }
        self.chunks[self.used].open(word, start);
        self.used += 1;
    }

    pub fn pair_count(&self) -> u64 {
        self.pair_count
    }

    /// Bytes that are allocated for words and hits.
    pub fn allocated_bytes(&self) -> usize {
        self.chunks.len() * 3 * CHUNK_WORDS * size_of::<u32>() + self.hits.allocated_bytes()
    }
}

impl FoundWords for WordSink {
    fn chunks(&self) -> impl Iterator<Item = [&[u32]; 3]> {
        self.chunks[..self.used].iter().map(WordChunk::arrays)
    }

    fn pair_count(&self) -> u64 {
        self.pair_count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::word_budget::WordBudget;
    use crate::engine::{AvailableIsa, HeapReply, PairRules, PairTest};
    use crate::mask::Encoding;
    use crate::units::BoxCount;

    fn no_limit() -> WordBudget {
        let n = BoxCount::new(u32::MAX);
        WordBudget::new(n, Encoding::Sparse, true, &HeapReply::new()).expect("no limit")
    }

    /// The best of this machine, without an order.
    fn gather<'a>(budget: &'a WordBudget, rules: PairRules<'a>) -> Gather<'a> {
        Gather { budget, rules, order: &[], isa: AvailableIsa::best(), keeps: true }
    }

    #[test]
    fn what_does_not_pass_takes_no_memory() {
        /// Lets one column of 300 rows pass.
        struct FewPass;
        impl PairTest for FewPass {
            fn passing(&self, row: u32, block: u32, bits: u32, _: &[u32]) -> u32 {
                if row.is_multiple_of(300) && block == row / 32 + 1 { bits & 1 } else { 0 }
            }
        }
        let budget = no_limit();
        let gather = &gather(&budget, PairRules::tested_by(&FewPass));
        let mut sink = WordSink::default();
        for row in 0..3_000 {
            for block in row / 32 + 1..94 {
                sink.push(row, block, 1, gather);
            }
        }
        sink.finish(gather);
        assert_eq!((sink.word_count(), sink.pair_count()), (10, 10));
        assert_eq!(sink.chunks.len(), 1, "of more than 100,000 words looked at");
    }

    #[test]
    fn a_refused_sink_keeps_no_words() {
        let budget = no_limit();
        let gather = &gather(&budget, PairRules::NONE);
        let mut sink = WordSink::default();
        let empty = sink.allocated_bytes();
        for row in 0..10_000 {
            sink.push(row, row / 32 + 1, 1, gather);
        }
        assert!(sink.allocated_bytes() > empty + 120_000);
        sink.give_back();
        assert_eq!((sink.allocated_bytes(), sink.word_count()), (empty, 0));
    }
}
