//! What a client keeps of a scene that lives in another process: enough to make it again.

use std::borrow::Cow;

use super::edit::{Edit, FilterDataSets, Indices, Sets, Step, UserData, UserDataSets};
use super::error::EditError;
use super::rules::{FilterHistory, apply_rules};
use super::snapshot::BoxSnapshot;
use super::states::{BoxStates, EDIT_REMOVES, EDIT_SETS, PRESENT, grow};
use crate::aabb::Aabb;
use crate::fetch::ask_for;
use crate::filters::{FilterData, FilterTable, Rules};
use crate::write::par_write_boxes;

/// Boxes, flags, collision filters and user data of a scene, by index: 25 bytes an index, 12 more up to the last one with
/// filter data, and 8 up to the last one with user data. It checks edits as the scene does, and applies them; it knows nothing of pairs.
///
/// ```
/// use pairmask_core::Aabb;
/// use pairmask_core::scene::{Edit, Scene, SceneCopy, SceneOptions, Sets, Step, Report};
///
/// let boxes = [[0.0, 1.0], [0.5, 2.0]].map(|[a, b]| Aabb::new([a; 3], [b; 3]));
/// let steps = [Step::Set(Sets { indices: (7..9).into(), boxes: &boxes })];
/// let edit = Edit { steps: &steps };
/// let mut copy = SceneCopy::new(100);
/// copy.check(edit)?;
/// copy.apply(edit);
///
/// let mut scene = Scene::new(SceneOptions::default());
/// let reported = scene.edit(Edit { steps: &copy.whole().steps() }, Report::Changes)?;
/// assert_eq!(reported.begun(), [[7, 8]]);
/// # Ok::<(), pairmask_core::scene::SceneError>(())
/// ```
#[derive(Clone, Debug)]
pub struct SceneCopy {
    boxes: Vec<Aabb>,
    states: BoxStates,
    limit: u32,
}

/// All boxes, flags and filters of a scene, as an edit that makes it.
#[derive(Debug)]
pub struct WholeScene<'a> {
    /// Words of a bitmask of the indices, where not every one has a box.
    present: Option<Vec<u32>>,
    boxes: Cow<'a, [Aabb]>,
    disabled: Vec<u32>,
    statics: Vec<u32>,
    /// Boxes with indices that are given filter data, and their filter data: those that are not the default ones.
    filtered: Vec<u32>,
    filter_data: Vec<FilterData>,
    /// Boxes with user data other than 0, and these.
    marked: Vec<u32>,
    user_data: Vec<UserData>,
    rules: Option<WholeRules<'a>>,
}

/// All rules of a scene but the filter data.
#[derive(Debug)]
struct WholeRules<'a> {
    rules: &'a Rules,
    included: Vec<[u32; 2]>,
    excluded: Vec<[u32; 2]>,
}

impl SceneCopy {
    /// Of a scene without boxes, whose indices are below a limit.
    pub fn new(limit: u32) -> Self {
        Self { boxes: Vec::new(), states: BoxStates::without_history(), limit }
    }

