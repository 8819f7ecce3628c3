//! Boxes out of their records, into the order of their cells.

use super::homes::REACH_SHIFT;
use super::level::Reach;
use super::tile::Record;
use crate::aabb::order_key;
use crate::engine::strips::KeyArraysMut;
use crate::simd::{MOST_LANES, per_isa};

per_isa! {
    /// Each position's box out of its record, whose number `order` holds. All are of one length.
    pub(super) fn fetch<simd: S>(
        records: &[Record],
        keys: &mut KeyArraysMut<'_>,
        order: &mut [u32],
        reach: &mut [Reach],
    ) {
        let mut homes = [0; MOST_LANES];
        let whole = order.len() / S::LANES * S::LANES;
        for first in (0..whole).step_by(S::LANES) {
            let order: &mut [i32] = bytemuck::cast_slice_mut(&mut order[first..first + S::LANES]);
            let [coordinates @ .., index, home] =
                simd.words_of(|i| bytemuck::cast_ref(&records[order[i] as u32 as usize]));
            for (array, bits) in keys.iter_mut().zip::<[S::Keys; 6]>(coordinates) {
                simd.store(simd.order_keys(bits), &mut array[first..first + S::LANES]);
            }
            simd.store(index, order);
            simd.store(home, &mut homes);
            for (reach, home) in reach[first..first + S::LANES].iter_mut().zip(homes) {
                *reach = (home as u32 >> REACH_SHIFT) as Reach;
            }
        }
        for at in whole..order.len() {
            let record = &records[order[at] as usize];
            let [coordinates @ .., _, _]: &[u32; 8] = bytemuck::cast_ref(record);
            for (array, bits) in keys.iter_mut().zip::<&[u32; 6]>(coordinates) {
                array[at] = order_key(*bits);
            }
            order[at] = record.index;
            reach[at] = (record.home >> REACH_SHIFT) as Reach;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aabb::Aabb;
    use crate::engine::{AvailableIsa, Isa};
    use bytemuck::Zeroable;

    #[test]
    fn every_instruction_set_fetches_the_same_boxes() {
        let records: Vec<Record> = (0..100u32)
            .map(|i| {
                let word = |k: u32| (8 * i + k).wrapping_mul(0x9e37_79b9);
                let coordinate = |k: u32| match word(k) % 9 {
                    0 => -0.0,
                    1 => f32::NEG_INFINITY,
                    _ => f32::from_bits(word(k)),
                };
                let aabb = Aabb {
                    min: std::array::from_fn(|axis| coordinate(axis as u32)),
                    max: std::array::from_fn(|axis| coordinate(3 + axis as u32)),
                };
                Record { aabb, index: word(6), home: word(7) }
            })
            .collect();
        for len in [0, 1, 15, 16, 17, 33, 80] {
            let sources: Vec<u32> = (0..len).map(|i| i * 37 % 100).collect();
            let mut expected = None;
            for isa in Isa::ALL.into_iter().filter_map(AvailableIsa::new) {
                let (mut keys, mut order) = (<[Vec<i32>; 6]>::default(), sources.clone());
                for array in &mut keys {
                    array.resize(len as usize, 7);
                }
                let mut reach = vec![Reach::zeroed(); len as usize];
                let mut arrays = keys.each_mut().map(Vec::as_mut_slice);
                fetch(&records, &mut arrays, &mut order, &mut reach, isa);
                for (i, source) in sources.iter().enumerate() {
                    let record = &records[*source as usize];
                    assert_eq!(order[i], record.index);
                    assert_eq!(u32::from(reach[i]), record.home >> REACH_SHIFT);
                    assert_eq!(keys[5][i], order_key(record.aabb.max[2].to_bits()));
                }
                let got = (keys, order, reach);
                assert_eq!(expected.get_or_insert_with(|| got.clone()), &got, "{}", isa.get());
            }
        }
    }
}
