//! What queries have found as a mask, so that it has every encoding and is decoded as all masks are.

use std::time::Instant;

use super::between::{MOST_OF_A_SET, between_unless};
use crate::aabb::Aabb;
use crate::cancel::Cancel;
use crate::dispatch::{CpuEngines, CullAnswer, CullOptions, StageTimes, nanoseconds_since};
use crate::engine::encode::{self, FoundWords};
use crate::engine::gather::Gather;
use crate::engine::word_budget::WordBudget;
use crate::engine::{
    AvailableIsa, Census, CullError, CullReport, EngineChoice, EngineName, EngineTimes, PairRules,
    PairSkips, ReplyBuffer,
};
use crate::mask::{Encoding, EncodingChoice, MaskShape};
use crate::precision::{BoxSlice, ExpandScratch};
use crate::scene::pair_list::Pair;
use crate::team::most_threads;
use crate::units::BoxCount;

/// Two sets are looked for in each other where the larger one has so many times the boxes of the smaller one, for
/// each thread: to sieve a box of the larger one takes about a hundredth of what looking around one takes, and
/// culling all about ten times as long as sieving.
const SMALL_SHARE: usize = 64;
/// Pairs between two sets up to which they are looked for in each other however many threads there are: that takes
/// some 0.2 ms, and answers small frames by a and then by b.
const FEW_PAIRS: usize = 1 << 20;

/// A mask of queries and boxes: query q is object q, and the box of index i is object `queries + i`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QueryMask {
    queries: u32,
    n: BoxCount,
}

/// A scene has indices beyond those of the mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BeyondMask;

impl From<BeyondMask> for CullError {
    fn from(_: BeyondMask) -> Self {
        let why = "the scene has indices beyond those of the mask";
        Self::Unavailable { engine: EngineName::CpuGrid, why }
    }
}

impl QueryMask {
    /// A mask of so many queries, and of boxes whose indices are below `index_end`; `None` where those are
    /// 2^32 objects or more.
    pub fn new(queries: usize, index_end: u32) -> Option<Self> {
        let n = BoxCount::of_len(queries.checked_add(index_end as usize)?)?;
        Some(Self { queries: queries as u32, n })
    }

    /// Objects of the mask.
    pub const fn n(&self) -> BoxCount {
        self.n
    }

    /// Queries.
    pub const fn queries(&self) -> u32 {
        self.queries
    }

    /// Indices are below this.
    pub const fn index_end(&self) -> u32 {
        self.n.get() - self.queries
    }

    /// Writes what was found, which is sorted. Says what an engine says of a frame: its census is that of
    /// `counted`, and of the queries times the boxes `tested` were tested.
    ///
    /// # Errors
    /// [`CullError::Reserve`] where the reply has no room.
    ///
    /// # Panics
    /// With a pair that the mask does not have.
    pub fn write(
        &self,
        counted: &[Aabb],
        found: &[Pair],
        tested: u64,
        encoding: Encoding,
        reply: &mut dyn ReplyBuffer,
    ) -> Result<CullReport, CullError> {
        let shape = if encoding == Encoding::List {
            let shape = MaskShape::list(found.len() as u64);
            let (out, _) = reply.reserve(shape.extent_words())?.as_chunks_mut();
            for (to, [query, index]) in out.iter_mut().zip(found) {
                *to = [*query, self.queries + index];
            }
            shape
        } else {
            let budget = &WordBudget::new(self.n, encoding, false, reply)?;
            let isa = AvailableIsa::best();
            let gather = &Gather { budget, rules: PairRules::NONE, order: &[], isa, keeps: true };
            let words = Words::of(found, self.queries);
            encode::write(std::iter::once(&words), gather, encoding, false, reply)?
        };
        let (census, pairs) = (Census::of(counted), found.len() as u64);
        let mut report = CullReport::new(self.n, shape, census, pairs, 0, EngineTimes::default());
        let pairs = (u64::from(self.queries) * u64::from(self.index_end())).saturating_sub(tested);
        report.skipped.pairs = pairs;
        report.skipped.why = PairSkips::NONE.with_cells_of(pairs);
        Ok(report)
    }

