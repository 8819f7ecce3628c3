//! `demo`: a daemon process, this process as its client with falling boxes, and figures while they run.
//!
//! The world and what was measured are state ([`world`], [`figures`]); the picture and the texts are functions of both.

mod drawing;
mod figures;
mod peers;
mod picture;
mod rerun;
mod world;

use std::num::{NonZeroU32, NonZeroU64};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use pairmask::{Backend, ServedBy, Session};
use pairmask_core::oracle::check::check_pairs;
use pairmask_core::oracle::{Pair, truth};
use ratatui::buffer::Buffer;
use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::layout::Rect;
use rustix::process::{Pid, Signal, kill_process};

use self::figures::{Figures, Kill};
use self::peers::{ParryTree, naive};
use self::rerun::Recording;
use self::world::{STEP, World};
use super::options::{CommonOptions, DaemonOptions};
use super::output::{OutputError, print_aside, print_json, print_text, write_file};
use super::program::{Result, WrongUsage};
use super::terminal::{Screen, Waited, can_draw, has_colours};
use super::whole_number::whole_number;
use crate::spawn::PrivateDaemon;

/// Most boxes: a frame is compared with all pairs, one by one, which takes 0.4 s of 20,000.
const MOST_BOXES: u32 = 20_000;
/// Frames from one of parry3d's to the next. Its tree is brought up to date each time.
const FRAMES_A_PARRY: u64 = 5;
/// What is slow runs again after this many times what it took, so that the world does not halt.
const PAUSES: u32 = 20;
/// Time between two checked frames at least, and between two of the naive loop.
const CHECK_INTERVAL: Duration = Duration::from_millis(500);
/// Frames from one drawing to the next: terminals show no more.
const FRAMES_A_DRAWING: u64 = 2;
const LINE_INTERVAL: Duration = Duration::from_secs(1);
/// Columns and rows of `--picture`.
const PICTURE: Rect = Rect::new(0, 0, 104, 30);
const SEED: u64 = 1;

/// Show falling boxes, their pairs, and what a frame takes here and elsewhere
#[derive(Debug, Args)]
#[command(after_help = "\
Starts a daemon of its own, lets boxes fall on a platform, and asks the daemon for the overlapping pairs of
every frame, which push the boxes apart. Beside that it measures a naive loop and parry3d's tree on the same
boxes, each on one thread, and checks samples of the frames against all pairs, compared one by one. Halfway it
kills the daemon's worker: this process answers until the next worker serves. No GPU is needed.

It draws on a terminal (q ends it), and prints a line a second elsewhere, or where NO_COLOR is set.

Examples:
  pairmaskd demo
  pairmaskd demo --seconds 3 --boxes 10000
  pairmaskd demo --json
  pairmaskd demo --picture demo.svg
  pairmaskd demo --rerun demo.rrd && rerun demo.rrd

Exit status: 0 where every sample was right.")]
pub struct Demo {
    /// How long
    #[arg(long, value_parser = whole_number::<NonZeroU64>, value_name = "N", default_value = "10")]
    seconds: NonZeroU64,
    /// How many boxes, 20000 at most
    #[arg(long, value_parser = whole_number::<NonZeroU32>, value_name = "N", default_value = "4000")]
    boxes: NonZeroU32,
    /// Write the last picture here as SVG
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// Write every other frame here for the viewer Rerun, by its Python package (pip install rerun-sdk)
    #[arg(long, value_name = "FILE")]
    rerun: Option<PathBuf>,
    /// Print one JSON object; the lines of progress go to stderr
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    daemon: DaemonOptions,
}

