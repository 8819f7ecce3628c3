//! The same hard scenes through a daemon: frames of several client processes at a time.
//!
//! Each client is a process, because the daemon shares its time by process. Its seed gives its frames again, but not
//! when they meet those of others: a failure's replay command sends its case many times, among others. The transport
//! loses a place of 128 with each port that goes while the daemon has not received its requests, and its server panics
//! when the last one is lost: the daemon's supervisor starts another worker, and such a run ends as failed.

mod client;
mod offer;
mod scene_client;

pub use client::{ClientSettings, Counts};

use std::collections::BTreeMap;
use std::num::NonZeroU16;
use std::ops::Range;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};
use std::{fmt, io};

use pairmask::{Aabb, Backend, Error, ServedBy, Session, SessionBuilder};
use pairmask_core::engine::{EngineChoice, EngineName};
use pairmask_transport::Limits;
use pairmask_wire::StatusBody;
use pairmaskd::scene::Random;
use serde::Serialize;

use self::client::{DEADLINE, FailedFrame, MOST_SESSIONS, Said};
use self::offer::Offer;
use super::report::{Failure, StressReport};
use super::{Case, MOST_FAILURES};
use crate::Result;
use crate::processes::{Daemon, Work, Worker};

/// Slots for sessions beside those of the living clients: a killed one's are free after about a second.
const SPARE_SLOTS: usize = 32;
const BETWEEN_KILLS_MS: Range<u64> = 200..1_500;
const TICK: Duration = Duration::from_millis(50);
/// A client that has not ended this long after it was asked to hangs: it waits for a few frames first.
const ENDS_WITHIN: Duration = DEADLINE.saturating_add(Duration::from_secs(30));

pub fn limits(clients: NonZeroU16) -> Limits {
    let default = Limits::default();
    let needed = usize::from(clients.get()) * MOST_SESSIONS as usize + SPARE_SLOTS;
    Limits { max_clients: default.max_clients.max(needed), ..default }
}

/// The field `clients` of `stress --json`. Fields may be added, never changed or taken away.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct ClientsReport {
    pub count: u64,
    #[serde(flatten)]
    pub counts: Counts,
    pub killed: u64,
    pub broken: Vec<String>,
    pub daemon: DaemonReport,
}

impl ClientsReport {
    /// Whether no frame was lost, no client broke, and the daemon serves on and found no wrong pair.
    pub fn is_clean(&self) -> bool {
        let DaemonReport { serves, was_restarted, audit, .. } = &self.daemon;
        let is_audit_clean = audit.is_none_or(|audit| audit.missed + audit.extra == 0);
        let is_daemon_clean = *serves && !was_restarted && is_audit_clean;
        let lost = self.counts.in_process + self.counts.unanswered;
        lost == 0 && self.broken.is_empty() && is_daemon_clean
    }
}

impl fmt::Display for ClientsReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { count, killed, .. } = self;
        let Counts { sessions, frames, edits, unread, in_process, unanswered, .. } = &self.counts;
        for why in &self.broken {
            writeln!(f, "BROKEN CLIENT: {why}")?;
        }
        write!(f, "{count} clients, {sessions} sessions, {killed} killed; ")?;
        writeln!(f, "{frames} frames, {edits} edits of scenes, {unread} left unread")?;
        writeln!(f, "lost: {unanswered} without an answer, {in_process} answered in process")?;
        let DaemonReport { serves, was_restarted, frames, errors, audit } = &self.daemon;
        let serves = if *serves { "serves" } else { "DOES NOT SERVE" };
        let restarted = if *was_restarted { ", WAS RESTARTED" } else { "" };
        write!(f, "daemon: {serves}{restarted}, {frames} frames, {errors} errors; ")?;
        match audit {
            None => f.write_str("no audit"),
            Some(AuditReport { frames, skipped, pairs, missed, extra }) => write!(
                f,
                "audit of {frames} frames ({skipped} skipped), {pairs} pairs: {missed} missed, {extra} extra"
            ),
        }
    }
}

#[derive(Clone, Debug)]
pub struct ClientsRun {
    pub clients: NonZeroU16,
    pub daemon: Daemon,
    /// Those of the run; each client has a seed of its own.
    pub settings: ClientSettings,
    pub time: Duration,
    /// The command that runs a case again, without the case.
    pub replay: String,
}

