//! Queries of scenes beside a model that compares each query with each box, after each of random edits.

use std::collections::BTreeMap;

use pairmask_core::filters::{Filter, FilterId, FilterTable, Owner, Tag, World};
use pairmask_core::scene::{Edit, QueryTags, Scene, Step, Tags, Want};
use pairmask_core::{Aabb, Encoding};

use crate::scene_edits::{EditMaker, OwnedEdit};
use crate::stress_scenes::Rng;

type Pair = [u32; 2];

/// A scene that is edited and queried.
pub trait QueriedScene {
    /// Applies an edit, which is right.
    fn edit(&mut self, edit: Edit<'_>);
    /// The pairs [query, index].
    fn query(&mut self, queries: &[Aabb], tags: QueryTags<'_>, encoding: Encoding) -> Vec<Pair>;
}

impl QueriedScene for Scene {
    fn edit(&mut self, edit: Edit<'_>) {
        Self::edit(self, edit, Want::Nothing).expect("a right edit");
    }

    fn query(&mut self, queries: &[Aabb], tags: QueryTags<'_>, _: Encoding) -> Vec<Pair> {
        let mut found = Vec::new();
        Self::query(self, queries, tags, &mut found).expect("an answer");
        found
    }
}

/// Whether two boxes overlap: written anew, apart from the engines'.
pub fn overlap(a: &Aabb, b: &Aabb) -> bool {
    let is_solid = |b: &Aabb| (0..3).all(|axis| b.min[axis] <= b.max[axis]);
    let is_over = (0..3).all(|axis| a.min[axis] <= b.max[axis] && b.min[axis] <= a.max[axis]);
    is_solid(a) && is_solid(b) && is_over
}

/// A box that is drawn for a query: a box, a point, a sweep, or one of those that are odd.
pub fn a_query(rng: &mut Rng, extent: f32) -> Aabb {
    let mut point = || rng.point().map(|x| (x * 4.0 * extent).floor() / 4.0);
    let (at, to) = (point(), point());
    let length = [0.0, 0.25, 1.0, 3.0][rng.below(4) as usize];
    let b = Aabb::new(at, at.map(|x| x + length));
    match rng.below(16) {
        0..=4 => b,
        5..=7 => Aabb::point(at),
        8 => Aabb::swept(&b, &Aabb::new(to, to.map(|x| x + length))),
        9..=11 => b.swept_by(to.map(|x| (x - extent / 2.0) / 8.0)),
        12 => Aabb::EMPTY,
        13 => Aabb::new(at, [at[0] - 1.0, extent, extent]),
        14 => {
            let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -0.0][rng.below(4) as usize];
            let mut values = <[f32; 6]>::from(b);
            values[rng.below(6) as usize] = odd;
            Aabb::from(values)
        }
        _ => Aabb::new([f32::NEG_INFINITY; 3], [f32::INFINITY; 3]),
    }
}

/// What the rules know of a box.
#[derive(Clone, Copy, Debug, Default)]
struct Body {
    is_off: bool,
    tag: Tag,
}

/// Random edits, and what they make of a scene.
pub struct Queries {
    maker: EditMaker,
    rng: Rng,
    bodies: BTreeMap<u32, Body>,
    filters: Vec<Filter>,
    extent: f32,
}

impl Queries {
    /// Of a scene that grows to so many boxes at most, and shrinks again.
    pub fn new(seed: u64, largest: usize) -> Self {
        Self {
            maker: EditMaker::new(seed, largest),
            rng: Rng::new(!seed),
            bodies: BTreeMap::new(),
            filters: Vec::new(),
            extent: 8.0,
        }
    }

    /// Has the scene grow to so many boxes.
    pub fn aim(&mut self, boxes: usize) {
        self.maker.aim(boxes, boxes);
        self.extent = (boxes as f32 * 6.0).cbrt();
    }

