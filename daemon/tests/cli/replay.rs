//! `serve --record` and `replay`, as a bug report is made and looked at.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use pairmask_core::Aabb;
use pairmaskd::recording::{Event, RecordFile, RecordSettings, Recording};
use rustix::process::Signal;

use crate::support::{Sandbox, Serving};

/// Records some frames of one program.
fn recorded(sandbox: &Sandbox) -> PathBuf {
    let serving = Serving::start(sandbox, "--gpu none --record a.pmrec", "default");
    let mut session = serving.session();
    for step in 0..20 {
        let at = |i: u32| [i as f32 * 0.75, step as f32, 0.0];
        let boxes: Vec<Aabb> = (0..50).map(|i| Aabb::new(at(i), at(i).map(|x| x + 1.0))).collect();
        let mut frame = session.frame(boxes.len()).unwrap();
        frame.write(&boxes).unwrap();
        assert_eq!(frame.submit().unwrap().wait().unwrap().count(), 49);
    }
    drop(session);
    assert_eq!(serving.stop(Signal::TERM).code, Some(0));
    sandbox.file("a.pmrec")
}

/// Makes the last recorded answer another one.
fn falsify(from: &Path, to: &Path) {
    let mut recording = Recording::open(fs::File::open(from).unwrap()).unwrap();
    let mut records = Vec::new();
    while let Some(block) = recording.next_block().unwrap() {
        records.extend(block);
    }
    let answers = records.iter_mut().rev().filter_map(|record| match &mut record.event {
        Event::Answer { answered, .. } => Some(answered),
        _ => None,
    });
    answers.take(1).for_each(|answered| answered.count += 1);
    let settings = RecordSettings { file: to.to_owned(), most_bytes: u64::MAX };
    let mut file = RecordFile::create(&settings).unwrap();
    for record in &records {
        file.write(record).unwrap();
    }
    file.flush().unwrap();
}

#[test]
fn what_is_recorded_replays_and_a_wrong_answer_is_named() {
    let sandbox = Sandbox::new();
    let file = recorded(&sandbox);
    assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600);
    let finished = sandbox.run_line("replay a.pmrec --gpu none");
    assert_eq!((finished.code, finished.stderr.as_str()), (Some(0), ""), "{finished:?}");
    assert!(finished.stdout.starts_with("20 requests, 0 answers differ\n"), "{finished:?}");
    let report = sandbox.run_line("replay a.pmrec --gpu none --json --compare cpu-sap").json();
    assert_eq!((&report["requests"], &report["differing"]), (&20.into(), &0.into()));
    let row = &report["rows"][0];
    assert_eq!((&row["kind"], &row["requests"]), (&"frame".into(), &20.into()));
    for times in [&row["recorded_ns"], &row["now"]["daemon_ns"], &row["compared"]["round_trip_ns"]]
    {
        assert!(times["p50"].as_u64().unwrap() > 0, "{row}");
    }

    let report = sandbox.run_line("replay a.pmrec --in-process --json").json();
    assert_eq!((&report["differing"], &report["skipped"]), (&0.into(), &0.into()));
    let finished = sandbox.run_line("replay a.pmrec --in-process --precision margin=1");
    assert_eq!((finished.code, finished.stderr.as_str()), (Some(0), ""), "{finished:?}");
    assert!(finished.stdout.contains("20 frames sent as margin=1: "), "{finished:?}");
    for (line, expected) in [
        ("replay a.pmrec --in-process --engine gpu-grid", "has the engines of cores"),
        ("replay a.pmrec --in-process --instance x", "asks no daemon"),
    ] {
        let finished = sandbox.run_line(line);
        assert!(finished.error(2).contains(expected), "{finished:?}");
    }

    falsify(&file, &sandbox.file("b.pmrec"));
    for more in ["--in-process", "--in-process --precision q8"] {
        let finished = sandbox.run_line(&format!("replay b.pmrec {more}"));
        assert_eq!(finished.code, Some(1), "{finished:?}");
    }
    let finished = sandbox.run_line("replay b.pmrec --gpu none");
    assert_eq!(finished.code, Some(1), "{finished:?}");
    assert!(finished.stderr.contains("1 of 20 answers differ"), "{finished:?}");
    assert!(
        finished.stdout.contains("request 20 (of frames): 50 pairs before, 49 now"),
        "{finished:?}"
    );
}

#[test]
fn a_recording_that_is_cut_is_replayed_up_to_there_and_other_files_are_not() {
    let sandbox = Sandbox::new();
    let file = recorded(&sandbox);
    let bytes = fs::read(&file).unwrap();
    fs::write(sandbox.file("cut.pmrec"), &bytes[..bytes.len() - 1]).unwrap();
    let finished = sandbox.run_line("replay cut.pmrec --gpu none --json");
    assert!(finished.stderr.contains("is cut behind byte"), "{finished:?}");
    assert_eq!(finished.code, Some(0));
    fs::write(sandbox.file("text"), "no recording").unwrap();
    for (line, expected) in [
        ("replay text", "text: this is no recording"),
        ("replay missing", "there is no such file"),
        ("serve --record text", "it is no recording, and is not overwritten"),
        ("serve --record missing/a", "there is no such directory"),
    ] {
        let finished = sandbox.run_line(line);
        assert!(finished.error(1).contains(expected), "{line}: {finished:?}");
    }
    assert_eq!(fs::read(sandbox.file("text")).unwrap(), b"no recording");
    assert_eq!(sandbox.run_line("serve --record-max 1G").code, Some(2), "without --record");
}
