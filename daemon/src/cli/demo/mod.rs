//! `demo`: a daemon process, this process as its client with falling boxes, and figures while they run.

mod display;

use std::num::{NonZeroU32, NonZeroU64};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use pairmask::{Backend, ServedBy, Session};
use pairmask_core::Aabb;
use pairmask_core::oracle::check::check_pairs;
use pairmask_core::oracle::truth;

use self::display::Display;
use super::options::{CommonOptions, DaemonOptions};
use super::program::Result;
use super::whole_number::whole_number;
use crate::scene::{Scene, SceneName};
use crate::spawn::PrivateDaemon;

/// Time between two checked frames. A check of all pairs of 10,000 boxes takes 0.1 s.
const CHECK_INTERVAL: Duration = Duration::from_millis(500);

/// Run a daemon and a client with falling boxes for a while
#[derive(Debug, Args)]
#[command(after_help = "\
Starts a daemon of its own, lets boxes fall, and asks the daemon for the overlapping pairs of every
frame. Samples are checked against all pairs, compared one by one. No GPU is needed.

Examples:
  pairmaskd demo
  pairmaskd demo --seconds 3 --boxes 10000

Exit status: 0 where every sample was right.")]
pub struct Demo {
    /// How long
    #[arg(long, value_parser = whole_number::<NonZeroU64>, value_name = "N", default_value = "10")]
    seconds: NonZeroU64,
    /// How many boxes
    #[arg(long, value_parser = whole_number::<NonZeroU32>, value_name = "N", default_value = "2000")]
    boxes: NonZeroU32,
    #[command(flatten)]
    daemon: DaemonOptions,
}

impl Demo {
    pub fn run(&self, common: &CommonOptions) -> Result {
        // By Ctrl-C and SIGTERM it ends early, with its summary.
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
            signal_hook::flag::register(signal, Arc::clone(&stop))
                .map_err(|error| format!("installing signal handlers: {error}"))?;
        }
        let daemon = PrivateDaemon::start_self(&self.daemon.private(common))?;
        // It falls back to this process if the daemon is killed.
        let mut session = daemon.session().backend(Backend::Auto).connect()?;
        let mut scene = Scene::new(SceneName::Cubes, self.boxes.get() as usize, 1);
        let (mut display, mut check_at) = (Display::new(), Instant::now());
        let duration = Duration::from_secs(self.seconds.get());
        while display.elapsed() < duration && !stop.load(Ordering::Relaxed) {
            scene.step();
            let is_checked = Instant::now() >= check_at;
            run_frame(&mut session, scene.boxes(), &mut display, is_checked)?;
            if is_checked {
                check_at = Instant::now() + CHECK_INTERVAL;
            }
            display.update()?;
        }
        Ok(display.end()?)
    }
}

/// Finds the pairs of a frame. One that is checked and wrong is an error.
fn run_frame(
    session: &mut Session,
    boxes: &[Aabb],
    display: &mut Display,
    is_checked: bool,
) -> Result {
    let mut frame = session.frame(boxes.len())?;
    frame.boxes_mut().copy_from_slice(boxes);
    let submitted = Instant::now();
    let mask = frame.submit()?.wait()?;
    let (round_trip, info) = (submitted.elapsed(), mask.info());
    let in_process = info.served_by == ServedBy::InProcess;
    display.note_frame(mask.count(), round_trip, info.engine, in_process);
    if is_checked {
        let mut pairs = mask.to_vec();
        pairs.sort_unstable();
        check_pairs(&pairs, &truth(boxes).pairs).map_err(|bad| {
            format!("frame {} is wrong: {bad}: please report this", display.frames())
        })?;
        display.note_check();
    }
    Ok(())
}
