//! Queries of scenes beside the model, which compares each query with each box, after each of random edits.

use pairmask_core::filters::{FilterId, Owner, Tag, World};
use pairmask_core::scene::{Edit, QueryTags, Report};
use pairmask_core::{Aabb, Encoding};

use crate::scene_model::{BareScene, Edits, Grouped};
use crate::stress_scenes::Rng;

type Pair = [u32; 2];

pub trait QueriedScene {
    fn edit(&mut self, edit: Edit<'_>);
    fn query(&mut self, queries: &[Aabb], tags: QueryTags<'_>, encoding: Encoding) -> Vec<Pair>;
}

impl<S: BareScene> QueriedScene for S {
    fn edit(&mut self, edit: Edit<'_>) {
        BareScene::edit(self, edit, Report::Nothing).expect("a right edit");
    }

    fn query(&mut self, queries: &[Aabb], tags: QueryTags<'_>, _: Encoding) -> Vec<Pair> {
        BareScene::query(self, queries, tags).expect("an answer")
    }
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
        // Beside it, by the least there is.
        _ if rng.below(2) == 0 => Aabb::new(b.max.map(f32::next_up), b.max.map(|x| x + 1.0)),
        _ => Aabb::new([f32::NEG_INFINITY; 3], [f32::INFINITY; 3]),
    }
}

pub struct Queries {
    edits: Edits,
    rng: Rng,
    has_tags: bool,
}

impl Queries {
    pub fn new(seed: u64, largest: u32, has_tags: bool) -> Self {
        let edits = Edits::new(seed, largest);
        let edits = if has_tags { edits } else { edits.without_rules() };
        Self { edits, rng: Rng::new(!seed), has_tags }
    }

    fn a_tag(&mut self) -> Tag {
        let world = World(self.rng.below(3) as i32 - 1);
        let tag = Tag::new(world, Owner(self.rng.below(3)), FilterId(self.rng.below(5) as u16));
        tag.with_static(self.rng.below(3) == 0)
    }

    /// Makes an edit, asks so many queries, and checks the answer. Returns how many pairs there were.
    pub fn check(&mut self, scene: &mut impl QueriedScene, count: usize) -> usize {
        let ops = self.edits.next_edit();
        scene.edit(Edit { steps: &Grouped::of(&ops).steps() });
        let extent = self.edits.extent();
        let queries: Vec<Aabb> = (0..count).map(|_| a_query(&mut self.rng, extent)).collect();
        let each: Vec<Tag> = (0..count).map(|_| self.a_tag()).collect();
        let tags = match self.rng.below(4) {
            2 if self.has_tags => QueryTags::One(self.a_tag()),
            3 if self.has_tags => QueryTags::Each(&each),
            _ => QueryTags::None,
        };
        let encoding = Encoding::ALL[self.rng.below(3) as usize];
        let found = scene.query(&queries, tags, encoding);
        let (model, boxes) = (self.edits.model(), self.edits.model().len());
        let expected = model.query(&queries, tags);
        assert!(
            found == expected,
            "{count} queries of {boxes} boxes, {tags:?}, {encoding}: {} pairs for {}",
            found.len(),
            expected.len()
        );
        expected.len()
    }
}
