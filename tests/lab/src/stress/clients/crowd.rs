//! The clients of a run: who is there, and what they have reported.

use std::collections::BTreeMap;
use std::io;
use std::ops::Range;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use pairmaskd::scene::Random;

use super::ClientsReport;
use super::client::{ClientSettings, DEADLINE, FailedFrame, Said};
use crate::processes::{Daemon, Work, Worker};

/// A client that has not ended this long after it was asked to hangs: it waits for a few frames first.
pub(crate) const ENDS_WITHIN: Duration = DEADLINE.saturating_add(Duration::from_secs(30));
const BETWEEN_KILLS_MS: Range<u64> = 200..1_500;

pub(crate) struct Crowd<'a> {
    daemon: &'a Daemon,
    random: Random,
    settings: ClientSettings,
    received: Sender<(u64, Option<Said>)>,
    ears: Receiver<(u64, Option<Said>)>,
    /// The clients by number, and whether each has said its last words.
    clients: BTreeMap<u64, (Worker, bool)>,
    started: u64,
    next_kill: Instant,
    pub(super) failed: Vec<FailedFrame>,
    pub(super) cases: u64,
    pub(super) answers: u64,
    pub(super) report: ClientsReport,
}

impl<'a> Crowd<'a> {
    pub(super) fn new(daemon: &'a Daemon, settings: ClientSettings, count: u64) -> Self {
        let (received, ears) = channel();
        let mut random = Random::new(settings.seed);
        Self {
            daemon,
            next_kill: Instant::now() + between_kills(&mut random),
            random,
            settings,
            received,
            ears,
            clients: BTreeMap::new(),
            started: 0,
            failed: Vec::new(),
            cases: 0,
            answers: 0,
            report: ClientsReport { count, ..ClientsReport::default() },
        }
    }

    pub(crate) fn start(&mut self) -> io::Result<()> {
        let settings = ClientSettings { seed: self.random.bits(), ..self.settings.clone() };
        let (number, received) = (self.started, self.received.clone());
        self.started += 1;
        // Nobody reads what a client reports after the run.
        let receive = move |said| drop(received.send((number, said)));
        let worker = self.daemon.start(&Work::Stress(settings), receive)?;
        self.clients.insert(number, (worker, false));
        Ok(())
    }

    pub(crate) const fn answers(&self) -> u64 {
        self.answers
    }

    pub(super) fn is_empty(&self) -> bool {
        self.clients.is_empty()
    }

    pub(crate) fn numbers(&self) -> Vec<u64> {
        self.clients.keys().copied().collect()
    }

    pub(crate) fn listen(&mut self, within: Duration) {
        if let Ok((number, said)) = self.ears.recv_timeout(within) {
            self.note(number, said);
        }
    }

    /// Kills a client, wherever it is, with SIGKILL.
    pub(crate) fn kill(&mut self, number: u64) {
        self.report.killed += u64::from(self.clients.remove(&number).is_some());
    }

    /// Now and then kills one of them, and starts another one.
    pub(crate) fn kill_at_times(&mut self) -> io::Result<()> {
        if Instant::now() < self.next_kill {
            return Ok(());
        }
        let which = self.random.below(self.clients.len().max(1) as u64) as usize;
        if let Some(number) = self.clients.keys().nth(which).copied() {
            self.kill(number);
        }
        self.next_kill = Instant::now() + between_kills(&mut self.random);
        self.start()
    }

    /// Asks a client to end.
    pub(crate) fn end(&mut self, number: u64) {
        if let Some((worker, _)) = self.clients.get_mut(&number) {
            worker.end();
        }
    }

    /// Kills a client that hangs.
    pub(crate) fn give_up(&mut self, number: u64) {
        self.clients.remove(&number);
        self.report.broken.push(format!("client {number} does not end when it is asked to"));
    }

    pub(super) fn end_all(&mut self) {
        self.numbers().into_iter().for_each(|number| self.end(number));
        let deadline = Instant::now() + ENDS_WITHIN;
        while !self.clients.is_empty() && Instant::now() < deadline {
            self.listen(deadline.saturating_duration_since(Instant::now()));
        }
        self.numbers().into_iter().for_each(|number| self.give_up(number));
    }

    fn note(&mut self, number: u64, said: Option<Said>) {
        // One that was killed is no longer among the clients.
        match said {
            Some(Said::Counted([cases, answers], counts)) => {
                self.cases += cases;
                self.answers += answers;
                self.report.counts.add(&counts);
            }
            Some(Said::Failed(failed)) => self.failed.push(*failed),
            Some(Said::Ended(why)) => {
                if let Some((_, has_ended)) = self.clients.get_mut(&number) {
                    *has_ended = true;
                    let why = why.map(|why| format!("client {number}: {why}"));
                    self.report.broken.extend(why);
                }
            }
            None => {
                if let Some((_, false)) = self.clients.remove(&number) {
                    self.report.broken.push(format!("client {number}: it died"));
                }
            }
        }
    }
}

fn between_kills(random: &mut Random) -> Duration {
    let Range { start, end } = BETWEEN_KILLS_MS;
    Duration::from_millis(start + random.below(end - start))
}
