//! The probe: one client that stays for the whole soak and times its frames, as a game would send them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{JoinHandle, sleep};
use std::time::{Duration, Instant};

use pairmask::{Backend, SessionBuilder};
use pairmaskd::cli::bench::SEED;
use pairmaskd::percentiles::Recorder;
use pairmaskd::precision::PrecisionChoice;
use pairmaskd::scene::{Scene, SceneName};
use pairmaskd::timed_client::{Decoding, TimedClient};
use serde::Serialize;

use crate::Result;

const BOXES: usize = 1_000;
/// 60 Hz.
const PERIOD: Duration = Duration::from_nanos(16_666_667);
/// A frame without an answer for this long is lost, as those of the other clients are.
const DEADLINE: Duration = Duration::from_secs(30);
/// Pause before it connects again, after a lost frame.
const RETRY_INTERVAL: Duration = Duration::from_millis(100);

/// What became of frames since the last look.
#[derive(Debug, Default)]
pub(crate) struct Probed {
    pub(crate) latency: Recorder,
    pub(crate) frames: u64,
    pub(crate) lost: u64,
    /// Why the last one was lost.
    pub(crate) why: Option<String>,
}

/// The field `probe` of the JSON: all frames of the run.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub(crate) struct ProbeReport {
    pub(crate) frames: u64,
    pub(crate) lost: u64,
    pub(crate) why: Option<String>,
}

impl ProbeReport {
    pub(crate) fn add(&mut self, probed: Probed) {
        self.frames += probed.frames;
        self.lost += probed.lost;
        self.why = probed.why.or(self.why.take());
    }
}

#[derive(Debug)]
pub(crate) struct Probe {
    probed: Arc<Mutex<Probed>>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Probe {
    pub(crate) fn start(daemon: SessionBuilder) -> std::io::Result<Self> {
        let (probed, is_over) = (Arc::new(Mutex::default()), Arc::new(AtomicBool::new(false)));
        let (counts, ends) = (Arc::clone(&probed), Arc::clone(&is_over));
        let daemon = daemon.backend(Backend::Daemon).deadline(DEADLINE);
        let work = move || {
            while !ends.load(Ordering::Relaxed) {
                if let Err(error) = frames(&daemon, &ends, &counts) {
                    with(&counts, |probed| {
                        probed.lost += 1;
                        probed.why = Some(error.to_string());
                    });
                    sleep(RETRY_INTERVAL);
                }
            }
        };
        let thread = std::thread::Builder::new().name("probe".into()).spawn(work)?;
        Ok(Self { probed, is_over, thread: Some(thread) })
    }

    pub(crate) fn take(&self) -> Probed {
        with(&self.probed, std::mem::take)
    }
}

impl Drop for Probe {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of it has been printed, and its last frame is missing.
            let _ = thread.join();
        }
    }
}

fn with<T>(probed: &Mutex<Probed>, work: impl FnOnce(&mut Probed) -> T) -> T {
    work(&mut probed.lock().unwrap_or_else(PoisonError::into_inner))
}

/// Sends frames through one session until the end, or until one is lost.
fn frames(daemon: &SessionBuilder, ends: &AtomicBool, probed: &Mutex<Probed>) -> Result<()> {
    let mut scene = Scene::new(SceneName::Uniform, BOXES, SEED);
    let session = daemon.clone().connect()?;
    let mut client = TimedClient::new(session, PrecisionChoice::Exact, scene.boxes());
    let decoding = Decoding::default();
    let mut due = Instant::now();
    while !ends.load(Ordering::Relaxed) {
        // After a stall the frames that are behind are left out.
        due = Instant::now().max(due + PERIOD);
        sleep(due.saturating_duration_since(Instant::now()));
        scene.step();
        let times = client.frame(scene.boxes(), &decoding, |_| ())?;
        let latency = times.fill + times.round_trip + times.decode;
        with(probed, |probed| {
            probed.frames += 1;
            probed.latency.record(latency.as_nanos() as u64);
        });
    }
    Ok(())
}
