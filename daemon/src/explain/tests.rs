use super::*;

const UNIT: [f32; 6] = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0];

fn are_pair(why: &Shown) -> bool {
    why.fields["overlaps"] == true
}

fn text<'a>(why: &'a Shown, field: &str) -> &'a str {
    why.fields[field].as_str().expect("text")
}

fn explain_exact(boxes: &[[f32; 6]]) -> Shown {
    let boxes: Vec<Aabb> = boxes.iter().copied().map(Aabb::from).collect();
    explain(&boxes, &SentBoxes::exact(&boxes), 0, 1).expect("two boxes")
}

#[test]
fn gaps_are_reported_in_units_and_in_ulps() {
    let one_ulp = 1.0f32.next_up();
    let apart = explain_exact(&[UNIT, [one_ulp, 0.0, 0.0, 2.0, 1.0, 1.0]]);
    assert!(!are_pair(&apart));
    let x = &apart.fields["axes"][0];
    assert_eq!((&x["state"], &x["gap_ulps"]), (&"apart".into(), &1.into()));
    assert_eq!(x["gap"], f64::from(one_ulp) - 1.0);
    assert_eq!(text(&apart, "reason"), "a gap of 1.192093e-7 on x keeps the boxes apart");

    let touching = explain_exact(&[UNIT, [1.0, 0.5, -3.0, 2.0, 1.0, -0.0]]);
    assert!(are_pair(&touching));
    assert_eq!(text(&touching, "reason"), "the boxes touch, and touching counts");
    let states = [0, 1, 2].map(|axis| &touching.fields["axes"][axis]["state"]);
    assert_eq!(states, ["touching", "overlapping", "touching"]);
}

#[test]
fn several_gaps_are_all_named() {
    let apart = explain_exact(&[UNIT, [3.0, 0.0, 1e30, 4.0, 1.0, 2e30]]);
    assert!(text(&apart, "reason").starts_with("gaps of 2 on x and 1"), "{apart}");
    let endless = explain_exact(&[UNIT, [f32::INFINITY, 0.0, 0.0, f32::INFINITY, 1.0, 1.0]]);
    assert_eq!(text(&endless, "reason"), "a gap of ∞ on x keeps the boxes apart");
    assert_eq!(endless.fields["axes"][0]["gap"], Value::Null);
}

#[test]
fn boxes_that_overlap_nothing_say_why() {
    let empty = explain_exact(&[UNIT, [2.0, 0.0, 0.0, 1.0, 1.0, 1.0]]);
    assert_eq!(text(&empty, "reason"), "box 1 is empty (min above max) and so overlaps nothing");
    let invalid = explain_exact(&[[f32::NAN, 0.0, 0.0, 1.0, 1.0, 1.0], UNIT]);
    assert_eq!(text(&invalid, "reason"), "box 0 has a NaN and so overlaps nothing");
    assert_eq!(invalid.fields["axes"], Value::Null);
    assert_eq!(invalid.fields["box_reports"][0]["class"], "invalid");
    assert!(invalid.to_string().contains("NaN"));
}

#[test]
fn an_explanation_agrees_with_the_box_type_on_every_pair() {
    for scene in pairmask_tests::stress_scenes::ALL {
        let boxes = scene.boxes(24, 3);
        for i in 0..24 {
            for j in 0..24 {
                let sent = SentBoxes::exact(&boxes);
                let why = explain(&boxes, &sent, i, j).expect("two boxes");
                let overlaps = i != j && boxes[i as usize].overlaps(&boxes[j as usize]);
                assert_eq!(are_pair(&why), overlaps, "{scene:?} ({i}, {j})");
                let axes = why.fields["axes"].as_array();
                let apart =
                    axes.is_none_or(|axes| axes.iter().any(|axis| axis["state"] == "apart"));
                assert_eq!(apart || i == j, !overlaps, "{scene:?} ({i}, {j})");
                assert!(
                    why.fields["grid"]["compared"] == true || !overlaps,
                    "{scene:?} ({i}, {j})"
                );
            }
        }
    }
}

