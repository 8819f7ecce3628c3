//! The same where cells do not part the boxes: in a tree of all boxes as they are, and another one of what those were that
//! have changed.
//!
//! A pair of a box that has changed and one that has not is found around what the first one was and is. A pair of two
//! changed boxes is found there too if they overlap now, and among what they were if they overlapped. What is found twice
//! is one change, as in cells.

use super::{Bound, Centre, Seen};
use crate::aabb::{Aabb, is_valid};
use crate::cancel::{Cancel, Pace};
use crate::cast::{Ahead, BoxTree};
use crate::scene::cells::{CHANGED, Candidate, Probe, STATIC};
use crate::scene::change::WasIs;
use crate::scene::pair_list::Difference;
use crate::scene::states;
use crate::scene::store::Store;
use crate::team::{in_parts, part_count};
use crate::test_budget::TestLot;

/// Changed boxes of a task, at least: some 100 µs.
const TASK_BOXES: usize = 32;

/// A box of the scene as searches in cells find it.
fn candidate(index: u32, store: &Store) -> Candidate {
    let flag = |state, flag| if store.states.has(index, state) { flag } else { 0 };
    let word = index | flag(states::CHANGED, CHANGED) | flag(states::STILL, STATIC);
    Candidate { probe: 0, word, is_sure: false }
}

/// One thread's searches.
#[derive(Default)]
struct Search {
    ahead: Ahead,
    near: Vec<u32>,
    looked_at: u64,
    found: Difference,
}

impl Search {
    /// Looks in both trees for changes of a box.
    fn look_around(&mut self, centre: &Centre, [now, were]: [&BoxTree; 2], store: &Store) {
        let Self { ahead, near, looked_at, found } = self;
        let (was, changed) = (centre.b.was.b, store.changed());
        centre.probes(|seen, probe| {
            let here = match probe {
                Probe::Both { was, is, .. } => Aabb::swept(&was, &is),
                Probe::One { here, .. } => here,
            };
            near.clear();
            *looked_at += now.add_overlapping(&here, ahead, near);
            // An infinite box overlaps also what stands for no box.
            for other in near.iter().filter(|other| (**other as usize) < store.boxes().len()) {
                centre.report_changes(seen, &candidate(*other, store), store, found);
            }
        });
        if is_valid(&was) {
            near.clear();
            *looked_at += were.add_overlapping(&was, ahead, near);
            for other in near.iter().filter_map(|number| changed.get(*number as usize)) {
                centre.report_changes(Seen::Was, &candidate(*other, store), store, found);
            }
        }
    }
}

/// What differs from then to now, in no order, some of it twice; and how many boxes and groups were looked at. `None`
/// where these are more than `looks`, what differs more than so many pairs, or nobody waits for them.
pub fn find(
    tree: &BoxTree,
    store: &Store,
    threads: usize,
    looks: u64,
    (most, cancel): (u64, &Cancel),
) -> Option<(Difference, u64)> {
    let changed = store.changed();
    let was = |index: &u32| store.before(*index).map_or(Aabb::EMPTY, |was| was.b);
    let were: Vec<Aabb> = changed.iter().map(was).collect();
    let were = BoxTree::unless(cancel, &were, threads)?;
    let bound = Bound::new(looks as i64, most, cancel);
    let parts = part_count(changed.len(), TASK_BOXES, threads);
    let step = changed.len().div_ceil(parts).max(1);
    let mut work: Vec<&[u32]> = changed.chunks(step).collect();
    let run = |work: &mut [&[u32]]| {
        let mut search = Search::default();
        let (mut lot, mut pace, mut counted) = (TestLot::default(), Pace::default(), 0);
        for index in work.iter().flat_map(|changed| *changed) {
            let before = search.looked_at;
            let centre = Centre { index: *index, b: WasIs::of(*index, store) };
            search.look_around(&centre, [tree, &were], store);
            let here = search.looked_at - before;
            lot.take(here as i64, &bound.tests);
            bound.count(&search.found, &mut counted);
            if bound.cancel.look_after(here, &mut pace) || bound.is_spent() {
                break;
            }
        }
        (search.found, search.looked_at)
    };
    let found =
        in_parts(work.as_mut_slice(), parts, &run, &|(low, a), (high, b)| (low.with(high), a + b));
    (!bound.is_spent()).then_some(found)
}

