//! Many boxes set at once, by a range of indices: in parts, side by side.

use super::{Store, are_same};
use crate::aabb::Aabb;
use crate::scene::states::{CHANGED, DISABLED, EDIT_SETS, NAMED, PRESENT};
use crate::team::{in_parts, part_count};

/// Fewest boxes of an edit that is applied so.
const BOXES_LEAST: usize = 8_192;
const TASK_BOXES: usize = 4_096;

/// Some indices of the range, and what is kept of them.
struct Part<'a> {
    first: u32,
    set: &'a [Aabb],
    boxes: &'a mut [Aabb],
    then: &'a mut [Aabb],
    bits: &'a mut [u8],
}

/// What a part has come across.
#[derive(Default)]
struct Noted {
    inserted: usize,
    any_differs: bool,
    /// Those that changed for the first time.
    changed: Vec<u32>,
    /// Those that are disabled, which stay so.
    disabled: Vec<(u32, Aabb)>,
}

impl Noted {
    fn with(mut self, mut later: Self) -> Self {
        self.changed.append(&mut later.changed);
        self.disabled.append(&mut later.disabled);
        Self {
            inserted: self.inserted + later.inserted,
            any_differs: self.any_differs | later.any_differs,
            ..self
        }
    }
}

impl Store {
    /// Whether boxes of a range are better set by [`Self::set_range`].
    pub(super) const fn is_long(set: &[Aabb]) -> bool {
        set.len() >= BOXES_LEAST
    }

    /// Sets boxes from an index on. There is room for them, and the edit has set none of these yet.
    pub(super) fn set_range(&mut self, first: u32, set: &[Aabb], threads: usize) {
        let range = first as usize..first as usize + set.len();
        let parts = part_count(set.len(), TASK_BOXES, threads);
        let step = set.len().div_ceil(parts).max(1);
        let firsts = (first..).step_by(step);
        let arrays = self.boxes[range.clone()]
            .chunks_mut(step)
            .zip(self.then[range.clone()].chunks_mut(step))
            .zip(self.states.bits_mut()[range].chunks_mut(step));
        let mut work: Vec<Part<'_>> = firsts
            .zip(set.chunks(step).zip(arrays))
            .map(|(first, (set, ((boxes, then), bits)))| Part { first, set, boxes, then, bits })
            .collect();
        let run = |work: &mut [Part<'_>]| {
            work.iter_mut().map(Part::run).fold(Noted::default(), Noted::with)
        };
        let mut noted = in_parts(work.as_mut_slice(), parts, &run, &Noted::with);
        self.states.note_inserted(noted.inserted);
        self.is_changed |= noted.any_differs;
        self.named.extend(first..first + set.len() as u32);
        if self.changed.is_empty() {
            self.changed = noted.changed;
        } else {
            self.changed.append(&mut noted.changed);
        }
        self.disabled.extend(noted.disabled);
    }
}

impl Part<'_> {
    fn run(&mut self) -> Noted {
        let mut noted = Noted { changed: Vec::with_capacity(self.set.len()), ..Noted::default() };
        let kept = self.boxes.iter_mut().zip(self.then.iter_mut()).zip(self.bits.iter_mut());
        for ((index, set), ((b, then), bits)) in (self.first..).zip(self.set).zip(kept) {
            noted.inserted += usize::from(*bits & PRESENT == 0);
            *bits = *bits & !EDIT_SETS | PRESENT | NAMED;
            if *bits & DISABLED != 0 {
                noted.disabled.push((index, *set));
                continue;
            }
            if are_same(b, set) {
                continue;
            }
            noted.any_differs = true;
            if *bits & CHANGED == 0 {
                *bits |= CHANGED;
                noted.changed.push(index);
                *then = *b;
            }
            *b = *set;
        }
        noted
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::edit::{Edit, Indices, Sets, Step};
    use super::*;

    const LONG: u32 = BOXES_LEAST as u32;

    /// What is kept, but for the order in which lists name indices.
    fn seen(store: &Store) -> impl PartialEq + use<> {
        let sorted = |list: &[u32]| {
            let mut list = list.to_vec();
            list.sort_unstable();
            list
        };
        let boxes: Vec<[u32; 6]> = store.boxes().iter().map(|b| bytemuck::cast(*b)).collect();
        let lists = [store.named(), store.changed(), store.ended()].map(sorted);
        let bits = store.states.bits().to_vec();
        let counts = [store.states.present(), store.states.active(), store.disabled.len()];
        (boxes, bits, lists, counts, store.is_changed())
    }

    fn boxes(n: u32, tick: u32) -> Vec<Aabb> {
        let at = |i: u32| ((i * 7 + i % 3 * tick) % 999) as f32;
        (0..n).map(|i| Aabb::point([at(i), 0.0, 0.0])).collect()
    }

    #[test]
    fn long_ranges_set_what_lists_do_beside_other_steps_too() {
        let (mut by_ranges, mut by_lists) = (Store::default(), Store::default());
        let removed = [3, LONG + 1];
        let off = [5, LONG, 2 * LONG + 6];
        for tick in 0..6 {
            let firsts = [0, LONG, 2 * LONG + 5];
            let counts = [LONG, if tick == 1 { 9 } else { LONG + 5 }, LONG];
            let sets: Vec<(u32, Vec<Aabb>)> =
                firsts.into_iter().zip(counts).map(|(first, n)| (first, boxes(n, tick))).collect();
            let lists: Vec<Vec<u32>> = sets
                .iter()
                .map(|(first, set)| (*first..first + set.len() as u32).collect())
                .collect();
            let mut edits = [Vec::new(), Vec::new()];
            for ((first, set), list) in sets.iter().zip(&lists) {
                let range = Indices::Range { first: *first, count: set.len() as u32 };
                edits[0].push(Step::Set(Sets { indices: range, boxes: set }));
                edits[1].push(Step::Set(Sets { indices: list.into(), boxes: set }));
            }
            let others = [
                Step::Remove(Indices::List(if tick == 3 { &removed } else { &[] })),
                Step::Enable(Indices::List(if tick == 2 { &off } else { &[] }), false),
            ];
            // Without other steps, ranges are not checked one by one.
            if tick > 1 {
                for steps in &mut edits {
                    steps.extend(others);
                }
            }
            let threads = 1 + tick as usize % 3;
            for (store, steps) in [&mut by_ranges, &mut by_lists].into_iter().zip(&edits) {
                assert_eq!(store.apply(Edit { steps }, 1 << 20, threads), Ok(()));
            }
            assert!(seen(&by_ranges) == seen(&by_lists), "tick {tick}");
            if tick == 4 {
                by_ranges.discard();
                by_lists.discard();
            }
        }
        // Ranges that name an index twice are refused, also where they fall.
        let set = boxes(LONG, 9);
        let step = |first| Step::Set(Sets { indices: (first..first + LONG).into(), boxes: &set });
        for steps in [[step(0), step(LONG - 1)], [step(LONG - 1), step(0)]] {
            assert!(by_ranges.apply(Edit { steps: &steps }, 1 << 20, 2).is_err());
            let right = [step(LONG), step(0)];
            assert_eq!(by_ranges.apply(Edit { steps: &right }, 1 << 20, 2), Ok(()));
        }
    }
}
