//! `cull`: files in, files and JSON out.

use pairmask_core::mask::{MaskShape, Span};
use pairmask_core::oracle::naive_decoder;
use pairmask_core::{Aabb, BoxCount};
use pairmask_tests::oracle::{self, Pair, Truth};
use pairmask_tests::{spheres, stress_scenes};
use serde_json::Value;

use crate::support::{Sandbox, Terminal, daemon, keys, names, words};

const FIELDS: &str = "shape boxes pairs invalid empty backend engine encoding mask_bytes precision \
                      box_form box_bytes gap_below stages_ns total_ns skipped warnings";

/// 345 boxes, some of them empty or with a NaN.
fn scene() -> Vec<Aabb> {
    let mut boxes = stress_scenes::named("uniform").boxes(345, 3);
    boxes[7] = Aabb::EMPTY;
    boxes[100].min[2] = f32::NAN;
    boxes[344].max[0] = f32::NAN;
    boxes
}

fn pairs_of(words: &[u32]) -> Vec<Pair> {
    words.chunks(2).map(|pair| [pair[0], pair[1]]).collect()
}

const ENCODINGS: [&str; 3] = ["dense", "sparse", "list"];

/// Pairs of a mask file. That of a sparse mask has the order, the rows, the blocks and the bits.
fn pairs_in(mask: &[u32], encoding: &str, n: u32) -> Vec<Pair> {
    let (words, n_words) = (mask.len() as u64, u64::from(n));
    let shape = match encoding {
        "dense" => MaskShape::dense(BoxCount::new(n)),
        "list" => MaskShape::list(words / 2),
        _ => {
            let len = (words - n_words) / 3;
            assert_eq!(words, n_words + 3 * len);
            let [rows, blocks, bits] = [0, 1, 2].map(|at| Span { start: n_words + at * len, len });
            MaskShape::Sparse { rows, blocks, bits, order: Some(Span { start: 0, len: n_words }) }
        }
    };
    naive_decoder::decode(mask, &shape, n).unwrap()
}

#[test]
fn pairs_and_masks_are_those_of_the_oracle() {
    let sandbox = Sandbox::new();
    let boxes = scene();
    let truth = oracle::truth(&boxes);
    let n = boxes.len() as u32;
    sandbox.boxes(&boxes);
    let daemon = daemon();
    let dir = daemon.dir().path().to_owned();
    for backend in ["in-process", "daemon"] {
        for encoding in ENCODINGS {
            let more =
                format!("--backend {backend} --encoding {encoding} --pairs pairs --mask mask");
            let line = format!("cull boxes.f32 --runtime-dir {} {more} --json", dir.display());
            let report = sandbox.run_line(&line).json();
            assert_eq!((&report["shape"], &report["boxes"]), (&"boxes".into(), &n.into()));
            assert_eq!(report["pairs"], truth.pairs.len());
            check_files(&sandbox, &report, (backend, encoding), (n, &truth));
        }
    }
}

/// Checks what is said of an answer, and the files of its pairs and its mask.
fn check_files(
    sandbox: &Sandbox,
    report: &Value,
    (backend, encoding): (&str, &str),
    (n, truth): (u32, &Truth),
) {
    assert_eq!(keys(report), names(FIELDS));
    assert_eq!((&report["backend"], &report["encoding"]), (&backend.into(), &encoding.into()));
    assert_eq!(report["invalid"], truth.census.invalid);
    assert_eq!(report["empty"], truth.census.empty);
    assert_eq!(pairs_of(&words(&sandbox.file("pairs"))), truth.pairs, "{backend} {encoding}");
    let mask = words(&sandbox.file("mask"));
    assert_eq!(pairs_in(&mask, encoding, n), truth.pairs, "{backend} {encoding}");
}

