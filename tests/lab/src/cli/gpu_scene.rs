//! `gpu-scene`: scenes that persist in video memory, edit by edit.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use clap::Args;
use pairmaskd::cli::config::Config;
use pairmaskd::cli::options::DaemonOptions;
use pairmaskd::cli::output::{print_json, print_text, spinner};
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::execute::gpu::{Gpu, HostImport, OpenError};
use pairmaskd::scene::SceneName;
use serde_json::json;

use super::error::LabError;
use crate::gpu_stages::BenchError;
use crate::gpu_stages::scenes::{Case, Row, measure};
use crate::study::moving::{Motion, World};

/// Scenes that persist in video memory: what an edit and its changes cost, by how much moves
#[derive(Debug, Args)]
#[allow(clippy::struct_excessive_bools)] // A flag each.
#[command(after_help = "\
Columns, µs: edit in, sorted changes out (median and 99 of 100), then the medians of its parts: the edit
checked, brought to the GPU, blocks made ready, the GPU with submission and wait, changes read and sorted.
Boxes of an edit are read where they lie (`imported`) or copied. What was told is compared with a fresh
search on the CPU at the end of each line. Between edits there are queries: their whole time (median, 1 and
99 of 100) and its parts. Needs a GPU; no daemon is between. Several GPUs (--gpu 0,1) keep each scene together;
times of stages are those of the first.

Examples:
  pairmask-lab gpu-scene --n 1000000 --moving 1,10,100 --stages
  pairmask-lab gpu-scene --gpu 0,1 --n 10000000 --moving 10 --queries 0
  pairmask-lab gpu-scene --gpu software --n 1000 --frames 5")]
pub struct GpuSceneBench {
    #[command(flatten)]
    options: DaemonOptions,
    /// Numbers of boxes
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N,..", value_delimiter = ',', default_values_t = [100_000, 1_000_000])]
    n: Vec<u32>,
    /// Scenes, as `pairmaskd scene` names them
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', default_values_t = [SceneName::Uniform, SceneName::Pile])]
    scene: Vec<SceneName>,
    /// How many of a hundred boxes move in each edit
    #[arg(long, value_parser = percent, value_name = "PERCENT,..", value_delimiter = ',', default_values_t = [0.0, 0.01, 0.1, 1.0, 10.0, 100.0])]
    moving: Vec<f64>,
    /// How they move: drift, jitter, teleport, spawn
    #[arg(long, value_name = "MOTION,..", value_delimiter = ',', default_value = "drift")]
    motion: Vec<Motion>,
    /// Edits of each line
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N", default_value_t = 100)]
    frames: u32,
    /// Boxes that are asked for after each edit
    #[arg(long, value_parser = whole_number::<u32>, value_name = "N", default_value_t = 10_000)]
    queries: u32,
    /// Copy boxes only; else both ways are measured
    #[arg(long)]
    copied: bool,
    /// Take times of stages too, by the GPU's clock
    #[arg(long)]
    stages: bool,
    /// Do not compare with the CPU's pairs
    #[arg(long)]
    unchecked: bool,
    /// Print JSON, one array of rows
    #[arg(long)]
    json: bool,
}

/// A text is no share of a hundred.
#[derive(Clone, Debug, thiserror::Error)]
#[error("must be a number from 0 to 100, such as 0.1")]
struct BadPercent;

fn percent(text: &str) -> Result<f64, BadPercent> {
    let percent = text.parse().map_err(|_| BadPercent)?;
    if (0.0..=100.0).contains(&percent) { Ok(percent) } else { Err(BadPercent) }
}

impl GpuSceneBench {
    pub fn run(&self, config: &Config) -> Result<(), LabError> {
        let choices = self.options.gpus(config).each();
        let gpus = choices.iter().map(|gpu| Gpu::open(gpu, HostImport::IfPossible));
        let gpus = gpus.collect::<Result<Vec<_>, _>>().map_err(BenchError::from)?;
        if gpus.is_empty() {
            return Err(BenchError::from(OpenError::SwitchedOff).into());
        }
        let names: Vec<&str> = gpus.iter().map(|gpu| gpu.info().name.as_str()).collect();
        if !self.json {
            print_text(&format!("{}\n{HEAD}", names.join(", ")))?;
        }
        let mut rows = Vec::new();
        for (scene, n, motion) in self.worlds() {
            let mut world = World::new(scene, n);
            for &percent in &self.moving {
                for imported in [true, false] {
                    if imported && self.copied {
                        continue;
                    }
                    let case = Case {
                        scene,
                        n,
                        motion,
                        percent,
                        imported,
                        frames: self.frames.max(1) as usize,
                        queries: self.queries as usize,
                        stages: self.stages,
                        checks: !self.unchecked,
                    };
                    let progress = spinner("measuring");
                    let row = measure(&gpus, &mut world, &case);
                    progress.finish_and_clear();
                    let row = row?;
                    if !self.json {
                        print_text(&line(&row))?;
                    }
                    rows.push(row);
                }
            }
        }
        if self.json {
            print_json(&json!({ "gpus": names, "rows": rows }))?;
        }
        Ok(())
    }

    fn worlds(&self) -> impl Iterator<Item = (SceneName, usize, Motion)> {
        let cases = self.scene.iter().flat_map(|scene| self.n.iter().map(|n| (*scene, *n)));
        cases.flat_map(|(scene, n)| self.motion.iter().map(move |m| (scene, n as usize, *m)))
    }
}

const HEAD: &str = "    scene        n  moving    motion boxes       edit      p99    check   upload     plan      \
                    gpu     sort again  changes      tested B/box";

fn line(row: &Row) -> String {
    let place = if row.imported { "there" } else { "copied" };
    let mut text = format!(
        "{:>9} {:>8} {:>6}% {:>9} {place:<6} {:>9.1} {:>8.1} {:>8.1} {:>8.1} {:>8.1} {:>8.1} {:>8.1} {:>5} {:>8} {:>11} {:>5.0}",
        row.scene,
        row.n,
        row.moving * 100.0,
        row.motion,
        row.edit_us,
        row.edit_p99_us,
        row.check_us,
        row.upload_us,
        row.plan_us,
        row.gpu_us,
        row.sort_us,
        row.repeated,
        row.changes,
        row.tested,
        row.video_bytes_a_box,
    );
    let add_stages = |text: &mut String, stages: &BTreeMap<&'static str, f64>| {
        if !stages.is_empty() {
            let stages = stages.iter().map(|(label, us)| format!("{label} {us:.1}"));
            text.push_str("\n          ");
            text.push_str(&stages.collect::<Vec<_>>().join("  "));
        }
    };
    add_stages(&mut text, &row.stage_us);
    if row.queries > 0 {
        let ([low, median, high], [upload, gpu, sort]) = (row.query_us, row.query_parts_us);
        let (queries, pairs) = (row.queries, row.query_pairs);
        // Writing to a String cannot fail.
        let _ = write!(
            text,
            "\n          {queries} queries, {pairs} pairs: {median:.1} ({low:.1} to {high:.1}), \
             upload {upload:.1}, gpu {gpu:.1}, sort {sort:.1}"
        );
        add_stages(&mut text, &row.query_stage_us);
    }
    text
}