impl ClientsRun {
    pub fn run(&self, mut watch: impl FnMut(u64, Duration)) -> Result<StressReport> {
        let start = Instant::now();
        let look = Look::before(&self.daemon.session())?;
        let settings = ClientSettings { with_gpu: look.has_gpu, ..self.settings.clone() };
        let offer = Offer::new(&settings.requested, look.has_gpu);
        if offer.is_empty() {
            return Err("nothing to ask the daemon for: spheres and scenes go with --mode exact only, and engines \
                        of the GPU need a daemon that has one"
                .into());
        }
        let (received, ears) = channel();
        let mut crowd = Crowd {
            daemon: &self.daemon,
            random: Random::new(settings.seed),
            settings,
            received,
            ears,
            clients: BTreeMap::new(),
            started: 0,
            failed: Vec::new(),
            cases: 0,
            answers: 0,
            report: ClientsReport { count: self.clients.get().into(), ..ClientsReport::default() },
        };
        for _ in 0..self.clients.get() {
            crowd.start()?;
        }
        let began = Instant::now();
        let pause = |random: &mut Random| {
            let Range { start, end } = BETWEEN_KILLS_MS;
            Duration::from_millis(start + random.below(end - start))
        };
        let mut next_kill = began + pause(&mut crowd.random);
        while began.elapsed() < self.time
            && crowd.failed.len() < MOST_FAILURES
            && !crowd.clients.is_empty()
        {
            if let Ok((number, said)) = crowd.ears.recv_timeout(TICK) {
                crowd.note(number, said);
            }
            watch(crowd.answers, began.elapsed());
            if self.settings.is_abrupt && Instant::now() >= next_kill {
                // One of them, wherever it is, with SIGKILL.
                let which = crowd.random.below(crowd.clients.len().max(1) as u64) as usize;
                if let Some(number) = crowd.clients.keys().nth(which).copied() {
                    crowd.clients.remove(&number);
                }
                crowd.report.killed += 1;
                crowd.start()?;
                next_kill = Instant::now() + pause(&mut crowd.random);
            }
        }
        crowd.clients.values_mut().for_each(|(worker, _)| worker.end());
        let deadline = Instant::now() + ENDS_WITHIN;
        while !crowd.clients.is_empty() {
            let left = deadline.saturating_duration_since(Instant::now());
            let Ok((number, said)) = crowd.ears.recv_timeout(left) else { break };
            crowd.note(number, said);
        }
        for (number, _) in std::mem::take(&mut crowd.clients) {
            crowd.report.broken.push(format!("client {number} does not end when it is asked to"));
        }
        let Crowd { failed, report: mut clients, cases, answers, .. } = crowd;
        clients.daemon = look.after().unwrap_or_default();
        let seed = self.settings.case.unwrap_or(self.settings.seed);
        let mut report = StressReport { cases, answers, ..StressReport::new(seed, offer.names()) };
        report.elapsed_ns = start.elapsed().as_nanos() as u64;
        report.clients = Some(clients);
        for FailedFrame { seed, is_large, form, way, finding } in failed {
            let subject = format!("{form} through the daemon: {way}");
            let replay = format!("{} --case {seed}", self.replay);
            let case = Case::of_size(seed, is_large);
            report.fail(Failure::new(&case, form, subject, replay, finding));
        }
        Ok(report)
    }
}

struct Crowd<'a> {
    daemon: &'a Daemon,
    random: Random,
    settings: ClientSettings,
    received: Sender<(u64, Option<Said>)>,
    ears: Receiver<(u64, Option<Said>)>,
    /// The clients by number, and whether each has said its last words.
    clients: BTreeMap<u64, (Worker, bool)>,
    started: u64,
    failed: Vec<FailedFrame>,
    cases: u64,
    answers: u64,
    report: ClientsReport,
}