#[test]
fn spheres_are_those_of_their_oracle() {
    let sandbox = Sandbox::new();
    let scene = spheres::hard_scene(300, 4);
    let truth = spheres::truth(&scene);
    assert!(truth.pairs.len() > 100 && truth.census.empty > 0 && truth.census.invalid > 0);
    std::fs::write(sandbox.file("spheres.f32"), bytemuck::cast_slice(&scene)).unwrap();
    let cull = |more: &str| sandbox.run_line(&format!("cull spheres.f32 --shape spheres {more}"));
    for backend in ["--spawn", "--backend=in-process"] {
        for encoding in ENCODINGS {
            let files = "--pairs pairs --mask mask --json";
            let report = cull(&format!("{backend} --encoding {encoding} {files}")).json();
            assert_eq!(report["shape"], "spheres");
            assert_eq!(report["boxes"], scene.len());
            assert_eq!(report["box_form"], "spheres");
            assert_eq!(report["box_bytes"], 16 * scene.len());
            let by = if backend == "--spawn" { "daemon" } else { "in-process" };
            check_files(&sandbox, &report, (by, encoding), (300, &truth));
        }
    }
    let text = cull("--backend=in-process").stdout;
    assert!(text.contains("spheres    300 ("), "{text}");
    for (more, flag) in [("--explain", "--explain"), ("--precision=q8", "--precision")] {
        let finished = cull(more);
        assert!(finished.error(2).contains(flag), "{finished:?}");
    }
    std::fs::write(sandbox.file("odd"), [0; 24]).unwrap();
    let finished = sandbox.run_line("cull odd --shape spheres");
    assert!(finished.error(1).contains("1 spheres of 16 bytes and 8 bytes more"), "{finished:?}");
}

#[test]
fn times_add_up() {
    let sandbox = Sandbox::new();
    sandbox.boxes(&scene());
    let report = sandbox.run_line("cull boxes.f32 --backend in-process --json").json();
    let stages = &report["stages_ns"];
    assert_eq!(keys(stages), names("read ingest plan execute publish engine round_trip decode"));
    let ns = |name: &str| stages[name].as_u64().unwrap();
    assert!(ns("ingest") + ns("plan") + ns("execute") + ns("publish") <= ns("engine"), "{stages}");
    assert!(ns("engine") <= ns("round_trip"), "{stages}");
    let parts = ns("read") + ns("round_trip") + ns("decode");
    assert!(parts <= report["total_ns"].as_u64().unwrap(), "{report}");
    assert_eq!(keys(&report["skipped"]), names("boxes pairs why zero_words"));
    let why = &report["skipped"]["why"];
    assert_eq!(keys(why), names("static unmoved empty cell axis"));
    let pairs = |name: &str| why[name].as_u64().unwrap();
    let all: u64 = ["empty", "cell", "axis"].map(pairs).iter().sum();
    assert_eq!(report["skipped"]["pairs"], all);
    assert_eq!(report["skipped"]["boxes"], 3);
}

#[test]
fn explain_says_what_was_seen_predicted_and_measured() {
    let sandbox = Sandbox::new();
    sandbox.boxes(&stress_scenes::named("uniform").boxes(1234, 3));
    let cull = "cull boxes.f32 --backend in-process --explain";
    let report = sandbox.run_line(&format!("{cull} --json")).json();
    let explain = &report["explain"];
    let fields = "stats calibration candidates engine encoding threads why predicted_ns measured_ns \
                  note";
    assert_eq!(keys(explain), names(fields));
    assert_eq!(explain["engine"], report["engine"], "planned as it was done");
    assert_eq!(explain["encoding"], report["encoding"]);
    assert_eq!(explain["why"], "least predicted time");
    assert_eq!(explain["stats"]["boxes"], 1234);
    assert_eq!(explain["stats"]["looked_at"], true);
    let candidates = explain["candidates"].as_array().unwrap();
    assert_eq!(candidates.len(), 4);
    let chosen = candidates.iter().find(|c| c["engine"] == explain["engine"]).unwrap();
    assert_eq!(chosen["predicted_ns"], explain["predicted_ns"]);
    let stages = &report["stages_ns"];
    let ns = |name: &str| stages[name].as_u64().unwrap();
    assert_eq!(explain["measured_ns"], ns("engine") - ns("plan") + ns("decode"));
    assert!(explain["note"].is_null());

    let text = sandbox.run_line(&format!("{cull} --engine cpu-sap")).stdout;
    for part in ["1234 boxes, 100 % valid", "-> cpu-sap", "asked for", "predicted ", "measured "] {
        assert!(text.contains(part), "{text}");
    }
    let report = sandbox.run_line("cull boxes.f32 --spawn --explain --json").json();
    let note = report["explain"]["note"].as_str().unwrap();
    assert!(note.contains("PAIRMASK_LOG=debug"), "{note}");
}

