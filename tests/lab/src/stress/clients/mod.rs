//! The same hard scenes through a daemon: frames of several client processes at a time.
//!
//! Each client is a process, because the daemon shares its time by process. Its seed gives its frames again, but not
//! when they meet those of others: a failure's replay command sends its case many times, among others. The transport
//! loses a place of 128 with each port that goes while the daemon has not received its requests, and its server panics
//! when the last one is lost: the daemon's supervisor starts another worker, and such a run ends as failed.

mod client;
mod crowd;
mod offer;
mod scene_client;

pub use client::{ClientSettings, Counts, Pace};
pub(crate) use crowd::{Crowd, ENDS_WITHIN};

use std::fmt;
use std::num::NonZeroU16;
use std::time::{Duration, Instant};

use pairmask::{Aabb, Backend, Error, ServedBy, Session, SessionBuilder};
use pairmask_core::engine::{EngineChoice, EngineName};
use pairmask_transport::Limits;
use pairmask_wire::StatusBody;
use serde::Serialize;

use self::client::{DEADLINE, FailedFrame, MOST_SESSIONS};
use self::offer::Offer;
use super::Case;
use super::report::{Failure, StressReport};
use crate::Result;
use crate::processes::Daemon;

/// Slots for sessions beside those of the living clients: a killed one's are free after about a second.
const SPARE_SLOTS: usize = 32;
const TICK: Duration = Duration::from_millis(50);

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
        let Counts { sessions, frames, edits, queries, unread, in_process, unanswered } =
            &self.counts;
        for why in &self.broken {
            writeln!(f, "BROKEN CLIENT: {why}")?;
        }
        write!(f, "{count} clients, {sessions} sessions, {killed} killed; ")?;
        writeln!(
            f,
            "{frames} frames, {edits} edits of scenes, {queries} queries, {unread} left unread"
        )?;
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
    /// Lost or wrong answers after which the run ends.
    pub most_failures: usize,
    /// The command that runs a case again, without the case.
    pub replay: String,
}

impl ClientsRun {
    /// Runs the clients. `turn` is called every few milliseconds, with the time since they began: it may start clients,
    /// kill them and ask them to end.
    pub(crate) fn run(
        &self,
        mut turn: impl FnMut(&mut Crowd<'_>, Duration) -> Result<()>,
    ) -> Result<StressReport> {
        let start = Instant::now();
        let look = Look::before(&self.daemon.session())?;
        let settings = ClientSettings { with_gpu: look.has_gpu, ..self.settings.clone() };
        let offer = Offer::new(&settings.requested, look.has_gpu);
        if offer.is_empty() {
            return Err("nothing to ask the daemon for: spheres and scenes go with --mode exact only, and engines \
                        of the GPU need a daemon that has one"
                .into());
        }
        let mut crowd = Crowd::new(&self.daemon, settings, self.clients.get().into());
        for _ in 0..self.clients.get() {
            crowd.start()?;
        }
        let began = Instant::now();
        while began.elapsed() < self.time
            && crowd.failed.len() < self.most_failures
            && !crowd.is_empty()
        {
            crowd.listen(TICK);
            turn(&mut crowd, began.elapsed())?;
        }
        crowd.end_all();
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
