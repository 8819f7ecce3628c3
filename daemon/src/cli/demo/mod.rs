//! `demo`: a daemon process, a client process with falling boxes, and figures while they run.

mod display;
mod world;

use std::num::{NonZeroU32, NonZeroU64};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use pairmask::{Backend, ServedBy, Session};
use pairmask_core::Aabb;
use pairmask_core::oracle::check::{Mismatch, check_pairs};
use pairmask_core::oracle::truth;
use rustix::process::{Pid, Signal, kill_process, set_parent_process_death_signal};

use self::display::{Display, Progress};
use self::world::World;
use super::options::{DaemonOptions, Place};
use super::program::{ClientFailed, Fault, Result};
use super::whole_number::whole_number;
use crate::spawn::{PrivateDaemon, own_binary};

/// A client that still runs this long after its time counts as hanging.
const PATIENCE: Duration = Duration::from_secs(60);
/// Time between two checks whether the client has ended.
const LOOK_INTERVAL: Duration = Duration::from_millis(20);

/// Run a daemon and a client with falling boxes for a while
#[derive(Debug, Args)]
#[command(after_help = "\
Starts a daemon of its own and a client process. The client lets boxes fall, asks the daemon for
the overlapping pairs of every frame, and pushes those boxes apart. Samples are checked against
all pairs, compared one by one. No GPU is needed.

Examples:
  pairmaskd demo
  pairmaskd demo --seconds 3 --boxes 10000

Exit status: 0 where every sample was right.")]
pub struct Demo {
    #[command(flatten)]
    options: DemoOptions,
    #[command(flatten)]
    daemon: DaemonOptions,
}

/// What the demo shows.
#[derive(Clone, Copy, Debug, Args)]
pub struct DemoOptions {
    /// How long
    #[arg(long, value_parser = whole_number::<NonZeroU64>, value_name = "N", default_value = "10")]
    seconds: NonZeroU64,
    /// How many boxes
    #[arg(long, value_parser = whole_number::<NonZeroU32>, value_name = "N", default_value = "2000")]
    boxes: NonZeroU32,
}

impl DemoOptions {
    const fn duration(&self) -> Duration {
        Duration::from_secs(self.seconds.get())
    }
}

/// An error of the system, and what was done.
fn while_at(step: &str) -> impl FnOnce(std::io::Error) -> Fault {
    move |error| format!("{step}: {error}").into()
}

impl Demo {
    pub fn run(&self, place: &Place) -> Result {
        let stop = stop_flag()?;
        let daemon = PrivateDaemon::start_self(&self.daemon.private(place))?;
        let client = self.start_client(&daemon)?;
        let status = wait_for(client, self.options.duration() + PATIENCE, &stop)?;
        if status.success() { Ok(()) } else { Err(ClientFailed(status).into()) }
    }

    fn start_client(&self, daemon: &PrivateDaemon) -> Result<Child> {
        let DemoOptions { seconds, boxes } = &self.options;
        Command::new(own_binary()?)
            .args(["demo-client", "--seconds", &seconds.to_string()])
            .args(["--boxes", &boxes.to_string()])
            .args(["--instance", daemon.instance().as_str()])
            .arg("--runtime-dir")
            .arg(daemon.dir().path())
            .stdin(Stdio::null())
            .spawn()
            .map_err(while_at("starting the client process"))
    }
}

/// A flag that Ctrl-C and SIGTERM set: the demo then ends early, with its summary.
fn stop_flag() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(while_at("installing signal handlers"))?;
    }
    Ok(stop)
}

/// Waits for the client's end. Passes on a request to stop, and kills a client that hangs.
fn wait_for(mut client: Child, patience: Duration, stop: &AtomicBool) -> Result<ExitStatus> {
    let watching = "watching the client process";
    let deadline = Instant::now() + patience;
    let mut reported = false;
    while Instant::now() < deadline {
        if let Some(status) = client.try_wait().map_err(while_at(watching))? {
            return Ok(status);
        }
        if stop.load(Ordering::Relaxed) && !std::mem::replace(&mut reported, true) {
            ask_to_stop(&client);
        }
        std::thread::sleep(LOOK_INTERVAL);
    }
    client.kill().and_then(|()| client.wait()).map_err(while_at(watching))?;
    Err(format!("the client process was not done {PATIENCE:?} after its time").into())
}

/// Time between two checked frames. A check of all pairs of 10,000 boxes takes 0.1 s.
const CHECK_INTERVAL: Duration = Duration::from_millis(500);

/// The client process of `demo`.
#[derive(Debug, Args)]
pub struct DemoClient {
    #[command(flatten)]
    options: DemoOptions,
}

fn ask_to_stop(client: &Child) {
    if let Some(pid) = i32::try_from(client.id()).ok().and_then(Pid::from_raw) {
        // Sending fails if the client has just ended, which is what is wanted.
        let _ = kill_process(pid, Signal::TERM);
    }
}

impl DemoClient {
    pub fn run(&self, place: &Place) -> Result {
        let stop = stop_flag()?;
        // If the demo's process is killed, this process has to end with it.
        set_parent_process_death_signal(Some(Signal::KILL))
            .map_err(|errno| while_at("binding to the demo")(errno.into()))?;
        let mut session = connect(place)?;
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
        Ok(progress.verdict()?)
    }
}

/// A session that starts with the daemon, and falls back to this process if the daemon is killed.
fn connect(place: &Place) -> Result<Session> {
    let builder =
        || Session::builder().runtime_dir(place.runtime_dir()).instance(place.instance().as_str());
    drop(builder().backend(Backend::Daemon).connect()?);
    Ok(builder().backend(Backend::Auto).connect()?)
}

/// Runs one frame. Returns its first wrong pair if the frame is checked.
fn run_frame(
    session: &mut Session,
    world: &mut World,
    progress: &mut Progress,
    is_checked: bool,
) -> Result<Option<Mismatch>> {
    let mut frame = session.frame(world.len())?;
    world.write_boxes(frame.boxes_mut());
    let sample: Option<Vec<Aabb>> = is_checked.then(|| frame.boxes().to_vec());
    let submitted = Instant::now();
    let mask = frame.submit()?.wait()?;
    let round_trip = submitted.elapsed();
    let in_process = mask.info().served_by == ServedBy::InProcess;
    progress.note_frame(mask.count(), round_trip, mask.info().engine, in_process);
    world.step(mask.pairs());
    let check = |boxes: Vec<Aabb>| {
        let mut pairs = mask.to_vec();
        pairs.sort_unstable();
        check_pairs(&pairs, &truth(&boxes).pairs).err()
    };
    Ok(sample.and_then(check))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Scene, SceneName};

    #[test]
    fn notices_one_pair_too_few_or_too_many() {
        let right = truth(Scene::new(SceneName::Uniform, 345, 7).boxes()).pairs;
        assert!(right.len() > 100, "{} pairs", right.len());
        assert_eq!(check_pairs(&right, &right), Ok(()));
        for (at, pair) in right.iter().enumerate() {
            let (mut less, mut twice) = (right.clone(), right.clone());
            less.remove(at);
            twice.insert(at, *pair);
            assert_eq!(check_pairs(&less, &right), Err(Mismatch::Missing(*pair)));
            assert_eq!(check_pairs(&twice, &right), Err(Mismatch::Extra(*pair)));
        }
    }
}
