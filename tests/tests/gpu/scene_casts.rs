//! Casts into scenes in video memory beside the core's, which are held to exact fractions: of many rays and spheres, for
//! which the GPU looks, and of few, which are the cores'.

use std::sync::Arc;

use pairmask::cast::{Hit, Hits, Ray, Shapes};
use pairmask_core::engine::CullError;
use pairmask_core::filters::{FilterData, World};
use pairmask_core::scene::{Cast, FilterDataSets, Indices, QueryError, QueryFilterData, Scene};
use pairmask_tests::casts::{Numbers, a_ray, a_sphere, some_hits};
use pairmask_tests::gpu::{scene_tools, shared_tools};
use pairmask_tests::prelude::*;
use pairmask_tests::stress_scenes::Rng;
use pairmaskd::execute::gpu::{Checks, EngineOptions, GpuScene, SceneTools};

/// So many the GPU looks for.
const MANY: usize = 600;
const MOST_HITS: u64 = 1 << 22;

/// A scene in video memory beside the core's.
struct Both {
    gpu: GpuScene,
    core: Scene,
    found: [Vec<Hit>; 2],
    /// Rays and spheres that were cast in batches of many, and how many of them were the cores'.
    cast: usize,
    left: usize,
}

impl Both {
    fn new(tools: &[Arc<SceneTools>], boxes: &[Aabb]) -> Self {
        let gpu = GpuScene::shared(tools, SceneOptions::default());
        let core = Scene::new(SceneOptions::default());
        let mut both = Self { gpu, core, found: [Vec::new(), Vec::new()], cast: 0, left: 0 };
        both.edit(&sets_all(boxes));
        both
    }

