//! `explain`: why two boxes of a file are a pair or not.

use std::path::PathBuf;

use clap::Args;

use super::object_files::BoxFile;
use super::output::{print_json, print_text};
use super::program::Result;
use super::progress::spinner;
use super::whole_number::whole_number;
use crate::explain::{SentBoxes, explain};
use crate::precision::PrecisionChoice;

/// Say why two boxes of a file are a pair or not
#[derive(Debug, Args)]
#[command(after_help = "\
The gap on each axis in units and in ulps (steps of f32), the class of each box, and the cells that
cpu-grid puts the two into; with --precision, what that mode makes of the two, as cull has it. Boxes
are numbered from 0, in the order of the file.

Examples:
  pairmaskd explain boxes.f32 3 17
  pairmaskd explain boxes.f32 3 17 --precision q16
  pairmaskd explain boxes.f32 3 17 --json")]
pub struct Explain {
    /// File of boxes, `-` for stdin
    #[arg(value_name = "FILE")]
    boxes: PathBuf,
    /// One box
    #[arg(value_parser = whole_number::<u32>)]
    i: u32,
    /// The other box
    #[arg(value_parser = whole_number::<u32>)]
    j: u32,
    /// Precision of the boxes: exact, q16, q8, f16 or margin=X
    #[arg(long, value_name = "MODE", default_value_t)]
    precision: PrecisionChoice,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Explain {
    pub fn run(&self) -> Result {
        let progress = spinner("reading and explaining");
        let boxes = BoxFile::open(&self.boxes)?.read()?;
        let sent = SentBoxes::of(self.precision, &boxes);
        let why = explain(&boxes, &sent, self.i, self.j)
            .map_err(|error| format!("{}: {error}", self.boxes.display()))?;
        progress.finish_and_clear();
        if self.json { print_json(&why) } else { print_text(why.to_string().trim_end()) }?;
        Ok(())
    }
}
