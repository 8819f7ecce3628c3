//! `explain`: a pair of boxes of a file.

use pairmask_core::Aabb;
use serde_json::Value;

use crate::support::{Sandbox, keys, names};

#[test]
fn a_pair_is_explained() {
    let sandbox = Sandbox::new();
    let apart = 1.0f32.next_up();
    let boxes = [
        Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]),
        Aabb::from([apart, 0.0, 0.0, 2.0, 1.0, 1.0]),
        Aabb::from([1.0, 0.0, f32::NEG_INFINITY, 2.0, 1.0, f32::NAN]),
    ];
    sandbox.boxes(&boxes);
    let why = sandbox.run_line("explain boxes.f32 0 1 --json").json();
    let fields = "pair boxes overlaps reason mode pair_index box_reports axes sent grid";
    assert_eq!(keys(&why), names(fields));
    assert_eq!((&why["overlaps"], &why["axes"][0]["gap_ulps"]), (&false.into(), &1.into()));
    assert_eq!(why["axes"][0]["gap"], f64::from(apart) - 1.0);
    assert_eq!((&why["mode"], &why["sent"]), (&"exact".into(), &Value::Null));
    let near = sandbox.run_line("explain boxes.f32 0 1 --precision q8 --json").json();
    assert_eq!((&near["mode"], &near["overlaps"]), (&"q8".into(), &true.into()));
    assert_eq!(keys(&near["sent"]), names("unit rule coordinates cell_edges axes"));
    let text = sandbox.run_line("explain boxes.f32 0 1 --precision margin=0.5").stdout;
    assert!(text.contains("an extra pair of margin=0.5"), "{text}");
    let text = sandbox.run_line("explain boxes.f32 1 0").stdout;
    assert!(text.contains("NOT in the mask") && text.contains("1 ulp"), "{text}");
    let invalid = sandbox.run_line("explain boxes.f32 0 2").stdout;
    assert!(invalid.contains("box 2 has a NaN"), "{invalid}");
    let unknown = sandbox.run_line("explain boxes.f32 0 3");
    assert!(unknown.error(1).contains("there is no box 3"), "{unknown:?}");
}
