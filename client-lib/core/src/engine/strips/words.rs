//! Hits and words: a register of strips, or the words of half as many hits, a step, without a branch on any
//! single one.

use super::StripBatch;
use super::batch::BATCH_STRIPS;
use super::hits::Hits;
use super::sink::WordChunk;
use crate::simd::{MOST_LANES, Simd, Squeeze, per_isa};

per_isa! {
    Squeeze, { collect_plain(batch, hits) }
    /// Squeezes the strips with an overlap together; returns hits and pairs.
    pub(super) fn collect<simd: S>(batch: &StripBatch, hits: &mut Hits) -> (usize, u64) {
        let (rows, starts, lanes) = batch.arrays();
        let (mut len, mut pairs) = (0, 0);
        for at in (0..batch.len()).step_by(S::LANES) {
            let requested = first_lanes((batch.len() - at).min(S::LANES));
            let bits = simd.widen(&lanes[at..]);
            let hit = requested & !simd.bits(simd.equal(bits, simd.splat(0)));
            let strips = [load(simd, rows, at), load(simd, starts, at), bits];
            let [row, start, bits] = simd.squeeze(hit, strips);
            store(simd, row, &mut *hits.rows, len);
            store(simd, start, &mut *hits.starts, len);
            store(simd, bits, &mut *hits.bits, len);
            len += hit.count_ones() as usize;
        }
        let (twos, rest) = hits.bits[..len].as_chunks::<2>();
        for [low, high] in twos {
            pairs += u64::from((low | high << 16).count_ones());
        }
        for bits in rest {
            pairs += u64::from(bits.count_ones());
        }
        (len, pairs)
    }
}

per_isa! {
    Squeeze, { append_plain(hits, from, chunk) }
    /// Adds hits from number `from` on while the chunk has room; returns the next one.
    pub(super) fn append<simd: S>(hits: &Hits, from: usize, chunk: &mut WordChunk) -> usize {
        let mut at = from;
        while at < hits.len() && chunk.has_room() {
            let [row, start, bits] =
                [&hits.rows, &hits.starts, &hits.bits].map(|array| load(simd, &**array, at));
            let words = simd.strip_words(row, start, bits);
            let found = !simd.bits(simd.equal(words[2], simd.splat(0))) & first_lanes(S::LANES);
            put_words(simd, simd.squeeze(found, words), found.count_ones(), chunk);
            at += S::LANES / 2;
        }
        at.min(hits.len())
    }
}

/// Whether a strip has a hit is a coin toss: all are copied and those without are overwritten.
fn collect_plain(batch: &StripBatch, hits: &mut Hits) -> (usize, u64) {
    let (rows, starts, lanes) = batch.arrays();
    let (mut len, mut pairs) = (0, 0);
    for ((&row, &start), &lanes) in rows.iter().zip(starts).zip(lanes).take(batch.len()) {
        let at = len % BATCH_STRIPS;
        (hits.rows[at], hits.starts[at], hits.bits[at]) = (row, start, u32::from(lanes));
        len += usize::from(lanes != 0);
        pairs += u64::from(lanes.count_ones());
    }
    (len, pairs)
}

fn append_plain(hits: &Hits, from: usize, chunk: &mut WordChunk) -> usize {
    for at in from..hits.len() {
        if !chunk.has_room() {
            return at;
        }
        let (row, start) = (hits.rows[at], hits.starts[at]);
        let bits = u64::from(hits.bits[at]) << (start % 32);
        chunk.push(row, start / 32, bits as u32);
        chunk.push(row, start / 32 + 1, (bits >> 32) as u32);
    }
    hits.len()
}

/// Adds the first `count` words, whose addresses do not fall: neighbours with the same one become
/// one word.
#[inline(always)]
fn put_words<S: Squeeze>(
    simd: S,
    [row, block, bits]: [S::Keys; 3],
    count: u32,
    chunk: &mut WordChunk,
) {
    let last = chunk.len - 1;
    let same_row = simd.equal(row, simd.behind(row, chunk.rows[last]));
    let same_block = simd.equal(block, simd.behind(block, chunk.blocks[last]));
    let requested = first_lanes(count as usize);
    let same = requested & simd.bits(same_row) & simd.bits(same_block);
    if same & (same << 1) != 0 {
        // Three strips with hits in one word: rare.
        let mut words = [[0; MOST_LANES]; 3];
        for (words, register) in words.iter_mut().zip([row, block, bits]) {
            store(simd, register, words, 0);
        }
        for lane in 0..count as usize {
            chunk.push(words[0][lane], words[1][lane], words[2][lane]);
        }
        return;
    }
    let bits_before = simd.behind(bits, chunk.bits[last]);
    let bits = simd.or_where([same_row, same_block], bits, bits_before);
    // The later one of two has the bits of both.
    let kept = requested & !(same >> 1);
    let at = chunk.len - (same & 1) as usize;
    let [row, block, bits] = simd.squeeze(kept, [row, block, bits]);
    store(simd, row, &mut chunk.rows, at);
    store(simd, block, &mut chunk.blocks, at);
    store(simd, bits, &mut chunk.bits, at);
    chunk.len = at + kept.count_ones() as usize;
}

/// The first `count` lanes, 16 at most.
#[inline(always)]
const fn first_lanes(count: usize) -> u32 {
    (1 << count) - 1
}

#[inline(always)]
fn load<S: Simd>(simd: S, words: &[u32], at: usize) -> S::Keys {
    simd.load(bytemuck::cast_slice(&words[at..at + S::LANES]))
}

#[inline(always)]
fn store<S: Simd>(simd: S, register: S::Keys, words: &mut [u32], at: usize) {
    simd.store(register, bytemuck::cast_slice_mut(&mut words[at..at + S::LANES]));
}
