//! Casts beside the naive answer in exact fractions.

use pairmask_core::cancel::Cancel;
use pairmask_core::cast::{Among, BoxTree, Hit, Hits, Limits, Ray, Shapes};
use pairmask_core::engine::{CullError, ReserveError};
use pairmask_tests::casts::{Numbers, by_query, check, hit_by, some_hits, touched_by};
use pairmask_tests::conformance::mixed_flags;
use pairmask_tests::prelude::*;
use stress_scenes::Rng;

static NEVER: Cancel = Cancel::never();

fn limits() -> Limits<'static> {
    Limits { most_hits: 1 << 30, threads: 2, cancel: &NEVER }
}

fn all(_: u32, _: u32) -> bool {
    true
}

/// Hits of all boxes, with room for them.
fn cast<'a>(among: Among<'_>, shapes: impl Into<Shapes<'a>>, asked: Hits) -> Vec<Hit> {
    let mut hits = Vec::new();
    among.cast(shapes.into(), asked, &all, limits(), &mut hits).expect("room");
    hits
}

/// Asks a tree for what is drawn, and compares.
fn ask(tree: &BoxTree, boxes: &[Aabb], numbers: Numbers, queries: usize, rng: &mut Rng) {
    let rays: Vec<Ray> = (0..queries).map(|_| numbers.ray(rng)).collect();
    let spheres: Vec<Sphere> = (0..queries).map(|_| numbers.sphere(rng)).collect();
    let asked = some_hits(rng);
    let hits = cast(Among::Tree(tree), &*rays, asked);
    assert_eq!(hits, cast(Among::Boxes(boxes), &*rays, asked));
    for (query, (hits, ray)) in (0..).zip(by_query(&hits, queries).iter().zip(&rays)) {
        let right = check(query, hits, &hit_by(ray, boxes), asked);
        right.unwrap_or_else(|wrong| panic!("{numbers:?} {ray:?}: {wrong}\n{boxes:?}"));
    }
    let hits = cast(Among::Tree(tree), &*spheres, asked);
    assert_eq!(hits, cast(Among::Boxes(boxes), &*spheres, asked));
    for (query, (hits, sphere)) in (0..).zip(by_query(&hits, queries).iter().zip(&spheres)) {
        let right = check(query, hits, &touched_by(sphere, boxes), asked);
        right.unwrap_or_else(|wrong| panic!("{numbers:?} {sphere:?}: {wrong}\n{boxes:?}"));
    }
}

#[test]
fn rays_and_spheres_hit_what_exact_fractions_say() {
    let rounds = tier::nightly_or(130_000, 400);
    let mut rng = Rng::new(7);
    for round in 0..rounds {
        for numbers in Numbers::ALL {
            let n = if round % 50 == 0 { 300 } else { rng.below(40) as usize };
            let boxes: Vec<Aabb> = (0..n).map(|_| numbers.some_box(&mut rng)).collect();
            let tree = BoxTree::of(&boxes, 1);
            ask(&tree, &boxes, numbers, 20, &mut rng);
        }
    }
}

#[test]
fn a_tree_follows_its_boxes() {
    let rounds = tier::nightly_or(3_000, 60);
    let mut rng = Rng::new(11);
    for _ in 0..rounds {
        for numbers in Numbers::ALL {
            let n = rng.below(700) as usize;
            let mut boxes: Vec<Aabb> = (0..n).map(|_| numbers.some_box(&mut rng)).collect();
            let mut tree = BoxTree::of(&boxes, 2);
            for _ in 0..6 {
                let mut changed = Vec::new();
                if rng.below(3) == 0 {
                    let len = boxes.len() as u32;
                    let end = [len / 2, len + rng.below(40), len + rng.below(600)];
                    let end = end[rng.below(3) as usize];
                    changed.extend(end.min(len)..end.max(len));
                    boxes.resize_with(end as usize, || numbers.some_box(&mut rng));
                }
                if !boxes.is_empty() {
                    let some = [1, 5, boxes.len() as u32][rng.below(3) as usize];
                    for _ in 0..some {
                        let index = rng.below(boxes.len() as u32);
                        boxes[index as usize] = numbers.some_box(&mut rng);
                        changed.push(index);
                    }
                }
                let which = (rng.below(3) > 0).then_some(&changed[..]);
                tree.update(&boxes, which, 2);
                ask(&tree, &boxes, numbers, 3, &mut rng);
            }
        }
    }
}