#[test]
fn every_precision_has_all_pairs_and_a_daemon_that_is_spawned_leaves_nothing() {
    let sandbox = Sandbox::new();
    sandbox.boxes(&scene());
    let exact = oracle::truth(&scene()).pairs;
    for (precision, form, box_bytes) in [
        ("exact", "f32", 24),
        ("q16", "q16", 12),
        ("q8", "q8", 6),
        ("f16", "f16", 12),
        ("margin=1.5", "f32", 24),
    ] {
        for (backend, by) in [("--spawn", "daemon"), ("--backend=in-process", "in-process")] {
            let line =
                format!("cull boxes.f32 {backend} --json --precision {precision} --pairs pairs");
            let report = sandbox.run_line(&line).json();
            assert_eq!(keys(&report), names(FIELDS));
            assert_eq!((&report["precision"], &report["backend"]), (&precision.into(), &by.into()));
            assert_eq!(report["box_form"], form);
            assert_eq!(report["box_bytes"], 345 * box_bytes);
            assert_eq!((&report["invalid"], &report["empty"]), (&2.into(), &1.into()));
            let pairs = pairs_of(&words(&sandbox.file("pairs")));
            assert!(exact.iter().all(|pair| pairs.binary_search(pair).is_ok()), "{precision}");
            assert_eq!(precision == "exact", report["gap_below"][0] == 0.0, "{report}");
            assert_eq!(report["pairs"], pairs.len());
            match precision {
                "exact" => assert_eq!(pairs, exact),
                _ => assert!(precision == "q16" || pairs.len() > exact.len()),
            }
        }
    }
    sandbox.assert_clean(&["boxes.f32", "pairs"]);
}

#[test]
fn stdin_and_no_box_at_all() {
    let sandbox = Sandbox::new();
    let boxes = scene();
    let arguments = ["cull", "-", "--backend", "in-process", "--json"];
    let report = sandbox.run_with_input(&arguments, bytemuck::cast_slice(&boxes)).json();
    assert_eq!(report["pairs"], oracle::truth(&boxes).pairs.len());
    let report = sandbox.run_with_input(&arguments, &[]).json();
    assert_eq!((&report["boxes"], &report["pairs"]), (&0.into(), &0.into()));
}

#[test]
fn results_go_to_stdout_and_the_report_aside() {
    let sandbox = Sandbox::new();
    sandbox.boxes(&scene());
    let truth = oracle::truth(&scene());
    let bytes = |name: &str, what: &str| {
        let line = format!("cull boxes.f32 --backend in-process --encoding dense {what} -");
        let finished = sandbox.line(&line).output().unwrap();
        let stderr = String::from_utf8_lossy(&finished.stderr);
        assert_eq!(finished.status.code(), Some(0), "{stderr}");
        for part in ["pairs      ", "345 (1 empty, 2 invalid)", "cpu-", "in-process", "round trip"]
        {
            assert!(stderr.contains(part), "{stderr}");
        }
        std::fs::write(sandbox.file(name), &finished.stdout).unwrap();
        words(&sandbox.file(name))
    };
    assert_eq!(pairs_of(&bytes("pairs", "--pairs")), truth.pairs);
    assert_eq!(pairs_in(&bytes("mask", "--mask"), "dense", 345), truth.pairs);
    assert!(!sandbox.file("-").exists());
    let scene = sandbox.line("scene uniform 50 -").output().unwrap().stdout;
    assert_eq!(scene.len(), 50 * 24);
}

#[test]
fn a_file_of_odd_size_is_named_with_its_size() {
    let sandbox = Sandbox::new();
    std::fs::write(sandbox.file("odd"), [0; 100]).unwrap();
    let finished = sandbox.run_line("cull odd --json");
    let error = finished.error(1);
    assert!(error.contains("odd has 100 bytes") && error.contains("4 boxes"), "{error}");
    assert_eq!(finished.stdout, "");
    let piped = sandbox.run_with_input(&["cull", "-"], &[0; 23]);
    assert!(piped.error(1).contains("23 bytes"));
}

#[test]
fn a_missing_daemon_says_what_to_do() {
    let sandbox = Sandbox::new();
    sandbox.boxes(&scene());
    let finished = sandbox.run_line("cull boxes.f32 --backend daemon --instance world");
    let error = finished.error(1);
    let searched = format!("instance 'world' in {}", sandbox.path().display());
    assert!(error.contains("pairmaskd serve") && error.contains(&searched), "{error}");
    let report = sandbox.run_line("cull boxes.f32 --backend auto --json");
    assert_eq!(report.json()["backend"], "in-process");
}

