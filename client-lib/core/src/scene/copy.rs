//! What a client keeps of a scene that lives in another process: enough to make it again.

use super::check::{EDIT_REMOVES, EDIT_SETS, PRESENT, len_after, mark, unmark};
use super::edit::{Edit, Flag, Indices, Sets, Step, Tags};
use super::error::EditError;
use super::fetch::ask_for;
use super::filtered::{Before, Expansion, apply_rules};
use super::kept::KeptBox;
use crate::aabb::Aabb;
use crate::filters::{Rules, Tag};
use crate::write::par_write_boxes;

/// The box is switched off.
const OFF: u8 = 1 << 1;
/// It is static.
const STATIC: u8 = 1 << 2;

/// Boxes and flags of a scene, by index: 25 bytes an index, and 12 more up to the last one with a tag. It
/// checks edits as the scene does, and applies them; it knows nothing of pairs.
///
/// ```
/// use pairmask_core::Aabb;
/// use pairmask_core::scene::{Edit, Scene, SceneCopy, SceneOptions, Sets, Step, Want};
///
/// let boxes = [[0.0, 1.0], [0.5, 2.0]].map(|[a, b]| Aabb::new([a; 3], [b; 3]));
/// let steps = [Step::Set(Sets { indices: (7..9).into(), boxes: &boxes })];
/// let edit = Edit { steps: &steps };
/// let mut copy = SceneCopy::new(100);
/// copy.check(edit)?;
/// copy.apply(edit);
///
/// let mut scene = Scene::new(SceneOptions::default());
/// let told = scene.edit(Edit { steps: &copy.whole().steps() }, Want::Changes)?;
/// assert_eq!(told.begun(), [[7, 8]]);
/// # Ok::<(), pairmask_core::scene::SceneError>(())
/// ```
#[derive(Debug)]
pub struct SceneCopy {
    boxes: Vec<Aabb>,
    flags: Vec<u8>,
    present: usize,
    limit: u32,
    /// Where an edit was ever about rules. What is static they know, then; the flag is what a scene that
    /// knows no rules is to take for static.
    rules: Option<Box<Rules>>,
}

/// All boxes and flags of a scene, as an edit that makes it.
#[derive(Debug)]
pub struct WholeScene<'a> {
    boxes: Boxes<'a>,
    off: Vec<u32>,
    statics: Vec<u32>,
    rules: Option<WholeRules<'a>>,
}

/// All rules of a scene.
#[derive(Debug)]
struct WholeRules<'a> {
    rules: &'a Rules,
    tagged: Vec<u32>,
    tags: Vec<Tag>,
    included: Vec<[u32; 2]>,
    excluded: Vec<[u32; 2]>,
}

/// The boxes of a scene.
#[derive(Debug)]
enum Boxes<'a> {
    /// Of every index from 0.
    All(&'a [Aabb]),
    /// Of the indices of a bitmask.
    Some(Vec<u32>, Vec<Aabb>),
}

impl SceneCopy {
    /// Of a scene without boxes, whose indices are below a limit.
    pub const fn new(limit: u32) -> Self {
        Self { boxes: Vec::new(), flags: Vec::new(), present: 0, limit, rules: None }
    }

    /// Boxes, those that are switched off too.
    pub const fn len(&self) -> usize {
        self.present
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.present == 0
    }

    /// Indices are below this number.
    pub const fn index_end(&self) -> usize {
        self.flags.len()
    }

    /// The box of an index, also one that is switched off.
    #[inline]
    pub fn get(&self, index: u32) -> Option<Aabb> {
        let i = index as usize;
        self.flags.get(i).is_some_and(|flags| flags & PRESENT != 0).then(|| self.boxes[i])
    }

    /// Asks for the box of an index. One in three lies on two lines.
    #[inline]
    pub(super) fn ask_for(&self, index: u32) {
        ask_for(&self.boxes, index);
        ask_for(&self.boxes, index + 1);
    }

    /// The box of an index and its flags.
    pub fn kept(&self, index: u32) -> Option<KeptBox> {
        let flags = *self.flags.get(index as usize)?;
        let has = |bit| flags & bit != 0;
        let b = self.get(index)?;
        let rules = self.rules.as_ref();
        let is_static = rules.map_or_else(|| has(STATIC), |rules| rules.tag(index).is_static());
        Some(KeptBox { b, is_on: !has(OFF), is_static })
    }

