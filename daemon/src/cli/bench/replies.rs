//! `bench replies`: bytes of a mask beside a list of pairs and beside denser forms.

use std::fmt;

use clap::Args;
use pairmask::dispatch::{CpuEngines, CullWish};
use pairmask::engine::{EngineName, HeapReply};
use pairmask::mask::EncodingChoice;
use pairmask::{BoxCount, Encoding, EngineChoice};
use serde::Serialize;

use super::BenchError;
use super::machine::Machine;
use super::scenes::SceneSizes;
use crate::cli::config::Config;
use crate::cli::options::Place;
use crate::cli::output::{print_json, print_text, progress_bar};
use crate::scene::{Scene, SceneName};
use crate::study::engines::{Case, EngineStudyError};
use crate::study::replies::{FormsReport, measure};

/// Sizes unless others are named.
const SIZES: [u32; 6] = [64, 1_000, 4_096, 10_000, 100_000, 1_000_000];
/// A pair in a list: two u32.
const LISTED_PAIR_BYTES: u64 = 8;
/// Scenes up to this size are culled by every engine, since the order of the boxes decides how many
/// pairs a word holds; larger ones by the planned engine alone.
const EVERY_ENGINE_BOXES: usize = 10_000;
/// Largest dense mask that is written out; of larger ones the size is known without.
const MOST_DENSE_BYTES: u64 = 64 << 20;

/// Bytes of a reply, each encoding, beside a list of pairs and denser forms of the sparse one
#[derive(Debug, Args)]
#[command(after_help = "\
Scenes are culled in this process by every engine (above 10,000 boxes by the planned one), in either
encoding. A list of pairs takes 8 bytes a pair. Bytes are those of the mask: rows, blocks, bits and
order of a sparse one, one bit a pair of a dense one.

The forms are those of the sparse mask that cpu-grid writes. None but the first is on the wire:
  sparse    row, block, bits: 12 bytes a word
  prefix    first word of each row, 4 bytes; block, bits: 8 bytes a word
  words-64  row, block of 64 columns, 64 bits: 16 bytes a word
  packed    half a row, distance of the block, bits: 8 bytes a word; 4 bytes for 65,536 rows
  list      two boxes: 8 bytes a pair, no order
Each but the last needs the order, 4 bytes a box, unless the client kept it. Times are medians on
one thread with decoders of the study, against the client library's own with the sparse form. What
the link saves is bytes over 52 GB/s, what an H200 writes to shared memory.

Examples:
  pairmaskd bench replies
  pairmaskd bench replies --scene uniform,pile --n 10000,100000 --json")]
pub struct Replies {
    #[command(flatten)]
    what: SceneSizes,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// The JSON object of `bench replies --json`. Fields may be added, never changed or taken away.
#[derive(Debug, Serialize)]
struct Report {
    machine: Machine,
    rows: Vec<Row>,
    #[serde(flatten)]
    forms: FormsReport,
}

#[derive(Debug, Serialize)]
struct Row {
    scene: &'static str,
    n: usize,
    engine: &'static str,
    encoding: &'static str,
    pairs: u64,
    mask_bytes: u64,
    /// Null where there is no pair.
    bytes_a_pair: Option<f64>,
    list_bytes: u64,
}

impl Row {
    fn new(case: Case, engine: &'static str, encoding: Encoding, pairs: u64, bytes: u64) -> Self {
        Self {
            scene: case.scene.as_str(),
            n: case.n,
            engine,
            encoding: encoding.as_str(),
            pairs,
            mask_bytes: bytes,
            bytes_a_pair: (pairs > 0).then(|| bytes as f64 / pairs as f64),
            list_bytes: LISTED_PAIR_BYTES * pairs,
        }
    }
}

impl Replies {
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), BenchError> {
        let (calibration, _) = place.calibration(config).resolve();
        let cases = self.what.cases(&SceneName::ALL, &SIZES);
        let progress = progress_bar(cases.len() as u64, "culling");
        let mut engines = CpuEngines::with_calibration(calibration);
        let (mut rows, mut forms) = (Vec::new(), Vec::new());
        for case in cases {
            let scene = Scene::new(case.scene, case.n, 1);
            rows.extend(rows_of(case, &scene, &mut engines).map_err(EngineStudyError::from)?);
            forms.extend(measure(case, &scene, &mut engines)?);
            progress.inc(1);
        }
        progress.finish_and_clear();
        let forms = FormsReport::new(forms);
        let report = Report { machine: Machine::this(), rows, forms };
        if self.json { print_json(&report) } else { print_text(&report.to_string()) }?;
        Ok(())
    }
}

fn rows_of(
    case: Case,
    scene: &Scene,
    engines: &mut CpuEngines,
) -> Result<Vec<Row>, pairmask::engine::CullError> {
    let mut choices: Vec<EngineChoice> = EngineName::CPU.map(EngineChoice::Only).into();
    if case.n > EVERY_ENGINE_BOXES {
        choices = vec![EngineChoice::Auto];
    }
    let dense_bytes = BoxCount::new(case.n as u32).dense_words().saturating_mul(4);
    let mut rows = Vec::new();
    for engine in choices {
        for encoding in [Encoding::Sparse, Encoding::Dense] {
            let encoding_choice = EncodingChoice::Only(encoding);
            let wish = CullWish { engine, encoding: encoding_choice, ..CullWish::default() };
            let known = rows.last().map(|row: &Row| row.pairs);
            if encoding == Encoding::Dense && dense_bytes > MOST_DENSE_BYTES {
                rows.push(Row::new(case, "any", encoding, known.unwrap_or(0), dense_bytes));
                continue;
            }
            let mut reply = HeapReply::new();
            let answer = engines.cull(scene.boxes(), &wish, &mut reply)?;
            let (pairs, bytes) = (answer.report.pair_count, answer.report.shape.mask_bytes());
            rows.push(Row::new(case, answer.engine.as_str(), encoding, pairs, bytes));
        }
    }
    Ok(rows)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:>9} {:>9}  {:<10} {:<7} {:>11} {:>13} {:>12} {:>14}",
            "scene", "n", "engine", "mask", "pairs", "bytes", "bytes/pair", "of pair list"
        )?;
        for row in &self.rows {
            let bytes_a_pair = row.bytes_a_pair.map_or("-".to_owned(), |b| format!("{b:.1}"));
            let share = row
                .bytes_a_pair
                .map_or("-".to_owned(), |b| format!("{:.2}", b / LISTED_PAIR_BYTES as f64));
            write!(
                f,
                "\n{:>9} {:>9}  {:<10} {:<7} {:>11} {:>13} {bytes_a_pair:>12} {share:>14}",
                row.scene, row.n, row.engine, row.encoding, row.pairs, row.mask_bytes
            )?;
        }
        write!(f, "\n\n{}", self.forms)
    }
}
