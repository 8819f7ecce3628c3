//! `cull`: the pairs of a file of boxes or spheres.

mod report;

use std::io;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use pairmask::{Backend, ConnectError, PairMask, Pending, Session};
use pairmask_core::mask::WordAddress;
use pairmask_core::plan::Plan;
use pairmask_core::{Aabb, Bounds, MaskView, Sphere};
use rayon::slice::ParallelSliceMut;

use self::report::{Timings, explanation, plan, report};
use super::object_files::{self, BoxFile, FileObject, Format, ObjectFile};
use super::options::{CommonOptions, CullFlags, DaemonOptions};
use super::output::{
    BinaryToTerminal, check_binary, is_stdout, print_aside, print_json, print_text, write_file,
};
use super::program::{Result, WrongUsage};
use super::progress::spinner;
use super::scene_look::Look;
use super::target::DEADLINE;
use crate::precision::PrecisionChoice;
use crate::spawn::PrivateDaemon;

/// Find the overlapping pairs of a file of boxes or spheres
#[derive(Debug, Args)]
#[command(after_help = "\
A file of boxes holds min.x min.y min.z max.x max.y max.z of each, a file of spheres x y z radius: as
little-endian f32 without anything between them, or as text, CSV or an array of numpy where its name ends
with .txt, .csv or .npy. Pairs are written the same way, as u32, the lower index first, in ascending order.
A dense mask is written as its u32 words; a sparse one as the order of its n boxes, then the rows
of all its words, their blocks and their bits; a list as its pairs, in the order in which the
engine found them.

Examples:
  pairmaskd cull boxes.f32                            by the daemon, or in process without one
  pairmaskd cull boxes.f32 --spawn --pairs pairs.u32  by a daemon of its own
  generate | pairmaskd cull - --backend in-process --json
  pairmaskd cull boxes.f32 --pairs - | consume         pairs to stdout, the report to stderr
  pairmaskd cull boxes.csv --pairs pairs.npy          from a table to numpy
  generate | pairmaskd cull - --input-format text --pairs - --pairs-format text
  pairmaskd cull boxes.f32 --explain                  and say why this engine
  pairmaskd cull balls.f32 --shape spheres --json     pairs of bounding spheres")]
pub struct Cull {
    /// File of boxes or spheres, `-` for stdin
    #[arg(value_name = "FILE")]
    file: PathBuf,
    #[command(flatten)]
    options: CullFlags,
    #[command(flatten)]
    daemon: DaemonOptions,
    /// Start a daemon for this call and stop it afterwards; --backend and --instance are not used
    #[arg(long)]
    spawn: bool,
    /// What the file holds. Spheres are always exact
    #[arg(long, value_enum, default_value_t)]
    shape: Shape,
    /// How the file holds them [default: by the end of its name: .txt, .csv, .npy, else raw]
    #[arg(long, value_enum, value_name = "FORMAT")]
    input_format: Option<Format>,
    /// Precision of the boxes: exact, q16, q8, f16 or margin=X. No pair is missed; all
    /// but exact may report pairs that are near
    #[arg(long, value_name = "MODE", default_value_t)]
    precision: PrecisionChoice,
    /// Write the pairs here, `-` for stdout; the report then goes to stderr
    #[arg(long, value_name = "OUT")]
    pairs: Option<PathBuf>,
    /// How the pairs are written [default: by the end of the name: .txt, .csv, .npy, else raw]
    #[arg(long, value_enum, value_name = "FORMAT", requires = "pairs")]
    pairs_format: Option<Format>,
    /// Write the mask here, `-` for stdout; the report then goes to stderr
    #[arg(long, value_name = "OUT")]
    mask: Option<PathBuf>,
    /// Say why this engine: what the plan saw and predicted, beside what was measured
    #[arg(long)]
    explain: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
enum Shape {
    #[default]
    Boxes,
    Spheres,
}

impl Cull {
    pub fn run(&self, common: &CommonOptions) -> Result {
        self.check().map_err(WrongUsage)?;
        self.check_terminal()?;
        let format = self.input_format.unwrap_or_else(|| Format::of(&self.file));
        match self.shape {
            Shape::Boxes => {
                let boxes = ObjectFile::open_as(&self.file, format)?;
                self.run_with(boxes, common, |boxes, session| {
                    let planner = self.explain.then(|| {
                        let (options, isa) = (self.options.cull_options(common), common.isa());
                        move |boxes: &[Aabb]| plan(boxes, &options, isa)
                    });
                    ask_boxes(session, boxes, self.precision, planner)
                })
            }
            Shape::Spheres => {
                self.run_with(ObjectFile::open_as(&self.file, format)?, common, ask_spheres)
            }
        }
    }