    /// The rules, if an edit was ever about some.
    pub fn rules(&self) -> Option<&Rules> {
        self.rules.as_deref()
    }

    /// What an edit that was checked, and is not applied, needs so that a scene can be sent it which does
    /// not know what rules and boxes were; `None` where it is to be sent as it is.
    pub fn expand(&self, edit: Edit<'_>) -> Option<Expansion> {
        let kept = |index| self.kept(index);
        let index_end = self.flags.len() as u32;
        Expansion::of(edit, &Before { kept, index_end, rules: self.rules() })
    }

    /// Bytes that are kept.
    pub fn allocated_bytes(&self) -> usize {
        let rules = self.rules().map_or(0, Rules::allocated_bytes);
        self.boxes.capacity() * size_of::<Aabb>() + self.flags.capacity() + rules
    }

    /// Checks an edit. Where it is right, [`apply`](Self::apply) or [`cancel`](Self::cancel) is to follow.
    ///
    /// # Errors
    /// [`EditError`]; the edit is forgotten then.
    pub fn check(&mut self, edit: Edit<'_>) -> Result<(), EditError> {
        let len = len_after(edit, self.flags.len(), self.limit)?;
        let more = len - self.flags.len();
        let no_memory = |_| EditError::NoMemory { boxes: len as u64 };
        self.boxes.try_reserve(more).map_err(no_memory)?;
        self.flags.try_reserve(more).map_err(no_memory)?;
        self.boxes.resize(len, Aabb::EMPTY);
        self.flags.resize(len, 0);
        mark(edit, &mut self.flags)
    }

    /// Whether the edit that was checked removes the box of an index.
    #[inline]
    pub(super) fn is_removed_by_edit(&self, index: u32) -> bool {
        self.flags.get(index as usize).is_some_and(|flags| flags & EDIT_REMOVES != 0)
    }

    /// Forgets an edit that was checked.
    pub fn cancel(&mut self, edit: Edit<'_>) {
        unmark(edit, &mut self.flags);
    }

    /// Applies an edit that was checked, with what it [needs](Self::expand).
    pub fn apply(&mut self, edit: Edit<'_>) {
        if self.rules.is_some() || edit.has_rules() {
            apply_rules(edit, self.rules.get_or_insert_default(), &mut ());
        }
        let Self { boxes, flags, present, .. } = self;
        edit.for_each_removed(|index| {
            flags[index as usize] &= EDIT_SETS;
            *present -= 1;
        });
        for &Sets { indices, boxes: new } in edit.sets() {
            *present += match indices {
                Indices::Range { count: 0, .. } => 0,
                Indices::Range { first, .. } => {
                    let range = first as usize..first as usize + new.len();
                    set_range(&mut boxes[range.clone()], &mut flags[range], new)
                }
                Indices::List(list) if list.len() >= PART_BOXES && list.is_sorted() => {
                    set_sorted(boxes, flags, 0, (list, new))
                }
                _ => {
                    let mut added = 0;
                    indices.for_each(|at, index| {
                        let i = index as usize;
                        added += set(&mut boxes[i], &mut flags[i], &new[at]);
                    });
                    added
                }
            };
        }
        edit.for_each_flag(|index, flag| {
            let flags = &mut flags[index as usize];
            let (bit, on) = match flag {
                Flag::On(on) => (OFF, !on),
                Flag::Static(on) => (STATIC, on),
            };
            *flags = if on { *flags | bit } else { *flags & !bit };
        });
    }

