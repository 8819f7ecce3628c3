//! The list encoding: the pairs themselves, smaller index first, sorted.

use super::{EncodingCost, FoundWords};
use crate::engine::cost::terms;
use crate::engine::gather::Gather;
use crate::engine::{CostTerm, CullError, ReplyBuffer};
use crate::mask::MaskShape;
use crate::stats::SceneStats;

terms! {
    /// A pair: written, sorted, copied by the client.
    PAIR = CostTerm::new("list-pair", 60.0);
}

/// What lists take.
pub(super) const COST: EncodingCost = EncodingCost { terms: TERMS, work };

fn work(stats: &SceneStats, _has_order: bool, amounts: &mut [f64]) {
    // One more, so that a scene without pairs has a sparse mask.
    amounts[PAIR] = stats.expected_pairs() + 1.0;
}

/// Writes the pairs of the words of all tasks, and sorts them.
pub(super) fn write<'a, W: FoundWords + 'a>(
    tasks: impl Iterator<Item = &'a W> + Clone,
    gather: &Gather<'_>,
    reply: &mut dyn ReplyBuffer,
) -> Result<MaskShape, CullError> {
    let words = || {
        tasks.clone().flat_map(FoundWords::chunks).flat_map(|[rows, blocks, bits]| {
            rows.iter().zip(blocks).zip(bits).map(|((row, block), bits)| (*row, *block, *bits))
        })
    };
    let pair_count = words().map(|(_, _, bits)| u64::from(bits.count_ones())).sum();
    let shape = MaskShape::list(pair_count);
    let (out, _) = reply.reserve(shape.extent_words())?.as_chunks_mut();
    let out = &mut out[..pair_count as usize];
    let index = |position: u32| gather.order.get(position as usize).copied().unwrap_or(position);
    let pairs = words().flat_map(|(row, block, bits)| {
        let columns = (0..32).filter(move |t| bits >> t & 1 != 0).map(move |t| 32 * block + t);
        columns.map(move |column| (row, column))
    });
    for (slot, (row, column)) in out.iter_mut().zip(pairs) {
        let (a, b) = (index(row), index(column));
        *slot = [a.min(b), a.max(b)];
    }
    out.sort_unstable();
    Ok(shape)
}

#[cfg(test)]
mod tests {
    use crate::engine::{CullInput, EngineName, HeapReply, Isa, ReplyBuffer, cpu_engine};
    use crate::mask::{Encoding, MaskView};
    use crate::units::BoxCount;
    use crate::{Aabb, oracle};

    #[test]
    fn a_small_scene_comes_back_as_a_list() {
        let boxes: Vec<Aabb> = (0..345)
            .map(|i| {
                let [x, y, z] = [i * 37 % 29, i * 53 % 31, i * 71 % 23].map(|x| x as f32);
                Aabb::from([x, y, z, x + 4.0, y + 5.0, z + 6.0])
            })
            .collect();
        let expected = oracle::truth(&boxes).pairs;
        assert!(expected.len() > 300);
        for name in EngineName::CPU {
            let mut engine = cpu_engine(name, Isa::best()).expect("of the CPU");
            for threads in [1, 2] {
                let mut reply = HeapReply::new();
                let input = CullInput::boxes(&boxes).encoding(Encoding::List).threads(threads);
                let report = engine.cull(&input, &mut reply).expect("a list");
                assert_eq!(report.shape.encoding(), Encoding::List);
                let mask = MaskView::new(BoxCount::new(345), &report.shape, reply.words());
                let mask = mask.expect("a list");
                assert_eq!(mask.verify(), Ok(()));
                assert_eq!(mask.to_vec(), expected, "{name}");
                assert_eq!(mask.count(), expected.len() as u64);
                assert_eq!(mask.words().count(), expected.len());
                for a in 0..345 {
                    for b in 0..345 {
                        let is_pair = expected.contains(&(a.min(b), a.max(b)));
                        assert_eq!(mask.contains(a, b), is_pair, "{a} {b}");
                    }
                }
                let naive = oracle::naive_decoder::decode(reply.words(), &report.shape, 345);
                assert_eq!(naive.as_ref(), Ok(&expected));
            }
        }
    }

    #[test]
    fn a_list_that_does_not_fit_is_refused() {
        let boxes = [Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]); 40];
        for name in EngineName::CPU {
            let mut engine = cpu_engine(name, Isa::best()).expect("of the CPU");
            let mut reply = HeapReply::with_limit_bytes(8 * 779);
            assert!(reply.limit_words() == 2 * 779);
            let input = CullInput::boxes(&boxes).encoding(Encoding::List);
            assert!(engine.cull(&input, &mut reply).is_err(), "{name}: 780 pairs");
        }
    }
}