    /// Boxes, those that are disabled too.
    pub const fn len(&self) -> usize {
        self.states.present()
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Indices are below this number.
    pub const fn index_end(&self) -> usize {
        self.states.index_end()
    }

    /// The box of an index, also one that is disabled.
    #[inline]
    pub fn get(&self, index: u32) -> Option<Aabb> {
        self.states.has(index, PRESENT).then(|| self.boxes[index as usize])
    }

    /// Asks for the box of an index. One in three lies on two lines.
    #[inline]
    pub(super) fn ask_for(&self, index: u32) {
        ask_for(&self.boxes, index);
        ask_for(&self.boxes, index + 1);
    }

    /// The box of an index, its flags and filter data.
    pub fn snapshot(&self, index: u32) -> Option<BoxSnapshot> {
        Some(BoxSnapshot::of(self.get(index)?, index, &self.states))
    }

    /// The table of filters.
    pub const fn filter_table(&self) -> &FilterTable {
        &self.states.filters.rules().table
    }

    /// What is known of each index beside its box.
    pub const fn states(&self) -> &BoxStates {
        &self.states
    }

    /// Bytes that are kept.
    pub fn allocated_bytes(&self) -> usize {
        self.boxes.capacity() * size_of::<Aabb>() + self.states.allocated_bytes()
    }

    /// Checks an edit. Where it is right, [`apply`](Self::apply) or [`cancel`](Self::cancel) is to follow.
    ///
    /// # Errors
    /// [`EditError`]; the edit is dropped then.
    pub fn check(&mut self, edit: Edit<'_>) -> Result<(), EditError> {
        self.states.check(edit, self.limit, |len| grow(&mut self.boxes, len, Aabb::EMPTY))
    }

    /// Whether the edit that was checked removes the box of an index.
    #[inline]
    pub(super) fn is_removed_by_edit(&self, index: u32) -> bool {
        self.states.has(index, EDIT_REMOVES)
    }

    /// Whether an index has no box once the edit that was checked has removed some.
    pub(super) fn is_replaced_by_edit(&self, index: u32) -> bool {
        !self.states.has(index, PRESENT) || self.is_removed_by_edit(index)
    }

    /// Calls `f` with the indices that an edit [names](super::Report::Moved), some of them twice, before it is applied.
    pub fn for_each_named(&self, edit: Edit<'_>, mut f: impl FnMut(u32)) {
        edit.for_each_named(&mut f);
        let tables = edit.steps.iter().filter_map(|step| match step {
            Step::Filters(table) => Some(*table),
            _ => None,
        });
        tables.flat_map(|table| self.states.filters.named_by(table, &self.states)).for_each(f);
    }

    /// Drops an edit that was checked.
    pub fn cancel(&mut self, edit: Edit<'_>) {
        self.states.unmark(edit);
    }

    /// Applies an edit that was checked.
    pub fn apply(&mut self, edit: Edit<'_>) {
        let Self { boxes, states, .. } = self;
        edit.for_each_removed(|index| {
            states.remove(index);
        });
        states.drop_user_data(edit);
        for &Sets { indices, boxes: new } in edit.sets() {
            match indices {
                Indices::Range { count: 0, .. } => {}
                Indices::Range { first, count } => {
                    par_write_boxes(new, &mut boxes[first as usize..][..new.len()]);
                    states.insert_range(first, count);
                }
                Indices::List(list) if list.len() >= PART_BOXES && list.is_sorted() => {
                    let added = set_sorted(boxes, states.bits_mut(), 0, (list, new));
                    states.note_inserted(added);
                }
                _ => indices.for_each(|at, index| {
                    boxes[index as usize] = new[at];
                    states.insert(index);
                }),
            }
        }
        apply_rules(edit, states);
    }

    /// All of it, to make the scene again from nothing.
    pub fn whole(&self) -> WholeScene<'_> {
        let all = (self.len() == self.index_end()).then_some(&self.boxes[..]);
        WholeScene::of(self.index_end(), all, |index| self.snapshot(index), &self.states.filters)
    }
}

impl<'a> WholeScene<'a> {
    /// Boxes with indices below an end, and the filters of their scene. `in_place` are the boxes, where they lie
    /// together and every index has one.
    pub(super) fn of(
        end: usize,
        in_place: Option<&'a [Aabb]>,
        snapshot: impl Fn(u32) -> Option<BoxSnapshot>,
        filters: &'a FilterHistory,
    ) -> Self {
        let words = || vec![0u32; end.div_ceil(32)];
        let (mut all, mut boxes) = (words(), Vec::new());
        let (mut disabled, mut statics) = (words(), words());
        let rules = filters.is_used().then(|| {
            let rules = filters.rules();
            let (included, excluded) = (rules.lists.included(), rules.lists.excluded());
            let (mut included, mut excluded): (Vec<_>, Vec<_>) =
                (included.collect(), excluded.collect());
            // So that equal scenes are equal edits.
            included.sort_unstable();
            excluded.sort_unstable();
            WholeRules { rules, included, excluded }
        });
        let (mut filtered, mut filter_data) = (Vec::new(), Vec::new());
        let (mut marked, mut user_data) = (Vec::new(), Vec::new());
        for index in 0..end as u32 {
            let Some(kept) = snapshot(index) else { continue };
            let BoxSnapshot { b, is_on, .. } = kept;
            let (word, bit) = (index as usize / 32, 1 << (index % 32));
            all[word] |= bit;
            if in_place.is_none() {
                boxes.push(b);
            }
            disabled[word] |= if is_on { 0 } else { bit };
            statics[word] |= if kept.is_static() { bit } else { 0 };
            let filter_datum = filters.rules().filter_data(index);
            if filter_datum != FilterData::default() {
                filtered.push(index);
                filter_data.push(filter_datum);
            }
            if kept.user_data != 0 {
                marked.push(index);
                user_data.push(kept.user_data.into());
            }
        }
        let present = in_place.is_none().then_some(all);
        let boxes = in_place.map_or(boxes.into(), Cow::from);
        Self { present, boxes, disabled, statics, filtered, filter_data, marked, user_data, rules }
    }

