//! Ops as the steps of an edit: those of one verb that follow each other are one step, with margins or without.

use pairmask::{Margin, SceneEdit};
use pairmask_core::Aabb;
use pairmask_core::filters::{FilterData, FilterTable};
use pairmask_core::scene::{FilterDataSets, Indices, Sets, Step, UserData, UserDataSets};

use super::script::{Op, Pair};
use crate::stress_scenes::Rng;

/// Ops of one verb that follow each other, with what they hold side by side.
#[derive(Debug, Default)]
struct Group {
    indices: Vec<u32>,
    /// The indices as bits, where they rise and are no range.
    words: Vec<u32>,
    boxes: Vec<Aabb>,
    filter_data: Vec<FilterData>,
    user_data: Vec<UserData>,
    pairs: Vec<Pair>,
    table: FilterTable,
}

impl Group {
    fn of(ops: &[Op]) -> Self {
        let mut group = Self::default();
        for op in ops {
            match op {
                Op::Include(pair, _) | Op::Exclude(pair, _) => group.pairs.push(*pair),
                Op::Filters(filters) => {
                    group.table = FilterTable::new(filters).expect("few filters");
                }
                _ => group.indices.extend(op.indices()),
            }
            match op {
                Op::Set(_, b) => group.boxes.push(*b),
                Op::FilterData(_, filter_data) => group.filter_data.push(*filter_data),
                Op::UserData(_, user_data) => group.user_data.push((*user_data).into()),
                _ => {}
            }
        }
        let rises = group.indices.windows(2).all(|two| two[0] < two[1]);
        if let ([first, .., last], true) = (&group.indices[..], rises)
            && (last - first) as usize >= group.indices.len()
        {
            group.words = vec![0; (last - first) as usize / 32 + 1];
            for index in &group.indices {
                group.words[(index - first) as usize / 32] |= 1 << ((index - first) % 32);
            }
        }
        group
    }

    /// The indices, in the way to name them that fits.
    fn named(&self) -> Indices<'_> {
        let indices = &self.indices;
        match indices[..] {
            [first, ..] if !self.words.is_empty() => Indices::Mask { first, words: &self.words },
            [first, ..] if (first..).zip(indices).all(|(index, named)| index == *named) => {
                Indices::Range { first, count: indices.len() as u32 }
            }
            _ => indices.into(),
        }
    }

    fn step(&self, op: &Op) -> Step<'_> {
        match op {
            Op::Remove(_) => Step::Remove(self.named()),
            Op::Set(..) => Step::Set(Sets { indices: self.named(), boxes: &self.boxes }),
            Op::Enable(_, on) => Step::Enable(self.named(), *on),
            Op::Static(_, on) => Step::Static(self.named(), *on),
            Op::FilterData(..) => Step::FilterData(FilterDataSets {
                indices: self.named(),
                filter_data: &self.filter_data,
            }),
            Op::UserData(..) => {
                Step::UserData(UserDataSets { indices: self.named(), user_data: &self.user_data })
            }
            Op::Filters(_) => Step::Filters(&self.table),
            Op::Include(_, on) => Step::Include(&self.pairs, *on),
            Op::Exclude(_, on) => Step::Exclude(&self.pairs, *on),
        }
    }
}

fn are_one_step(a: &Op, b: &Op) -> bool {
    let on = |op: &Op| match op {
        Op::Enable(_, on) | Op::Static(_, on) | Op::Include(_, on) | Op::Exclude(_, on) => *on,
        _ => true,
    };
    std::mem::discriminant(a) == std::mem::discriminant(b) && on(a) == on(b)
}

pub struct Grouped<'o>(Vec<(&'o Op, Group)>);

impl<'o> Grouped<'o> {
    pub fn of(ops: &'o [Op]) -> Self {
        Self(ops.chunk_by(are_one_step).map(|ops| (&ops[0], Group::of(ops))).collect())
    }

    pub fn steps(&self) -> Vec<Step<'_>> {
        self.0.iter().map(|(op, group)| group.step(op)).collect()
    }
}

/// A margin, of a scene with so many boxes: few huge ones in large scenes, where each such box is near all others.
pub fn a_margin(rng: &mut Rng, boxes: usize) -> Margin {
    let units = match rng.below(12 + boxes as u32) {
        0..3 => 0.0,
        3 => 1e-45,
        4 => 1e30,
        5 => 20.0,
        6 => f32::MAX,
        at => [0.05, 0.3, 0.3, 1.0][at as usize % 4],
    };
    Margin::new(units).expect("finite, and not negative")
}

/// Margins for the groups of an edit that set boxes: none, one for all, or one for each.
pub fn margins_for(grouped: &Grouped<'_>, rng: &mut Rng, boxes: usize) -> Vec<Vec<Margin>> {
    let of = |(op, group): &(&Op, Group)| {
        let (Op::Set(..), count) = (op, [0, 1, group.boxes.len()][rng.below(3) as usize]) else {
            return Vec::new();
        };
        (0..count).map(|_| a_margin(rng, boxes)).collect()
    };
    grouped.0.iter().map(of).collect()
}

impl Grouped<'_> {
    /// The margin of each box that is set, where `margins` names none the usual one.
    pub fn margins_of_boxes(&self, margins: &[Vec<Margin>], usual: Margin) -> Vec<(u32, Margin)> {
        let mut all = Vec::new();
        for ((op, group), margins) in self.0.iter().zip(margins) {
            if let Op::Set(..) = op {
                let of = |at| *margins.get(at).or(margins.last()).unwrap_or(&usual);
                all.extend((0..).zip(&group.indices).map(|(at, index)| (*index, of(at))));
            }
        }
        all
    }

    pub fn with_margins<'s, 'a>(
        &'a self,
        edit: SceneEdit<'s, 'a>,
        margins: &'a [Vec<Margin>],
    ) -> SceneEdit<'s, 'a> {
        let groups = self.0.iter().zip(margins);
        groups.fold(edit, |edit, ((op, group), margins)| {
            let (boxes, singly) = (&group.boxes[..], group.boxes.len() % 3 == 1);
            let mut each = group.indices.iter().copied().zip(boxes.iter().copied());
            match &margins[..] {
                [] if boxes.is_empty() || boxes.len() % 3 == 0 => edit.step(group.step(op)),
                [] if singly => each.fold(edit, |edit, (index, b)| edit.set(index, b)),
                [] => edit.set_with(group.named(), |_| each.next().map_or(Aabb::EMPTY, |(_, b)| b)),
                [margin] if singly => {
                    each.fold(edit, |edit, (index, b)| edit.set_margined(index, b, *margin))
                }
                [margin] => edit.set_all_margined(group.named(), boxes, *margin),
                margins if singly => {
                    let mut margins = margins.iter();
                    each.fold(edit, |edit, (index, b)| {
                        edit.set_margined(index, b, *margins.next().expect("one for each"))
                    })
                }
                margins => edit.set_all_margined(group.named(), boxes, margins),
            }
        })
    }
}
