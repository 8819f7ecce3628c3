//! What is left of ranges whose lease has ended: removed, or kept for who leases their indices next.

use std::collections::BTreeSet;
use std::ops::Range;

use super::Ranges;
use crate::filters::{FilterData, in_order};
use crate::scene::SceneCopy;
use crate::scene::edit::{Edit, FilterDataSets, Indices, Step, UserData, UserDataSets};
use crate::scene::error::EditError;

/// Removes the boxes of indices that are no longer a member's, and listed pairs that name them, from what it keeps.
///
/// # Errors
/// As [`SceneCopy::check`].
pub fn remove_range(copy: &mut SceneCopy, range: Range<u32>) -> Result<(), EditError> {
    let remains = Remains::of(copy, &std::iter::once(range).collect());
    let steps = remains.steps();
    let edit = Edit { steps: &steps };
    copy.check(edit)?;
    copy.apply(edit);
    Ok(())
}

/// Boxes of ranges that are nobody's any more, and listed pairs that name an index of them, where an entry waits for
/// a first box as well: the next boxes of the indices are on no list.
#[derive(Debug)]
pub struct Remains {
    boxes: Vec<u32>,
    included: Vec<[u32; 2]>,
    excluded: Vec<[u32; 2]>,
}

impl Remains {
    /// What a scene has of some ranges.
    pub fn of(copy: &SceneCopy, ranges: &Ranges) -> Self {
        let end = copy.index_end() as u32;
        let indices = ranges.as_slice().iter().flat_map(|range| range.start..range.end.min(end));
        let boxes = indices.filter(|index| copy.get(*index).is_some()).collect();
        let (mut included, mut excluded) = (Vec::new(), Vec::new());
        let lists = &copy.states().filters.rules().lists;
        let is_of = |pair: &[u32; 2]| pair.iter().any(|index| ranges.has(*index));
        included.extend(lists.included().filter(is_of));
        excluded.extend(lists.excluded().filter(is_of));
        Self { boxes, included, excluded }
    }

    /// The steps that take it out of the scene.
    pub fn steps(&self) -> Vec<Step<'_>> {
        let mut steps = Vec::new();
        if !self.boxes.is_empty() {
            steps.push(Step::Remove((&self.boxes).into()));
        }
        if !self.included.is_empty() {
            steps.push(Step::Include(&self.included, false));
        }
        if !self.excluded.is_empty() {
            steps.push(Step::Exclude(&self.excluded, false));
        }
        steps
    }
}

/// Boxes that were kept when the lease of their indices ended, until who leases them next sets them.
///
/// A box that is set anew is the same box, so that a writer that restarts ends no pair. But flags, filter data and entries in
/// pair lists are those that its new writer gives it, and the usual ones where it gives none.
#[derive(Debug, Default)]
pub struct RemainingBoxes {
    boxes: BTreeSet<u32>,
    /// Those of them with user data.
    marked: BTreeSet<u32>,
    /// Listed pairs that name one of them, and that nobody has listed again.
    included: BTreeSet<[u32; 2]>,
    excluded: BTreeSet<[u32; 2]>,
}

/// What a new writer's boxes lose of those that were kept.
#[derive(Debug)]
pub struct Reset {
    indices: Vec<u32>,
    filter_data: Vec<FilterData>,
    marked: Vec<u32>,
    user_data: Vec<UserData>,
    included: Vec<[u32; 2]>,
    excluded: Vec<[u32; 2]>,
}

impl RemainingBoxes {
    /// Whether the box of an index is kept.
    pub fn has(&self, index: u32) -> bool {
        self.boxes.contains(&index)
    }

    /// Boxes of a scene in ranges that are nobody's any more are kept.
    pub fn keep(&mut self, copy: &SceneCopy, ranges: &Ranges) {
        let Remains { boxes, included, excluded } = Remains::of(copy, ranges);
        let is_marked = |index: &u32| copy.states().user_data(*index) != 0;
        self.marked.extend(boxes.iter().copied().filter(is_marked));
        self.boxes.extend(boxes);
        self.included.extend(included);
        self.excluded.extend(excluded);
    }

