//! The sweep study, on a software adapter: every scene has its row, and the files are written.
#![allow(clippy::unwrap_used)]

use pairmask_lab::study::sweep::{SweepOptions, SweepScene, run_and_print};
use pairmaskd::execute::gpu::GpuChoice;

#[test]
fn a_quick_study_has_a_row_for_every_scene() {
    let folder = tempfile::tempdir().unwrap();
    let out = Some(folder.path().join("records"));
    let gpu = GpuChoice::Software;
    let options = SweepOptions { gpu, counts: vec![700], quick: true, out, json: true };
    let mut printed = Vec::new();
    let report = run_and_print(&options, &mut printed).unwrap();
    assert_eq!(report.rows.len(), SweepScene::ALL.len());
    for row in &report.rows {
        assert!(row.ratio().unwrap() > 0.0 && row.pairs > 0, "{}", row.scene);
        let sweep = row.sweep.as_ref().unwrap();
        assert!(sweep.all_us > 0.0 && sweep.entries >= row.n && sweep.tested >= row.pairs);
    }
    let json: serde_json::Value = serde_json::from_slice(&printed).unwrap();
    assert_eq!(json["rows"][0]["n"], 700);
    let text = std::fs::read_to_string(folder.path().join("records/sweep.md")).unwrap();
    assert!(text.contains("| needles | 700 |") && text.contains("The sweep is the fastest"));
}