#[test]
fn the_flags_of_threads_do_not_matter() {
    let mut rng = Rng::new(13);
    let numbers = Numbers::Odd;
    let boxes: Vec<Aabb> = (0..3_000).map(|_| numbers.some_box(&mut rng)).collect();
    let rays: Vec<Ray> = (0..300).map(|_| numbers.ray(&mut rng)).collect();
    let spheres: Vec<Sphere> = (0..300).map(|_| numbers.sphere(&mut rng)).collect();
    let answer = || {
        let tree = BoxTree::of(&boxes, 2);
        [
            cast(Among::Tree(&tree), &*rays, Hits::All),
            cast(Among::Tree(&tree), &*spheres, Hits::All),
        ]
    };
    let expected = answer();
    assert!(expected.iter().all(|hits| hits.len() > 1_000));
    let pool = pool(2);
    for flags in mixed_flags() {
        assert!(flags.install(&pool, answer) == expected, "{flags}");
    }
}

#[test]
fn the_rules_of_the_definition_hold() {
    let unit = Aabb::new([1.0; 3], [2.0; 3]);
    let at_infinity = Aabb::new([f32::INFINITY; 3], [f32::INFINITY; 3]);
    let half_space = Aabb::new([f32::NEG_INFINITY; 3], [f32::INFINITY, f32::INFINITY, -5.0]);
    let boxes = [unit, at_infinity, half_space, Aabb::EMPTY, Aabb::new([f32::NAN; 3], [0.0; 3])];
    let tree = BoxTree::of(&boxes, 1);
    let found = |ray: Ray| {
        let hits = cast(Among::Tree(&tree), &[ray][..], Hits::All);
        hits.iter().map(|hit| (hit.index, hit.distance)).collect::<Vec<_>>()
    };
    // Along an edge, from inside, backward, to a face and no farther, and one step less.
    assert_eq!(found(Ray::new([0.0, 1.0, 1.0], [2.0, 0.0, 0.0])), [(0, 0.5)]);
    assert_eq!(found(Ray::new([1.5; 3], [1.0, 0.0, 0.0])), [(0, 0.0)]);
    assert_eq!(found(Ray::new([0.0, 1.0, 1.0], [-1.0, 0.0, 0.0])), []);
    assert_eq!(found(Ray::new([0.0, 1.0, 1.0], [1.0, 0.0, 0.0]).up_to(1.0)), [(0, 1.0)]);
    assert_eq!(found(Ray::new([0.0, 1.0, 1.0], [1.0, 0.0, 0.0]).up_to(1.0f32.next_down())), []);
    // A direction of zeros is a point, or a box.
    assert_eq!(found(Ray::new([2.0; 3], [0.0, -0.0, 0.0])), [(0, 0.0)]);
    assert_eq!(found(Ray::new([3.0; 3], [0.0; 3])), []);
    assert_eq!(found(Ray::new([3.0; 3], [0.0; 3]).with_half_extents([1.0; 3])), [(0, 0.0)]);
    // What is infinite is hit where a finite way leads to it.
    assert_eq!(found(Ray::new([9.0; 3], [0.0, 0.0, -2.0])), [(2, 7.0)]);
    assert_eq!(found(Ray::new([9.0; 3], [1.0; 3])), []);
    // Invalid rays hit nothing.
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert_eq!(found(Ray::new([bad, 1.0, 1.0], [1.0; 3])), []);
        assert_eq!(found(Ray::new([1.5; 3], [0.0, bad, 1.0])), []);
        assert_eq!(found(Ray::new([1.5; 3], [1.0; 3]).with_half_extents([0.0, bad, 0.0])), []);
    }
    assert_eq!(found(Ray::new([1.5; 3], [1.0; 3]).up_to(-1.0)), []);
    assert_eq!(found(Ray::new([1.5; 3], [1.0; 3]).up_to(f32::NAN)), []);
    assert_eq!(found(Ray::new([1.5; 3], [1.0; 3]).with_half_extents([0.0, -1.0, 0.0])), []);
    let near = |sphere: Sphere, asked| {
        let hits = cast(Among::Tree(&tree), &[sphere][..], asked);
        hits.iter().map(|hit| (hit.index, hit.distance)).collect::<Vec<_>>()
    };
    let everywhere = Sphere::new([1.5, 1.5, 6.0], f32::INFINITY);
    assert_eq!(near(everywhere, Hits::All), [(0, 4.0), (2, 11.0)]);
    assert_eq!(near(everywhere, Hits::Closest(1)), [(0, 4.0)]);
    assert_eq!(near(everywhere, Hits::Closest(0)), []);
    assert_eq!(near(everywhere, Hits::Any), [(Hit::ANY, 0.0)]);
    assert_eq!(near(Sphere::new([0.0, 1.5, 1.5], 1.0), Hits::All), [(0, 1.0)]);
    assert_eq!(near(Sphere::new([0.0, 1.5, 1.5], 1.0f32.next_down()), Hits::All), []);
    assert_eq!(near(Sphere::new([1.5; 3], -1.0), Hits::All), []);
}

