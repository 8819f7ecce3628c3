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