    /// Takes out the boxes that an edit sets or removes, before it is applied; what those lose that it sets, if any.
    pub fn reset_by(&mut self, edit: Edit<'_>) -> Option<Reset> {
        if self.boxes.is_empty() {
            return None;
        }
        let (mut touched, mut indices) = (BTreeSet::new(), Vec::new());
        edit.for_each_removed(|index| {
            if self.boxes.remove(&index) {
                touched.insert(index);
            }
        });
        edit.for_each_set(|index, _| {
            if self.boxes.remove(&index) {
                touched.insert(index);
                indices.push(index);
            }
        });
        for step in edit.steps {
            let (kept, pairs) = match step {
                Step::Include(pairs, _) => (&mut self.included, pairs),
                Step::Exclude(pairs, _) => (&mut self.excluded, pairs),
                _ => continue,
            };
            // They are the new writer's from now on.
            for pair in *pairs {
                kept.remove(&in_order(*pair));
            }
        }
        let lost = |kept: &mut BTreeSet<[u32; 2]>| -> Vec<[u32; 2]> {
            let is_lost = |pair: &[u32; 2]| pair.iter().any(|index| touched.contains(index));
            let lost: Vec<[u32; 2]> = kept.iter().copied().filter(is_lost).collect();
            kept.retain(|pair| !is_lost(pair));
            lost
        };
        let [included, excluded] = [&mut self.included, &mut self.excluded].map(lost);
        let filter_data = vec![FilterData::default(); indices.len()];
        let marked: Vec<u32> =
            indices.iter().copied().filter(|index| self.marked.remove(index)).collect();
        let user_data = vec![UserData::default(); marked.len()];
        (!indices.is_empty()).then_some(Reset {
            indices,
            filter_data,
            marked,
            user_data,
            included,
            excluded,
        })
    }
}

