//! One client of a load: a process with a session of its own.

use std::io::BufRead;
use std::num::{NonZeroU32, NonZeroUsize};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::Args;
use pairmask::Backend;
use pairmask_core::BoxCount;
use pairmask_core::spinner::Spinner;
use rustix::process::{Signal, set_parent_process_death_signal};

use super::asked::Rate;
use super::protocol::{self, Said};
use super::schedule::Schedule;
use crate::cli::bench::latency::{BenchError, SEED, Wait, threads_of};
use crate::cli::bench::measured::{Figures, Measured};
use crate::cli::config::Config;
use crate::cli::options::{CullFlags, Place};
use crate::cli::output::print_text;
use crate::cli::raw_objects::RawBoxes;
use crate::cli::target::DEADLINE;
use crate::cli::whole_number::whole_number;
use crate::precision::PrecisionChoice;
use crate::scene::{Scene, SceneName};
use crate::timed_client::TimedClient;

/// A paced client is awake this long before a frame is due: a sleeping thread wakes up to 0.1 ms late
/// on a virtual machine, and a game that has just moved its boxes is awake.
const AWAKE_BEFORE: Duration = Duration::from_micros(300);

/// A client process of `bench latency`.
#[derive(Debug, Args)]
pub struct BenchClient {
    #[command(flatten)]
    options: CullFlags,
    /// Boxes of a uniform scene.
    #[arg(long, value_parser = whole_number::<u32>)]
    n: u32,
    /// File of boxes instead.
    #[arg(long)]
    scene: Option<PathBuf>,
    /// Which of the clients this is: each has a scene of its own.
    #[arg(long, value_parser = whole_number::<u32>)]
    index: u32,
    #[arg(long)]
    rate: Rate,
    #[arg(long)]
    precision: PrecisionChoice,
    #[arg(long)]
    wait: Wait,
    #[arg(long, value_parser = whole_number::<NonZeroUsize>)]
    decode_threads: NonZeroUsize,
    /// Time before the first recorded frame, ms.
    #[arg(long, value_parser = whole_number::<u32>)]
    warm_up_ms: u32,
    /// Time of recorded frames.
    #[arg(long, value_parser = whole_number::<NonZeroU32>)]
    seconds: NonZeroU32,
}

impl BenchClient {
    /// Connects, says so, waits for the start, measures, tells the figures, and stays connected until
    /// stdin ends. A failure is told to the parent, which says why the measurement failed.
    ///
    /// # Errors
    /// [`BenchError`] where the parent cannot be told.
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), BenchError> {
        // Without its parent a client has nobody to tell.
        set_parent_process_death_signal(Some(Signal::KILL)).map_err(protocol::lost)?;
        let said = match self.measure(place, config) {
            Ok(Some(figures)) => Said::Done(Box::new(figures)),
            Ok(None) => return Ok(()),
            Err(error) => Said::Failed(error.to_string()),
        };
        tell(&said)?;
        wait_for_parent()?;
        Ok(())
    }

    /// `None` where the parent gave up before the start.
    fn measure(&self, place: &Place, config: &Config) -> Result<Option<Figures>, BenchError> {
        let mut scene = self.scene()?;
        let n = u32::try_from(scene.boxes().len()).unwrap_or(u32::MAX);
        let session = self
            .options
            .session(place, config)
            .runtime_dir(place.runtime_dir(config))
            .instance(place.instance(config).as_str())
            .backend(self.options.backend(config, Backend::Daemon))
            .spin(self.wait.spin())
            .deadline(DEADLINE)
            .capacity(BoxCount::new(n))
            .visit_threads(self.decode_threads.get())
            .connect()?;
        let mut decoding = threads_of(self.decode_threads)?;
        let mut client = TimedClient::new(session, self.precision, scene.boxes());
        // The backend of this frame has to serve all frames. It touches all memory too.
        let first = client.frame_decoded(scene.boxes(), &mut decoding, |_| ())?;
        let mut measured = Measured::of(&first.info);
        tell(&Said::Ready)?;
        if !wait_for_parent()? {
            return Ok(None);
        }
        let start = Instant::now();
        let from = start + Duration::from_millis(self.warm_up_ms.into());
        let until = from + Duration::from_secs(self.seconds.get().into());
        let mut turns = Turns::new(self.rate, start);
        let mut last_done = from;
        loop {
            scene.step();
            let turn = turns.next();
            if turn.begins >= until {
                break;
            }
            let times = client.frame_decoded(scene.boxes(), &mut decoding, |_| ())?;
            let done = Instant::now();
            if turn.begins >= from {
                measured.record(&times)?;
                last_done = done;
                if turn.is_due {
                    measured.record_due(done.saturating_duration_since(turn.begins), turn.is_late);
                }
            }
        }
        // A client whose frames take longer than the measurement counts to the end of its last one.
        let elapsed = (until - from).max(last_done - from);
        if measured.is_empty() {
            return Err(BenchError::NoFrame { seconds: self.seconds });
        }
        Ok(Some(Figures::of(measured, elapsed)))
    }

    fn scene(&self) -> Result<Scene, BenchError> {
        let seed = SEED + u64::from(self.index);
        Ok(match &self.scene {
            Some(path) => Scene::from_boxes(RawBoxes::open(path)?.read()?, seed),
            None => Scene::new(SceneName::Uniform, self.n as usize, seed),
        })
    }
}

/// Whose turn it is: in a closed loop always the next frame's, else from its due time on.
enum Turns {
    Closed,
    Paced(Schedule),
}

/// A frame that may begin now.
struct Turn {
    /// When it was due; now in a closed loop.
    begins: Instant,
    is_due: bool,
    is_late: bool,
}

impl Turns {
    const fn new(rate: Rate, start: Instant) -> Self {
        match rate {
            Rate::Closed => Self::Closed,
            Rate::Paced(rate) => Self::Paced(Schedule::new(start, rate)),
        }
    }

    /// Waits for the next turn.
    fn next(&mut self) -> Turn {
        match self {
            Self::Closed => Turn { begins: Instant::now(), is_due: false, is_late: false },
            Self::Paced(schedule) => {
                let due = schedule.next(Instant::now());
                await_time(due.at);
                Turn { begins: due.at, is_due: true, is_late: due.is_late }
            }
        }
    }
}

/// Sleeps until shortly before `at`, then spins.
fn await_time(at: Instant) {
    let left = at.saturating_duration_since(Instant::now());
    if let Some(nap) = left.checked_sub(AWAKE_BEFORE) {
        std::thread::sleep(nap);
    }
    let mut spinner = Spinner::default();
    while Instant::now() < at {
        spinner.turn();
    }
}

fn tell(said: &Said) -> Result<(), BenchError> {
    Ok(print_text(&serde_json::to_string(said).map_err(protocol::lost)?)?)
}

/// Waits for a line of the parent; `false` where it has closed the pipe.
fn wait_for_parent() -> Result<bool, BenchError> {
    let mut line = String::new();
    Ok(std::io::stdin().lock().read_line(&mut line).map_err(protocol::lost)? > 0)
}