    fn edit(&mut self, steps: &[Step<'_>]) {
        self.core.edit(Edit { steps }, Report::Nothing).expect("right");
        self.gpu.edit(Edit { steps }, Report::Nothing).expect("right");
    }

    fn check(&mut self, cast: &Cast<'_>, what: &str) {
        let Self { gpu, core, found: [right, found], .. } = self;
        core.cast(cast, right).expect("hits");
        gpu.cast(cast, found).expect("hits");
        let first = right.iter().zip(found.iter()).find(|(right, found)| right != found);
        assert!(right == found, "{what}, {:?}: first {first:?}", cast.hits);
        if cast.shapes.len() >= MANY {
            self.cast += cast.shapes.len();
            self.left += gpu.left_to_cores();
        }
    }

    /// Casts rays and spheres in some of the ways.
    fn ask(&mut self, rays: &[Ray], spheres: &[Sphere], hits: Hits, what: &str) {
        let all = [Shapes::from(rays), Shapes::from(spheres)];
        for shapes in all.into_iter().filter(|shapes| !shapes.is_empty()) {
            let filter_data = QueryFilterData::None;
            self.check(&Cast { shapes, hits, filter_data, most_hits: MOST_HITS }, what);
        }
    }

    /// How much of what the GPU is asked it leaves to the cores.
    fn left_share(&self) -> f64 {
        self.left as f64 / self.cast as f64
    }
}

fn tools_with(options: &EngineOptions) -> [Arc<SceneTools>; 1] {
    [scene_tools(0, options)]
}

/// Usual questions among which one in twenty is as odd as the boxes may be, all of them so many times as large.
fn questions(numbers: Numbers, scale: f32, rng: &mut Rng) -> (Vec<Ray>, Vec<Sphere>) {
    let of = |at: usize| match at % 20 {
        0 => numbers,
        1..10 => Numbers::Quarters,
        _ => Numbers::Fractions,
    };
    let scaled = |point: [f32; 3]| point.map(|x| x * scale);
    let rays = (0..MANY).map(|at| {
        let ray = of(at).ray(rng);
        Ray {
            origin: scaled(ray.origin),
            half_extents: scaled(ray.half_extents),
            most: if at % 2 == 0 { ray.most * scale } else { ray.most },
            ..ray
        }
    });
    let rays = rays.collect();
    let spheres = (0..MANY).map(|at| {
        let sphere = of(at).sphere(rng);
        let far = [1.0, 1.0, 1e3, 1e15][rng.below(4) as usize];
        Sphere::new(scaled(sphere.center), sphere.radius * scale * far)
    });
    (rays, spheres.collect())
}

/// Boxes and questions of every magnitude, with checked stages and in memory that held something else as well.
#[test]
fn rays_and_spheres_hit_what_the_core_says() {
    let poisoned = |word| EngineOptions { poison: Some(word), ..EngineOptions::default() };
    let checked = EngineOptions { checks: Checks::On, ..EngineOptions::default() };
    let all = [EngineOptions::default(), checked, poisoned(0xa5a5_a5a5), poisoned(u32::MAX)];
    let (mut cast, mut left) = (0, 0);
    for (seed, options) in (0..).zip(all) {
        let (tools, mut rng) = (tools_with(&options), Rng::new(seed));
        for round in 0..tier::nightly_or(60, 4) {
            for numbers in Numbers::ALL {
                let n = [1, 17, 300, 2_000][round % 4];
                let scale = [1.0, 1e-9, 1e14, 3e17][rng.below(4) as usize];
                let boxes = (0..n).map(|_| {
                    let Aabb { min, max } = numbers.some_box(&mut rng);
                    Aabb::new(min.map(|x| x * scale), max.map(|x| x * scale))
                });
                let boxes: Vec<Aabb> = boxes.collect();
                let (rays, spheres) = questions(numbers, scale.min(1e14), &mut rng);
                let mut both = Both::new(&tools, &boxes);
                for _ in 0..3 {
                    let hits = some_hits(&mut rng);
                    both.ask(&rays, &spheres, hits, &format!("{numbers:?} {scale}, {n} boxes"));
                }
                (cast, left) = (cast + both.cast, left + both.left);
            }
        }
    }
    assert!(left * 4 < cast, "{left} of {cast} were the cores'");
}

/// A sphere whose radius is large and ends before the boxes that a search looks at first.
#[test]
fn a_large_radius_ends() {
    let near = Aabb::new([-1.3e15; 3], [-1.2e15; 3]);
    let far = |axis: usize| {
        let min: [f32; 3] = std::array::from_fn(|at| if at == axis { 1e17 } else { -1e15 });
        Aabb::new(min, min.map(|x| x + 1e16))
    };
    let mut boxes = vec![near; 32];
    boxes.extend((0..32).map(|at| far(at % 2)));
    let mut both = Both::new(&tools_with(&EngineOptions::default()), &boxes);
    for radius in [1e15, 2.5e15, 1e17, 3e17, 1e19, f32::INFINITY] {
        for hits in [Hits::Any, Hits::All, Hits::Closest(5)] {
            let spheres = vec![Sphere::new([0.0; 3], radius); MANY];
            both.ask(&[], &spheres, hits, &format!("a radius of {radius}"));
        }
    }
}

/// Ordinary rays and spheres are the GPU's, nearly all of them.
#[test]
fn the_gpu_leaves_little_to_the_cores() {
    let tools = tools_with(&EngineOptions::default());
    let mut rng = Rng::new(5);
    for hard in stress_scenes::ALL {
        let boxes = hard.boxes(2_500, 8);
        let mut both = Both::new(&tools, &boxes);
        for _ in 0..3 {
            let rays: Vec<Ray> = (0..MANY).map(|_| a_ray(&mut rng, 60.0)).collect();
            let spheres: Vec<Sphere> = (0..MANY).map(|_| a_sphere(&mut rng, 60.0)).collect();
            both.ask(&rays, &spheres, some_hits(&mut rng), &format!("{hard:?}"));
        }
    }
    let boxes = stress_scenes::named("uniform").boxes(3_000, 8);
    let mut both = Both::new(&tools, &boxes);
    let bounds = boxes.iter().fold(0.0, |most: f32, b| most.max(b.max[0]));
    let rays: Vec<Ray> = (0..MANY).map(|_| a_ray(&mut rng, bounds)).collect();
    let spheres: Vec<Sphere> = (0..MANY).map(|_| a_sphere(&mut rng, bounds)).collect();
    for hits in [Hits::All, Hits::Any, Hits::Closest(1), Hits::Closest(8), Hits::Closest(32)] {
        both.ask(&rays, &spheres, hits, "uniform");
    }
    assert!(both.left_share() < 0.01, "{}", both.left_share());
}

/// Boxes at the same distance come by index, on a GPU too that cannot keep all of them at hand.
#[test]
fn what_is_as_near_comes_by_index() {
    let tools = tools_with(&EngineOptions::default());
    let one = Aabb::new([2.0, -1.0, -1.0], [3.0, 1.0, 1.0]);
    let rays = vec![Ray::new([0.0; 3], [1.0, 0.0, 0.0]); MANY];
    let within = vec![Ray::new([2.5, 0.0, 0.0], [1.0, 0.0, 0.0]); MANY];
    let spheres = vec![Sphere::new([0.0; 3], 4.0); MANY];
    for n in [20, 100, 700] {
        for hits in [Hits::Closest(1), Hits::Closest(9), Hits::Closest(32), Hits::Any, Hits::All] {
            let mut both = Both::new(&tools, &vec![one; n]);
            both.ask(&rays, &spheres, hits, &format!("{n} times the same"));
            // What contains the origin is ordered by its index.
            let mut both = Both::new(&tools, &vec![one; n]);
            both.ask(&within, &[], hits, &format!("{n} around the origin"));
            assert_eq!(both.left, 0, "{n} {hits:?}");
        }
    }
}

/// More hits than there is room for at first, and than may be.
#[test]
fn many_hits_have_room_or_are_an_error() {
    let tools = tools_with(&EngineOptions::default());
    let boxes: Vec<Aabb> = (0..900).map(|index| at(index as f32)).collect();
    let mut both = Both::new(&tools, &boxes);
    let rays = vec![Ray::new([-9.0, 0.5, 0.5], [1.0, 0.0, 0.0]); MANY];
    both.ask(&rays, &[], Hits::All, "a row");
    assert_eq!(both.found[1].len(), 900 * MANY);
    both.ask(&rays, &[], Hits::Closest(1), "after a row");
    assert_eq!(both.left, 0);
    let cast = |most_hits| Cast {
        shapes: Shapes::Rays(&rays),
        hits: Hits::All,
        filter_data: QueryFilterData::None,
        most_hits,
    };
    let count = 900 * MANY as u64;
    both.check(&cast(count), "as many as may be");
    let refused = [both.core.cast(&cast(count - 1), &mut Vec::new()), {
        both.gpu.cast(&cast(count - 1), &mut Vec::new())
    }];
    let [right, found] = refused.map(|refused| refused.expect_err("too many").to_string());
    assert_eq!(right, found);
}

/// More rays than one submission takes, and fewer hits of later ones than may be of all.
#[test]
fn casts_of_several_submissions_are_numbered_on() {
    let tools = tools_with(&EngineOptions::default());
    let mut both = Both::new(&tools, &[at(0.0), at(5.0)]);
    let mut rays = vec![Ray::new([0.0, 9.0, 0.0], [1.0, 0.0, 0.0]); (1 << 18) + 300];
    let count = rays.len();
    for at in [0, 7, (1 << 18) - 1, 1 << 18, count - 1] {
        rays[at] = Ray::new([-9.0, 0.5, 0.5], [1.0, 0.0, 0.0]);
    }
    both.ask(&rays, &[], Hits::All, "many rays");
    assert_eq!((both.found[1].len(), both.left), (10, 0));
    let (shapes, filter_data) = (Shapes::Rays(&rays), QueryFilterData::None);
    let cast = Cast { shapes, hits: Hits::All, filter_data, most_hits: 8 };
    let mut found = vec![Hit::default()];
    let right = both.core.cast(&cast, &mut Vec::new()).expect_err("too many").to_string();
    let refused = both.gpu.cast(&cast, &mut found).expect_err("too many").to_string();
    assert_eq!((refused, found), (right, Vec::new()));
}

/// Shapes with filter data find what they may meet.
#[test]
fn filters_say_what_is_found() {
    let tools = tools_with(&EngineOptions::default());
    let mut rng = Rng::new(9);
    let boxes = stress_scenes::named("uniform").boxes(500, 8);
    let mut both = Both::new(&tools, &boxes);
    let data: Vec<FilterData> =
        (0..500).map(|index| FilterData::default().with_world(World(index % 3))).collect();
    let given = FilterDataSets { indices: Indices::from(0..500), filter_data: &data };
    both.edit(&[Step::FilterData(given)]);
    let rays: Vec<Ray> = (0..MANY).map(|_| a_ray(&mut rng, 12.0)).collect();
    let each: Vec<FilterData> =
        (0..MANY as i32).map(|query| FilterData::default().with_world(World(query % 3))).collect();
    for filter_data in [QueryFilterData::One(each[1]), QueryFilterData::Each(&each)] {
        for hits in [Hits::All, Hits::Any, Hits::Closest(2)] {
            let shapes = Shapes::Rays(&rays);
            both.check(&Cast { shapes, hits, filter_data, most_hits: MOST_HITS }, "worlds");
            assert_eq!(both.gpu.left_to_cores() == 0, hits == Hits::All);
        }
    }
}

/// What casts look at, in video memory and beside it, follows edits; the copy is read again after some without a cast.
#[test]
fn casts_follow_edits() {
    let boxes: Vec<Aabb> = (0..400).map(|index| at(index as f32)).collect();
    let mut both = Both::new(&tools_with(&EngineOptions::default()), &boxes);
    // Each hits all boxes; from 32 casts on there is a tree.
    let rays = vec![Ray::new([-9.0, 0.5, 0.5], [1.0, 0.0, 0.0]); MANY];
    let mut random = Rng::new(3);
    for round in 0..200 {
        let index = random.below(if round < 100 { 400 } else { 900 });
        let one = Indices::Range { first: index, count: 1 };
        let moved = [at(random.below(900) as f32)];
        let (is_there, set) = (both.core.get(index).is_some(), sets(index..index + 1, &moved));
        let on = Step::Enable(one, random.below(2) == 0);
        let steps: &[Step<'_>] = match random.below(6) {
            0 if is_there => &[Step::Remove(one)],
            1 if is_there => &[Step::Remove(one), set, on],
            2 | 3 if is_there => &[on],
            4 => &[on, set],
            _ => &[set],
        };
        let edit = if random.below(30) == 0 { &sets_all(&boxes)[..] } else { steps };
        for _ in 0..if random.below(20) == 0 { 12 } else { 1 } {
            both.edit(edit);
            if edit.iter().any(|step| matches!(step, Step::Remove(_))) {
                break;
            }
        }
        let what = format!("round {round}: {steps:?}");
        if round % 3 > 0 {
            both.ask(&rays[..1], &[], Hits::All, &what);
        }
        if round % 4 > 0 {
            both.ask(&rays, &[], [Hits::All, Hits::Closest(3)][round % 2], &what);
        }
        assert!(round == 0 || both.found[1].len() > 200);
    }
    assert_eq!(both.left, 0);
}

/// Boxes that go far make a tree that is put in order anew: a search takes as many steps as in a new one.
#[test]
fn casts_follow_boxes_that_go_far() {
    let tools = tools_with(&EngineOptions::default());
    let mut rng = Rng::new(4);
    let mut both = Both::new(&tools, &stress_scenes::named("uniform").boxes(600, 0));
    for round in 0..12 {
        let boxes = stress_scenes::named("uniform").boxes(600 + 40 * round, round as u64);
        both.edit(&sets_all(&boxes));
        let rays: Vec<Ray> = (0..MANY).map(|_| a_ray(&mut rng, 12.0)).collect();
        let spheres: Vec<Sphere> = (0..MANY).map(|_| a_sphere(&mut rng, 12.0)).collect();
        both.ask(&rays, &spheres, Hits::Closest(4), &format!("round {round}"));
        let (shapes, filter_data) = (Shapes::Rays(&rays), QueryFilterData::None);
        let cast = Cast { shapes, hits: Hits::Closest(1), filter_data, most_hits: MOST_HITS };
        let looked_at = |both: &mut Both| both.gpu.cast(&cast, &mut Vec::new()).expect("hits");
        let [here, new] = [looked_at(&mut both), looked_at(&mut Both::new(&tools, &boxes))];
        assert!(4 * here <= 5 * new, "round {round}: {here} and {new}");
    }
    assert_eq!(both.left, 0);
}

/// A device that is lost leaves casts to another that has the scene; the last one's loss is an error.
#[test]
fn casts_go_on_on_another_device() {
    let tools = shared_tools(2);
    let boxes = stress_scenes::named("uniform").boxes(600, 1);
    let mut both = Both::new(&tools, &boxes);
    let mut rng = Rng::new(6);
    let rays: Vec<Ray> = (0..MANY).map(|_| a_ray(&mut rng, 12.0)).collect();
    both.ask(&rays, &[], Hits::Closest(2), "two devices");
    tools[0].gpu().destroy();
    both.ask(&rays, &[], Hits::Closest(2), "one device");
    // Where it is lost before any cast.
    let others = shared_tools(2);
    let mut other = Both::new(&others, &boxes);
    others[0].gpu().destroy();
    other.ask(&rays, &[], Hits::Closest(2), "one device at first");
    assert_eq!((both.left, other.left, other.gpu.gpu_count()), (0, 0, 1));
    both.ask(&rays[..3], &[], Hits::Closest(2), "one device, few rays");
    tools[1].gpu().destroy();
    let (filter_data, most_hits) = (QueryFilterData::None, MOST_HITS);
    let cast = Cast { shapes: Shapes::Rays(&rays), hits: Hits::All, filter_data, most_hits };
    let lost = both.gpu.cast(&cast, &mut Vec::new());
    assert!(matches!(lost, Err(QueryError::Cull(CullError::DeviceLost { .. }))), "{lost:?}");
}