#[test]
fn a_mode_says_what_it_makes_of_the_two() {
    let boxes = [UNIT, [1.001, 0.0, 0.0, 2.0, 1.0, 1.0], [9.0, 0.0, 0.0, 9.5, 1.0, 1.0]];
    let boxes = boxes.map(Aabb::from);
    let explain = |mode: &str, j| {
        let sent = SentBoxes::of(mode.parse().expect("a mode"), &boxes);
        super::explain(&boxes, &sent, 0, j).expect("three boxes")
    };
    let extra = explain("q8", 1);
    assert_eq!((are_pair(&extra), text(&extra, "mode")), (true, "q8"));
    let reason = "a gap of 0.001000047 on x keeps the boxes apart, but their cells meet: an extra \
                  pair of q8";
    assert_eq!(text(&extra, "reason"), reason);
    let sent = &extra.fields["sent"];
    assert_eq!([&sent["unit"], &sent["coordinates"][0][3]], ["cells", "26"]);
    assert!(extra.to_string().contains("x  they meet"), "{extra}");
    let far = explain("q8", 2);
    assert!(!are_pair(&far) && text(&far, "reason").ends_with("; the same in q8"), "{far}");
    for (mode, overlaps) in
        [("exact", false), ("q16", false), ("f16", false), ("margin=0.25", true)]
    {
        let why = explain(mode, 1);
        assert_eq!(
            (are_pair(&why), text(&why, "mode"), why.fields["sent"].is_object()),
            (overlaps, mode, mode != "exact")
        );
        assert_eq!(why.fields["axes"][0]["state"], "apart");
    }
}

#[test]
fn a_box_with_itself_is_reported_once() {
    let boxes = [UNIT, [3.0, 0.0, 0.0, 4.0, 1.0, 1.0]].map(Aabb::from);
    for mode in ["exact", "q16", "q8", "f16", "margin=1"] {
        let sent = SentBoxes::of(mode.parse().expect("a mode"), &boxes);
        let why = super::explain(&boxes, &sent, 1, 1).expect("two boxes");
        assert_eq!((are_pair(&why), &why.fields["pair_index"]), (false, &Value::Null));
        assert_eq!(text(&why, "reason"), "a box is no pair with itself");
        let text = why.to_string();
        assert!(text.starts_with("Box 1 of 2 boxes is no pair with itself: "), "{text}");
        assert_eq!(text.matches("  box 1 ").count(), 1, "{text}");
        assert!(!text.contains("overlapping"), "{text}");
    }
}

#[test]
fn gaps_of_cells_are_reported_in_cells_and_in_units() {
    let boxes = [UNIT, [2.0, 0.0, 0.0, 3.0, 1.0, 1.0], [9.0, 0.0, 0.0, 10.0, 1.0, 1.0]];
    let boxes = boxes.map(Aabb::from);
    let explain = |mode: &str| {
        let sent = SentBoxes::of(mode.parse().expect("a mode"), &boxes);
        super::explain(&boxes, &sent, 0, 1).expect("three boxes")
    };
    let cells = explain("q8");
    let sent = &cells.fields["sent"];
    let edge = sent["cell_edges"][0].as_f64().expect("cells have edges");
    let gap = sent["axes"][0]["gap"].as_f64().expect("finite");
    // Two cells on, each face lies in its own: the gap of a unit to within two cells.
    assert!(gap >= 1.0 && (gap * edge - 1.0).abs() <= 2.0 * edge, "{gap} cells of {edge}");
    let text = cells.to_string();
    assert!(text.contains(&format!("x  apart by {gap} cells (")), "{text}");
    assert!(text.contains("apart by 1 units ("), "{text}");
    // The grid counts in cells of the mode, and the text has units too.
    let line = |text: &str| text.lines().find(|l| l.contains(" of about ")).map(str::to_owned);
    assert!(line(&text).is_some_and(|line| line.ends_with(" units")), "{text}");
    let halves = explain("f16");
    assert_eq!(halves.fields["sent"]["cell_edges"], Value::Null);
    assert!(halves.to_string().contains("  sent      x  apart by 1 units"), "{halves}");
}
