//! Scenes with rules: worlds, owners, filters and lists of pairs, over any scene that finds pairs of boxes.
//!
//! The scene below knows boxes alone. What it tells is filtered by the rules of then and of now, and boxes of
//! which rules changed are looked at anew (`expand`). So every engine has the same rules, and a scene that
//! nobody gives rules pays nothing.

mod expand;
mod then;

use std::collections::BTreeSet;
use std::sync::Arc;

use rayon::prelude::*;

pub use self::expand::Expansion;
pub(super) use self::expand::{Before, apply_rules};
use self::then::Then;
use super::answer::{EndReason, Ended, Told, Want, is_resync_due};
use super::edit::{Edit, Step, Tags};
use super::error::{EditError, SceneError};
use super::pair_list::Pair;
use super::{KeptBox, QueryError, QueryTags, Scene, SceneOptions};
use crate::aabb::Aabb;
use crate::engine::CullError;
use crate::filters::Rules;

/// Pairs from which several threads filter: one takes 100 µs.
const MANY_PAIRS: usize = 16_384;

/// A scene that finds pairs of boxes, whatever rules there are.
pub trait PairScene {
    /// Applies an edit that says nothing of rules, and answers.
    ///
    /// # Errors
    /// As [`Scene::edit`].
    fn edit(&mut self, edit: Edit<'_>, want: Want) -> Result<(), SceneError>;
    /// The last answer.
    fn told(&self) -> &Told;
    /// Takes the last answer.
    fn take(&mut self);
    /// Forgets what was told.
    fn lose(&mut self);
    /// Indices are below this.
    fn most_boxes(&self) -> u32;
    /// Threads that an edit may use.
    fn threads(&self) -> usize;
    /// Whether an index has a box.
    fn is_present(&self, index: u32) -> bool;
    /// Whether it has one that is switched off.
    fn is_off(&self, index: u32) -> bool;
    /// Whether it has one that an edit made static.
    fn is_static(&self, index: u32) -> bool;
    /// Finds the boxes that some other boxes overlap.
    ///
    /// # Errors
    /// As [`Scene::query`].
    fn query(&mut self, queries: &[Aabb], found: &mut Vec<Pair>) -> Result<u64, CullError>;
}

impl PairScene for Scene {
    fn edit(&mut self, edit: Edit<'_>, want: Want) -> Result<(), SceneError> {
        Self::edit(self, edit, want).map(drop)
    }

    fn told(&self) -> &Told {
        Self::told(self)
    }

    fn take(&mut self) {
        Self::take(self);
    }

    fn lose(&mut self) {
        Self::lose(self);
    }

    fn most_boxes(&self) -> u32 {
        self.options.most_boxes
    }

    fn threads(&self) -> usize {
        Self::threads(self)
    }

    fn is_present(&self, index: u32) -> bool {
        self.get(index).is_some()
    }

    fn is_off(&self, index: u32) -> bool {
        (index as usize) < self.store.boxes().len() && self.store.is_off(index)
    }

    fn is_static(&self, index: u32) -> bool {
        (index as usize) < self.store.boxes().len() && self.store.is_static(index)
    }

