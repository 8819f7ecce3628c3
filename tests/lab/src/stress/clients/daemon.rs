//! The daemon of a run, as a session sees it: its counts, and whether it still serves.

use std::time::{Duration, Instant};

use pairmask::{Aabb, Backend, ServedBy, Session, SessionBuilder, StatusError};
use pairmask_core::engine::{EngineChoice, EngineName};
use pairmask_wire::StatusBody;
use serde::Serialize;

use super::client::DEADLINE;

/// The auditor's counts are final when they have not changed for this long: it has the lowest priority, and
/// beside busy threads a check of 10 ms takes half a second and more.
const SETTLED: Duration = Duration::from_secs(1);
/// Longest wait for that.
const SETTLES_WITHIN: Duration = Duration::from_secs(10);

/// What the daemon says of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DaemonReport {
    pub serves: bool,
    pub was_restarted: bool,
    pub frames: u64,
    pub errors: u64,
    pub audit: Option<AuditReport>,
}

/// The auditor's counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct AuditReport {
    pub frames: u64,
    pub skipped: u64,
    pub pairs: u64,
    pub missed: u64,
    pub extra: u64,
}

/// Looks at a daemon before and after a run.
#[derive(Debug)]
pub(super) struct Look {
    daemon: SessionBuilder,
    before: StatusBody,
    /// Whether it answers with the simplest engine of the GPU.
    pub(super) has_gpu: bool,
}

impl Look {
    /// Looks at a daemon before a run.
    pub(super) fn before(daemon: &SessionBuilder) -> Result<Self, StatusError> {
        let daemon = daemon.clone().backend(Backend::Daemon).deadline(DEADLINE);
        let engine = EngineChoice::Only(EngineName::GpuBrute);
        let has_gpu = answers(&mut daemon.clone().engine(engine).connect()?);
        let before = daemon.clone().connect()?.daemon_status()?;
        Ok(Self { daemon, before, has_gpu })
    }

    /// Looks at it again. One that does not answer serves no more.
    pub(super) fn after(&self) -> DaemonReport {
        let Some((mut session, now)) = self.settled() else { return DaemonReport::default() };
        let was_restarted = now.pid != self.before.pid;
        let before = if was_restarted { StatusBody::default() } else { self.before };
        let (then, audit) = (before.audit, now.audit);
        DaemonReport {
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
        }
    }

    /// The status once the auditor has nothing to do any more, and a session.
    fn settled(&self) -> Option<(Session, StatusBody)> {
        let mut session = self.daemon.clone().connect().ok()?;
        let mut status = session.daemon_status().ok()?;
        let deadline = Instant::now() + SETTLES_WITHIN;
        loop {
            std::thread::sleep(SETTLED);
            let later = session.daemon_status().ok()?;
            if later.audit == status.audit || Instant::now() >= deadline {
                return Some((session, later));
            }
            status = later;
        }
    }
}

/// Whether the daemon finds the three pairs of three boxes.
fn answers(session: &mut Session) -> bool {
    let mut ask = || {
        let mut frame = session.frame(3).ok()?;
        frame.boxes_mut().fill(Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]));
        let mask = frame.submit().ok()?.wait().ok()?;
        let mut pairs = mask.to_vec();
        pairs.sort_unstable();
        Some(pairs == [(0, 1), (0, 2), (1, 2)] && mask.info().served_by == ServedBy::Daemon)
    };
    ask().unwrap_or(false)
}