    /// Boxes of now.
    pub fn len(&self) -> usize {
        self.maker.boxes().len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Makes an edit.
    pub fn edit(&mut self, scene: &mut impl QueriedScene) {
        let edit = self.maker.next_edit();
        edit.with(self.rng.below(3) as usize, |edit| scene.edit(edit));
        self.note(&edit);
    }

    fn note(&mut self, edit: &OwnedEdit) {
        self.bodies.retain(|index, _| !edit.removed.contains(index));
        for index in edit.set.keys() {
            self.bodies.entry(*index).or_default();
        }
        for (index, on) in &edit.switched {
            self.bodies.entry(*index).or_default().is_off = !on;
        }
        for (index, on) in &edit.flagged {
            let body = self.bodies.entry(*index).or_default();
            body.tag = body.tag.with_static(*on);
        }
    }

    fn a_tag(&mut self) -> Tag {
        let world = World(self.rng.below(3) as i32 - 1);
        let tag = Tag::new(world, Owner(self.rng.below(3)), FilterId(self.rng.below(5) as u16));
        tag.with_static(self.rng.below(3) == 0)
    }

    /// Gives some boxes tags, and the scene filters now and then.
    ///
    /// # Panics
    /// When the table of filters, or an edit, is refused.
    pub fn edit_rules(&mut self, scene: &mut impl QueriedScene) {
        let indices: Vec<u32> = self.bodies.keys().copied().collect();
        let indices: Vec<u32> = indices.into_iter().filter(|_| self.rng.below(4) == 0).collect();
        let tags: Vec<Tag> = indices.iter().map(|_| self.a_tag()).collect();
        if self.rng.below(4) == 0 {
            let count = self.rng.below(6);
            let filter = |rng: &mut Rng| {
                let filter = Filter::new(u64::from(rng.below(4)), u64::from(rng.below(4)));
                let filter = filter.with_group(rng.below(4) as i32 - 1);
                filter.with_static(rng.below(5) == 0).with_either(rng.below(2) == 0)
            };
            self.filters = (0..count).map(|_| filter(&mut self.rng)).collect();
        }
        let table = FilterTable::new(&self.filters).expect("few filters");
        // A query has no index, so that lists say nothing of it.
        let pairs: Vec<Pair> = indices.windows(2).map(|pair| [pair[0], pair[1]]).collect();
        let steps = [
            Step::Tag(Tags { indices: (&indices).into(), tags: &tags }),
            Step::Filters(&table),
            Step::Include(&pairs, true),
            Step::Exclude(&pairs, self.rng.below(2) == 0),
        ];
        scene.edit(Edit { steps: &steps });
        for (index, tag) in indices.iter().zip(tags) {
            // Whether a box is static another step says.
            let body = self.bodies.entry(*index).or_default();
            body.tag = tag.with_static(body.tag.is_static());
        }
    }

    /// The rules, in their order.
    fn may_meet(&self, a: &Tag, b: &Tag) -> bool {
        let (w, v) = (a.world.0, b.world.0);
        let filter = |tag: &Tag| self.filters.get(usize::from(tag.filter.0)).copied();
        let (f, g) = (filter(a).unwrap_or(Filter::ALL), filter(b).unwrap_or(Filter::ALL));
        if w != v && w != -1 && v != -1 || a.owner == b.owner && a.owner.0 != 0 {
            return false;
        }
        if (a.is_static() || f.is_static) && (b.is_static() || g.is_static) {
            return false;
        }
        if f.group == g.group && f.group != 0 {
            return f.group > 0;
        }
        let (one, other) = (f.category & g.mask != 0, g.category & f.mask != 0);
        if f.either && g.either { one || other } else { one && other }
    }

    fn expected(&self, queries: &[Aabb], tags: QueryTags<'_>) -> Vec<Pair> {
        let mut pairs = Vec::new();
        for (number, query) in (0..).zip(queries) {
            for (index, b) in self.maker.boxes() {
                let body = &self.bodies[index];
                let meets = match tags {
                    QueryTags::None => true,
                    QueryTags::One(tag) => self.may_meet(&tag, &body.tag),
                    QueryTags::Each(tags) => self.may_meet(&tags[number as usize], &body.tag),
                };
                if meets && !body.is_off && overlap(query, b) {
                    pairs.push([number, *index]);
                }
            }
        }
        pairs
    }

    /// Draws so many queries, asks, and checks the answer in each way. Returns how many pairs there were.
    ///
    /// # Panics
    /// Where an answer is wrong.
    pub fn check(&mut self, scene: &mut impl QueriedScene, count: usize) -> usize {
        let extent = self.extent;
        let queries: Vec<Aabb> = (0..count).map(|_| a_query(&mut self.rng, extent)).collect();
        let each: Vec<Tag> = (0..count).map(|_| self.a_tag()).collect();
        let tags = match self.rng.below(4) {
            0 | 1 => QueryTags::None,
            2 => QueryTags::One(self.a_tag()),
            _ => QueryTags::Each(&each),
        };
        let encodings = [Encoding::List, Encoding::Sparse, Encoding::Dense];
        let encoding = encodings[self.rng.below(3) as usize];
        let found = scene.query(&queries, tags, encoding);
        let expected = self.expected(&queries, tags);
        assert!(
            found == expected,
            "{count} queries of {} boxes, {tags:?}, {encoding}: {} pairs for {}",
            self.len(),
            found.len(),
            expected.len()
        );
        expected.len()
    }
}
