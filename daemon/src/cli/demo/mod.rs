//! `demo`: a daemon process, a client process with falling boxes, and figures while they run.

mod check;
mod client;
mod display;
mod world;

use std::num::{NonZeroU32, NonZeroU64};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use pairmask::{ConnectError, FrameError, WaitError};

pub use self::client::DemoClient;
use super::config::Config;
use super::options::{DaemonOptions, Place};
use super::output::OutputError;
use super::whole_number::whole_number;
use crate::spawn::{PrivateDaemon, SpawnError, own_binary};

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

/// Why the demo failed.
#[derive(Debug, thiserror::Error)]
pub enum DemoError {
    #[error(transparent)]
    Spawn(#[from] SpawnError),
    /// The client process or the handler for Ctrl-C could not be set up.
    #[error("{step}: {source}")]
    System { step: &'static str, source: std::io::Error },
    /// The client failed and printed the reason.
    #[error("the client process failed ({status})")]
    Client { status: ExitStatus },
    /// The client did not end in time.
    #[error("the client process was not done {PATIENCE:?} after its time")]
    Hangs,
    /// A sample was wrong.
    #[error("{wrong} of {checked} sampled frames were wrong: please report this")]
    Wrong { wrong: u64, checked: u64 },
    #[error(transparent)]
    Connect(#[from] ConnectError),
    #[error(transparent)]
    Frame(#[from] FrameError),
    #[error(transparent)]
    Wait(#[from] WaitError),
    #[error(transparent)]
    Output(#[from] OutputError),
}

impl DemoError {
    fn system(step: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        move |source| Self::System { step, source }
    }
}

impl Demo {
    /// Starts both processes and waits for the client.
    pub fn run(&self, place: &Place, config: &Config) -> Result<(), DemoError> {
        let stop = stop_flag()?;
        let daemon = PrivateDaemon::start_self(&self.daemon.private(place, config))?;
        let client = self.start_client(&daemon)?;
        let status = wait_for(client, self.options.duration() + PATIENCE, &stop)?;
        if status.success() { Ok(()) } else { Err(DemoError::Client { status }) }
    }

    fn start_client(&self, daemon: &PrivateDaemon) -> Result<Child, DemoError> {
        let DemoOptions { seconds, boxes } = &self.options;
        Command::new(own_binary()?)
            .args(["demo-client", "--seconds", &seconds.to_string()])
            .args(["--boxes", &boxes.to_string()])
            .args(["--instance", daemon.instance().as_str()])
            .arg("--runtime-dir")
            .arg(daemon.dir().path())
            .stdin(Stdio::null())
            .spawn()
            .map_err(DemoError::system("starting the client process"))
    }
}

/// A flag that Ctrl-C and SIGTERM set: the demo then ends early, with its summary.
fn stop_flag() -> Result<Arc<AtomicBool>, DemoError> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(DemoError::system("installing signal handlers"))?;
    }
    Ok(stop)
}

/// Waits for the client's end. Passes on a request to stop, and kills a client that hangs.
fn wait_for(
    mut client: Child,
    patience: Duration,
    stop: &AtomicBool,
) -> Result<ExitStatus, DemoError> {
    let watching = "watching the client process";
    let deadline = Instant::now() + patience;
    let mut told = false;
    while Instant::now() < deadline {
        if let Some(status) = client.try_wait().map_err(DemoError::system(watching))? {
            return Ok(status);
        }
        if stop.load(Ordering::Relaxed) && !std::mem::replace(&mut told, true) {
            client::ask_to_stop(&client);
        }
        std::thread::sleep(LOOK_INTERVAL);
    }
    client.kill().and_then(|()| client.wait()).map_err(DemoError::system(watching))?;
    Err(DemoError::Hangs)
}
