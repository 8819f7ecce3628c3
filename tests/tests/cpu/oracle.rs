//! The oracle against the box type: two definitions of overlap agree.

use pairmask_tests::oracle::truth;
use pairmask_tests::stress_scenes;

#[test]
fn the_oracle_agrees_with_the_box_type_on_single_pairs() {
    for scene in stress_scenes::ALL {
        let boxes = scene.boxes(24, 7);
        let pairs = truth(&boxes).pairs;
        for a in 0..boxes.len() {
            for b in a + 1..boxes.len() {
                let listed = pairs.binary_search(&(a as u32, b as u32)).is_ok();
                assert_eq!(boxes[a].overlaps(&boxes[b]), listed, "{scene:?} ({a}, {b})");
            }
        }
    }
}
