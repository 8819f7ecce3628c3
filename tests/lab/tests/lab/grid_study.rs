//! The grid study, on a software adapter: every figure is there, and the files are written.

use pairmask_lab::study::grid::measure;
use pairmask_lab::study::harness::write_files;
use pairmaskd::execute::gpu::GpuChoice;

#[test]
fn a_quick_study_fills_every_table_and_compares_every_mask() {
    let folder = tempfile::tempdir().unwrap();
    let report = measure(&GpuChoice::Software, &[700], true).unwrap();
    write_files(&report, &folder.path().join("records")).unwrap();
    assert_eq!(report.scenes.len(), 4);
    assert!(report.scenes.iter().all(|row| row.checked && row.pairs > 0 && row.frame_us > 0.0));
    assert_eq!(report.stages.len(), 6);
    assert!(report.stages.iter().all(|row| row.floor_us > 0.0));
    assert_eq!((report.parts.len(), report.engines.len(), report.under_way.len()), (1, 1, 1));
    assert!(report.with_and_without.iter().any(|row| row.paper_ms.is_some()));
    assert_eq!(report.moving.len(), 6);
    let read =
        |name: &str| std::fs::read_to_string(folder.path().join("records").join(name)).unwrap();
    let json: serde_json::Value = serde_json::from_str(&read("grid.json")).unwrap();
    assert_eq!(json["parts"][0]["n"], 700);
    let text = read("grid.md");
    for heading in ["Table 6", "Table 7", "Figure 5", "Figure 6", "Stages", "Frames under way"] {
        assert!(text.contains(heading), "{heading}");
    }
}
