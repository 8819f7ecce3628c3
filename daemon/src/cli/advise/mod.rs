//! `advise`: which session serves a program soonest on this machine, and the lines of code that make it.

mod picture;
mod report;

use std::fs::File;
use std::io::{BufReader, ErrorKind};
use std::num::{NonZeroU64, NonZeroUsize};
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args;

use self::report::Report;
use super::machine::Machine;
use super::object_files::{BoxFile, Format};
use super::options::{CommonOptions, DaemonOptions};
use super::output::{is_stdout, print_json, print_text, write_file};
use super::program::{Result, WrongUsage};
use super::progress::progress_bar;
use super::scene_look;
use super::whole_number::whole_number;
use crate::advise::{Answer, Effort, Hosts, Workload, advise};
use crate::file_error::{Access, FileError};
use crate::recording::{ReadError, Recording};

/// The share of the boxes of a file that move, unless it is said: of a game most boxes stand.
const MOVING: f64 = 0.1;
/// Steps of the progress bar.
const STEPS: u64 = 1_000;

/// Measure which session serves a program soonest, and print the lines that make it
#[derive(Debug, Args)]
#[command(after_help = "\
FILE is a recording (`serve --record`), whose ticks are done again, or a file of boxes as `cull` takes, which
is set in motion. Ticks are done in each way that can serve them: in process or by a daemon, on cores or a GPU,
as frames or as a scene, with margins or without, in f32 or in cells of 16 bits, with the plan's choice of
threads or with one. A tick is what a program waits for: boxes written, the answer, every pair looked at. Ways
are measured in turns, one tick after another as fast as it goes; the best one is measured again beside its
rivals. Daemons of its own are started for that.

Of ways that differ by less than the noise, the simpler one is advised. Ways whose pairs may be near ones are
advised only where the program sends such boxes by itself; else the table has the fastest one.

Columns: a tick is the mean over all ticks, of each the median of its repetitions, and decides; cpu is the time
of all cores, of the program and the daemon.

Examples:
  pairmaskd advise game.pmrec
  pairmaskd advise game.pmrec --gpu none --seconds 60 --all
  pairmaskd advise boxes.csv --moving 0.5 --changes
  pairmaskd advise game.pmrec --picture advice.svg --json")]
pub struct Advise {
    /// Recording or file of boxes, `-` for boxes from stdin
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// How a file holds boxes [default: by the end of its name: .txt, .csv, .npy, else raw]
    #[arg(long, value_enum, value_name = "FORMAT")]
    input_format: Option<Format>,
    /// Share of the boxes of a file that move each tick, by 2 % of their size [default: 0.1]
    #[arg(long, value_parser = share, value_name = "SHARE")]
    moving: Option<f64>,
    /// The program needs pairs that began and ended, of a file of boxes [default: all pairs]
    #[arg(long)]
    changes: bool,
    /// How long it may take, about
    #[arg(long, value_parser = whole_number::<NonZeroU64>, value_name = "N", default_value = "20")]
    seconds: NonZeroU64,
    /// List all ways, not only the fastest
    #[arg(long)]
    all: bool,
    /// Write the figures here as SVG, `-` for stdout
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    #[command(flatten)]
    daemon: DaemonOptions,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

fn share(text: &str) -> Result<f64, String> {
    let share = text.parse().ok().filter(|share: &f64| (0.0..=1.0).contains(share));
    share.ok_or_else(|| "must be a share from 0 to 1, such as 0.1".to_owned())
}

impl Advise {
    pub fn run(&self, common: &CommonOptions) -> Result {
        if self.json && self.picture.as_deref().is_some_and(is_stdout) {
            let what = "--json and --picture - would both write to stdout: name a file";
            return Err(WrongUsage(what.to_owned()).into());
        }
        let workload = self.workload()?;
        let hosts = Hosts::start(self.daemon.private(common))?;
        let time = Duration::from_secs(self.seconds.get());
        let cores = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
        let name = self.file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let progress = progress_bar(STEPS, &format!("measuring {name}"));
        let advice = advise(&workload, &hosts, Effort { time, cores }, &mut |done, what| {
            progress.set_position((done * STEPS as f64) as u64);
            progress.set_message(what.to_owned());
        })?;
        progress.finish_and_clear();
        let machine = Machine::this();
        let report =
            Report { name: &name, machine: &machine, workload: &workload, advice: &advice };
        if let Some(path) = &self.picture {
            let svg = picture::svg(&report);
            write_file(path, |file| file.write_all(svg.as_bytes()))?;
            if is_stdout(path) {
                return Ok(());
            }
        }
        let shown = report.shown(self.all);
        if self.json { print_json(&shown) } else { print_text(&shown.text) }?;
        Ok(())
    }

    fn workload(&self) -> Result<Workload> {
        let name = self.file.display();
        if let Some(mut recording) = recording(&self.file)? {
            if self.moving.is_some() || self.changes || self.input_format.is_some() {
                let what = "--moving, --changes and --input-format are about a file of boxes: \
                            a recording says itself what its program does";
                return Err(WrongUsage(what.to_owned()).into());
            }
            let workload = Workload::of_recording(&mut recording);
            return Ok(workload.map_err(|error| format!("{name}: {error}"))?);
        }
        let format = self.input_format.unwrap_or_else(|| Format::of(&self.file));
        let boxes = BoxFile::open_as(&self.file, format)?.read()?;
        if let Some(warning) = scene_look::of_boxes(&boxes) {
            log::warn!("{name}: {warning}");
        }
        let answer = if self.changes { Answer::Changes } else { Answer::Pairs };
        let workload = Workload::of_boxes(boxes, self.moving.unwrap_or(MOVING), answer);
        Ok(workload.map_err(|error| format!("{name}: {error}"))?)
    }
}

/// The recording that a file is; `None` where it is none.
fn recording(path: &Path) -> Result<Option<Recording<BufReader<File>>>> {
    if is_stdout(path) {
        return Ok(None);
    }
    let file = File::open(path).map_err(FileError::of(path, Access::Read))?;
    match Recording::open(BufReader::new(file)) {
        Ok(recording) => Ok(Some(recording)),
        // A directory, say: reading it as boxes says so.
        Err(ReadError::NoRecording) => Ok(None),
        Err(ReadError::Io(error)) if error.kind() == ErrorKind::IsADirectory => Ok(None),
        Err(error) => Err(format!("{}: {error}", path.display()).into()),
    }
}