    fn query(&mut self, queries: &[Aabb], found: &mut Vec<Pair>) -> Result<u64, CullError> {
        Self::query(self, queries, found)
    }
}

/// A scene with rules of which boxes may be a pair.
///
/// Edits have the steps of [`Step`] that are about rules as well; what is told is what [`Scene`] tells of
/// the pairs that the rules let meet. A pair that ends because rules changed ends as
/// [`EndReason::Filtered`]. Rules are looked at where boxes overlap, or did: many worlds in one place are
/// better a scene each. [`Want::Moved`] counts a box as moved whose tag, filter or list the edit changed.
///
/// ```
/// use pairmask_core::Aabb;
/// use pairmask_core::filters::{Owner, Tag};
/// use pairmask_core::scene::{Edit, EndReason, FilteredScene, Scene, SceneOptions};
/// use pairmask_core::scene::{Sets, Step, Tags, Want};
///
/// let boxes = [Aabb::new([0.0; 3], [1.0; 3]); 3];
/// let mut scene = FilteredScene::new(SceneOptions::default());
/// let all = [Step::Set(Sets { indices: (0..3).into(), boxes: &boxes })];
/// assert_eq!(scene.edit(Edit { steps: &all }, Want::Changes)?.begun().len(), 3);
/// scene.take();
///
/// // Two of them are parts of one body.
/// let tags = [Tag::default().with_owner(Owner(7)); 2];
/// let body = [Step::Tag(Tags { indices: (&[0, 2]).into(), tags: &tags })];
/// let told = scene.edit(Edit { steps: &body }, Want::Changes)?;
/// assert!(told.begun().is_empty());
/// assert_eq!(told.ended()[0].pair, [0, 2]);
/// assert_eq!(told.ended()[0].reason, EndReason::Filtered);
/// # Ok::<(), pairmask_core::scene::SceneError>(())
/// ```
#[derive(Debug)]
pub struct FilteredScene<S = Scene> {
    scene: S,
    ruled: Option<Box<Ruled>>,
    /// Pairs that were told.
    count_then: u64,
    /// Whether the last answer can be taken.
    is_open: bool,
}

/// Rules, and what they made of the last answer.
#[derive(Debug, Default)]
struct Ruled {
    rules: Rules,
    then: Then,
    told: Told,
}

impl FilteredScene {
    /// A scene of this process without boxes and rules.
    pub fn new(options: SceneOptions) -> Self {
        Self::over(Scene::new(options))
    }

    /// Applies an edit and answers, as [`Scene::edit`] does.
    ///
    /// # Errors
    /// As [`Scene::edit`].
    pub fn edit(&mut self, edit: Edit<'_>, want: Want) -> Result<&Told, SceneError> {
        if self.ruled.is_none() && !edit.has_rules() {
            return self.edit_expanded(edit, want);
        }
        self.check(edit)?;
        self.scene.store.check(edit, self.scene.options.most_boxes)?;
        let kept = |index: u32| {
            let scene = &self.scene;
            let b = scene.get(index)?;
            let rules = self.ruled.as_ref().map(|ruled| &ruled.rules);
            let of_store = || scene.store.is_static(index);
            let is_static = rules.map_or_else(of_store, |rules| rules.tag(index).is_static());
            Some(KeptBox { b, is_on: !scene.store.is_off(index), is_static })
        };
        let before = Before {
            kept,
            index_end: self.scene.store.boxes().len() as u32,
            rules: self.ruled.as_ref().map(|ruled| &ruled.rules),
        };
        match Expansion::of(edit, &before) {
            None => self.edit_expanded(edit, want),
            // What it adds is right where the edit is.
            Some(more) => self.edit_expanded(Edit { steps: &more.steps(edit) }, want),
        }
    }
}

impl<S: PairScene> FilteredScene<S> {
    /// A scene without rules over one without boxes.
    pub const fn over(scene: S) -> Self {
        Self { scene, ruled: None, count_then: 0, is_open: false }
    }

    /// The scene below.
    pub const fn scene(&self) -> &S {
        &self.scene
    }

    /// The scene below, for who changes how it works, and nothing that it holds.
    pub const fn scene_mut(&mut self) -> &mut S {
        &mut self.scene
    }

    /// The rules, if an edit was ever about some.
    pub fn rules(&self) -> Option<&Rules> {
        self.ruled.as_ref().map(|ruled| &ruled.rules)
    }

    /// The last answer.
    pub fn told(&self) -> &Told {
        self.ruled.as_ref().map_or_else(|| self.scene.told(), |ruled| &ruled.told)
    }

    /// Bytes that rules take, and lists of pairs that they let meet.
    pub fn rule_bytes(&self) -> usize {
        self.ruled.as_ref().map_or(0, |ruled| {
            ruled.rules.allocated_bytes()
                + ruled.then.allocated_bytes()
                + ruled.told.allocated_bytes()
                + size_of_val(ruled.told.pairs())
        })
    }

