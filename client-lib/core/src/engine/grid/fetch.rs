//! Boxes out of their records, into the order of their cells.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;

use super::homes::REACH_SHIFT;
use super::level::Reach;
use super::tile::Record;
use crate::aabb::{Aabb, order_key};
use crate::engine::AvailableIsa;
#[cfg(target_arch = "x86_64")]
use crate::engine::Isa;
use crate::engine::strips::KeyArraysMut;

/// Each position's box out of its record, whose number `order` holds. All are of one length.
pub(super) fn fetch(
    records: &[Record],
    keys: &mut KeyArraysMut<'_>,
    order: &mut [u32],
    reach: &mut [Reach],
    isa: AvailableIsa,
) {
    let done = match isa.get() {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => avx512::fetch(records, keys, order, reach, isa),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => avx2::fetch(records, keys, order, reach, isa),
        _ => 0,
    };
    let mut rest = keys.each_mut().map(|array| &mut array[done..]);
    fetch_portable(records, &mut rest, &mut order[done..], &mut reach[done..]);
}

fn fetch_portable(
    records: &[Record],
    keys: &mut KeyArraysMut<'_>,
    order: &mut [u32],
    reach: &mut [Reach],
) {
    let [min_x, min_y, min_z, max_x, max_y, max_z] = keys;
    let mins = min_x.iter_mut().zip(min_y.iter_mut()).zip(min_z.iter_mut());
    let maxs = max_x.iter_mut().zip(max_y.iter_mut()).zip(max_z.iter_mut());
    let rest = order.iter_mut().zip(reach);
    for ((((x0, y0), z0), ((x1, y1), z1)), (order, reach)) in mins.zip(maxs).zip(rest) {
        let record = &records[*order as usize];
        let Aabb { min, max } = &record.aabb;
        (*x0, *y0, *z0) = (bits(min[0]), bits(min[1]), bits(min[2]));
        (*x1, *y1, *z1) = (bits(max[0]), bits(max[1]), bits(max[2]));
        *order = record.index;
        *reach = (record.home >> REACH_SHIFT) as Reach;
    }
    for array in keys {
        for key in array.iter_mut() {
            *key = order_key(*key as u32);
        }
    }
}

fn bits(x: f32) -> i32 {
    x.to_bits() as i32
}

#[cfg(test)]
mod tests {
    use super::*;
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