#[test]
fn what_is_not_admitted_is_not_found_and_does_not_count() {
    let boxes: Vec<Aabb> = (0..100).map(|i| Aabb::point([i as f32, 0.0, 0.0])).collect();
    let tree = BoxTree::of(&boxes, 1);
    let along = Ray::new([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]);
    let mut hits = Vec::new();
    let admits = |query: u32, index: u32| index % 7 == query + 3;
    let (among, rays) = (Among::Tree(&tree), [along; 2]);
    let shapes = Shapes::Rays(&rays);
    among.cast(shapes, Hits::Closest(2), &admits, limits(), &mut hits).expect("room");
    let found: Vec<_> = hits.iter().map(|hit| [hit.query, hit.index]).collect();
    assert_eq!(found, [[0, 3], [0, 10], [1, 4], [1, 11]]);
    among.cast(shapes, Hits::Any, &|_, _| false, limits(), &mut hits).expect("room");
    assert_eq!(hits, []);
}

#[test]
fn more_hits_than_may_be_are_an_error() {
    let boxes = [Aabb::new([0.0; 3], [1.0; 3]); 50];
    let tree = BoxTree::of(&boxes, 1);
    let through = [Ray::new([0.5; 3], [1.0; 3]); 10];
    let mut hits = Vec::new();
    let mut ask = |most_hits, asked| {
        let limits = Limits { most_hits, threads: 2, cancel: &Cancel::never() };
        let shapes = Shapes::Rays(&through);
        Among::Tree(&tree).cast(shapes, asked, &all, limits, &mut hits).map(|_| hits.len())
    };
    assert_eq!(ask(500, Hits::All), Ok(500));
    assert_eq!(ask(500, Hits::Closest(1_000)), Ok(500));
    assert_eq!(ask(10, Hits::Any), Ok(10));
    for asked in [Hits::All, Hits::Closest(1_000), Hits::Closest(50)] {
        let refused = CullError::Reserve(ReserveError::TooLarge {
            at_least_bytes: 6_000,
            limit_bytes: 5_988,
        });
        assert_eq!(ask(499, asked), Err(refused));
    }
}

#[test]
fn more_boxes_on_the_way_than_there_is_room_for_are_none() {
    // The farthest first.
    let boxes: Vec<Aabb> = (0..90).map(|i| Aabb::point([90.0 - i as f32, 0.0, 0.0])).collect();
    let along = [Ray::new([0.0; 3], [1.0, 0.0, 0.0])];
    let mut hits = Vec::new();
    for most in [5, 40] {
        let limits = Limits { most_hits: 45, threads: 1, cancel: &Cancel::never() };
        let (shapes, asked) = (Shapes::Rays(&along), Hits::Closest(most));
        Among::Boxes(&boxes).cast(shapes, asked, &all, limits, &mut hits).expect("room");
        assert!(check(0, &hits, &hit_by(&along[0], &boxes), asked).is_ok());
    }
}

#[test]
fn the_comparison_with_exact_fractions_can_fail() {
    let boxes = [Aabb::point([1.0, 0.0, 0.0]), Aabb::point([2.0, 0.0, 0.0])];
    let ray = Ray::new([0.0; 3], [1.0, 0.0, 0.0]);
    let right = [(0, 1.0), (1, 2.0)].map(|(index, distance)| Hit { query: 0, index, distance });
    let exact = hit_by(&ray, &boxes);
    assert!(check(0, &right, &exact, Hits::All).is_ok());
    assert!(check(0, &right[..1], &exact, Hits::Closest(1)).is_ok());
    let [first, second] = right;
    let off = Hit { distance: 2.0f32.next_up().next_up(), ..second };
    for wrong in [&[first][..], &[second, first], &[first, second, second], &[first, off]] {
        assert!(check(0, wrong, &exact, Hits::All).is_err(), "{wrong:?}");
    }
    assert!(check(0, &[], &exact, Hits::Any).is_err());
    assert!(check(1, &right, &exact, Hits::All).is_err());
}