impl Demo {
    pub fn run(&self, common: &CommonOptions) -> Result {
        if self.boxes.get() > MOST_BOXES {
            let what = format!(
                "--boxes must be at most {MOST_BOXES}, since all pairs are compared with each other too: \
                 `bench latency` measures more"
            );
            return Err(WrongUsage(what).into());
        }
        // By SIGINT and SIGTERM it ends early, with its summary.
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            signal_hook::flag::register(signal, Arc::clone(&stop))
                .map_err(|error| format!("installing signal handlers: {error}"))?;
        }
        // Messages about the worker that is killed, the session's and the daemon's, would go between the lines.
        log::set_max_level(log::max_level().min(log::LevelFilter::Error));
        let mut recording = self.rerun.as_deref().map(Recording::start).transpose()?;
        let daemon = PrivateDaemon::start_self_quietly(&self.daemon.private(common))?;
        let mut show = Show::new(self, &daemon)?;
        // The screen ends before anything else is printed.
        let mut display = Display::open(self.json)?;
        while show.figures.elapsed < show.figures.length && !stop.load(Ordering::Relaxed) {
            show.frame(&daemon)?;
            if let Some(recording) = &mut recording
                && show.figures.frames.is_multiple_of(FRAMES_A_DRAWING)
                && !recording.add(show.figures.frames, show.world.boxes(), &show.pairs)
            {
                break;
            }
            if display.update(&show)? {
                break;
            }
        }
        drop(display);
        recording.map_or(Ok(()), Recording::end)?;
        self.end(&show)
    }

    fn end(&self, show: &Show) -> Result {
        if let Some(path) = &self.picture {
            let svg = picture_of(&show.world, &show.figures);
            write_file(path, |file| file.write_all(svg.as_bytes()))?;
        }
        if self.json {
            return Ok(print_json(&show.figures.json())?);
        }
        print_text(&format!("{}\n\n{}", show.figures, next_steps()))?;
        Ok(())
    }
}

/// What to do next, with this program as it was called.
fn next_steps() -> String {
    let program = std::env::args().next().unwrap_or_else(|| "pairmaskd".to_owned());
    format!(
        "next\n  \
         {program} serve                   a daemon for your programs, until Ctrl-C\n  \
         {program} bench latency           what a frame takes on this machine, by stage\n  \
         {program} cull boxes.csv --pairs pairs.csv   the pairs of your own boxes"
    )
}

fn picture_of(world: &World, figures: &Figures) -> String {
    let mut buffer = Buffer::empty(PICTURE);
    drawing::draw(&mut buffer, world, figures);
    let label = format!(
        "pairmaskd demo: {} boxes fall on a platform, those in a pair lit up; this machine: {}",
        figures.boxes,
        figures.medians().machine()
    );
    picture::svg(&buffer, &label)
}

/// The world, who finds its pairs, and what that took.
struct Show {
    world: World,
    session: Session,
    parry: ParryTree,
    figures: Figures,
    start: Instant,
    naive_at: Instant,
    check_at: Instant,
    pairs: Vec<Pair>,
    pairs_of_peer: Vec<Pair>,
}

impl Show {
    fn new(demo: &Demo, daemon: &PrivateDaemon) -> Result<Self> {
        let n = demo.boxes.get() as usize;
        let world = World::new(n, SEED);
        // It falls back to this process while the worker is killed. One thread, as the others have.
        let session = daemon.session().backend(Backend::Auto).threads(1);
        let now = Instant::now();
        Ok(Self {
            session: session.connect()?,
            parry: ParryTree::new(world.boxes()),
            figures: Figures::new(n, Duration::from_secs(demo.seconds.get())),
            world,
            start: now,
            naive_at: now + CHECK_INTERVAL / 2,
            check_at: now,
            pairs: Vec::new(),
            pairs_of_peer: Vec::new(),
        })
    }

    fn frame(&mut self, daemon: &PrivateDaemon) -> Result {
        self.kill_halfway(daemon)?;
        self.world.step();
        self.find()?;
        self.measure_peers();
        if Instant::now() >= self.check_at {
            let (took, checked) = timed(|| self.check());
            checked?;
            self.check_at = Instant::now() + CHECK_INTERVAL.max(took * PAUSES);
        }
        self.world.push_apart(&self.pairs);
        self.figures.elapsed = self.start.elapsed();
        Ok(())
    }

    fn find(&mut self) -> Result {
        let boxes = self.world.boxes();
        let begun = Instant::now();
        let mut frame = self.session.frame(boxes.len())?;
        frame.boxes_mut().copy_from_slice(boxes);
        let mask = frame.submit()?.wait()?;
        self.pairs.clear();
        self.pairs.extend(mask.pairs());
        let (took, info) = (begun.elapsed(), mask.info());
        let in_process = info.served_by == ServedBy::InProcess;
        self.figures.note_frame(mask.count(), took, info.engine, in_process);
        Ok(())
    }