    /// The steps of an edit that makes the scene where there is no box.
    pub fn steps(&self) -> Vec<Step<'_>> {
        let flagged = |words| Indices::Mask { first: 0, words };
        let all = Indices::from(0..self.boxes.len() as u32);
        let indices = self.present.as_deref().map_or(all, flagged);
        let mut steps = vec![
            Step::Set(Sets { indices, boxes: &self.boxes }),
            Step::Enable(flagged(&self.disabled), false),
            Step::Static(flagged(&self.statics), true),
        ];
        if let Some(WholeRules { rules, included, excluded }) = &self.rules {
            steps.extend([
                Step::FilterData(FilterDataSets {
                    indices: (&self.filtered).into(),
                    filter_data: &self.filter_data,
                }),
                Step::Filters(&rules.table),
                Step::Include(included, true),
                Step::Exclude(excluded, true),
            ]);
        }
        if !self.marked.is_empty() {
            steps.push(Step::UserData(UserDataSets {
                indices: (&self.marked).into(),
                user_data: &self.user_data,
            }));
        }
        steps
    }
}

/// Fewest boxes of a list that two threads set.
const PART_BOXES: usize = 8_192;

/// Sets one box; 1 where there was none.
#[inline(always)]
fn set(to: &mut Aabb, bits: &mut u8, b: &Aabb) -> usize {
    let added = usize::from(*bits & PRESENT == 0);
    *bits = *bits & !EDIT_SETS | PRESENT;
    *to = *b;
    added
}

/// Sets boxes of rising indices, which lie in these from `first` on; how many there were not. The stores
/// wait for memory: several threads wait at the same time.
fn set_sorted(
    boxes: &mut [Aabb],
    flags: &mut [u8],
    first: usize,
    (list, new): (&[u32], &[Aabb]),
) -> usize {
    if list.len() < 2 * PART_BOXES {
        let slots = list.iter().map(|index| *index as usize - first);
        return slots.zip(new).map(|(at, b)| set(&mut boxes[at], &mut flags[at], b)).sum();
    }
    let half = list.len() / 2;
    let middle = list[half] as usize;
    let (boxes, later_boxes) = boxes.split_at_mut(middle - first);
    let (flags, later_flags) = flags.split_at_mut(middle - first);
    let (list, later_list) = list.split_at(half);
    let (new, later_new) = new.split_at(half);
    let (added, later_added) = rayon::join(
        || set_sorted(boxes, flags, first, (list, new)),
        || set_sorted(later_boxes, later_flags, middle, (later_list, later_new)),
    );
    added + later_added
}

#[cfg(test)]
mod tests {
    use super::super::{Report, Scene, SceneOptions};
    use super::*;

