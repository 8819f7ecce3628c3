//! What is left of ranges whose lease has ended.

use super::Ranges;
use crate::scene::SceneCopy;
use crate::scene::edit::Step;

/// Boxes of ranges that are nobody's any more, and pairs of lists that name an index of them: lists are of
/// indices, not of boxes, so who leases the indices next would find its boxes on them.
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
        if let Some(rules) = copy.rules() {
            let is_of = |pair: &[u32; 2]| pair.iter().any(|index| ranges.has(*index));
            included.extend(rules.lists.included().filter(is_of));
            excluded.extend(rules.lists.excluded().filter(is_of));
        }
        Self { boxes, included, excluded }
    }

    /// The steps that take it out of the scene. None is about rules where no list names an index: a scene that
    /// knows no rules is to know none afterwards.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::aabb::Aabb;
    use crate::scene::{Edit, Sets};

    #[test]
    fn boxes_and_listed_pairs_of_ended_ranges_are_taken_out() {
        let mut copy = SceneCopy::new(30);
        let mut apply = |steps: &[Step<'_>]| {
            copy.check(Edit { steps }).expect("right");
            copy.apply(Edit { steps });
            let ended = [0..5, 10..20].into_iter().collect();
            Remains::of(&copy, &ended)
        };
        let boxes = [Aabb::EMPTY; 3];
        let set = Step::Set(Sets { indices: (&[3, 7, 12]).into(), boxes: &boxes });
        let remains = apply(&[set]);
        assert!(matches!(remains.steps()[..], [Step::Remove(_)]), "no rules where there are none");
        let remains = apply(&[
            Step::Include(&[[7, 3], [6, 7]], true),
            Step::Exclude(&[[12, 3], [8, 9], [25, 26]], true),
        ]);
        assert_eq!(remains.boxes, [3, 12]);
        assert_eq!((&remains.included[..], &remains.excluded[..]), (&[[3, 7]][..], &[[3, 12]][..]));
        // Boxes may be gone before the lists are.
        let remains = apply(&[Step::Remove((&[3, 12]).into())]);
        let steps = remains.steps();
        assert!(matches!(steps[..], [Step::Include(_, false), Step::Exclude(_, false)]));
        assert!(apply(&steps).steps().is_empty());
    }
}