#[test]
fn text_csv_and_numpys_files_are_read_and_written() {
    let sandbox = Sandbox::new();
    let run = |line: &str| assert_eq!(sandbox.run_line(line).code, Some(0), "{line}");
    run("scene uniform 345 boxes.f32");
    let cull = "--backend in-process --pairs";
    run(&format!("cull boxes.f32 {cull} pairs.u32"));
    let expected = pairs_of(&words(&sandbox.file("pairs.u32")));
    assert!(expected.len() > 100);
    for end in ["txt", "csv", "npy"] {
        run(&format!("scene uniform 345 boxes.{end}"));
        run(&format!("cull boxes.{end} {cull} pairs.{end} --precision exact"));
        run(&format!("cull boxes.{end} {cull} again.u32"));
        assert_eq!(pairs_of(&words(&sandbox.file("again.u32"))), expected, "{end}");
    }
    let text = |name: &str| std::fs::read_to_string(sandbox.file(name)).unwrap();
    let rows = |separator: &str| {
        let row = |[a, b]: &Pair| format!("{a}{separator}{b}\n");
        expected.iter().map(row).collect::<String>()
    };
    assert_eq!(text("pairs.txt"), rows(" "));
    assert_eq!(text("pairs.csv"), format!("a,b\n{}", rows(",")));
    let array = std::fs::read(sandbox.file("pairs.npy")).unwrap();
    let numbers = array.len() - 8 * expected.len();
    assert_eq!(array[numbers..], *bytemuck::cast_slice::<_, u8>(&expected));
    let shape = format!("'shape': ({}, 2)", expected.len());
    assert!(String::from_utf8_lossy(&array[..numbers]).contains(&shape));

    // From a pipe to a pipe, by a flag.
    let boxes = std::fs::read(sandbox.file("boxes.csv")).unwrap();
    let line = "cull - --input-format csv --pairs - --pairs-format text --backend in-process";
    let piped = sandbox.run_with_input(&line.split(' ').collect::<Vec<_>>(), &boxes);
    assert_eq!((piped.code, piped.stdout), (Some(0), rows(" ")), "{}", piped.stderr);
    let report = sandbox.run_line("explain boxes.npy 0 1 --json").json();
    assert_eq!(report["boxes"], 345);
}

#[test]
fn a_mistake_in_a_file_is_named_with_its_place() {
    let sandbox = Sandbox::new();
    std::fs::write(sandbox.file("boxes.csv"), "0,0,0,1,1,1\n0,0,0,1,1,one\n").unwrap();
    let finished = sandbox.run_line("cull boxes.csv --backend in-process");
    let expected = "boxes.csv: line 2, column 6: 'one' is no number";
    assert!(finished.error(1).ends_with(expected), "{finished:?}");
    for (line, expected) in [
        ("cull /dev/zero --input-format text", "line 1: it is longer than 4096 bytes"),
        ("cull /dev/zero --input-format npy", "it is no .npy file"),
        ("cull /dev/zero", "it is a device without an end"),
        ("cull boxes.csv --shape spheres", "line 1: there are 6 columns, where 4 make one"),
    ] {
        let finished = sandbox.run_line(&format!("{line} --backend in-process"));
        assert!(finished.error(1).contains(expected), "{line}: {finished:?}");
    }
    let finished = sandbox.run_line("cull boxes.csv --pairs-format csv");
    assert!(finished.error(2).contains("--pairs"), "{finished:?}");
}

#[test]
fn binary_results_do_not_go_to_a_terminal() {
    let sandbox = Sandbox::new();
    assert_eq!(sandbox.run_line("scene uniform 100 boxes.f32").code, Some(0));
    let cull = "cull boxes.f32 --backend in-process";
    for (line, cure) in [
        (format!("{cull} --pairs -"), "add --pairs-format text, or name a file or a pipe"),
        (format!("{cull} --pairs - --pairs-format npy"), "add --pairs-format text"),
        (format!("{cull} --mask -"), "name a file or a pipe"),
        ("scene uniform 100 -".to_owned(), "name a file or a pipe"),
    ] {
        let terminal = Terminal::new();
        let (code, stderr) = terminal.run(sandbox.line(&line), |_| ());
        let expected = format!("pairmaskd: stdout is a terminal, and the result is binary: {cure}");
        assert!(code == Some(2) && stderr.starts_with(&expected), "{line}: {code:?} {stderr}");
        assert_eq!(terminal.close(), "", "{line}");
    }
    let terminal = Terminal::new();
    let line = format!("{cull} --pairs - --pairs-format text");
    assert_eq!(terminal.run(sandbox.line(&line), |_| ()).0, Some(0));
    let printed = terminal.close();
    let is_pair =
        |line: &str| line.split(' ').filter(|word| word.parse::<u32>().is_ok()).count() == 2;
    assert!(printed.lines().count() > 10 && printed.lines().all(is_pair), "{printed}");
}
