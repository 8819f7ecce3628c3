//! The same hard scenes through a daemon: frames of several client processes at a time.
//!
//! Each client is a process, because the daemon shares its time by process. From its seed it opens
//! sessions that ask for any engine, encoding and number of threads, sends scenes in any form (boxes,
//! spheres, precision modes), some thousands of boxes large, and compares the answers with the oracle. It
//! has several frames under way, reads them in any order, drops some unread, pauses, closes sessions and
//! opens others. Between its frames each session edits a scene that persists, whose answers are taken or
//! dropped by chance and compared with a model. On request clients are killed and started again, and close sessions with frames under
//! way. The transport loses a place of 128 with each port that goes while the daemon has not received
//! its requests, and its server panics when the last one is lost: the daemon's supervisor starts another
//! worker, and such a run ends as failed.
//!
//! A client's seed gives its frames again; the time at which they meet those of others is not given
//! again. So a failure's replay command sends its case many times, among others.
//!
//! ```text
//! offer      what clients may ask for, and what a session asks for        (pure)
//! steps      what a client does next                                      (pure)
//! frame      a case as a frame, and its answer against the oracle
//! kept_scene a scene that persists, edited towards cases, its answers against a model
//! client     one client: the process
//! protocol   what it tells
//! processes  all clients: started, killed, told to end
//! daemon     what the daemon says before and after
//! report     what this adds to the report
//! ```

mod client;
mod daemon;
mod frame;
mod kept_scene;
mod offer;
mod processes;
mod protocol;
mod report;
mod steps;

pub use client::ClientSettings;
pub use daemon::{AuditReport, DaemonReport};
pub use report::ClientsReport;

use std::io;
use std::num::NonZeroU16;
use std::process::Command;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use pairmask::{SessionBuilder, StatusError};
use pairmask_transport::Limits;
use pairmaskd::explain::Explanation;
use pairmaskd::scene::Random;

use self::client::{DEADLINE, MOST_SESSIONS};
use self::daemon::Look;
use self::offer::{Asked, Form, Offer};
use self::processes::{ClientProcess, Heard, Life};
use self::protocol::{Counts, Ended, FailedFrame, Said};
use super::modes::ModeChoice;
use super::report::{Failure, StressReport};
use super::roster::Entrant;
use super::{MOST_FAILURES, mode_subject};

/// Slots for sessions beside those of the living clients: slots of killed clients are free again after
/// about a second.
const SPARE_SLOTS: usize = 32;
/// Time between two kills, ms.
const BETWEEN_KILLS_MS: std::ops::Range<u64> = 200..1_500;
/// How often the time is looked at.
const TICK: Duration = Duration::from_millis(50);
/// A client that has not ended this long after it was told to hangs: it waits for a few frames first.
const ENDS_WITHIN: Duration = DEADLINE.saturating_add(Duration::from_secs(30));

/// The limits that a daemon needs for so many clients.
pub fn limits(clients: NonZeroU16) -> Limits {
    let default = Limits::default();
    let needed = usize::from(clients.get()) * MOST_SESSIONS as usize + SPARE_SLOTS;
    Limits { max_clients: default.max_clients.max(needed), ..default }
}

/// A run with clients.
#[derive(Clone, Debug)]
pub struct ClientsRun {
    /// Client processes at a time.
    pub clients: NonZeroU16,
    /// Whether they are killed now and then, and close sessions with frames under way.
    pub with_kills: bool,
    /// Determines the clients' seeds.
    pub seed: u64,
    /// A case that every second frame is of.
    pub case: Option<u64>,
    /// How long.
    pub time: Duration,
    /// What clients ask for: engines and spheres.
    pub entrants: Vec<Entrant>,
    /// Precision modes.
    pub modes: Vec<ModeChoice>,
    /// Most threads of a frame.
    pub threads: usize,
    /// The command that runs a case again, without the case.
    pub replay: String,
}

