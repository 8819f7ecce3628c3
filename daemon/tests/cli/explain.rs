//! `explain`: a pair of boxes of a file.

use pairmask_tests::stress_scenes;

use crate::support::Place;

#[test]
fn a_box_with_itself_is_a_plain_sentence() {
    let place = Place::new();
    place.boxes(&stress_scenes::named("uniform").boxes(70, 1));
    for precision in ["exact", "q16", "margin=0.5"] {
        let explain = ["explain", "boxes.f32", "3", "3", "--precision", precision];
        let text = place.run(&explain).stdout;
        assert!(text.starts_with("Box 3 of 70 boxes is no pair with itself"), "{text}");
        let report = place.run(&[&explain[..], &["--json"]].concat()).json();
        assert_eq!((&report["overlaps"], &report["pair_index"]), (&false.into(), &().into()));
    }
}

#[test]
fn gaps_in_a_mode_have_their_unit() {
    let place = Place::new();
    place.boxes(&stress_scenes::named("uniform").boxes(70, 1));
    let explain = ["explain", "boxes.f32", "3", "4", "--precision", "q16"];
    let text = place.run(&explain).stdout;
    let sent: Vec<&str> = text.lines().filter(|line| line.starts_with("  sent      x ")).collect();
    assert!(sent[0].contains(" cells (") && sent[0].ends_with(" units)"), "{text}");
    let report = place.run(&[&explain[..], &["--json"]].concat()).json();
    let edges = report["sent"]["cell_edges"].as_array().unwrap();
    assert!(edges.iter().all(|edge| edge.as_f64().unwrap() > 0.0), "{report}");
}