impl Reset {
    /// The edit, with what its boxes lose before.
    pub fn steps<'a>(&'a self, edit: Edit<'a>) -> Vec<Step<'a>> {
        let indices: Indices<'a> = (&self.indices).into();
        let mut steps = vec![
            Step::Enable(indices, true),
            Step::Static(indices, false),
            Step::FilterData(FilterDataSets { indices, filter_data: &self.filter_data }),
            Step::Include(&self.included, false),
            Step::Exclude(&self.excluded, false),
        ];
        if !self.marked.is_empty() {
            let (indices, user_data) = ((&self.marked).into(), &self.user_data[..]);
            steps.push(Step::UserData(UserDataSets { indices, user_data }));
        }
        steps.extend_from_slice(edit.steps);
        steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aabb::Aabb;
    use crate::filters::Owner;
    use crate::scene::Sets;

    fn apply(copy: &mut SceneCopy, steps: &[Step<'_>]) {
        copy.check(Edit { steps }).expect("right");
        copy.apply(Edit { steps });
    }

    #[test]
    fn boxes_and_listed_pairs_of_ended_ranges_are_taken_out() {
        let mut copy = SceneCopy::new(30);
        let mut left_after = |steps: &[Step<'_>]| {
            apply(&mut copy, steps);
            let ended = [0..5, 10..20].into_iter().collect();
            Remains::of(&copy, &ended)
        };
        let boxes = [Aabb::EMPTY; 3];
        let set = Step::Set(Sets { indices: (&[3, 7, 12]).into(), boxes: &boxes });
        let remains = left_after(&[set]);
        assert!(matches!(remains.steps()[..], [Step::Remove(_)]), "no rules where there are none");
        let remains = left_after(&[
            Step::Include(&[[7, 3], [6, 7], [6, 4]], true),
            Step::Exclude(&[[12, 3], [8, 9], [25, 26]], true),
        ]);
        assert_eq!(remains.boxes, [3, 12]);
        let mut included = remains.included.clone();
        included.sort_unstable();
        assert_eq!((&included[..], &remains.excluded[..]), (&[[3, 7], [4, 6]][..], &[[3, 12]][..]));
        // Entries end with their boxes; those of an index without one are there still.
        let remains = left_after(&[Step::Remove((&[3, 12]).into())]);
        let steps = remains.steps();
        assert!(matches!(steps[..], [Step::Include([[4, 6]], false)]));
        assert!(left_after(&steps).steps().is_empty());
    }

    #[test]
    fn remaining_boxes_lose_flags_filter_data_and_lists_when_set_anew() {
        let mut copy = SceneCopy::new(30);
        let (boxes, filter_data) =
            ([Aabb::EMPTY; 4], [FilterData::default().with_owner(Owner(3)); 3]);
        let set = Step::Set(Sets { indices: (2..6).into(), boxes: &boxes });
        let steps = [
            set,
            Step::Static((2..5).into(), true),
            Step::Enable((2..5).into(), false),
            Step::FilterData(FilterDataSets { indices: (2..5).into(), filter_data: &filter_data }),
            Step::Exclude(&[[2, 3], [3, 4], [2, 5]], true),
        ];
        apply(&mut copy, &steps);
        let mut kept = RemainingBoxes::default();
        kept.keep(&copy, &std::iter::once(2..4).collect());
        // Index 2 is set anew; 3 is removed, and then another box comes.
        let mut set_anew = |copy: &mut SceneCopy, steps: &[Step<'_>]| {
            let edit = Edit { steps };
            let reset = kept.reset_by(edit);
            let steps = reset.as_ref().map(|reset| reset.steps(edit));
            apply(copy, steps.as_deref().unwrap_or(edit.steps));
            reset.is_some()
        };
        let one =
            |index: u32| Step::Set(Sets { indices: (index..index + 1).into(), boxes: &boxes[..1] });
        let seen = |copy: &SceneCopy, index| {
            let kept = copy.snapshot(index).expect("a box");
            (kept.is_on, kept.is_static(), kept.filter_data.owner)
        };
        assert!(set_anew(&mut copy, &[one(2), Step::Exclude(&[[2, 5]], true)]));
        assert_eq!(seen(&copy, 2), (true, false, Owner::NONE));
        assert_eq!(seen(&copy, 3), (false, true, Owner(3)), "nobody has set it");
        let mut excluded: Vec<_> = copy.states().filters.rules().lists.excluded().collect();
        excluded.sort_unstable();
        assert_eq!(excluded, [[2, 5], [3, 4]]);
        assert!(!set_anew(&mut copy, &[Step::Remove((3..4).into())]));
        assert!(!set_anew(&mut copy, &[one(3), one(4), Step::Static((4..5).into(), true)]));
        assert_eq!(seen(&copy, 4), (false, true, Owner(3)), "its lease goes on");
        // What the new writer lists before it sets the box is its own.
        kept.keep(&copy, &std::iter::once(4..6).collect());
        let listed = [Step::Exclude(&[[5, 4], [2, 5]], true), Step::Include(&[[4, 2]], true)];
        let edit = Edit { steps: &listed };
        assert!(kept.reset_by(edit).is_none());
        apply(&mut copy, edit.steps);
        let edit = [one(4), one(5)];
        let reset = kept.reset_by(Edit { steps: &edit }).expect("kept boxes");
        apply(&mut copy, &reset.steps(Edit { steps: &edit }));
        let mut excluded: Vec<_> = copy.states().filters.rules().lists.excluded().collect();
        excluded.sort_unstable();
        assert_eq!(excluded, [[2, 5], [4, 5]]);
        assert_eq!(copy.states().filters.rules().lists.included().collect::<Vec<_>>(), [[2, 4]]);
    }
}
