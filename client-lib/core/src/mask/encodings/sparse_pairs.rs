//! Pairs of a sparse mask, with and without an order.

#[cfg(target_arch = "x86_64")]
mod avx512;
mod by_word;
#[cfg(target_arch = "x86_64")]
mod vbmi2;

#[cfg(target_arch = "x86_64")]
use self::vbmi2::Vbmi2;
use super::sparse_words::SparseWords;
use crate::isa::{AvailableIsa, Isa};
use crate::mask::pair_buffer::PairWriter;
use crate::units::BoxCount;

/// The pairs of the words of a sparse mask, in the order of the words, columns rising.
#[derive(Clone)]
pub(in crate::mask) struct SparsePairs<'a> {
    n: BoxCount,
    /// `n` positions, where there is one.
    order: Option<&'a [u32]>,
    words: SparseWords<'a>,
    kernel: Kernel,
}

/// How words become pairs.
#[derive(Clone, Copy, Debug)]
pub(in crate::mask::encodings) enum Kernel {
    /// [`by_word`].
    ByWord(AvailableIsa),
    /// Sixteen words at a time, then a look-up of each position.
    #[cfg(target_arch = "x86_64")]
    Avx512(AvailableIsa),
    /// Word by word; of masks with an order only.
    #[cfg(target_arch = "x86_64")]
    Vbmi2(Vbmi2),
}

impl Kernel {
    /// The fastest one of an instruction set and a mask.
    pub fn of(isa: AvailableIsa, has_order: bool) -> Self {
        let _ = has_order;
        match isa.get() {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => match Vbmi2::new(isa).filter(|_| has_order) {
                Some(proof) => Self::Vbmi2(proof),
                None => Self::Avx512(isa),
            },
            _ => Self::ByWord(isa),
        }
    }
}

impl<'a> SparsePairs<'a> {
    pub(in crate::mask::encodings) const fn new(
        n: BoxCount,
        order: Option<&'a [u32]>,
        words: SparseWords<'a>,
        kernel: Kernel,
    ) -> Self {
        Self { n, order, words, kernel }
    }

    /// Puts the pairs of words until there is no more room. False at the end of the mask; nothing
    /// may be put before it, where the mask is malformed.
    #[inline]
    pub fn write(&mut self, writer: &mut PairWriter) -> bool {
        match (self.kernel, self.order) {
            #[cfg(target_arch = "x86_64")]
            (Kernel::Vbmi2(proof), Some(order)) => vbmi2::write(self, order, writer, proof),
            #[cfg(target_arch = "x86_64")]
            (Kernel::Vbmi2(_), None) => by_word::write(self, writer, AvailableIsa::best()),
            #[cfg(target_arch = "x86_64")]
            (Kernel::Avx512(isa), _) => avx512::write(self, writer, isa),
            (Kernel::ByWord(isa), _) => by_word::write(self, writer, isa),
        }
    }

    /// Turns positions into boxes.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    fn name_boxes(&self, writer: &mut PairWriter) {
        if let Some(order) = self.order {
            writer.name_boxes(order);
            writer.drop_strays(self.n);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::collection::vec;
    use proptest::prelude::*;

    use super::super::PairSource;
    use super::*;
    use crate::mask::Pairs;

    /// The pairs by definition, one bit after the other in u64.
    fn naive(n: BoxCount, words: &[(u32, u32, u32)], order: Option<&[u32]>) -> Vec<[u32; 2]> {
        let n = u64::from(n.get());
        let mut pairs = Vec::new();
        for &(row, block, bits) in words {
            for t in (0..32).filter(|t| bits >> t & 1 != 0) {
                let column = 32 * u64::from(block) + t;
                if u64::from(row) >= column || column >= n {
                    continue;
                }
                let name = |at: u64| order.map_or(at as u32, |order| order[at as usize]);
                let (p, q) = (name(u64::from(row)), name(column));
                if p != q && u64::from(p.max(q)) < n {
                    pairs.push([p.min(q), p.max(q)]);
                }
            }
        }
        pairs
    }

    /// Numbers that are mostly below `n`, and now and then about `n`, as good as below it once high
    /// bits are lost, or anything.
    fn near(n: u32) -> impl Strategy<Value = u32> {
        prop_oneof![
            20 => 0..n.max(1),
            1 => n.saturating_sub(3)..n.saturating_add(3),
            1 => (0..n.max(1), 27u32..32).prop_map(|(x, s)| x | 1 << s),
            1 => any::<u32>(),
        ]
    }

    /// Bits of a word: at most `most` of them, or anything.
    fn bits(most: Option<usize>) -> BoxedStrategy<u32> {
        let some =
            |most| vec(0u32..32, 0..=most).prop_map(|bits| bits.iter().fold(0, |w, t| w | 1 << t));
        match most {
            Some(most) => some(most).boxed(),
            None => prop_oneof![20 => some(3), 1 => any::<u32>(), 1 => Just(u32::MAX)].boxed(),
        }
    }

    /// Each kernel that this machine can run on a mask.
    fn kernels(has_order: bool) -> Vec<Kernel> {
        let available = Isa::ALL.into_iter().filter_map(AvailableIsa::new);
        let all = available.flat_map(|isa| [Kernel::ByWord(isa), Kernel::of(isa, has_order)]);
        #[cfg(target_arch = "x86_64")]
        let all = all.chain(AvailableIsa::new(Isa::Avx512).map(Kernel::Avx512));
        all.collect()
    }

    type Case = (u32, Vec<(u32, u32, u32)>, Option<Vec<u32>>);

    fn case() -> impl Strategy<Value = Case> {
        let n = prop_oneof![0u32..70, Just(345), Just(1_234)];
        // Each limit is a kernel's, and one more.
        let most = proptest::sample::select(
            &[Some(1), Some(2), Some(4), Some(5), Some(8), Some(9), None][..],
        );
        (n, most).prop_flat_map(|(n, most)| {
            let words = vec((near(n), near(n.div_ceil(32)), bits(most)), 0..200);
            (Just(n), words, proptest::option::of(vec(near(n), n as usize)))
        })
    }

    proptest! {
        #[test]
        fn every_kernel_gives_the_pairs_of_any_words((n, words, order) in case()) {
            let n = BoxCount::new(n);
            let column = |i: fn(&(u32, u32, u32)) -> u32| words.iter().map(i).collect::<Vec<_>>();
            let (rows, blocks, bits) = (column(|w| w.0), column(|w| w.1), column(|w| w.2));
            let expected = naive(n, &words, order.as_deref());
            for kernel in kernels(order.is_some()) {
                let words = SparseWords::new(&rows, &blocks, &bits);
                let pairs = SparsePairs { n, order: order.as_deref(), words, kernel };
                let pairs = Pairs::of(PairSource::Sparse(pairs));
                prop_assert_eq!(&pairs.clone().collect::<Vec<_>>(), &expected, "{:?}", kernel);
                let folded = pairs.fold(Vec::new(), |mut all, pair| {
                    all.push(pair);
                    all
                });
                prop_assert_eq!(&folded, &expected, "{:?}", kernel);
            }
        }
    }
}