    /// All of it, to make the scene again from nothing.
    pub fn whole(&self) -> WholeScene<'_> {
        let mask = |bit: u8| -> Vec<u32> {
            let has = |flags: &u8| flags & (PRESENT | bit) == PRESENT | bit;
            let word = |flags: &[u8]| {
                flags.iter().enumerate().fold(0, |word, (t, f)| word | u32::from(has(f)) << t)
            };
            self.flags.chunks(32).map(word).collect()
        };
        let boxes = if self.present == self.flags.len() {
            Boxes::All(&self.boxes)
        } else {
            let present = self.boxes.iter().zip(&self.flags);
            let packed = present.filter(|(_, f)| **f & PRESENT != 0).map(|(b, _)| *b);
            Boxes::Some(mask(0), packed.collect())
        };
        let rules = self.rules().map(|rules| self.whole_rules(rules));
        WholeScene { boxes, off: mask(OFF), statics: mask(STATIC), rules }
    }

    fn whole_rules<'a>(&self, rules: &'a Rules) -> WholeRules<'a> {
        let is_tagged = |(index, tag): &(u32, Tag)| {
            *tag != Tag::default()
                && self.flags.get(*index as usize).is_some_and(|flags| flags & PRESENT != 0)
        };
        let tags = (0..).zip(rules.tags.iter().copied());
        let (tagged, tags) = tags.filter(is_tagged).unzip();
        let (included, excluded) = (rules.lists.included(), rules.lists.excluded());
        let (included, excluded) = (included.collect(), excluded.collect());
        WholeRules { rules, tagged, tags, included, excluded }
    }
}

impl WholeScene<'_> {
    /// The steps of the edit.
    pub fn steps(&self) -> Vec<Step<'_>> {
        let set = match &self.boxes {
            Boxes::All(boxes) => Sets { indices: (0..boxes.len() as u32).into(), boxes },
            Boxes::Some(words, boxes) => Sets { indices: Indices::Mask { first: 0, words }, boxes },
        };
        let flagged = |words| Indices::Mask { first: 0, words };
        let mut steps = vec![
            Step::Set(set),
            Step::Switch(flagged(&self.off), false),
            Step::Static(flagged(&self.statics), true),
        ];
        if let Some(WholeRules { rules, tagged, tags, included, excluded }) = &self.rules {
            let tags = Tags { indices: tagged.into(), tags };
            steps.extend([
                Step::Tag(tags),
                Step::Filters(&rules.table),
                Step::Include(included, true),
                Step::Exclude(excluded, true),
            ]);
        }
        steps
    }
}

/// Fewest boxes of a list that two threads set.
const PART_BOXES: usize = 8_192;

/// Sets one box; 1 where there was none.
#[inline(always)]
fn set(to: &mut Aabb, flags: &mut u8, b: &Aabb) -> usize {
    let added = usize::from(*flags & PRESENT == 0);
    *flags = *flags & !EDIT_SETS | PRESENT;
    *to = *b;
    added
}

/// Sets boxes of indices that follow each other; how many there were not.
fn set_range(to: &mut [Aabb], flags: &mut [u8], new: &[Aabb]) -> usize {
    par_write_boxes(new, to);
    let present: u64 = flags.iter().map(|flags| u64::from(flags & PRESENT)).sum();
    let added = flags.len() - (present / u64::from(PRESENT)) as usize;
    for flags in flags {
        *flags = *flags & !EDIT_SETS | PRESENT;
    }
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
        let places = list.iter().map(|index| *index as usize - first);
        return places.zip(new).map(|(at, b)| set(&mut boxes[at], &mut flags[at], b)).sum();
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
    use super::super::{Scene, SceneOptions, Want};
    use super::*;

    fn at(x: f32) -> Aabb {
        Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0])
    }

    /// Applies an edit to both; whether it was right.
    fn both(copy: &mut SceneCopy, scene: &mut Scene, steps: &[Step<'_>]) -> bool {
        let edit = Edit { steps };
        let (checked, edited) = (copy.check(edit), scene.edit(edit, Want::Nothing).map(drop));
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
            (&[Step::Remove(one(5)), Step::Switch(one(5), false)], false),
            (&[Step::Remove(one(5)), set(5, 1), Step::Static(one(5), true)], true),
            (&[set(7, 2), set(8, 1)], false),
            (&[Step::Static((9..30).into(), true), Step::Static((10..12).into(), false)], true),
            (&[Step::Switch((20..40).into(), false), Step::Remove((50..60).into())], true),
            (&[Step::Switch(one(21), true), Step::Remove(one(20))], true),
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
            let told = again.edit(edit, Want::All).expect("a right edit");
            let all = scene.edit(Edit::NONE, Want::All).expect("a right edit");
            assert_eq!(told.pairs(), all.pairs());
            assert_eq!(told.skipped().static_pairs, all.skipped().static_pairs);
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
