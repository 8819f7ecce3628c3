//! The sweep study, on a software adapter: every scene has its row, and the files are written.

use pairmask_lab::study::harness::write_files;
use pairmask_lab::study::sweep::{SweepScene, measure};
use pairmaskd::execute::gpu::GpuChoice;

#[test]
fn a_quick_study_has_a_row_for_every_scene() {
    let folder = tempfile::tempdir().unwrap();
    let report = measure(&GpuChoice::Software, &[700], true).unwrap();
    write_files(&report, &folder.path().join("records")).unwrap();
    assert_eq!(report.rows.len(), SweepScene::ALL.len());
    for row in &report.rows {
        assert!(row.ratio().unwrap() > 0.0 && row.pairs > 0, "{}", row.scene);
        let sweep = row.sweep.as_ref().unwrap();
        assert!(sweep.all_us > 0.0 && sweep.entries >= row.n && sweep.tested >= row.pairs);
    }
    let read =
        |name: &str| std::fs::read_to_string(folder.path().join("records").join(name)).unwrap();
    let json: serde_json::Value = serde_json::from_str(&read("sweep.json")).unwrap();
    assert_eq!(json["rows"][0]["n"], 700);
    let text = read("sweep.md");
    assert!(text.contains("| needles ") && text.contains("The sweep is the fastest"), "{text}");
}
