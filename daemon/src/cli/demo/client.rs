//! The demo's client process: a closed loop of world and daemon.

use std::process::Child;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clap::Args;
use pairmask::{Backend, ServedBy, Session};
use pairmask_core::Aabb;
use rustix::process::{Pid, Signal, kill_process, set_parent_process_death_signal};

use super::check::{self, BadPair};
use super::display::{Display, Progress};
use super::world::World;
use super::{DemoError, DemoOptions, stop_flag};
use crate::cli::config::Config;
use crate::cli::options::Place;

/// Time between two checked frames. A check of all pairs of 10,000 boxes takes 0.1 s.
const CHECK_INTERVAL: Duration = Duration::from_millis(500);

/// The client process of `demo`.
#[derive(Debug, Args)]
pub struct DemoClient {
    #[command(flatten)]
    options: DemoOptions,
}

/// Asks a client to end early.
pub(super) fn ask_to_stop(client: &Child) {
    if let Some(pid) = i32::try_from(client.id()).ok().and_then(Pid::from_raw) {
        // Sending fails if the client has just ended, which is what is wanted.
        let _ = kill_process(pid, Signal::TERM);
    }
}

impl DemoClient {
    /// Runs frames until the demo's time is over.
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), DemoError> {
        let stop = stop_flag()?;
        // If the demo's process is killed, this process has to end with it.
        set_parent_process_death_signal(Some(Signal::KILL))
            .map_err(|errno| DemoError::system("binding to the demo")(errno.into()))?;
        let mut session = connect(place, config)?;
        let mut world = World::new(self.options.boxes.get());
        let mut display = Display::new();
        let mut progress = Progress::new();
        let mut check_at = Instant::now();
        while progress.elapsed() < self.options.duration() && !stop.load(Ordering::Relaxed) {
            let is_checked = Instant::now() >= check_at;
            let sampled = run_frame(&mut session, &mut world, &mut progress, is_checked)?;
            if is_checked {
                progress.note_check(sampled);
                check_at = Instant::now() + CHECK_INTERVAL;
            }
            display.update(&mut progress)?;
        }
        display.summary(&progress)?;
        progress.verdict()
    }
}

/// A session that starts with the daemon, and falls back to this process if the daemon is killed.
fn connect(place: &Place, config: &Config) -> Result<Session, DemoError> {
    let builder = || {
        Session::builder()
            .runtime_dir(place.runtime_dir(config))
            .instance(place.instance(config).as_str())
    };
    drop(builder().backend(Backend::Daemon).connect()?);
    Ok(builder().backend(Backend::Auto).connect()?)
}

/// Runs one frame. Returns its first wrong pair if the frame is checked.
fn run_frame(
    session: &mut Session,
    world: &mut World,
    progress: &mut Progress,
    is_checked: bool,
) -> Result<Option<BadPair>, DemoError> {
    let mut frame = session.frame(world.len())?;
    world.write_boxes(frame.boxes_mut());
    let sample: Option<Vec<Aabb>> = is_checked.then(|| frame.boxes().to_vec());
    let submitted = Instant::now();
    let mask = frame.submit()?.wait()?;
    let round_trip = submitted.elapsed();
    let in_process = mask.info().served_by == ServedBy::InProcess;
    progress.note_frame(mask.count(), round_trip, mask.info().engine, in_process);
    world.step(mask.pairs());
    Ok(sample.and_then(|boxes| check::first_bad_pair(&boxes, mask.to_vec())))
}
