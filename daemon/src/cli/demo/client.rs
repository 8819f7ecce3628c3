//! The demo's client process: a closed loop of world and daemon.

use std::process::Child;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clap::Args;
use pairmask::{Aabb, Backend, ServedBy, Session};
use rustix::process::{Pid, Signal, kill_process, set_parent_process_death_signal};

use super::check::{self, BadPair};
use super::display::{Display, Progress};
use super::world::World;
use super::{DemoError, DemoOptions, stop_flag};
use crate::cli::config::Config;
use crate::cli::options::Place;

/// A frame is checked this often. All pairs of 10,000 boxes take 0.1 s.
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
        // It may just have ended: then there is nobody to tell.
        let _ = kill_process(pid, Signal::TERM);
    }
}

impl DemoClient {
    /// Runs frames until the time is over.
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), DemoError> {
        let stop = stop_flag()?;
        // Whoever started the demo may be killed; this process would go on unseen.
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

/// A session that falls back to this process, so that a daemon that is killed for fun does not end
/// the demo; but one that starts with the daemon.
fn connect(place: &Place, config: &Config) -> Result<Session, DemoError> {
    let builder = || {
        Session::builder()
            .runtime_dir(place.runtime_dir(config))
            .instance(place.instance(config).as_str())
    };
    drop(builder().backend(Backend::Daemon).connect()?);
    Ok(builder().backend(Backend::Auto).connect()?)
}

/// One frame; the first wrong pair of it where it is checked.
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