    /// The answer of the cells of a scene: found by `find`, and written. `found` is memory for that.
    ///
    /// # Errors
    /// As `find`, and as [`write`](Self::write); [`BeyondMask`] with a pair that the mask does not have.
    pub fn answer<E: From<CullError> + From<BeyondMask>>(
        &self,
        counted: &[Aabb],
        encoding: Encoding,
        threads: usize,
        found: &mut Vec<Pair>,
        reply: &mut dyn ReplyBuffer,
        find: impl FnOnce(&mut Vec<Pair>) -> Result<u64, E>,
    ) -> Result<CullAnswer, E> {
        let start = Instant::now();
        found.clear();
        let tested = find(found)?;
        let execute_ns = nanoseconds_since(start);
        // All are looked at, several at a time.
        let last = found.iter().fold(0, |last, [_, index]| last.max(*index));
        if last >= self.index_end() && !found.is_empty() {
            return Err(BeyondMask.into());
        }
        let mut report = self.write(counted, found, tested, encoding, reply)?;
        let total_ns = nanoseconds_since(start);
        let publish_ns = total_ns - execute_ns;
        report.times = EngineTimes { ingest_ns: 0, execute_ns, publish_ns };
        let times = StageTimes { execute_ns, publish_ns, total_ns, ..StageTimes::default() };
        Ok(CullAnswer { engine: EngineName::CpuGrid, threads, report, times, expected_ns: 0 })
    }
}

/// Whether two sets are looked for in each other: one is empty, or few beside the other. The more threads, the
/// fewer, for a whole frame has more of them. Else the whole frame is sooner culled.
pub fn is_small_set(first: BoxCount, n: usize, threads: usize) -> bool {
    let first = first.len().min(n);
    let small = first.min(n - first);
    small.saturating_mul(n - small) <= FEW_PAIRS
        || small.saturating_mul(SMALL_SHARE).saturating_mul(threads.max(1)) <= n
}

/// Finds the pairs of a box of the first `first` and one of the others, and writes the mask of all boxes.
///
/// Where one set is [small](is_small_set), that is what [`between`](super::between()) finds, the same whichever engine of the CPU
/// is asked for, and a list unless an encoding is. Else the engines cull the whole frame, and keep those pairs
/// ([`CpuEngines::cull_sets`]).
///
/// # Errors
/// [`CullError::Unavailable`] for an engine of a GPU; [`CullError::Reserve`] where the reply has no room;
/// [`CullError::TooManyBoxes`] for a set of 2^29 boxes or more.
pub fn cull_between<'a>(
    engines: &mut CpuEngines,
    boxes: impl Into<BoxSlice<'a>>,
    first: BoxCount,
    options: &CullOptions,
    reply: &mut dyn ReplyBuffer,
) -> Result<CullAnswer, CullError> {
    if let EngineChoice::Only(engine) = options.engine
        && engine.is_gpu()
    {
        let why = "it needs a daemon with a GPU";
        return Err(CullError::Unavailable { engine, why });
    }
    let mut scratch = ExpandScratch::default();
    let threads = most_threads(options.threads);
    // What is expanded is of f32.
    let boxes = boxes.into().expand(&mut scratch, threads > 1).as_f32().unwrap_or_default();
    if !is_small_set(first, boxes.len(), threads) {
        return engines.cull_sets(boxes, first, options, reply);
    }
    let (a, b) = boxes.split_at(first.len().min(boxes.len()));
    let (n, limit) = (boxes.len() as u64, MOST_OF_A_SET as u64);
    let too_many = CullError::TooManyBoxes { engine: EngineName::CpuGrid, n, limit };
    let mask = QueryMask::new(a.len(), b.len() as u32);
    let mask = mask.filter(|_| a.len().max(b.len()) <= MOST_OF_A_SET).ok_or(too_many)?;
    let encoding = match options.encoding {
        EncodingChoice::Only(encoding) => encoding,
        EncodingChoice::Auto => Encoding::List,
    };
    let most_pairs = match encoding {
        Encoding::List => reply.limit_words() / 2,
        _ => u64::MAX,
    };
    let cancel = &Cancel::by(reply.asker());
    mask.answer(boxes, encoding, threads, &mut Vec::new(), reply, |found| {
        between_unless(cancel, [a, b], options.threads, most_pairs, found)
    })
}

/// The same as an engine finds it: words of a row and a block of 32 columns.
#[derive(Default)]
struct Words {
    rows: Vec<u32>,
    blocks: Vec<u32>,
    bits: Vec<u32>,
    pairs: u64,
}

impl Words {
    fn of(found: &[Pair], queries: u32) -> Self {
        let mut words = Self { pairs: found.len() as u64, ..Self::default() };
        for [query, index] in found {
            let (row, column) = (*query, queries + index);
            if words.rows.last() != Some(&row) || words.blocks.last() != Some(&(column / 32)) {
                words.rows.push(row);
                words.blocks.push(column / 32);
                words.bits.push(0);
            }
            if let Some(bits) = words.bits.last_mut() {
                *bits |= 1 << (column % 32);
            }
        }
        words
    }
}

impl FoundWords for Words {
    fn chunks(&self) -> impl Iterator<Item = [&[u32]; 3]> {
        std::iter::once([&self.rows[..], &self.blocks[..], &self.bits[..]])
    }

    fn pair_count(&self) -> u64 {
        self.pairs
    }
}
