//! Many boxes set at once, by a range of indices or by a list in which they rise: in parts, side by side.

use super::{AHEAD, Store, are_same};
use crate::aabb::Aabb;
use crate::fetch::ask_for;
use crate::scene::edit::Indices;
use crate::scene::states::{CHANGED, DISABLED, EDIT_SETS, NAMED, PRESENT};
use crate::team::{in_parts, part_count};

/// Fewest boxes of an edit that is applied so.
const BOXES_LEAST: usize = 8_192;
const TASK_BOXES: usize = 4_096;

/// Indices that rise.
#[derive(Clone, Copy)]
pub(super) enum Rising<'a> {
    From(u32),
    List(&'a [u32]),
}

impl<'a> Rising<'a> {
    /// Those of so many boxes that are better set by [`Store::set_rising`].
    pub fn of(indices: Indices<'a>, count: usize) -> Option<Self> {
        match indices {
            _ if count < BOXES_LEAST => None,
            Indices::Range { first, .. } => Some(Self::From(first)),
            Indices::List(list) if list.is_sorted_by(|a, b| a < b) => Some(Self::List(list)),
            _ => None,
        }
    }

    /// The indices of a mask of so many, which rise, as a list, where they are better set so.
    pub fn listed(indices: Indices<'_>, count: usize) -> Option<Vec<u32>> {
        if !matches!(indices, Indices::Mask { .. }) || count < BOXES_LEAST {
            return None;
        }
        let mut list = Vec::with_capacity(count);
        indices.for_each(|_, index| list.push(index));
        Some(list)
    }

    #[inline(always)]
    fn at(&self, at: usize) -> u32 {
        match self {
            Self::From(first) => first + at as u32,
            Self::List(list) => list[at],
        }
    }

    fn part(&self, start: usize, count: usize) -> Self {
        match self {
            Self::From(first) => Self::From(first + start as u32),
            Self::List(list) => Self::List(&list[start..start + count]),
        }
    }
}

/// Some of the indices, and what is kept of all from the first to the last of them.
struct Part<'a> {
    indices: Rising<'a>,
    set: &'a [Aabb],
    boxes: &'a mut [Aabb],
    then: &'a mut [Aabb],
    bits: &'a mut [u8],
    named: &'a mut [u32],
    /// Room for those that change for the first time.
    changed: &'a mut [u32],
}

/// What a part has come across.
#[derive(Default)]
struct Noted {
    inserted: usize,
    any_differs: bool,
    /// How many of each part changed for the first time.
    changed: Vec<usize>,
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

/// What is kept of indices from `first` on: that of a range of them, and that of those behind it.
fn split<'a, T>(
    all: &'a mut [T],
    first: usize,
    range: &std::ops::Range<usize>,
) -> (&'a mut [T], &'a mut [T]) {
    all[range.start - first..].split_at_mut(range.len())
}

impl Store {
    /// Sets boxes of indices that rise. There is room for them, and the edit has set none of these yet.
    pub(super) fn set_rising(&mut self, indices: Rising<'_>, set: &[Aabb], threads: usize) {
        let parts = part_count(set.len(), TASK_BOXES, threads);
        let step = set.len().div_ceil(parts).max(1);
        let (named_before, changed_before) = (self.named.len(), self.changed.len());
        self.named.resize(named_before + set.len(), 0);
        self.changed.resize(changed_before + set.len(), 0);
        let named = self.named[named_before..].chunks_mut(step);
        let changed = self.changed[changed_before..].chunks_mut(step);
        let mut rest =
            (self.boxes.as_mut_slice(), self.then.as_mut_slice(), self.states.bits_mut(), 0);
        let mut work = Vec::with_capacity(parts);
        for ((start, set), (named, changed)) in
            (0..).step_by(step).zip(set.chunks(step)).zip(named.zip(changed))
        {
            let indices = indices.part(start, set.len());
            let part = indices.at(0) as usize..indices.at(set.len() - 1) as usize + 1;
            let (boxes, later_boxes) = split(rest.0, rest.3, &part);
            let (then, later_then) = split(rest.1, rest.3, &part);
            let (bits, later_bits) = split(rest.2, rest.3, &part);
            rest = (later_boxes, later_then, later_bits, part.end);
            work.push(Part { indices, set, boxes, then, bits, named, changed });
        }
        let run = |work: &mut [Part<'_>]| {
            work.iter_mut().map(Part::run).fold(Noted::default(), Noted::with)
        };
        let noted = in_parts(work.as_mut_slice(), parts, &run, &Noted::with);
        self.states.note_inserted(noted.inserted);
        self.is_changed |= noted.any_differs;
        self.disabled.extend(noted.disabled);
        // What each part has noted moves up to that of the one before.
        let mut end = changed_before;
        for (start, count) in (changed_before..).step_by(step).zip(noted.changed) {
            if start > end {
                self.changed.copy_within(start..start + count, end);
            }
            end += count;
        }
        self.changed.truncate(end);
    }
}