    /// Finds the boxes that some other boxes overlap and, where those have tags, may meet by the rules, but for
    /// the include and the exclude list: a query has no index. Pairs [query, index], by query and then by index.
    /// Boxes that are switched off are not found. Returns how many boxes were tested.
    ///
    /// ```
    /// use pairmask_core::Aabb;
    /// use pairmask_core::filters::{Tag, World};
    /// use pairmask_core::scene::{Edit, FilteredScene, QueryTags, SceneOptions, Sets, Step, Tags, Want};
    ///
    /// let boxes = [Aabb::new([0.0; 3], [1.0; 3]); 2];
    /// let tags = [3, 4].map(|world| Tag::default().with_world(World(world)));
    /// let mut scene = FilteredScene::new(SceneOptions::default());
    /// let set = Step::Set(Sets { indices: (0..2).into(), boxes: &boxes });
    /// let tag = Step::Tag(Tags { indices: (0..2).into(), tags: &tags });
    /// scene.edit(Edit { steps: &[set, tag] }, Want::Nothing)?;
    ///
    /// let (point, mut found) = ([Aabb::point([0.5; 3])], Vec::new());
    /// scene.query(&point, QueryTags::None, &mut found)?;
    /// assert_eq!(found, [[0, 0], [0, 1]]);
    /// scene.query(&point, QueryTags::One(tags[1]), &mut found)?;
    /// assert_eq!(found, [[0, 1]]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`QueryError`].
    pub fn query(
        &mut self,
        queries: &[Aabb],
        tags: QueryTags<'_>,
        found: &mut Vec<Pair>,
    ) -> Result<u64, QueryError> {
        tags.check(queries)?;
        let tested = self.scene.query(queries, found)?;
        tags.filter(&self.scene, self.rules(), found);
        Ok(tested)
    }

    /// Takes the last answer, as [`Scene::take`] does.
    pub fn take(&mut self) {
        if !std::mem::take(&mut self.is_open) {
            return;
        }
        let told = self.told();
        if matches!(told.want, Want::Changes | Want::All) {
            self.count_then = told.pair_count;
            if let Some(ruled) = &mut self.ruled {
                ruled.then.forget();
            }
        }
        self.scene.take();
    }

    /// Forgets what was told: the next changes are a resync.
    pub fn lose(&mut self) {
        self.scene.lose();
        self.is_open = false;
        if let Some(ruled) = &mut self.ruled {
            ruled.then.forget();
            ruled.told = Told::of_none(Want::Nothing, 0);
        }
    }

    /// Applies an edit to which an [`Expansion`] has added what it needs, and answers.
    ///
    /// # Errors
    /// As [`Scene::edit`].
    pub fn edit_expanded(&mut self, edit: Edit<'_>, want: Want) -> Result<&Told, SceneError> {
        if self.ruled.is_none() && !edit.has_rules() {
            self.is_open = false;
            self.scene.edit(edit, want)?;
            self.is_open = true;
            return Ok(self.scene.told());
        }
        self.check(edit)?;
        let plain: Vec<Step<'_>> =
            edit.steps.iter().filter(|step| !step.is_rule()).copied().collect();
        let edited = self.scene.edit(Edit { steps: &plain }, want);
        if let Err(SceneError::Edit(error)) = edited {
            return Err(error.into());
        }
        self.is_open = false;
        let ruled = self.ruled.get_or_insert_default();
        apply_rules(edit, &mut ruled.rules, &mut ruled.then);
        let answered = edited.and_then(|()| ruled.answer(&mut self.scene, want, self.count_then));
        match answered {
            Ok(()) => {
                self.is_open = true;
                Ok(&ruled.told)
            }
            Err(error) => {
                ruled.then.forget();
                ruled.told = Told::of_none(Want::Nothing, 0);
                self.scene.lose();
                Err(error)
            }
        }
    }