    fn measure_peers(&mut self) {
        let (boxes, pairs) = (self.world.boxes(), &mut self.pairs_of_peer);
        if self.figures.frames.is_multiple_of(FRAMES_A_PARRY) {
            let (took, ()) = timed(|| self.parry.find(boxes, pairs));
            self.figures.parry.record(took.as_nanos() as u64);
        }
        if Instant::now() >= self.naive_at {
            let (took, ()) = timed(|| naive(boxes, pairs));
            self.figures.naive.record(took.as_nanos() as u64);
            self.naive_at = Instant::now() + CHECK_INTERVAL.max(took * PAUSES);
        }
    }

    /// Compares the pairs of this frame with the truth.
    fn check(&mut self) -> Result {
        self.pairs.sort_unstable();
        check_pairs(&self.pairs, &truth(self.world.boxes()).pairs).map_err(|bad| {
            format!("frame {} is wrong: {bad}: please report this", self.figures.frames)
        })?;
        self.figures.checked += 1;
        Ok(())
    }

    fn kill_halfway(&mut self, daemon: &PrivateDaemon) -> Result {
        let at = self.start.elapsed();
        if self.figures.kill != Kill::Ahead || at < self.figures.length / 2 {
            return Ok(());
        }
        let record = daemon.record();
        let worker =
            record.and_then(|record| Pid::from_raw(i32::try_from(record.worker_pid).ok()?));
        if let Some(worker) = worker {
            kill_process(worker, Signal::KILL)
                .map_err(|error| format!("killing the demo's own worker: {error}"))?;
            self.figures.kill = Kill::Done { at };
        }
        Ok(())
    }
}

fn timed<T>(work: impl FnOnce() -> T) -> (Duration, T) {
    let begun = Instant::now();
    let done = work();
    (begun.elapsed(), done)
}

/// Where the demo is seen, and when its next frame begins.
struct Display {
    screen: Option<Screen>,
    to_stderr: bool,
    next_frame: Instant,
    next_line: Instant,
}

impl Display {
    fn open(json: bool) -> Result<Self> {
        let draws = !json && can_draw() && has_colours();
        let screen = draws.then(Screen::open).transpose().map_err(OutputError::Io)?;
        let now = Instant::now();
        Ok(Self { screen, to_stderr: json, next_frame: now, next_line: now + LINE_INTERVAL })
    }

    /// Shows a frame and waits for the next one. Returns whether the user quits.
    fn update(&mut self, show: &Show) -> Result<bool> {
        // Frames that were missed are not caught up with.
        self.next_frame = (self.next_frame + Duration::from_secs_f32(STEP)).max(Instant::now());
        if let Some(screen) = &mut self.screen {
            if show.figures.frames.is_multiple_of(FRAMES_A_DRAWING) {
                let (world, figures) = (&show.world, &show.figures);
                let draw = screen.draw(|frame| drawing::draw(frame.buffer_mut(), world, figures));
                draw.map_err(OutputError::Io)?;
            }
            loop {
                match screen.wait(self.next_frame).map_err(OutputError::Io)? {
                    Waited::Due => return Ok(false),
                    Waited::Stop => return Ok(true),
                    Waited::Key(key) if is_quit(key) => return Ok(true),
                    Waited::Key(_) | Waited::Other => {}
                }
            }
        }
        let now = Instant::now();
        if now >= self.next_line {
            self.next_line = now + LINE_INTERVAL;
            let line = show.figures.line();
            if self.to_stderr { print_aside(&line) } else { print_text(&line)? }
        }
        std::thread::sleep(self.next_frame.saturating_duration_since(Instant::now()));
        Ok(false)
    }
}

/// Whether a key ends the demo: q, Escape or Ctrl-C, which is a key here.
fn is_quit(key: KeyEvent) -> bool {
    let is_its = match key.code {
        KeyCode::Char('q') | KeyCode::Esc => true,
        KeyCode::Char('c') => key.modifiers.contains(KeyModifiers::CONTROL),
        _ => false,
    };
    is_its && key.kind != KeyEventKind::Release
}
