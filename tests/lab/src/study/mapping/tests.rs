//! The mapping study: WGSL against the Rust mirrors, and a complete report.

use pairmask_core::pair_index::row_start;
use pairmask_core::{Aabb, BoxCount, PairIndex};
use pairmask_tests::gpu::{choice, open};
use pairmaskd::execute::gpu::{Checks, GpuChoice, GpuError, Home, HostImport};

use super::gpu::{self, Bench, Ids, count, count_roots};
use super::stage::{MappingStage, PAIRS, PAPERS_OWN, Root, TIME, Variant};
use super::variants::map;
use super::{Plan, errors, measure};
use crate::study::harness::Fields;

fn bench() -> Bench {
    Bench::new(&open(HostImport::Never), Checks::On).unwrap_or_else(|error| panic!("{error}"))
}

/// Maps `ids` on the device, for comparison with the mirrors. Ids past the variant's last one have no meaning.
fn map_on_gpu(
    bench: &mut Bench,
    variant: Variant,
    is_wide: bool,
    n: u32,
    ids: &[u64],
) -> Result<Vec<[i32; 2]>, GpuError> {
    let bytes = size_of_val(ids) as u64;
    let (from, to) = (bench.block(Home::Host, bytes)?, bench.block(Home::Host, bytes)?);
    from.write(0, ids);
    let params = [n, ids.len() as u32];
    // A few thousand ids: one row of workgroups.
    let groups = bench.groups(ids.len() as u64).map_or([1, 1], |groups| [groups[0], 1]);
    bench.run_stage(MappingStage::Map(PAIRS, variant, is_wide), &[&from, &to], &params, groups)?;
    let mut pairs = vec![[0; 2]; ids.len()];
    to.read(0, &mut pairs);
    Ok(pairs)
}

/// Ids around the ends of rows near the first, the middle and the last, and some between.
fn telling_ids(variant: Variant, n: u32) -> Vec<u64> {
    let total = variant.id_count(n);
    let boxes = BoxCount::new(n);
    let rows = [0, 1, 2, n / 3, n / 2, n - n.min(40), n.saturating_sub(3), n.saturating_sub(2)];
    let starts = rows.iter().flat_map(|row| {
        let start = row_start(boxes, *row);
        [start.saturating_sub(2), start.saturating_sub(1), start, start + 1]
    });
    let spread = (0..2000).map(|i| total / 2000 * i);
    let mut ids: Vec<u64> = starts.chain(spread).chain([0, total - 1]).collect();
    ids.retain(|k| *k < total);
    ids
}

#[test]
fn wgsl_variants_answer_as_their_mirrors() {
    let mut bench = bench();
    let (int64, software) = (bench.gpu().limits().int64, bench.gpu().is_software());
    let mut compared = 0;
    for variant in Variant::all() {
        for (n, is_wide) in [
            (2, false),
            (3, false),
            (70, false),
            (345, true),
            (4_113, false),
            (65_536, false),
            (92_682, variant.is_wide(92_682)),
            (1_000_000, true),
        ] {
            if is_wide && !int64 {
                continue;
            }
            let ids = telling_ids(variant, n);
            let gpu = map_on_gpu(&mut bench, variant, is_wide, n, &ids)
                .unwrap_or_else(|error| panic!("{variant}, {n} boxes: {error}"));
            // A software adapter computes as the CPU does; a GPU may fuse operations, and round roots otherwise.
            let is_closed = matches!(variant, Variant::Closed { .. });
            let rows = if is_closed && !software { 2 + u64::from(n) / 2000 } else { 0 };
            for (k, gpu) in ids.iter().zip(gpu) {
                let (gpu, mirror) = (gpu.map(i64::from), map(variant, BoxCount::new(n), *k));
                let is_same = gpu == mirror || rows > 0 && gpu[0].abs_diff(mirror[0]) <= rows;
                assert!(is_same, "{variant}, {n} boxes, id {k}: {gpu:?} and {mirror:?}");
            }
            compared += ids.len();
        }
        // The report of a quick run has the errors of 64-bit ids, and no times of them.
        let wide = MappingStage::Map(TIME, variant, true);
        let ms = gpu::ms(&mut bench, wide, 345, 1_000, &Plan::new(true, software));
        assert!(ms.is_ok_and(|ms| ms.is_some() == int64), "{variant}");
    }
    assert!(compared > 25 * 4 * 2000, "{compared} ids were compared");
}

#[test]
fn the_gpu_counts_the_errors_that_the_cpu_counts() {
    let mut bench = bench();
    let software = bench.gpu().is_software();
    for variant in Variant::all() {
        for n in [2, 33, 345, 1000] {
            let on_gpu = count(&mut bench, variant, n, Ids::All);
            let (tally, coverage) = on_gpu.expect("runs").expect("it fits");
            let (mut expected, expected_coverage) = errors::exhaustive(variant, BoxCount::new(n));
            // The GPU does not report the first wrong id.
            expected.first_wrong = None;
            assert_eq!(tally.ids, variant.id_count(n), "{variant}, {n} boxes");
            if software || expected.wrong == 0 {
                assert_eq!(tally, expected, "{variant}, {n} boxes");
                assert_eq!(coverage, expected_coverage, "{variant}, {n} boxes");
            }
        }
    }
    let around = count(&mut bench, PAPERS_OWN, 4_113, Ids::AroundRows);
    assert!(around.is_ok_and(|found| found.is_some_and(|(tally, _)| tally.wrong > 0)));
}

