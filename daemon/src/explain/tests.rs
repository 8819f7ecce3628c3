use super::*;

const UNIT: [f32; 6] = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0];

fn explain(boxes: &[[f32; 6]]) -> Explanation {
    let boxes: Vec<Aabb> = boxes.iter().copied().map(Aabb::from).collect();
    Explanation::of(&boxes, 0, 1).expect("two boxes")
}

#[test]
fn gaps_are_told_in_units_and_in_ulps() {
    let one_ulp = 1.0f32.next_up();
    let apart = explain(&[UNIT, [one_ulp, 0.0, 0.0, 2.0, 1.0, 1.0]]);
    assert!(!apart.overlaps);
    let x = &apart.axes.as_ref().expect("solid")[0];
    assert_eq!((x.state, x.gap_ulps), (Separation::Apart, 1));
    assert_eq!(x.gap, Some(f64::from(one_ulp) - 1.0));
    assert_eq!(apart.reason, "a gap of 1.192093e-7 on x keeps the boxes apart");

    let touching = explain(&[UNIT, [1.0, 0.5, -3.0, 2.0, 1.0, -0.0]]);
    assert!(touching.overlaps);
    assert_eq!(touching.reason, "the boxes touch, and touching counts");
    let states = touching.axes.map(|axes| axes.map(|axis| axis.state));
    assert_eq!(states, Some([Separation::Touching, Separation::Overlapping, Separation::Touching]));
}

#[test]
fn several_gaps_are_all_named() {
    let apart = explain(&[UNIT, [3.0, 0.0, 1e30, 4.0, 1.0, 2e30]]);
    assert!(apart.reason.starts_with("gaps of 2 on x and 1"), "{}", apart.reason);
    let endless = explain(&[UNIT, [f32::INFINITY, 0.0, 0.0, f32::INFINITY, 1.0, 1.0]]);
    assert_eq!(endless.reason, "a gap of ∞ on x keeps the boxes apart");
    assert_eq!(endless.axes.expect("solid")[0].gap, None);
}

#[test]
fn boxes_that_overlap_nothing_say_why() {
    let empty = explain(&[UNIT, [2.0, 0.0, 0.0, 1.0, 1.0, 1.0]]);
    assert_eq!(empty.reason, "box 1 is empty (min above max) and so overlaps nothing");
    let invalid = explain(&[[f32::NAN, 0.0, 0.0, 1.0, 1.0, 1.0], UNIT]);
    assert_eq!(invalid.reason, "box 0 has a NaN and so overlaps nothing");
    assert_eq!((invalid.axes.is_none(), invalid.box_reports[0].class), (true, "invalid"));
    assert!(invalid.to_string().contains("NaN"));
}

#[test]
fn an_explanation_agrees_with_the_box_type_on_every_pair() {
    for scene in crate::stress::scenes::ALL {
        let boxes = scene.boxes(24, 3);
        for i in 0..24 {
            for j in 0..24 {
                let why = Explanation::of(&boxes, i, j).expect("two boxes");
                let overlaps = i != j && boxes[i as usize].overlaps(&boxes[j as usize]);
                assert_eq!(why.overlaps, overlaps, "{scene:?} ({i}, {j})");
                let apart = why
                    .axes
                    .as_ref()
                    .is_none_or(|axes| axes.iter().any(|axis| axis.state == Separation::Apart));
                assert_eq!(apart || i == j, !overlaps, "{scene:?} ({i}, {j})");
                assert!(why.grid.compared || !overlaps, "{scene:?} ({i}, {j})");
            }
        }
    }
}

#[test]
fn a_number_that_names_no_box_is_an_error() {
    let boxes = [Aabb::EMPTY; 2];
    let error = Explanation::of(&boxes, 0, 2).map_err(|e| e.to_string());
    assert_eq!(error.err().as_deref(), Some("there is no box 2: the scene has 2, numbered from 0"));
}
