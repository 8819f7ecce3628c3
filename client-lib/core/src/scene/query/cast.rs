//! Casts into a scene: rays and spheres, among the boxes one after the other or in a tree, which follows the edits from
//! then on.

use std::ops::Range;

use super::{QueryError, QueryFilterData};
use crate::aabb::Aabb;
use crate::cancel::Cancel;
use crate::cast::{Among, BoxTree, Hit, Hits, Limits, Shapes};
use crate::engine::CullError;
use crate::scene::Scene;
use crate::scene::rules::FilterHistory;
use crate::scene::states::STILL;
use crate::team;

/// Rays and spheres from which a tree is built: to look at a box of so many takes as long as to place it.
const MANY_SHAPES: u64 = 32;
/// Boxes that are never worth a tree.
const FEW_BOXES: usize = 64;
/// A tree that nobody has asked while so many times its boxes have changed is dropped.
const UNUSED_ROUNDS: usize = 4;
/// A ray or a sphere takes so long on one thread, ns.
const CAST_NS: f64 = 600.0;

/// What a cast asks of a scene.
#[derive(Clone, Copy, Debug)]
pub struct Cast<'a> {
    /// Rays or spheres.
    pub shapes: Shapes<'a>,
    /// Which boxes are reported of each.
    pub hits: Hits,
    /// The filter data of the shapes: they find what they may meet by them, but for the include and the exclude list.
    pub filter_data: QueryFilterData<'a>,
    /// Most hits of all shapes together.
    pub most_hits: u64,
}

impl Cast<'_> {
    /// That of some of its shapes.
    ///
    /// # Panics
    /// Without these shapes, or filter data of them.
    #[must_use]
    pub fn part(&self, some: Range<usize>) -> Self {
        let filter_data = match self.filter_data {
            QueryFilterData::Each(each) => QueryFilterData::Each(&each[some.clone()]),
            same => same,
        };
        let shapes = match self.shapes {
            Shapes::Rays(rays) => Shapes::Rays(&rays[some]),
            Shapes::Spheres(spheres) => Shapes::Spheres(&spheres[some]),
        };
        Self { shapes, filter_data, ..*self }
    }

    /// Finds the hits, given the filters of the boxes. Returns how many boxes were looked at.
    ///
    /// # Errors
    /// As [`Scene::cast`].
    pub fn among(
        &self,
        among: Among<'_>,
        filters: &FilterHistory,
        is_still: impl Fn(u32) -> bool + Sync,
        threads: usize,
        cancel: &Cancel,
        found: &mut Vec<Hit>,
    ) -> Result<u64, CullError> {
        let Self { shapes, hits, most_hits, .. } = *self;
        let admits = self.admits(filters, is_still);
        among.cast(shapes, hits, &admits, Limits { most_hits, threads, cancel }, found)
    }

    /// Whether a shape may find a box, by their numbers.
    pub fn admits(
        &self,
        filters: &FilterHistory,
        is_still: impl Fn(u32) -> bool + Sync,
    ) -> impl Fn(u32, u32) -> bool + Sync {
        let filter_data = self.filter_data;
        move |shape, index| {
            filter_data.of(shape).is_none_or(|filter_data| {
                let of_box = filters.filter_data(index, is_still(index));
                filters.rules().may_meet(&filter_data, &of_box)
            })
        }
    }
}

/// A tree for casts, and for queries that cells do not part. It follows its boxes, and is built when that has come to cost
/// less than looking at all of them.
#[derive(Debug, Default)]
pub struct CastTree {
    tree: Option<BoxTree>,
    /// Indices that have changed since the tree was right.
    changed: Vec<u32>,
    /// More than these have.
    is_all_changed: bool,
    /// Boxes that have changed since somebody asked.
    unused: usize,
    /// Shapes that were cast without a tree.
    cast: u64,
}

impl CastTree {
    /// Bytes that are allocated.
    pub fn allocated_bytes(&self) -> usize {
        self.tree.as_ref().map_or(0, BoxTree::allocated_bytes)
            + self.changed.capacity() * size_of::<u32>()
    }

    /// Notes boxes that have changed, of so many.
    pub fn note(&mut self, changed: [&[u32]; 2], boxes: usize) {
        if self.tree.is_none() {
            return;
        }
        let count = changed[0].len() + changed[1].len();
        self.unused += count;
        if self.unused > UNUSED_ROUNDS * boxes + FEW_BOXES {
            *self = Self::default();
        } else if self.is_all_changed || self.changed.len() + count > boxes / 2 {
            self.note_all();
        } else {
            for changed in changed {
                self.changed.extend_from_slice(changed);
            }
        }
    }