    fn at(x: f32) -> Aabb {
        Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0])
    }

    /// Applies an edit to both; whether it was right.
    fn both(copy: &mut SceneCopy, scene: &mut Scene, steps: &[Step<'_>]) -> bool {
        let edit = Edit { steps };
        let (checked, edited) = (copy.check(edit), scene.edit(edit, Report::Nothing).map(drop));
        assert_eq!(checked.map_err(Into::into), edited);
        if checked.is_ok() {
            copy.apply(edit);
        }
        checked.is_ok()
    }

    #[test]
    fn a_copy_refuses_what_the_scene_refuses_and_makes_it_again() {
        let mut scene = Scene::new(SceneOptions::default().with_most_boxes(90));
        let mut copy = SceneCopy::new(90);
        let boxes: Vec<Aabb> = (0..80).map(|i| at(0.7 * i as f32)).collect();
        let set = |first: u32, count: usize| {
            let indices = (first..first + count as u32).into();
            Step::Set(Sets { indices, boxes: &boxes[..count] })
        };
        let one = |index: u32| Indices::Range { first: index, count: 1 };
        let edits: [(&[Step<'_>], bool); 13] = [
            (&[], true),
            (&[set(3, 70)], true),
            (&[set(89, 2)], false),
            (&[Step::Remove(one(2))], false),
            (&[Step::Remove(one(5)), Step::Enable(one(5), false)], false),
            (&[Step::Remove(one(5)), set(5, 1), Step::Static(one(5), true)], true),
            (&[set(7, 2), set(8, 1)], false),
            (&[Step::Static((9..30).into(), true), Step::Static((10..12).into(), false)], true),
            (&[Step::Enable((20..40).into(), false), Step::Remove((50..60).into())], true),
            (&[Step::Enable(one(21), true), Step::Remove(one(20))], true),
            (&[Step::Remove(one(22)), set(22, 3)], true),
            (&[Step::Remove(one(23)), Step::Remove(one(23))], false),
            (&[set(u32::MAX, 0), Step::Remove((u32::MAX..u32::MAX).into())], true),
        ];
        for (steps, is_right) in edits {
            assert_eq!(both(&mut copy, &mut scene, steps), is_right, "{steps:?}");
            assert_eq!(copy.len(), scene.len());
            for index in 0..95 {
                assert_eq!(copy.get(index), scene.get(index));
            }
            let mut again = Scene::new(SceneOptions::default());
            let whole = copy.whole();
            let edit = Edit { steps: &whole.steps() };
            let reported = again.edit(edit, Report::All).expect("a right edit");
            let all = scene.edit(Edit::NONE, Report::All).expect("a right edit");
            assert_eq!(reported.pairs(), all.pairs());
            assert_eq!(reported.skipped().static_pairs, all.skipped().static_pairs);
        }
    }

    #[test]
    fn long_lists_and_ranges_set_what_short_ones_do() {
        let n = 3 * PART_BOXES + 5;
        let boxes: Vec<Aabb> = (0..n).map(|i| at(i as f32)).collect();
        let rising: Vec<u32> = (0..n as u32).map(|i| 3 * i + 1).collect();
        let falling: Vec<u32> = rising.iter().rev().copied().collect();
        let sets = |indices| [Step::Set(Sets { indices, boxes: &boxes })];
        let limit = 4 * n as u32;
        for steps in
            [sets((&rising).into()), sets((&falling).into()), sets((7..7 + n as u32).into())]
        {
            let mut copy = SceneCopy::new(limit);
            for _ in 0..2 {
                copy.check(Edit { steps: &steps }).expect("right");
                copy.apply(Edit { steps: &steps });
                assert_eq!(copy.len(), n);
            }
            let Step::Set(sets) = &steps[0] else { continue };
            sets.indices.for_each(|at, index| assert_eq!(copy.get(index), Some(boxes[at])));
        }
    }

    #[test]
    fn an_edit_that_was_cancelled_leaves_no_mark() {
        let mut copy = SceneCopy::new(9);
        let edit = [Step::Set(Sets { indices: (0..2).into(), boxes: &[at(0.0), at(1.0)] })];
        for _ in 0..2 {
            copy.check(Edit { steps: &edit }).expect("right");
            copy.cancel(Edit { steps: &edit });
            assert!(copy.is_empty());
        }
        copy.check(Edit { steps: &edit }).expect("right");
        copy.apply(Edit { steps: &edit });
        let remove = [Step::Remove((0..2).into())];
        for _ in 0..2 {
            copy.check(Edit { steps: &remove }).expect("right");
            copy.cancel(Edit { steps: &remove });
            assert_eq!(copy.len(), 2);
        }
    }
}