#[cfg(test)]
mod tests {
    use crate::aabb::Aabb;
    use crate::backoff::Backoff;
    use crate::filters::{FilterData, World};
    use crate::scene::{
        Edit, FilterDataSets, Known, Report, Reported, Scene, SceneOptions, Sets, Step,
    };

    /// Numbers that look like random ones.
    struct Numbers(u32);

    impl Numbers {
        fn below(&mut self, limit: u32) -> u32 {
            self.0 = self.0.wrapping_mul(2_891_336_453).wrapping_add(747_796_405);
            (self.0 >> 10) % limit
        }

        /// Boxes of all kinds: crossing straps, cubes, infinite ones, at infinity, points, none.
        fn any_box(&mut self) -> Aabb {
            let min = [0; 3].map(|_| self.below(64) as f32);
            let edges = [[40.0, 0.5, 1.0], [0.5, 40.0, 1.0], [4.0; 3]][self.below(3) as usize];
            let max = [0, 1, 2].map(|axis| min[axis] + edges[axis]);
            let infinite = f32::INFINITY;
            match self.below(24) {
                0 => Aabb::new([-infinite; 3], [infinite, 5.0, infinite]),
                1 => Aabb::new([infinite, 0.0, 0.0], [infinite, 9.0, 9.0]),
                2 => Aabb::new(max, min),
                3 => Aabb::new([f32::NAN; 3], max),
                4 => Aabb::point(min),
                _ => Aabb::new(min, max),
            }
        }

        fn some(&mut self, most: u32, limit: u32) -> Vec<u32> {
            let count = self.below(most + 1);
            let mut some: Vec<u32> = (0..count).map(|_| self.below(limit)).collect();
            some.sort_unstable();
            some.dedup();
            some
        }
    }

    /// All that an answer says of pairs.
    fn news(reported: &Reported) -> String {
        let (begun, ended, pairs) = (reported.begun(), reported.ended(), reported.pairs());
        format!("{:?} {begun:?} {ended:?} {pairs:?}", (reported.pair_count(), reported.is_resync()))
    }

    #[test]
    fn a_tree_reports_what_cells_do() {
        let (mut numbers, mut by_tree) = (Numbers(7), 0);
        for threads in [1, 3] {
            let scene = || Scene::new(SceneOptions::default().with_threads(threads));
            let (mut scene, mut crowded) = (scene(), scene());
            for turn in 0..400 {
                let at = |numbers: &mut Numbers| numbers.some(12, 400);
                let all: Vec<u32> = (0..400).collect();
                let set = if turn % 100 == 0 { all } else { at(&mut numbers) };
                let boxes: Vec<Aabb> = set.iter().map(|_| numbers.any_box()).collect();
                let gone = if turn % 3 == 1 { at(&mut numbers) } else { Vec::new() };
                let lives = |index: &u32| scene.get(*index).is_some() && !gone.contains(index);
                let [off, still, filtered] = [0; 3].map(|_| {
                    let mut some = at(&mut numbers);
                    some.retain(|index| turn % 4 == 2 && lives(index));
                    some
                });
                let gone: Vec<u32> =
                    gone.iter().copied().filter(|i| scene.get(*i).is_some()).collect();
                let world = FilterData::default().with_world(World(numbers.below(2) as i32));
                let filter_data = vec![world; filtered.len()];
                let indices = (&filtered).into();
                let steps = [
                    Step::Remove((&gone).into()),
                    Step::Set(Sets { indices: (&set).into(), boxes: &boxes }),
                    Step::Enable((&off).into(), numbers.below(2) == 0),
                    Step::Static((&still).into(), numbers.below(3) > 0),
                    Step::FilterData(FilterDataSets { indices, filter_data: &filter_data }),
                ];
                let report = [Report::Changes, Report::Changes, Report::Moved, Report::All]
                    [numbers.below(4) as usize];
                crowded.crowded.failed();
                crowded.cells = None;
                let edit = Edit { steps: &steps };
                let expected = news(scene.edit(edit, report).expect("a right edit"));
                let found = news(crowded.edit(edit, report).expect("a right edit"));
                assert_eq!(found, expected, "{threads} threads, turn {turn}, {report:?}");
                assert!(crowded.cells.is_none());
                by_tree += u32::from(crowded.known == Known::Few && report == Report::Changes);
                if numbers.below(3) > 0 {
                    scene.acknowledge();
                    crowded.acknowledge();
                }
            }
        }
        assert!(by_tree > 200, "{by_tree}");
    }