/// Why a run did not begin or could not go on.
#[derive(Debug, thiserror::Error)]
pub enum ClientsError {
    /// The daemon does not tell its status.
    #[error(transparent)]
    Status(#[from] StatusError),
    /// A client process cannot be started or killed.
    #[error("a client process cannot be started: {0}")]
    Process(#[from] io::Error),
    /// The flags leave nothing.
    #[error(
        "nothing to ask the daemon for: spheres go with --mode exact only, updates not through a \
         daemon, and engines of the GPU need a daemon that has one"
    )]
    NothingToAsk,
}

impl ClientsRun {
    /// Runs clients of the daemon that `daemon` connects to, for the time of the run. `command` makes the
    /// process of a client with these settings. `watch` is called now and then with the number of
    /// answers and the time since the start.
    ///
    /// # Errors
    /// [`ClientsError`]; no client is left then.
    pub fn run(
        &self,
        daemon: &SessionBuilder,
        command: impl Fn(&ClientSettings) -> Command,
        watch: impl FnMut(u64, Duration),
    ) -> Result<StressReport, ClientsError> {
        let start = Instant::now();
        let look = Look::before(daemon)?;
        let offer = Offer::new(&self.entrants, &self.modes, self.threads, look.has_gpu);
        if offer.is_empty() {
            return Err(ClientsError::NothingToAsk);
        }
        let (heard, ears) = channel();
        let mut crowd = Crowd {
            run: self,
            with_gpu: look.has_gpu,
            command,
            random: Random::new(self.seed),
            heard,
            ears,
            clients: Vec::new(),
            lives: 0,
            counts: Counts::default(),
            failed: Vec::new(),
            killed: 0,
            broken: Vec::new(),
        };
        crowd.work(watch)?;
        crowd.end();
        let Crowd { counts, failed, killed, broken, .. } = crowd;
        let clients =
            ClientsReport::new(self.clients.get().into(), &counts, killed, broken, look.after());
        Ok(StressReport {
            seed: self.case.unwrap_or(self.seed),
            subjects: offer.names(),
            cases: counts.cases,
            answers: counts.answers,
            skipped: Vec::new(),
            missed: failed.iter().map(|failed| failed.finding.missed).sum(),
            extra: failed.iter().map(|failed| failed.finding.extra).sum(),
            elapsed_ns: start.elapsed().as_nanos() as u64,
            failures: failed.iter().take(MOST_FAILURES).map(|f| self.failure(f)).collect(),
            clients: Some(clients),
        })
    }

    /// The failure as the report has it.
    fn failure(&self, failed: &FailedFrame) -> Failure {
        let FailedFrame { case: id, asked, way, finding } = failed;
        let case = id.case();
        let (boxes, scene) = match asked {
            Asked::Frame(Form::Boxes) | Asked::Edit => (case.boxes.len(), case.recipe.clone()),
            Asked::Frame(Form::Spheres) => (case.spheres().spheres.len(), "spheres".to_owned()),
            Asked::Frame(Form::Mode(usage)) => {
                (case.in_mode(*usage).given.len(), case.recipe.clone())
            }
        };
        let explain = finding.first.and_then(|(i, j)| match asked {
            Asked::Frame(Form::Boxes) => Explanation::of(&case.boxes, i, j).ok(),
            // Boxes of a scene lie where some edit has put them.
            Asked::Frame(Form::Spheres) | Asked::Edit => None,
            Asked::Frame(Form::Mode(usage)) => mode_subject::explain(case.in_mode(*usage), (i, j)),
        });
        Failure {
            case: id.seed,
            subject: format!("{asked} through the daemon: {way}"),
            mode: asked.mode().as_str(),
            replay: format!("{} --case {}", self.replay, id.seed),
            boxes: boxes as u64,
            scene,
            flags: case.flags.to_string(),
            what: finding.what.clone(),
            missed: finding.missed,
            extra: finding.extra,
            pair: finding.first.map(|(i, j)| [i, j]),
            explain,
        }
    }
}

