//! Scenes have the properties of their names, and keep them while they move.

use super::*;

/// Pairs a box, by a plain sweep along x.
fn pairs_a_box(boxes: &[Aabb]) -> f64 {
    let mut order: Vec<&Aabb> = boxes.iter().collect();
    order.sort_by(|a, b| a.min[0].total_cmp(&b.min[0]));
    let mut pairs = 0u64;
    for (i, a) in order.iter().enumerate() {
        let window = order[i + 1..].iter().take_while(|b| b.min[0] <= a.max[0]);
        pairs += window.filter(|b| a.overlaps(b)).count() as u64;
    }
    pairs as f64 / boxes.len() as f64
}

#[test]
fn anchor_scenes_have_their_pairs_and_keep_them() {
    let n = 20_000;
    for (name, expected) in [
        (SceneName::Uniform, 1.0),
        (SceneName::Mixed, 2.0),
        (SceneName::Pile, 7.0),
        (SceneName::Plane, 3.0),
    ] {
        let mut scene = Scene::new(name, n, 1);
        for frame in [0, 200] {
            if frame > 0 {
                (0..frame).for_each(|_| scene.step());
            }
            let pairs = pairs_a_box(scene.boxes());
            assert!(
                (0.8 * expected..1.2 * expected).contains(&pairs),
                "{name}, frame {frame}: {pairs} pairs a box, not about {expected}"
            );
        }
    }
}

#[test]
fn every_scene_has_n_solid_boxes_at_any_n_and_frame() {
    for name in SceneName::ALL {
        for n in [0, 1, 2, 3, 17, 64, 70, 1_234] {
            let mut scene = Scene::new(name, n, 3);
            for _ in 0..20 {
                assert_eq!(scene.boxes().len(), n, "{name}");
                assert!(
                    scene.boxes().iter().all(|b| b.class() == pairmask_core::BoxClass::Solid),
                    "{name}"
                );
                scene.step();
            }
        }
    }
}

#[test]
fn a_seed_gives_the_same_scene_and_another_seed_another() {
    for name in SceneName::ALL {
        let (mut a, mut b) = (Scene::new(name, 345, 5), Scene::new(name, 345, 5));
        (0..5).for_each(|_| {
            a.step();
            b.step();
        });
        assert_eq!(a.boxes(), b.boxes(), "{name}");
        let mut other = Scene::new(name, 345, 6);
        (0..5).for_each(|_| other.step());
        assert_ne!(a.boxes(), other.boxes(), "{name}");
    }
}

#[test]
fn papers_scenes_have_contacts_but_not_everywhere() {
    for name in [
        SceneName::Cubes,
        SceneName::Balls,
        SceneName::Skittles,
        SceneName::Torus,
        SceneName::Letters,
    ] {
        let pairs = pairs_a_box(Scene::new(name, 4_000, 1).boxes());
        assert!((0.3..6.0).contains(&pairs), "{name}: {pairs} pairs a box");
    }
}

#[test]
fn rods_have_about_one_pair_a_box() {
    let pairs = pairs_a_box(Scene::new(SceneName::Rods, 20_000, 1).boxes());
    assert!((0.6..1.2).contains(&pairs), "{pairs}");
}

#[test]
fn given_boxes_move_and_stay_in_their_bounds() {
    let boxes = Scene::new(SceneName::Uniform, 100, 1).boxes().to_vec();
    let mut scene = Scene::from_boxes(boxes.clone(), 2);
    (0..500).for_each(|_| scene.step());
    assert_ne!(scene.boxes(), boxes);
    assert!(scene.boxes().iter().all(|b| b.max.iter().chain(&b.min).all(|x| x.abs() < 20.0)));
}