    /// Two layers of straps that cross.
    fn strap(i: u32, at: f32) -> Aabb {
        let layer = (i % 2) as f32;
        let (min, max) = ([0.0, at, layer], [4_000.0, at + 0.2, layer + 0.4]);
        let turned = |[x, y, z]: [f32; 3]| if i.is_multiple_of(2) { [x, y, z] } else { [y, x, z] };
        Aabb::new(turned(min), turned(max))
    }

    #[test]
    fn edits_of_woven_straps_leave_cells_and_go_on_with_a_tree() {
        const COUNT: u32 = 3_000;
        let mut numbers = Numbers(1);
        let mut place = |i: u32| strap(i, numbers.below(40_000) as f32 / 10.0);
        let mut boxes: Vec<Aabb> = (0..COUNT).map(&mut place).collect();
        let pairs = |boxes: &[Aabb]| {
            let row = |a: u32| (a + 1..COUNT).map(move |b| [a, b]);
            let overlap = |[a, b]: &[u32; 2]| boxes[*a as usize].overlaps(&boxes[*b as usize]);
            (0..COUNT).flat_map(row).filter(overlap).collect::<Vec<_>>()
        };
        let mut scene = Scene::new(SceneOptions::default().with_threads(1));
        let all = [Step::Set(Sets { indices: (0..COUNT).into(), boxes: &boxes })];
        scene.edit(Edit { steps: &all }, Report::Changes).expect("a right edit");
        scene.acknowledge();
        let (mut known, mut by_tree) = (pairs(&boxes), 0);
        for turn in 0..24 {
            let indices: Vec<u32> = (turn..COUNT).step_by(23).collect();
            let moved: Vec<Aabb> = indices.iter().map(|i| place(*i)).collect();
            for (index, b) in indices.iter().zip(&moved) {
                boxes[*index as usize] = *b;
            }
            let set = [Step::Set(Sets { indices: (&indices).into(), boxes: &moved })];
            let reported = scene.edit(Edit { steps: &set }, Report::Changes).expect("a right edit");
            let now = pairs(&boxes);
            let missing = |from: &[[u32; 2]], of: &[[u32; 2]]| {
                from.iter().copied().filter(|pair| of.binary_search(pair).is_err()).collect()
            };
            let [begun, ended]: [Vec<_>; 2] = [missing(&now, &known), missing(&known, &now)];
            assert_eq!(reported.begun(), begun, "{turn}");
            assert!(reported.ended().iter().map(|ended| ended.pair).eq(ended), "{turn}");
            scene.acknowledge();
            known = now;
            assert_ne!(scene.crowded, Backoff::NONE, "cells part these");
            by_tree += u32::from(scene.cells.is_none());
        }
        assert!(by_tree > 20, "{by_tree}");
    }
}