#[test]
fn the_gpu_counts_wrong_roots_as_the_cpu_does() {
    let mut bench = bench();
    let software = bench.gpu().is_software();
    for root in Root::all() {
        let gpu = count_roots(&mut bench, root, 12_345).expect("runs").expect("it fits");
        let cpu = errors::count_roots(root, 12_345);
        let is_near = !software && gpu.other.abs_diff(cpu.other) < 60;
        assert!(gpu == cpu || is_near, "{root}: {gpu:?} and {cpu:?}");
    }
}

#[test]
fn every_output_form_has_the_bits_of_the_overlaps() {
    let mut bench = bench();
    let boxes: Vec<Aabb> = crate::stress::scenes::ALL[0].boxes(345, 5);
    let n = BoxCount::new(345);
    let plan = Plan::new(true, true);
    let mut forms = 0;
    for thread_a_pair in [false, true] {
        for bits in [8, 1] {
            let run = gpu::mask(&mut bench, bits, thread_a_pair, &boxes, &plan);
            let run = run.expect("runs").expect("it fits");
            let per_word = u64::from(32 / bits);
            let mut hits = 0;
            for k in 0..run.words.len() as u64 * per_word {
                let shift = k % per_word * (32 / per_word);
                let bit = run.words[(k / per_word) as usize] >> shift & 1 == 1;
                let pair = PairIndex::new(k).pair(n);
                let expected =
                    pair.is_some_and(|[a, b]| boxes[a as usize].overlaps(&boxes[b as usize]));
                assert_eq!(bit, expected, "{bits} bits, pair {k}");
                hits += u64::from(bit);
            }
            assert!(hits > 0, "a scene without pairs shows nothing");
            forms += 1;
        }
    }
    assert_eq!(forms, 4);
}

#[test]
fn a_report_has_a_row_for_every_variant_and_is_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let made = measure(&choice(), true).unwrap_or_else(|error| panic!("{error}"));
    let out = folder.path().join("deep").join("er");
    made.write(&out).unwrap_or_else(|error| panic!("{error}"));
    let read = |name| std::fs::read_to_string(out.join(name)).expect("it was written");
    let (csv, page) = (read("mapping.csv"), read("mapping.html"));
    let json: serde_json::Value = serde_json::from_str(&read("mapping.json")).expect("it is JSON");
    let check = |name: &str, processor: &str, field: &str, value: &str| {
        let is_its = |row: &Fields| row["processor"] == processor && row[field] == value;
        assert!(made.lists[name].iter().any(is_its), "{name}: {processor}, {value}");
        assert!(csv.contains(&format!("\n{processor},{value},")), "{processor}, {value}");
    };
    for (variant, processor) in Variant::all().flat_map(|v| [(v, "cpu"), (v, "gpu")]) {
        check("pair_errors", processor, "variant", &variant.to_string());
        check("map_times", processor, "variant", &variant.to_string());
    }
    for root in Root::all() {
        check("root_errors", "gpu", "root", &root.to_string());
        check("root_times", "gpu", "root", &root.to_string());
    }
    let is_timed = |row: &&Fields| row["ps_per_pair"].as_f64() > Some(0.0);
    let timed = made.lists["pair_errors"].iter().filter(is_timed).count();
    assert_eq!(timed, 2 * 25, "of 1,000 boxes");
    assert!(page.contains("<svg") && page.contains("carmack-1, n 1000, gpu"), "{page}");
    // Two sizes, two forms, two ways to write them; three sizes.
    assert_eq!(["outputs", "growth", "claims"].map(|name| made.lists[name].len()), [8, 3, 9]);
    for name in made.lists.keys() {
        assert!(csv.contains(&format!("# {name}\n")) && json[name].is_array(), "{name}");
    }
    let machine = &json["machine"];
    for name in ["cpu", "gpu", "driver", "rustc", "commit", "command"] {
        assert!(machine[name].as_str().is_some_and(|text| !text.is_empty()), "{name}: {machine}");
    }
}

#[test]
fn without_a_gpu_the_cpu_alone_is_measured_and_a_missing_one_is_an_error() {
    let made = measure(&GpuChoice::None, true).unwrap_or_else(|error| panic!("{error}"));
    assert!(made.values["machine"]["gpu"].is_null() && made.lists["outputs"].is_empty());
    assert!(made.lists["pair_errors"].iter().all(|row| row["processor"] == "cpu"));
    let missing = measure(&GpuChoice::Name("no such adapter".into()), true);
    assert!(missing.is_err());
}