impl Crowd<'_> {
    fn start(&mut self) -> io::Result<()> {
        let settings = ClientSettings { seed: self.random.bits(), ..self.settings.clone() };
        let (number, received) = (self.started, self.received.clone());
        self.started += 1;
        // Nobody reads what a client reports after the run.
        let receive = move |said| drop(received.send((number, said)));
        let worker = self.daemon.start(&Work::Stress(settings), receive)?;
        self.clients.insert(number, (worker, false));
        Ok(())
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

/// The auditor's counts are final when they have not changed for this long: it has the lowest priority, and
/// beside busy threads a check of 10 ms takes half a second and more.
const SETTLED: Duration = Duration::from_secs(1);
const SETTLES_WITHIN: Duration = Duration::from_secs(10);

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DaemonReport {
    pub serves: bool,
    pub was_restarted: bool,
    pub frames: u64,
    pub errors: u64,
    pub audit: Option<AuditReport>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct AuditReport {
    pub frames: u64,
    pub skipped: u64,
    pub pairs: u64,
    pub missed: u64,
    pub extra: u64,
}

#[derive(Debug)]
struct Look {
    daemon: SessionBuilder,
    before: StatusBody,
    /// Whether it answers with the simplest engine of the GPU.
    has_gpu: bool,
}

impl Look {
    fn before(daemon: &SessionBuilder) -> Result<Self, Error> {
        let daemon = daemon.clone().backend(Backend::Daemon).deadline(DEADLINE);
        let engine = EngineChoice::Only(EngineName::GpuBrute);
        let has_gpu = answers(&mut daemon.clone().engine(engine).connect()?);
        let before = daemon.clone().connect()?.daemon_status()?;
        Ok(Self { daemon, before, has_gpu })
    }

    /// Looks at it again, once the auditor has nothing to do any more. `None` where it does not answer.
    fn after(&self) -> Option<DaemonReport> {
        let mut session = self.daemon.clone().connect().ok()?;
        let mut now = session.daemon_status().ok()?;
        let deadline = Instant::now() + SETTLES_WITHIN;
        loop {
            std::thread::sleep(SETTLED);
            let earlier = std::mem::replace(&mut now, session.daemon_status().ok()?);
            if earlier.audit == now.audit || Instant::now() >= deadline {
                break;
            }
        }
        let was_restarted = now.pid != self.before.pid;
        let before = if was_restarted { StatusBody::default() } else { self.before };
        let (then, audit) = (before.audit, now.audit);
        Some(DaemonReport {
            serves: answers(&mut session),
            was_restarted,
            frames: now.frames - before.frames,
            errors: now.errors - before.errors,
            audit: (audit.one_in > 0).then(|| AuditReport {
                frames: audit.frames - then.frames,
                skipped: audit.skipped - then.skipped,
                pairs: audit.pairs - then.pairs,
                missed: audit.missed - then.missed,
                extra: audit.extra - then.extra,
            }),
        })
    }
}

fn answers(session: &mut Session) -> bool {
    let mut ask = || {
        let mut frame = session.frame(3)?;
        frame.boxes_mut().fill(Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]));
        frame.submit()?.wait()
    };
    ask().is_ok_and(|mask| {
        let mut pairs = mask.to_vec();
        pairs.sort_unstable();
        pairs == [[0, 1], [0, 2], [1, 2]] && mask.info().served_by == ServedBy::Daemon
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lost_wrong_or_broken_answer_is_not_clean() {
        let audit = Some(AuditReport { frames: 9, ..AuditReport::default() });
        let daemon = DaemonReport { serves: true, audit, ..DaemonReport::default() };
        let clean = ClientsReport { killed: 3, daemon, ..ClientsReport::default() };
        assert!(clean.is_clean());
        let spoils: [fn(&mut ClientsReport); 7] = [
            |report| report.counts.in_process = 1,
            |report| report.counts.unanswered = 1,
            |report| report.broken.push("it died".to_owned()),
            |report| report.daemon.serves = false,
            |report| report.daemon.was_restarted = true,
            |report| report.daemon.audit.as_mut().expect("audited").missed = 1,
            |report| report.daemon.audit.as_mut().expect("audited").extra = 1,
        ];
        for (index, spoil) in spoils.into_iter().enumerate() {
            let mut report = clean.clone();
            spoil(&mut report);
            assert!(!report.is_clean(), "{index}: {report}");
        }
    }
}
