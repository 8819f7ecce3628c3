//! Queries of scenes beside the model, which compares each query with each box, after each of random edits.

use pairmask_core::cast::{Hit, Ray, Shapes};
use pairmask_core::filters::{FilterData, FilterId, Owner, World};
use pairmask_core::scene::{Cast, Edit, QueryFilterData, Report};
use pairmask_core::{Aabb, Encoding, Sphere};

use crate::casts::{a_ray, a_sphere, by_query, check, hit_by, some_hits, touched_by};
use crate::scene_model::{BareScene, Edits, Grouped};
use crate::stress_scenes::Rng;

type Pair = [u32; 2];

/// Rays and spheres that are cast at a time: exact fractions take their time.
const MOST_CAST: usize = 20;
const MOST_HITS: u64 = 1 << 24;

pub trait QueriedScene {
    fn edit(&mut self, edit: Edit<'_>);
    fn query(
        &mut self,
        queries: &[Aabb],
        filter_data: QueryFilterData<'_>,
        encoding: Encoding,
    ) -> Vec<Pair>;
    fn cast(&mut self, cast: &Cast<'_>) -> Vec<Hit>;
}

impl<S: BareScene> QueriedScene for S {
    fn edit(&mut self, edit: Edit<'_>) {
        BareScene::edit(self, edit, Report::Nothing).expect("a right edit");
    }

    fn query(
        &mut self,
        queries: &[Aabb],
        filter_data: QueryFilterData<'_>,
        _: Encoding,
    ) -> Vec<Pair> {
        BareScene::query(self, queries, filter_data).expect("an answer")
    }

    fn cast(&mut self, cast: &Cast<'_>) -> Vec<Hit> {
        BareScene::cast(self, cast).expect("an answer")
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
    has_filter_data: bool,
}

impl Queries {
    pub fn new(seed: u64, largest: u32, has_filter_data: bool) -> Self {
        let edits = Edits::new(seed, largest);
        let edits = if has_filter_data { edits } else { edits.without_rules() };
        Self { edits, rng: Rng::new(!seed), has_filter_data }
    }

    fn some_filter_data(&mut self) -> FilterData {
        let world = World(self.rng.below(3) as i32 - 1);
        let filter_data =
            FilterData::new(world, Owner(self.rng.below(3)), FilterId(self.rng.below(5) as u16));
        filter_data.with_static(self.rng.below(3) == 0)
    }

    /// Makes an edit, asks so many queries, and checks the answer. Returns how many pairs there were.
    pub fn check(&mut self, scene: &mut impl QueriedScene, count: usize) -> usize {
        let ops = self.edits.next_edit();
        scene.edit(Edit { steps: &Grouped::of(&ops).steps() });
        let extent = self.edits.extent();
        let queries: Vec<Aabb> = (0..count).map(|_| a_query(&mut self.rng, extent)).collect();
        let each: Vec<FilterData> = (0..count).map(|_| self.some_filter_data()).collect();
        let filter_data = match self.rng.below(4) {
            2 if self.has_filter_data => QueryFilterData::One(self.some_filter_data()),
            3 if self.has_filter_data => QueryFilterData::Each(&each),
            _ => QueryFilterData::None,
        };
        let encoding = Encoding::ALL[self.rng.below(3) as usize];
        let found = scene.query(&queries, filter_data, encoding);
        let (model, boxes) = (self.edits.model(), self.edits.model().len());
        let expected = model.query(&queries, filter_data);
        assert!(
            found == expected,
            "{count} queries of {boxes} boxes, {filter_data:?}, {encoding}: {} pairs for {}",
            found.len(),
            expected.len()
        );
        self.check_casts(scene, count.min(MOST_CAST), filter_data);
        expected.len()
    }

    /// Casts so many rays and spheres, and checks the hits by exact fractions.
    fn check_casts(
        &mut self,
        scene: &mut impl QueriedScene,
        count: usize,
        filter_data: QueryFilterData<'_>,
    ) {
        let (extent, rng, model) = (self.edits.extent(), &mut self.rng, self.edits.model());
        let rays: Vec<Ray> = (0..count).map(|_| a_ray(rng, extent)).collect();
        let spheres: Vec<Sphere> = (0..count).map(|_| a_sphere(rng, extent)).collect();
        let filter_data = match filter_data {
            QueryFilterData::Each(each) => QueryFilterData::Each(&each[..count]),
            other => other,
        };
        let boxes = |query| model.boxes_found_by(filter_data.of(query));
        let of_all = boxes(0);
        for shapes in [Shapes::Rays(&rays), Shapes::Spheres(&spheres)] {
            let hits = some_hits(rng);
            let found = scene.cast(&Cast { shapes, hits, filter_data, most_hits: MOST_HITS });
            for (query, found) in (0..).zip(by_query(&found, count)) {
                let own = matches!(filter_data, QueryFilterData::Each(_)).then(|| boxes(query));
                let boxes = own.as_ref().unwrap_or(&of_all);
                let expected = match shapes {
                    Shapes::Rays(rays) => hit_by(&rays[query as usize], boxes),
                    Shapes::Spheres(spheres) => touched_by(&spheres[query as usize], boxes),
                };
                check(query, found, &expected, hits).unwrap_or_else(|wrong| panic!("{wrong}"));
            }
        }
    }
}