    fn pairs_format(&self, path: &Path) -> Format {
        self.pairs_format.unwrap_or_else(|| Format::of(path))
    }

    fn check_terminal(&self) -> Result<(), BinaryToTerminal> {
        if let Some(path) = self.pairs.as_deref().filter(|path| self.pairs_format(path).is_binary())
        {
            check_binary(path, "add --pairs-format text, or name a file or a pipe")?;
        }
        self.mask.as_deref().map_or(Ok(()), |path| check_binary(path, "name a file or a pipe"))
    }

    fn run_with<T: FileObject>(
        &self,
        objects: ObjectFile<T>,
        common: &CommonOptions,
        ask: impl FnOnce(ObjectFile<T>, &mut Session) -> Result<Asked>,
    ) -> Result {
        let progress = spinner(&format!("{} {}", objects.count(), T::PLURAL));
        let spawn = || PrivateDaemon::start_self(&self.daemon.private(common));
        let daemon = self.spawn.then(spawn).transpose()?;
        let mut session = self.connect(daemon.as_ref(), common)?;
        let Asked { times, frame, planned, look, world } = ask(objects, &mut session)?;
        let (mask, timings) = answer(frame, times)?;

        let explain = planned.map(|plan| explanation(&plan, common.isa(), &mask, timings.decode));
        let (are_boxes, census) = (self.shape == Shape::Boxes, &mask.info().census);
        let warnings = Vec::from_iter(look.warning(are_boxes, mask.n().get(), census));
        let report = report(&mask, self.precision, &world, &timings, explain, &warnings);
        if let Some(path) = &self.pairs {
            write_pairs(path, self.pairs_format(path), &mask)?;
        }
        if let Some(path) = &self.mask {
            write_mask(path, &mask)?;
        }
        progress.finish_and_clear();
        for warning in &warnings {
            log::warn!("{}: {warning}", self.file.display());
        }
        if [&self.pairs, &self.mask].into_iter().flatten().any(|path| is_stdout(path)) {
            print_aside(&report.to_string());
            return Ok(());
        }
        if self.json { print_json(&report) } else { print_text(&report.to_string()) }?;
        Ok(())
    }

    fn check(&self) -> Result<(), String> {
        let is_precise = self.precision == PrecisionChoice::Exact;
        for (flag, allowed) in [("--precision", is_precise), ("--explain", !self.explain)] {
            if self.shape == Shape::Spheres && !allowed {
                return Err(format!("{flag} is about boxes: leave it out with --shape spheres"));
            }
        }
        let to_stdout = |path: &Option<PathBuf>| path.as_deref().is_some_and(is_stdout);
        let results = [
            ("--pairs -", to_stdout(&self.pairs)),
            ("--mask -", to_stdout(&self.mask)),
            ("--json", self.json),
        ];
        let mut on_stdout = results.iter().filter(|(_, is_there)| *is_there);
        if let (Some((first, _)), Some((second, _))) = (on_stdout.next(), on_stdout.next()) {
            return Err(format!(
                "{first} and {second} would both write to stdout: name a file for one of them"
            ));
        }
        match (&self.pairs, &self.mask) {
            (Some(path), Some(mask)) if path == mask => {
                Err(format!("--pairs and --mask name the same file, {}: name two", path.display()))
            }
            _ => Ok(()),
        }
    }