    /// Checks what an edit says of rules.
    fn check(&self, edit: Edit<'_>) -> Result<(), EditError> {
        if let Some((indices, boxes)) = edit.uneven() {
            return Err(EditError::Lengths { indices, boxes });
        }
        let limit = self.scene.most_boxes();
        let mut wrong = None;
        let mut check = |index: u64| {
            if index >= u64::from(limit) {
                wrong = wrong.or(Some(EditError::BeyondLimit { index, limit }));
            }
        };
        for step in edit.steps {
            match step {
                Step::Tag(Tags { indices, .. }) | Step::Renew(indices) => {
                    indices.last().into_iter().for_each(&mut check);
                }
                Step::Include(pairs, _) | Step::Exclude(pairs, _) => {
                    pairs.as_flattened().iter().for_each(|index| check(u64::from(*index)));
                }
                _ => {}
            }
        }
        if let Some(wrong) = wrong {
            return Err(wrong);
        }
        // Boxes with tags are there, or are set.
        let mut absent = BTreeSet::new();
        edit.for_each_tag(|index, _| {
            if !self.scene.is_present(index) {
                absent.insert(index);
            }
        });
        if !absent.is_empty() {
            for sets in edit.sets() {
                let last = sets.indices.last().unwrap_or(0);
                if last >= u64::from(limit) {
                    return Err(EditError::BeyondLimit { index: last, limit });
                }
                sets.indices.for_each(|_, index| {
                    absent.remove(&index);
                });
            }
        }
        let absent = absent.first().map(|index| EditError::Absent { index: u64::from(*index) });
        absent.map_or(Ok(()), Err)
    }
}

impl Ruled {
    /// Tells what the scene below has told, as far as the rules let it.
    fn answer<S: PairScene>(
        &mut self,
        scene: &mut S,
        want: Want,
        count_then: u64,
    ) -> Result<(), SceneError> {
        let threads = scene.threads();
        let skips = *scene.told().skipped();
        let told = match want {
            Want::Nothing => Told::of_none(want, 0),
            Want::Changes if !scene.told().is_resync() => {
                let (begun, ended) = self.changes(scene, threads);
                let (more, less) = (begun.len() as u64, ended.len() as u64);
                let pair_count = (count_then + more).saturating_sub(less);
                if is_resync_due(more + less, pair_count) {
                    scene.edit(Edit::NONE, Want::All)?;
                    self.pairs(scene.told().pairs(), want, threads)
                } else {
                    Told::of_changes(begun, ended, pair_count)
                }
            }
            _ => self.pairs(scene.told().pairs(), want, threads),
        };
        self.told = told.with_skips(skips);
        Ok(())
    }

    /// Those pairs that may meet.
    fn pairs(&self, pairs: &[Pair], want: Want, threads: usize) -> Told {
        let pairs = filtered(pairs, threads, |[a, b]| self.rules.meet(*a, *b));
        let count = if want == Want::Moved { 0 } else { pairs.len() as u64 };
        Told::of_pairs(want, Arc::new(pairs), count)
    }

    /// What began and what ended.
    fn changes<S: PairScene>(&self, scene: &S, threads: usize) -> (Vec<Pair>, Vec<Ended>) {
        let Self { rules, then, .. } = self;
        let told = scene.told();
        let mut begun = filtered(told.begun(), threads, |[a, b]| rules.meet(*a, *b));
        let met = |Ended { pair: [a, b], .. }: &Ended| then.met(rules, *a, *b);
        let mut ended = filtered(told.ended(), threads, met);
        let is_replaced = |ended: &Ended| {
            let below = ended.reason == EndReason::Removed && !then.is_renewed(ended.pair);
            below || then.is_removed(ended.pair)
        };
        if then.has_renewed() {
            cancel(&mut begun, &mut ended, is_replaced);
        }
        let is_off = |index| scene.is_off(index) || !scene.is_present(index);
        for ended in &mut ended {
            let [a, b] = ended.pair;
            let is_renewed = then.is_renewed(ended.pair);
            ended.reason = if is_replaced(ended) {
                EndReason::Removed
            } else if !rules.meet(a, b) || is_renewed && (is_off(a) || is_off(b)) {
                EndReason::Filtered
            } else if is_renewed {
                EndReason::Separated
            } else {
                ended.reason
            };
        }
        (begun, ended)
    }
}

/// Those of a list that pass, in order.
fn filtered<T: Copy + Send + Sync>(
    list: &[T],
    threads: usize,
    passes: impl Fn(&T) -> bool + Send + Sync,
) -> Vec<T> {
    if threads == 1 || list.len() < MANY_PAIRS {
        list.iter().copied().filter(passes).collect()
    } else {
        list.par_iter().copied().filter(passes).collect()
    }
}

/// Takes out of both sorted lists what ended and began again, unless it was replaced.
fn cancel(begun: &mut Vec<Pair>, ended: &mut Vec<Ended>, is_replaced: impl Fn(&Ended) -> bool) {
    let mut stays = Vec::new();
    let mut at = 0;
    ended.retain(|this| {
        while begun.get(at).is_some_and(|pair| *pair < this.pair) {
            stays.push(begun[at]);
            at += 1;
        }
        let begins = begun.get(at) == Some(&this.pair);
        let cancels = begins && !is_replaced(this);
        if cancels {
            at += 1;
        }
        !cancels
    });
    stays.extend_from_slice(&begun[at..]);
    *begun = stays;
}