impl Part<'_> {
    fn run(&mut self) -> Noted {
        let Self { indices, set, boxes, then, bits, named, changed } = self;
        let (mut noted, mut change_count) = (Noted::default(), 0);
        let base = indices.at(0);
        for (at, set) in set.iter().enumerate() {
            if let Rising::List(list) = indices
                && let Some(ahead) = list.get(at + AHEAD)
            {
                ask_for(boxes, ahead - base);
                ask_for(then, ahead - base);
            }
            let index = indices.at(at);
            let own = (index - base) as usize;
            let bits = &mut bits[own];
            noted.inserted += usize::from(*bits & PRESENT == 0);
            *bits = *bits & !EDIT_SETS | PRESENT | NAMED;
            named[at] = index;
            if *bits & DISABLED != 0 {
                noted.disabled.push((index, *set));
                continue;
            }
            let b = &mut boxes[own];
            if are_same(b, set) {
                continue;
            }
            noted.any_differs = true;
            if *bits & CHANGED == 0 {
                *bits |= CHANGED;
                changed[change_count] = index;
                change_count += 1;
                then[own] = *b;
            }
            *b = *set;
        }
        noted.changed.push(change_count);
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
    fn long_ranges_and_rising_lists_set_what_other_lists_do() {
        let [mut by_ranges, mut by_rising, mut one_by_one] = [(); 3].map(|()| Store::default());
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
            let falling = |list: &Vec<u32>| list.iter().rev().copied().collect::<Vec<_>>();
            let fallen: Vec<Vec<u32>> = lists.iter().map(falling).collect();
            let turned = |(_, set): &(u32, Vec<Aabb>)| set.iter().rev().copied().collect();
            let turned: Vec<Vec<Aabb>> = sets.iter().map(turned).collect();
            let mut edits = [Vec::new(), Vec::new(), Vec::new()];
            for (at, (first, set)) in sets.iter().enumerate() {
                let range = Indices::Range { first: *first, count: set.len() as u32 };
                edits[0].push(Step::Set(Sets { indices: range, boxes: set }));
                edits[1].push(Step::Set(Sets { indices: (&lists[at]).into(), boxes: set }));
                let (indices, boxes) = ((&fallen[at]).into(), &turned[at][..]);
                edits[2].push(Step::Set(Sets { indices, boxes }));
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
            let stores = [&mut by_ranges, &mut by_rising, &mut one_by_one];
            for (store, steps) in stores.into_iter().zip(&edits) {
                assert_eq!(store.apply(Edit { steps }, 1 << 20, threads), Ok(()));
                // Indices that rise with gaps between them.
                let mut some: Vec<u32> = (0..LONG).map(|i| 2 * i + i % 2).collect();
                let mut set = boxes(LONG, 9 * tick);
                if steps.as_ptr() == edits[2].as_ptr() {
                    some.reverse();
                    set.reverse();
                }
                let mut words = vec![0u32; 2 * LONG.div_ceil(32) as usize];
                for index in &some {
                    words[*index as usize / 32] |= 1 << (index % 32);
                }
                let is_masked = steps.as_ptr() == edits[0].as_ptr();
                let mask = Indices::Mask { first: 0, words: &words };
                let indices = if is_masked { mask } else { (&some).into() };
                let gaps = [Step::Set(Sets { indices, boxes: &set })];
                assert_eq!(store.apply(Edit { steps: &gaps }, 1 << 20, threads), Ok(()));
                if tick == 4 {
                    store.discard();
                }
            }
            for store in [&by_ranges, &by_rising] {
                assert!(seen(store) == seen(&one_by_one), "tick {tick}");
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