/// The clients of a run at work.
struct Crowd<'a, C> {
    run: &'a ClientsRun,
    with_gpu: bool,
    command: C,
    random: Random,
    heard: Sender<(Life, Heard)>,
    ears: Receiver<(Life, Heard)>,
    clients: Vec<ClientProcess>,
    lives: u64,
    counts: Counts,
    failed: Vec<FailedFrame>,
    killed: u64,
    broken: Vec<String>,
}

impl<C: Fn(&ClientSettings) -> Command> Crowd<'_, C> {
    /// Starts the clients, and lets them work until the time is over or too much is wrong.
    fn work(&mut self, mut watch: impl FnMut(u64, Duration)) -> io::Result<()> {
        for client in 0..self.run.clients.get().into() {
            self.start(client)?;
        }
        let start = Instant::now();
        let mut next_kill = start + self.until_next_kill();
        while start.elapsed() < self.run.time
            && self.failed.len() < MOST_FAILURES
            && !self.clients.is_empty()
        {
            if let Ok((life, heard)) = self.ears.recv_timeout(TICK) {
                self.note(life, heard);
            }
            watch(self.counts.answers, start.elapsed());
            if self.run.with_kills && Instant::now() >= next_kill {
                self.kill_one()?;
                next_kill = Instant::now() + self.until_next_kill();
            }
        }
        Ok(())
    }

    /// Tells all clients to end, and hears them out.
    fn end(&mut self) {
        for client in &mut self.clients {
            client.end();
        }
        let deadline = Instant::now() + ENDS_WITHIN;
        while !self.clients.is_empty() {
            let left = deadline.saturating_duration_since(Instant::now());
            match self.ears.recv_timeout(left) {
                Ok((life, heard)) => self.note(life, heard),
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => break,
            }
        }
        for client in self.clients.drain(..) {
            let Life { client, .. } = client.life;
            self.broken.push(format!("client {client} does not end when it is told to"));
        }
    }

    fn start(&mut self, client: usize) -> io::Result<()> {
        let ClientsRun { case, entrants, modes, threads, with_kills, .. } = self.run;
        let settings = ClientSettings {
            seed: self.random.bits(),
            case: *case,
            entrants: entrants.clone(),
            modes: modes.clone(),
            threads: *threads,
            with_gpu: self.with_gpu,
            abrupt: *with_kills,
        };
        let life = Life { client, life: self.lives };
        self.lives += 1;
        let heard = self.heard.clone();
        self.clients.push(ClientProcess::start((self.command)(&settings), life, heard)?);
        Ok(())
    }

    fn until_next_kill(&mut self) -> Duration {
        let range = BETWEEN_KILLS_MS;
        Duration::from_millis(range.start + self.random.below(range.end - range.start))
    }

    fn kill_one(&mut self) -> io::Result<()> {
        let which = self.random.below(self.clients.len() as u64) as usize;
        let client = self.clients.swap_remove(which);
        let Life { client: number, .. } = client.life;
        client.kill()?;
        self.killed += 1;
        self.start(number)
    }

    fn note(&mut self, life: Life, heard: Heard) {
        let place = self.clients.iter().position(|client| client.life == life);
        match heard {
            Heard::Line(Said::Counted(counts)) => self.counts.add(&counts),
            Heard::Line(Said::Failed(failed)) => self.failed.push(*failed),
            Heard::Line(Said::Ended(how)) => {
                if let Some(place) = place {
                    self.clients[place].ended = Some(how);
                }
            }
            Heard::End => {
                // One that was killed is no longer among the clients.
                if let Some(place) = place {
                    let why = match &self.clients.swap_remove(place).ended {
                        Some(Ended::Done) => return,
                        Some(Ended::GaveUp(why)) => why.clone(),
                        None => "it died".to_owned(),
                    };
                    self.broken.push(format!("client {}: {why}", life.client));
                }
            }
        }
    }
}
