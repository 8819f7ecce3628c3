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
fn scenes_have_their_pairs_and_keep_them() {
    let anchors = [("uniform", 1.0), ("mixed", 2.0), ("pile", 7.0), ("plane", 3.0)];
    let anchors = anchors.map(|(name, pairs)| (name, 20_000, 0.8 * pairs..1.2 * pairs, 200));
    // The papers' have contacts, but not everywhere.
    let falling = ["cubes", "balls", "skittles", "torus", "letters"];
    let falling = falling.map(|name| (name, 4_000, 0.3..6.0, 0));
    let all = anchors.into_iter().chain(falling).chain([("rods", 20_000, 0.6..1.2, 0)]);
    for (name, n, expected, later) in all {
        let mut scene = Scene::new(name.parse().expect("a scene"), n, 1);
        for frame in [0, later] {
            (0..frame).for_each(|_| scene.step());
            let pairs = pairs_a_box(scene.boxes());
            assert!(expected.contains(&pairs), "{name}, frame {frame}: {pairs} pairs a box");
        }
    }
}

#[test]
fn every_scene_has_n_valid_boxes_at_any_n_and_frame() {
    for name in SceneName::ALL {
        for n in [0, 1, 2, 3, 17, 64, 70, 1_234] {
            let mut scene = Scene::new(name, n, 3);
            for _ in 0..20 {
                assert_eq!(scene.boxes().len(), n, "{name}");
                assert!(
                    scene.boxes().iter().all(|b| b.class() == pairmask_core::BoxClass::Valid),
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
fn given_boxes_move_and_stay_in_their_bounds() {
    let boxes = Scene::new(SceneName::Uniform, 100, 1).boxes().to_vec();
    let mut scene = Scene::from_boxes(boxes.clone(), 2);
    (0..500).for_each(|_| scene.step());
    assert_ne!(scene.boxes(), boxes);
    assert!(scene.boxes().iter().all(|b| b.max.iter().chain(&b.min).all(|x| x.abs() < 20.0)));
}

#[test]
fn names_parse_back_and_errors_list_them_all() {
    for name in SceneName::ALL {
        assert_eq!(name.to_string().parse::<SceneName>().ok(), Some(name));
    }
    let error = "nowhere".parse::<SceneName>().map_err(|e| e.to_string());
    let Err(text) = error else { panic!("an unknown name must not parse") };
    for name in SceneName::ALL {
        assert!(text.contains(name.as_str()), "{text} lacks {name}");
    }
}

#[test]
fn boxes_turn_at_walls_and_infinities_stay() {
    let mut boxes =
        [Aabb::from([0.0, 0.0, f32::NEG_INFINITY, 1.0, 1.0, 0.0]), Aabb::from([8.9; 6])];
    let mut velocities = [[-0.2, 0.2, 0.0], [0.2; 3]];
    let walls = Walls::Scene { low: [0.0; 3], high: [9.0; 3] };
    for _ in 0..100 {
        advance(&mut boxes, &mut velocities, &walls);
        for axis in 0..2 {
            let centre = 0.5 * (boxes[0].min[axis] + boxes[0].max[axis]);
            assert!((-0.2..=9.2).contains(&centre), "axis {axis}: {centre}");
        }
        assert_eq!((boxes[0].min[2], boxes[0].max[2]), (f32::NEG_INFINITY, 0.0));
    }
}

#[test]
fn fallen_boxes_come_back_at_the_top() {
    let mut boxes = [Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0])];
    let walls = Walls::Falling { low: [0.0; 3], high: [9.0; 3] };
    advance(&mut boxes, &mut [[0.0, 0.0, -1.0]], &walls);
    assert_eq!(boxes[0].min[2], 8.0);
}

#[test]
fn known_numbers_of_seed_zero() {
    let mut random = Random::new(0);
    assert_eq!(random.bits(), 0xe220_a839_7b1d_cdaf);
    assert_eq!(random.bits(), 0x6e78_9e6a_a1b9_65f4);
}
