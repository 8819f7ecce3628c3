//! Looks at a daemon while an answer of it is waited for: does it live, does it run, can it connect.

use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::liveness::{DaemonWatch, SILENT_AFTER, Stillness};

/// A waiting thread checks this often whether the daemon lives, and whether its response has come:
/// another thread of the session may have taken the wake-up.
pub const WAIT_SLICE: Duration = Duration::from_millis(2);
/// Time that counts between two looks at the daemon's heartbeat: more than a beat takes, and than a game
/// that looks once a frame. A client that was itself starved for longer knows no more of the daemon.
const LONGEST_LOOK: Duration = Duration::from_millis(25);

/// Looks at the daemon while a request is under way, from one wait for its answer to the next.
#[derive(Debug, Default)]
pub struct Vigil {
    heart: Option<Stillness>,
    look_at: Option<Instant>,
}

/// The daemon that a client waits for.
#[derive(Clone, Copy, Debug)]
pub struct Watched<'a> {
    /// Its worker.
    pub daemon: &'a DaemonWatch,
    /// Whether the client goes on without a daemon that does not run.
    pub leaves_silent: bool,
}

/// What a look at the daemon shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen {
    /// It runs, as far as one knows.
    Running,
    /// Its worker has died.
    Dead,
    /// Its heartbeat stands still, and the client goes on without it.
    Silent,
}

impl Vigil {
    /// Looks at the daemon once a slice, for a thread that comes by more often.
    pub fn look_at_times(&mut self, watched: &Watched<'_>) -> Seen {
        let now = Instant::now();
        if now < *self.look_at.get_or_insert(now + WAIT_SLICE) {
            return Seen::Running;
        }
        self.look(watched, now)
    }

    /// Looks at the daemon.
    pub fn look(&mut self, watched: &Watched<'_>, now: Instant) -> Seen {
        let Watched { daemon, leaves_silent } = *watched;
        self.look_at = Some(now + WAIT_SLICE);
        if !daemon.is_alive() {
            return Seen::Dead;
        }
        if !leaves_silent {
            return Seen::Running;
        }
        let beats = daemon.beats();
        let heart = self.heart.get_or_insert_with(|| Stillness::new(beats, now, LONGEST_LOOK));
        if heart.look(beats, now) < SILENT_AFTER { Seen::Running } else { Seen::Silent }
    }
}

/// A daemon that a session has left, because it did not answer.
#[derive(Debug)]
pub struct LeftDaemon {
    daemon: Arc<DaemonWatch>,
    /// Its beats at that time.
    beats: Option<u64>,
}

impl LeftDaemon {
    /// The daemon that is left now.
    pub fn new(daemon: &Arc<DaemonWatch>) -> Self {
        Self { daemon: Arc::clone(daemon), beats: daemon.beats() }
    }

    /// Whether its worker has died: another one may serve.
    pub fn has_ended(&self) -> bool {
        !self.daemon.is_alive()
    }

    /// Whether it has run since. One that counts no beats may have.
    pub fn has_run(&self) -> bool {
        let beats = self.daemon.beats();
        beats.is_none() || beats != self.beats
    }
}
