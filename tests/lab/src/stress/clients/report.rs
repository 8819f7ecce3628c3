//! What a run with clients adds to the report.

use std::fmt;

use serde::Serialize;

use super::daemon::DaemonReport;
use super::protocol::Counts;

/// The field `clients` of `stress --json`. Fields may be added, never changed or taken away.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ClientsReport {
    /// Client processes at a time.
    pub count: u64,
    /// Sessions that they opened.
    pub sessions: u64,
    /// Frames that they sent.
    pub frames: u64,
    /// Edits of scenes that persist, which they sent.
    pub edits: u64,
    /// Frames and edits whose answers they dropped unread.
    pub unread: u64,
    /// Answers of a client's own process, because the daemon gave none. They are compared, too.
    pub in_process: u64,
    /// Frames without an answer within 30 s.
    pub unanswered: u64,
    /// Clients that were killed with SIGKILL, and started again.
    pub killed: u64,
    /// Clients that ended by themselves before they were told to, or not at all: why, one each.
    pub broken: Vec<String>,
    /// The daemon at the end.
    pub daemon: DaemonReport,
}

impl ClientsReport {
    pub(super) const fn new(
        count: u64,
        counts: &Counts,
        killed: u64,
        broken: Vec<String>,
        daemon: DaemonReport,
    ) -> Self {
        let Counts { frames, edits, unread, in_process, unanswered, sessions, .. } = *counts;
        Self {
            count,
            sessions,
            frames,
            edits,
            unread,
            in_process,
            unanswered,
            killed,
            broken,
            daemon,
        }
    }

    /// Frames that did not get their answer from the daemon.
    pub const fn lost(&self) -> u64 {
        self.in_process + self.unanswered
    }

    /// Whether no frame was lost, no client broke, and the daemon serves on and found no wrong pair.
    pub fn is_clean(&self) -> bool {
        let DaemonReport { serves, was_restarted, audit, .. } = &self.daemon;
        let is_audit_clean = audit.is_none_or(|audit| audit.wrong() == 0);
        let is_daemon_clean = *serves && !was_restarted && is_audit_clean;
        self.lost() == 0 && self.broken.is_empty() && is_daemon_clean
    }
}

impl fmt::Display for ClientsReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { count, sessions, frames, edits, unread, in_process, unanswered, killed, .. } =
            self;
        for why in &self.broken {
            writeln!(f, "BROKEN CLIENT: {why}")?;
        }
        writeln!(
            f,
            "{count} clients, {sessions} sessions, {killed} killed; {frames} frames, {edits} edits of scenes, {unread} left unread"
        )?;
        writeln!(f, "lost: {unanswered} without an answer, {in_process} answered in process")?;
        let DaemonReport { serves, was_restarted, frames, errors, audit } = &self.daemon;
        let serves = if *serves { "serves" } else { "DOES NOT SERVE" };
        let restarted = if *was_restarted { ", WAS RESTARTED" } else { "" };
        write!(f, "daemon: {serves}{restarted}, {frames} frames, {errors} errors; ")?;
        match audit {
            None => f.write_str("no audit"),
            Some(audit) => write!(
                f,
                "audit of {} frames ({} skipped), {} pairs: {} missed, {} extra",
                audit.frames, audit.skipped, audit.pairs, audit.missed, audit.extra
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::daemon::AuditReport;
    use super::*;

    fn clean() -> ClientsReport {
        let audit = AuditReport { frames: 9, skipped: 0, pairs: 5, missed: 0, extra: 0 };
        let daemon = DaemonReport {
            serves: true,
            was_restarted: false,
            frames: 9,
            errors: 0,
            audit: Some(audit),
        };
        ClientsReport::new(2, &Counts::default(), 3, Vec::new(), daemon)
    }

    #[test]
    fn whatever_is_lost_wrong_or_broken_is_not_clean() {
        assert!(clean().is_clean());
        let spoils: [fn(&mut ClientsReport); 7] = [
            |report| report.in_process = 1,
            |report| report.unanswered = 1,
            |report| report.broken.push("it died".to_owned()),
            |report| report.daemon.serves = false,
            |report| report.daemon.was_restarted = true,
            |report| report.daemon.audit.as_mut().expect("audited").missed = 1,
            |report| report.daemon.audit.as_mut().expect("audited").extra = 1,
        ];
        for (index, spoil) in spoils.into_iter().enumerate() {
            let mut report = clean();
            spoil(&mut report);
            assert!(!report.is_clean(), "{index}: {report}");
        }
    }
}
