//! `cull`: the pairs of a file of boxes.

mod explain;
mod files;
mod report;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use pairmask::session::{ConnectError, FrameError, WaitError};
use pairmask::{Aabb, Backend, EngineName, PairMask, Session};

use self::explain::{Explanation, Planned};
use self::files::FileError;
pub use self::report::backend_name;
use self::report::{CullReport, Timings};
use super::config::Config;
use super::options::{CullOptions, DaemonOptions, Place};
use super::output::{OutputError, print_json, print_text, spinner};
use super::raw_boxes::{RawBoxes, RawBoxesError};
use crate::precision::PrecisionChoice;
use crate::spawn::{PrivateDaemon, SpawnError};

/// How long one frame may take. Any scene that fits into memory is done by then.
const DEADLINE: Duration = Duration::from_secs(600);

/// Find the overlapping pairs of a file of boxes
#[derive(Debug, Args)]
#[command(after_help = "\
A file of boxes holds little-endian f32, min.x min.y min.z max.x max.y max.z, 24 bytes a box.
Pairs are written as two little-endian u32 each, the lower index first, in ascending order.
A dense mask is written as its u32 words; a sparse one as the order of its n boxes, then the rows
of all its words, their blocks and their bits.

Examples:
  pairmaskd cull boxes.f32                            by the daemon, or in process without one
  pairmaskd cull boxes.f32 --spawn --pairs pairs.u32  by a daemon of its own
  generate | pairmaskd cull - --backend in-process --json
  pairmaskd cull boxes.f32 --explain                  and say why this engine")]
pub struct Cull {
    /// File of boxes, `-` for stdin
    #[arg(value_name = "FILE")]
    boxes: PathBuf,
    #[command(flatten)]
    options: CullOptions,
    #[command(flatten)]
    daemon: DaemonOptions,
    /// Start a daemon for this call and stop it afterwards; --backend and --instance are not used
    #[arg(long)]
    spawn: bool,
    /// How precisely boxes are told apart: exact, q16, q8, f16 or margin=X. No pair is missed; all
    /// but exact may report pairs that are near
    #[arg(long, value_name = "MODE", default_value_t)]
    precision: PrecisionChoice,
    /// Write the pairs here
    #[arg(long, value_name = "OUT")]
    pairs: Option<PathBuf>,
    /// Write the mask here
    #[arg(long, value_name = "OUT")]
    mask: Option<PathBuf>,
    /// Say why this engine: what the plan saw and predicted, beside what was measured
    #[arg(long)]
    explain: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Why there are no pairs.
#[derive(Debug, thiserror::Error)]
pub enum CullCommandError {
    #[error(transparent)]
    Boxes(#[from] RawBoxesError),
    #[error(transparent)]
    Spawn(#[from] SpawnError),
    #[error(transparent)]
    Connect(#[from] ConnectError),
    #[error(transparent)]
    Frame(#[from] FrameError),
    #[error(transparent)]
    Wait(#[from] WaitError),
    /// An engine is broken: the number that it gives is not that of the bits that it set.
    #[error("{engine} counted {counted} pairs and its mask holds {decoded}: please report this")]
    Miscounted { engine: EngineName, counted: u64, decoded: u64 },
    #[error(transparent)]
    File(#[from] FileError),
    #[error(transparent)]
    Output(#[from] OutputError),
}

impl Cull {
    /// Reads, culls, decodes, writes.
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), CullCommandError> {
        let boxes = RawBoxes::open(&self.boxes)?;
        let spawn = || PrivateDaemon::start_self(&self.daemon.private(place, config));
        let daemon = self.spawn.then(spawn).transpose()?;
        let mut session = self.connect(daemon.as_ref(), place, config)?;

        let progress = spinner(&format!("{} boxes", boxes.len()));
        let planner = self.explain.then(|| {
            let (wish, calibration) = (self.options.wish(config), place.calibration(config));
            move |boxes: &[Aabb]| Planned::new(boxes, &wish, &calibration)
        });
        let (mask, timings, planned) = cull(&mut session, boxes, self.precision, planner)?;
        progress.finish_and_clear();

        let explanation = planned.map(|planned| Explanation::new(&planned, &mask, timings.decode));
        let report = CullReport::new(&mask, self.precision, &timings, explanation);
        if let Some(path) = &self.pairs {
            files::write_pairs(path, &mask)?;
        }
        if let Some(path) = &self.mask {
            files::write_mask(path, &mask)?;
        }
        if self.json { print_json(&report) } else { print_text(&report.to_string()) }?;
        Ok(())
    }

    fn connect(
        &self,
        daemon: Option<&PrivateDaemon>,
        place: &Place,
        config: &Config,
    ) -> Result<Session, ConnectError> {
        let builder = self.options.session(place, config).deadline(DEADLINE);
        let (dir, instance, backend) = if let Some(daemon) = daemon {
            (daemon.dir(), daemon.instance(), Backend::Daemon)
        } else {
            let backend = self.options.backend(config, Backend::Auto);
            (place.runtime_dir(config), place.instance(config), backend)
        };
        builder.runtime_dir(dir).instance(instance.as_str()).backend(backend).connect()
    }
}

/// The pairs of the boxes, what each stage took, and what was planned.
fn cull(
    session: &mut Session,
    boxes: RawBoxes,
    precision: PrecisionChoice,
    planner: Option<impl FnOnce(&[Aabb]) -> Planned>,
) -> Result<(PairMask, Timings, Option<Planned>), CullCommandError> {
    let start = Instant::now();
    let (read, planned, submitted, frame);
    if precision == PrecisionChoice::Exact {
        let mut exact = session.frame(boxes.len())?;
        boxes.read_into(exact.boxes_mut())?;
        read = Instant::now();
        planned = planner.map(|plan| plan(exact.boxes_mut()));
        submitted = Instant::now();
        frame = exact.submit()?;
    } else {
        let mut boxes = boxes.read()?;
        precision.inflate(&mut boxes);
        let mut narrow = session.narrow_frame(boxes.len(), precision.precision(&boxes))?;
        narrow.fill(&boxes);
        read = Instant::now();
        planned = planner.map(|plan| plan(&boxes));
        submitted = Instant::now();
        frame = narrow.submit()?;
    }
    let mask = frame.wait()?;
    let answered = Instant::now();
    let mut decoded = 0;
    mask.view().for_each(|_, _| decoded += 1);
    let end = Instant::now();

    let (engine, counted) = (mask.info().engine, mask.count());
    if counted != decoded {
        return Err(CullCommandError::Miscounted { engine, counted, decoded });
    }
    let timings = Timings {
        read: read - start,
        round_trip: answered - submitted,
        decode: end - answered,
        total: (end - submitted) + (read - start),
    };
    Ok((mask, timings, planned))
}
