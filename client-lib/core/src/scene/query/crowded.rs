//! Queries among boxes that cells do not part: from the top of a tree down, which parts what crosses.

use super::Room;
use crate::aabb::{Aabb, KeyBox, is_valid};
use crate::cancel::Pace;
use crate::cast::{Ahead, BoxTree};
use crate::engine::CullError;
use crate::scene::pair_list::{Pair, sort_row};
use crate::team::{appended, in_parts, part_count};

/// Queries of a task, at least: some 50 µs.
const TASK_QUERIES: usize = 32;

/// Finds the boxes that queries overlap, by query and then by index. Returns how many boxes and groups were looked at.
pub(super) fn find(
    tree: &BoxTree,
    boxes: &[Aabb],
    queries: &[Aabb],
    threads: usize,
    room: &Room<'_>,
    found: &mut Vec<Pair>,
) -> Result<u64, CullError> {
    let parts = part_count(queries.len(), TASK_QUERIES, threads);
    let step = queries.len().div_ceil(parts).max(1);
    let mut work: Vec<(u32, &[Aabb])> = (0u32..).step_by(step).zip(queries.chunks(step)).collect();
    let run = |work: &mut [(u32, &[Aabb])]| {
        let (mut pairs, mut looked_at, mut pace) = (Vec::new(), 0, Pace::default());
        let (mut ahead, mut indices) = (Ahead::default(), Vec::new());
        for (first, queries) in work {
            for (number, query) in (*first..).zip(*queries) {
                // A copy: another process may write queries while they are read.
                let query = *query;
                if !is_valid(&query) {
                    continue;
                }
                indices.clear();
                let here = tree.add_overlapping(&query, &mut ahead, &mut indices);
                looked_at += here;
                let start = pairs.len();
                let keys = KeyBox::from(&query);
                let overlaps = |index: &u32| {
                    let b = boxes.get(*index as usize);
                    b.is_some_and(|b| keys.overlaps(&KeyBox::from(b)))
                };
                pairs.extend(indices.iter().filter(|index| overlaps(index)).map(|i| [number, *i]));
                sort_row(&mut pairs[start..]);
                let is_within = room.take(pairs.len() - start, 0);
                if !is_within || room.cancel.look_after(here, &mut pace) {
                    return (pairs, looked_at);
                }
            }
        }
        (pairs, looked_at)
    };
    let (pairs, looked_at) = in_parts(work.as_mut_slice(), parts, &run, &|(low, a), (high, b)| {
        (appended(low, high), a + b)
    });
    room.check()?;
    super::reserve(found, pairs.len())?;
    found.extend_from_slice(&pairs);
    Ok(looked_at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backoff::Backoff;
    use crate::cancel::Cancel;
    use crate::scene::query::{QueryFilterData, direct};
    use crate::scene::{Edit, Report, Scene, SceneOptions, Sets, Step};

    /// Boxes of all kinds: crossing straps, at infinity, infinite, points, subnormal, none.
    fn boxes(count: u32, salt: u32) -> Vec<Aabb> {
        let infinite = f32::INFINITY;
        let of = |i: u32| {
            let at = |k: u32| (i.wrapping_mul(2_654_435_761).wrapping_add(k * salt) >> 8) % 64;
            let min = [at(1) as f32, at(3) as f32, at(7) as f32];
            let edges = if i.is_multiple_of(2) { [40.0, 0.1, 0.5] } else { [0.1, 40.0, 0.5] };
            let max = std::array::from_fn(|axis| min[axis] + edges[axis]);
            match i % 23 {
                3 => Aabb::EMPTY,
                5 => Aabb::new([-infinite; 3], [infinite; 3]),
                7 => Aabb::new([infinite; 3], [infinite; 3]),
                9 => Aabb::new([f32::NAN, 0.0, 0.0], max),
                11 => Aabb::point([-0.0, f32::from_bits(i), 0.0]),
                13 => Aabb::point([0.0, f32::from_bits(i + 1), 0.0]),
                _ => Aabb::new(min, max),
            }
        };
        (0..count).map(of).collect()
    }

    #[test]
    fn a_tree_finds_what_each_box_compared_with_each_query_does() {
        let cancel = Cancel::never();
        for count in [1, 15, 16, 17, 300, 5_000] {
            let (boxes, queries) = (boxes(count, 40_503), boxes(200, 65_521));
            let tree = BoxTree::of(&boxes, 1);
            let room = |most| Room::new(most, queries.len(), boxes.len(), &cancel);
            let mut expected = Vec::new();
            let all = u64::from(u32::MAX);
            direct::find(&boxes, &queries, 1, &room(all), &mut expected).expect("room");
            for threads in [1, 3] {
                let mut found = Vec::new();
                find(&tree, &boxes, &queries, threads, &room(all), &mut found).expect("room");
                assert!(found == expected, "{count} boxes, {threads} threads");
                let most = expected.len() as u64;
                assert!(
                    find(&tree, &boxes, &queries, threads, &room(most), &mut Vec::new()).is_ok()
                );
                let refused =
                    find(&tree, &boxes, &queries, threads, &room(most - 1), &mut Vec::new());
                assert!(refused.is_err(), "more pairs than there is room for");
            }
        }
    }

    /// Two layers of straps that cross, which lie in cells as long as they are.
    fn straps(count: u32) -> Vec<Aabb> {
        let strap = |i: u32| {
            let (at, layer) = ((i * 37 % 5_003) as f32, (i % 2) as f32);
            let (min, long) = ([0.0, at, layer], [5_000.0, at + 0.2, layer + 0.4]);
            let turned =
                |[x, y, z]: [f32; 3]| if i.is_multiple_of(2) { [x, y, z] } else { [y, x, z] };
            Aabb::new(turned(min), turned(long))
        };
        (0..count).map(strap).collect()
    }

    #[test]
    fn pairs_that_were_counted_in_cells_count_once() {
        let boxes = straps(20_000);
        // Thin ones that stand: a few straps of each layer.
        let stands = |i: u32| {
            let [x, y] = [i * 23 % 4_999, i * 17 % 4_987].map(|x| x as f32);
            Aabb::new([x, y, 0.0], [x + 1.1, y + 1.1, 2.0])
        };
        let queries: Vec<Aabb> = (0..400).map(stands).collect();
        let (cancel, mut expected) = (Cancel::never(), Vec::new());
        let room = Room::new(u64::MAX, queries.len(), boxes.len(), &cancel);
        direct::find(&boxes, &queries, 1, &room, &mut expected).expect("room");
        let pairs = expected.len() as u64;
        for (most, is_found) in [(pairs, true), (pairs - 1, false)] {
            let mut scene = Scene::new(SceneOptions::default().with_threads(1));
            let all = [Step::Set(Sets { indices: (0..20_000).into(), boxes: &boxes })];
            scene.edit(Edit { steps: &all }, Report::Nothing).expect("right");
            scene.limit_query_pairs(most);
            let mut found = Vec::new();
            for turn in 0..3 {
                let asked = scene.query(&queries, QueryFilterData::None, &mut found);
                assert_eq!(asked.is_ok(), is_found, "{turn}");
                assert!(!is_found || found == expected, "{turn}");
            }
            assert_ne!(scene.asked.crowded, Backoff::NONE, "cells part these");
        }
    }
}
