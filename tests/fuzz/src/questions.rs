//! Queries and casts of a scene with filters, beside the naive model.

use pairmask_core::cast::{Hits, Ray, Shapes};
use pairmask_core::filters::{FilterData, FilterTable};
use pairmask_core::scene::{
    Cast, Edit, FilterDataSets, Indices, QueryFilterData, Report, Scene, SceneOptions, Sets, Step,
};
use pairmask_core::{Aabb, Sphere};
use pairmask_tests::casts;
use pairmask_tests::scene_model::{Model, Op};

use crate::input::Input;

/// Boxes of a scene, its filters and the questions are fewer.
const MOST_BOXES: u32 = 100;
const MOST_FILTERS: u32 = 8;
const MOST_QUESTIONS: u32 = 40;
/// Hits and pairs are fewer than all questions about all boxes.
const MOST_HITS: u64 = 1 << 20;

pub fn decode(data: &[u8]) {
    let mut input = Input(data);
    let counts = [MOST_BOXES, MOST_FILTERS, MOST_BOXES].map(|end| input.below(end));
    let first = input.below(4);
    let boxes = input.some(counts[0], Input::aabb);
    let filters = input.some(counts[1], Input::filter);
    let filter_data = input.some(counts[2].min(boxes.len() as u32), Input::filter_data);
    let off = input.some(8, Input::byte);
    let off: Vec<u32> =
        off.into_iter().map(u32::from).filter(|at| *at < boxes.len() as u32).collect();

    let table = FilterTable::new(&filters).expect("few filters");
    let disabled: Vec<u32> = off.iter().map(|at| first + at).collect();
    let named = Indices::Range { first, count: filter_data.len() as u32 };
    let steps = [
        Step::Set(Sets { indices: (first..first + boxes.len() as u32).into(), boxes: &boxes }),
        Step::Enable(Indices::List(&disabled), false),
        Step::Filters(&table),
        Step::FilterData(FilterDataSets { indices: named, filter_data: &filter_data }),
    ];
    let mut scene = Scene::new(SceneOptions::default());
    scene.edit(Edit { steps: &steps }, Report::Nothing).expect("a right edit");
    let mut model = Model::default();
    let sets = (first..).zip(&boxes).map(|(index, b)| Op::Set(index, *b));
    let disables = disabled.iter().map(|index| Op::Enable(*index, false));
    let given = (first..).zip(&filter_data).map(|(index, of)| Op::FilterData(index, *of));
    let ops: Vec<Op> = sets.chain(disables).chain([Op::Filters(filters)]).chain(given).collect();
    model.apply(0, &ops);

    while !input.is_empty() {
        let kind = input.byte();
        let count = input.below(MOST_QUESTIONS);
        let each = input.some(count, Input::filter_data);
        match kind % 3 {
            0 => query(&mut scene, &model, &input.some(count, Input::aabb), (kind, &each)),
            1 => {
                let rays = input.some(count, a_ray);
                cast(&mut scene, &model, Shapes::Rays(&rays), (kind, &each), &mut input);
            }
            _ => {
                let spheres = input.some(count, a_sphere);
                cast(&mut scene, &model, Shapes::Spheres(&spheres), (kind, &each), &mut input);
            }
        }
    }
}

fn a_ray(input: &mut Input<'_>) -> Ray {
    let mut point =
        |signed: bool| [0; 3].map(|_: u8| input.coordinate() - if signed { 31.0 } else { 0.0 });
    let (origin, direction, half_extents) = (point(false), point(true), point(false));
    let ray = Ray::new(origin, direction).with_half_extents(half_extents);
    if input.flag() { ray.up_to(input.coordinate()) } else { ray.with_half_extents([0.0; 3]) }
}

fn a_sphere(input: &mut Input<'_>) -> Sphere {
    let center = [0; 3].map(|_: u8| input.coordinate());
    Sphere::new(center, input.coordinate())
}

/// How questions have filter data, and filter data of some.
type Given<'a> = (u8, &'a [FilterData]);

/// Filter data for so many questions: none, one or one for each.
fn filter_data((kind, each): Given<'_>, count: usize) -> QueryFilterData<'_> {
    match (kind & 0x60, each.first()) {
        (0x20, Some(one)) => QueryFilterData::One(*one),
        (0x40, _) if each.len() >= count => QueryFilterData::Each(&each[..count]),
        _ => QueryFilterData::None,
    }
}

fn query(scene: &mut Scene, model: &Model, queries: &[Aabb], given: Given<'_>) {
    let filter_data = filter_data(given, queries.len());
    let mut found = Vec::new();
    scene.query(queries, filter_data, &mut found).expect("few pairs");
    assert_eq!(found, model.query(queries, filter_data));
}

fn cast(
    scene: &mut Scene,
    model: &Model,
    shapes: Shapes<'_>,
    given: Given<'_>,
    input: &mut Input<'_>,
) {
    let hits = match input.byte() {
        0 => Hits::All,
        1 => Hits::Any,
        255 => Hits::Closest(u32::MAX),
        most => Hits::Closest(u32::from(most) - 2),
    };
    let filter_data = filter_data(given, shapes.len());
    let mut found = Vec::new();
    let cast = Cast { shapes, hits, filter_data, most_hits: MOST_HITS };
    scene.cast(&cast, &mut found).expect("few hits");
    for (number, own) in (0..).zip(casts::by_query(&found, shapes.len())) {
        let boxes = model.boxes_found_by(filter_data.of(number));
        let expected = match shapes {
            Shapes::Rays(rays) => casts::hit_by(&rays[number as usize], &boxes),
            Shapes::Spheres(spheres) => casts::touched_by(&spheres[number as usize], &boxes),
        };
        casts::check(number, own, &expected, hits).expect("as the naive answer");
    }
}