    fn connect(
        &self,
        daemon: Option<&PrivateDaemon>,
        common: &CommonOptions,
    ) -> Result<Session, ConnectError> {
        let builder = self.options.session(common).deadline(DEADLINE);
        let (dir, instance, backend) = if let Some(daemon) = daemon {
            (daemon.dir(), daemon.instance(), Backend::Daemon)
        } else {
            let backend = self.options.backend(common, Backend::Auto);
            (common.runtime_dir(), common.instance(), backend)
        };
        builder.runtime_dir(dir).instance(instance.as_str()).backend(backend).connect()
    }
}

struct Asked {
    /// When it was begun, read and submitted.
    times: [Instant; 3],
    frame: Pending<PairMask>,
    planned: Option<Plan>,
    look: Look,
    /// Bounds of the boxes, where a gap depends on their coordinates.
    world: Bounds,
}

fn ask_boxes(
    session: &mut Session,
    boxes: BoxFile,
    precision: PrecisionChoice,
    planner: Option<impl FnOnce(&[Aabb]) -> Plan>,
) -> Result<Asked> {
    let start = Instant::now();
    let look_at = |boxes: &[Aabb]| {
        let read = Instant::now();
        (planner.map(|plan| plan(boxes)), Look::at(boxes), [start, read, Instant::now()])
    };
    if precision == PrecisionChoice::Exact {
        let mut exact = session.frame(boxes.count())?;
        boxes.read_into(exact.boxes_mut())?;
        let (planned, look, times) = look_at(exact.boxes());
        let world = Bounds::around(&[]);
        return Ok(Asked { times, frame: exact.submit()?, planned, look, world });
    }
    let mut boxes = boxes.read()?;
    let has_margin = matches!(precision, PrecisionChoice::Margin(_));
    let world = Bounds::around(if has_margin { &boxes } else { &[] });
    precision.inflate(&mut boxes);
    let mut narrow = session.narrow_frame(boxes.len(), precision.precision(&boxes))?;
    narrow.write(&boxes)?;
    let (planned, look, times) = look_at(&boxes);
    Ok(Asked { times, frame: narrow.submit()?, planned, look, world })
}

fn ask_spheres(spheres: ObjectFile<Sphere>, session: &mut Session) -> Result<Asked> {
    let start = Instant::now();
    let mut frame = session.sphere_frame(spheres.count())?;
    spheres.read_into(frame.spheres_mut())?;
    let read = Instant::now();
    let look = Look::at(frame.spheres_mut());
    let times = [start, read, Instant::now()];
    Ok(Asked { times, frame: frame.submit()?, planned: None, look, world: Bounds::around(&[]) })
}

fn answer(
    frame: Pending<PairMask>,
    [start, read, submitted]: [Instant; 3],
) -> Result<(PairMask, Timings)> {
    let mask = frame.wait()?;
    let answered = Instant::now();
    let mut decoded = 0;
    mask.view().for_each(|_, _| decoded += 1);
    let end = Instant::now();

    let (engine, counted) = (mask.info().engine, mask.count());
    if counted != decoded {
        let text = format!(
            "{engine} counted {counted} pairs and its mask holds {decoded}: please report this"
        );
        return Err(text.into());
    }
    let timings = Timings {
        read: read - start,
        round_trip: answered - submitted,
        decode: end - answered,
        total: (end - submitted) + (read - start),
    };
    Ok((mask, timings))
}

/// Writes the pairs, the lower index first, in ascending order; to stdout for `-`.
fn write_pairs(path: &Path, format: Format, mask: &PairMask) -> Result {
    let mut pairs: Vec<[u32; 2]> = Vec::new();
    let room = usize::try_from(mask.count()).ok();
    if room.is_none_or(|room| pairs.try_reserve_exact(room).is_err()) {
        let pairs = mask.count();
        let what = format!("no memory to sort {pairs} pairs: write the mask instead (--mask)");
        return Err(what.into());
    }
    mask.view().for_each(|a, b| pairs.push([a, b]));
    if !pairs.is_sorted() {
        pairs.par_sort_unstable();
    }
    write_file(path, |file| object_files::write_pairs(file, format, &pairs))
}

/// Writes the words of a dense mask; of a sparse one the order of the boxes, then the rows, the
/// blocks and the bits of its words. The order comes first and is always written, so that the
/// number of words follows from the file's length; of a list its pairs, in its own order. Of any
/// other mask the sections, as they lie in the reply. To stdout for `-`.
fn write_mask(path: &Path, mask: &PairMask) -> Result {
    let view = mask.view();
    write_file(path, |file| match &view {
        MaskView::Dense(dense) => file.write_all(bytemuck::cast_slice(dense.as_words())),
        MaskView::Sparse(sparse) => {
            let addresses = || {
                view.words().filter_map(|word| match word.address {
                    WordAddress::Sparse { row, block } => Some((row, block)),
                    WordAddress::Dense { .. } => None,
                })
            };
            match sparse.order() {
                Some(order) => write_words(file, order.iter().copied())?,
                None => write_words(file, 0..sparse.n().get())?,
            }
            write_words(file, addresses().map(|(row, _)| row))?;
            write_words(file, addresses().map(|(_, block)| block))?;
            write_words(file, view.words().map(|word| word.bits.0))
        }
        MaskView::List(_) => {
            let mut done = Ok(());
            view.for_each_slice(|pairs| {
                if done.is_ok() {
                    done = file.write_all(bytemuck::cast_slice(pairs));
                }
            });
            done
        }
        _ => {
            let sections = mask.shape().spans().filter_map(|span| span.of(mask.reply_words()));
            write_words(file, sections.flatten().copied())
        }
    })
}

fn write_words(file: &mut dyn Write, words: impl Iterator<Item = u32>) -> io::Result<()> {
    for word in words {
        file.write_all(&word.to_le_bytes())?;
    }
    Ok(())
}