    /// Notes that any box may have changed.
    pub fn note_all(&mut self) {
        self.is_all_changed = true;
        self.changed.clear();
    }

    /// Where so many shapes are looked for in boxes. No tree is built where nobody waits for the hits.
    pub fn among<'a>(
        &'a mut self,
        boxes: &'a [Aabb],
        shapes: usize,
        threads: usize,
        cancel: &Cancel,
    ) -> Among<'a> {
        if self.tree.is_none() {
            self.cast = self.cast.saturating_add(shapes as u64);
            if self.cast < MANY_SHAPES || boxes.len() <= FEW_BOXES {
                self.unused = 0;
                return Among::Boxes(boxes);
            }
        }
        self.tree(boxes, shapes, threads, cancel).map_or(Among::Boxes(boxes), Among::Tree)
    }

    /// Whether there is a tree of the boxes as they are.
    pub(super) const fn is_right(&self) -> bool {
        self.tree.is_some() && !self.is_all_changed && self.changed.is_empty()
    }

    /// The tree of boxes, as they are, for so many searches; `None` where nobody waits for it.
    pub(super) fn tree(
        &mut self,
        boxes: &[Aabb],
        searches: usize,
        threads: usize,
        cancel: &Cancel,
    ) -> Option<&BoxTree> {
        self.unused = 0;
        if self.tree.is_none() {
            let tree = BoxTree::unless(cancel, boxes, threads)?;
            (self.is_all_changed, self.cast) = (false, 0);
            return Some(self.tree.insert(tree));
        }
        let changed = (!std::mem::take(&mut self.is_all_changed)).then_some(&self.changed[..]);
        let tree = self.tree.as_mut()?;
        if changed.is_none_or(|changed| !changed.is_empty()) || tree.is_costly() {
            tree.update(boxes, changed, threads);
            self.changed.clear();
        }
        tree.note_searches(searches);
        Some(tree)
    }
}

impl Scene {
    /// Finds the boxes that rays hit or spheres touch, in the order of their [distance](crate::cast). Boxes that are
    /// disabled are not found; static ones are. What `found` held is dropped. Returns how many boxes were looked at.
    ///
    /// A cast changes nothing that edits report.
    ///
    /// ```
    /// use pairmask_core::Aabb;
    /// use pairmask_core::cast::{Hits, Ray, Shapes};
    /// use pairmask_core::scene::{Cast, Edit, QueryFilterData, Report, Scene, SceneOptions, Sets, Step};
    ///
    /// let boxes = [5.0, 2.0].map(|x| Aabb::new([x, -1.0, -1.0], [x + 1.0, 1.0, 1.0]));
    /// let mut scene = Scene::new(SceneOptions::default());
    /// let set = [Step::Set(Sets { indices: (7..9).into(), boxes: &boxes })];
    /// scene.edit(Edit { steps: &set }, Report::Nothing)?;
    ///
    /// let cast = Cast {
    ///     shapes: Shapes::Rays(&[Ray::new([0.0; 3], [1.0, 0.0, 0.0])]),
    ///     hits: Hits::Closest(1),
    ///     filter_data: QueryFilterData::None,
    ///     most_hits: 100,
    /// };
    /// let mut found = Vec::new();
    /// scene.cast(&cast, &mut found)?;
    /// assert_eq!((found[0].index, found[0].distance), (8, 2.0));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`QueryError::FilterData`]; [`CullError::Reserve`] where there are more hits than may be, or there is no memory for
    /// them; [`CullError::Cancelled`], which changes nothing.
    pub fn cast(&mut self, cast: &Cast<'_>, found: &mut Vec<Hit>) -> Result<u64, QueryError> {
        cast.filter_data.check(cast.shapes.len())?;
        let shapes = cast.shapes.len();
        self.threads = team::threads_for(shapes as f64 * CAST_NS, self.options.threads);
        let threads = self.threads;
        let _team = team::enter(threads);
        let among = self.asked.casts.among(self.store.boxes(), shapes, threads, &self.cancel);
        let states = &self.store.states;
        let is_still = |index| states.has(index, STILL);
        Ok(cast.among(among, &states.filters, is_still, threads, &self.cancel, found)?)
    }
}
