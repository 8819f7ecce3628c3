//! What the GPU tests share: a device, scenes with every awkward number, a naive reference.

use std::sync::Arc;

use pairmask::engine::{CullJob, CullReport, Engine, ReplyBuffer, ReserveError};
use pairmask::mask::MaskShape;
use pairmask::{Aabb, Encoding};
use pairmaskd::execute::gpu::{AllPairs, AllPairsOptions, Gpu, GpuChoice, HostImport};

/// The GPU of the tests: what `PAIRMASK_TEST_GPU` names, by default the software adapter.
///
/// # Panics
/// Without an adapter: a GPU test that cannot run fails.
pub fn open(host_import: HostImport) -> Arc<Gpu> {
    let choice = std::env::var("PAIRMASK_TEST_GPU").unwrap_or_else(|_| "software".into());
    let choice: GpuChoice = choice.parse().unwrap_or_default();
    match Gpu::open(&choice, host_import) {
        Ok(gpu) => gpu,
        Err(error) => panic!("the GPU tests need a Vulkan adapter: {error}"),
    }
}

/// An engine on a device of its own.
///
/// # Panics
/// When it cannot be made.
pub fn engine(options: AllPairsOptions) -> AllPairs {
    match AllPairs::new(&open(HostImport::IfPossible), options) {
        Ok(engine) => engine,
        Err(error) => panic!("{error}"),
    }
}

/// Reply memory in a vector, filled with junk so that unwritten words show.
#[derive(Default)]
pub struct VecReply(pub Vec<u32>);

impl ReplyBuffer for VecReply {
    fn reserve(&mut self, words: u64) -> Result<&mut [u32], ReserveError> {
        self.0 = vec![0xdead_beef; words as usize];
        Ok(&mut self.0)
    }
}

/// Culls into fresh memory.
///
/// # Panics
/// When the engine fails.
pub fn cull(engine: &mut AllPairs, boxes: &[Aabb], encoding: Encoding) -> (CullReport, Vec<u32>) {
    let mut reply = VecReply::default();
    match engine.cull(boxes, &CullJob { encoding, threads: 1 }, &mut reply) {
        Ok(report) => (report, reply.0),
        Err(error) => panic!("{} boxes, {encoding}: {error}", boxes.len()),
    }
}

/// The pairs of a mask, in its own order.
///
/// # Panics
/// When the shape does not fit the reply.
pub fn pairs(n: usize, shape: &MaskShape, reply: &[u32]) -> Vec<(u32, u32)> {
    let section = |span: &pairmask::mask::Span| match span.of(reply) {
        Some(words) => words,
        None => panic!("{span:?} is outside a reply of {} words", reply.len()),
    };
    match shape {
        MaskShape::Dense { words } => {
            let words = section(words);
            let all = (0..n as u32).flat_map(|a| (a + 1..n as u32).map(move |b| (a, b)));
            let is_set = |k: usize| words[k / 32] >> (k % 32) & 1 == 1;
            all.enumerate().filter(|(k, _)| is_set(*k)).map(|(_, pair)| pair).collect()
        }
        MaskShape::Sparse { rows, blocks, bits, order } => {
            assert!(order.is_none(), "all pairs keep the boxes' own order");
            let words = section(rows).iter().zip(section(blocks)).zip(section(bits));
            words
                .flat_map(|((row, block), bits)| {
                    pairmask::MaskWord(*bits).bits().map(move |bit| (*row, 32 * block + bit))
                })
                .collect()
        }
    }
}

/// All overlapping pairs, by the definition.
pub fn reference(boxes: &[Aabb]) -> Vec<(u32, u32)> {
    let keys: Vec<_> = boxes.iter().map(pairmask::aabb::KeyBox::from).collect();
    let mut pairs = Vec::new();
    for (a, key) in keys.iter().enumerate() {
        let later = keys.iter().enumerate().skip(a + 1);
        pairs.extend(later.filter(|(_, k)| key.overlaps(k)).map(|(b, _)| (a as u32, b as u32)));
    }
    pairs
}

/// A fixed sequence of pseudo-random numbers (splitmix64).
pub struct Numbers(pub u64);

impl Numbers {
    /// The next number.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// In 0..1.
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// `n` boxes of equal size with about `n` overlapping pairs.
pub fn uniform(n: usize, seed: u64) -> Vec<Aabb> {
    let mut numbers = Numbers(seed);
    // Two boxes of edge e overlap with probability (2e)^3 in a unit cube: n²/2 · 8e³ = n.
    let edge = (1.0 / (4.0 * n.max(1) as f32)).cbrt();
    (0..n)
        .map(|_| {
            let min = [numbers.unit(), numbers.unit(), numbers.unit()];
            Aabb { min, max: min.map(|x| x + edge) }
        })
        .collect()
}

/// `n` boxes whose corners are drawn from the awkward numbers: subnormals, both zeros, infinities,
/// NaN, the largest magnitudes, neighbours of one another. Many touch, many are empty.
pub fn awkward(n: usize, seed: u64) -> Vec<Aabb> {
    const VALUES: [f32; 16] = [
        f32::NEG_INFINITY,
        -3.0e38,
        f32::MIN,
        -1.0,
        -f32::MIN_POSITIVE,
        -1.0e-45,
        -0.0,
        0.0,
        1.0e-45,
        3.0e-45,
        f32::MIN_POSITIVE,
        1.0,
        1.000_000_1,
        3.0e38,
        f32::MAX,
        f32::INFINITY,
    ];
    let mut numbers = Numbers(seed);
    (0..n)
        .map(|_| {
            let mut corner = || VALUES[(numbers.bits() % 16) as usize];
            let (mut min, mut max) = ([0.0; 3], [0.0; 3]);
            for axis in 0..3 {
                let (a, b) = (corner(), corner());
                (min[axis], max[axis]) = if a <= b { (a, b) } else { (b, a) };
            }
            match numbers.bits() % 32 {
                0 => min[(numbers.bits() % 3) as usize] = f32::NAN,
                1 => max[(numbers.bits() % 3) as usize] = -f32::NAN,
                2 => std::mem::swap(&mut min, &mut max),
                3 => return Aabb::EMPTY,
                _ => {}
            }
            Aabb { min, max }
        })
        .collect()
}
