//! What a client process tells the process that started it: a line of JSON each.

use serde::{Deserialize, Serialize};

use super::frame::CaseId;
use super::offer::Asked;
use crate::stress::subject::Finding;

/// A line from a client.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) enum Said {
    /// What it did since it last told.
    Counted(Counts),
    /// An answer was wrong, or did not come from the daemon.
    Failed(Box<FailedFrame>),
    /// Its last words.
    Ended(Ended),
}

/// How a client ended.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) enum Ended {
    /// As it was told to, or after it has told of many failures.
    Done,
    /// It could not go on, and why.
    GaveUp(String),
}

impl Said {
    /// The line.
    pub(super) fn line(&self) -> String {
        // Numbers, texts and enums: they always become JSON.
        serde_json::to_string(self).unwrap_or_default()
    }

    /// The contents of a line; `None` for another text, such as the half line of a killed client.
    pub(super) fn parse(line: &str) -> Option<Self> {
        serde_json::from_str(line).ok()
    }
}

/// What clients did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Counts {
    /// Scenes that were drawn.
    pub(super) cases: u64,
    /// Frames that were sent.
    pub(super) frames: u64,
    /// Edits of scenes that were sent.
    pub(super) edits: u64,
    /// Answers that were compared.
    pub(super) answers: u64,
    /// Frames and edits that were dropped unread.
    pub(super) unread: u64,
    /// Answers of the client's own process, because the daemon gave none.
    pub(super) in_process: u64,
    /// Frames without an answer within the deadline.
    pub(super) unanswered: u64,
    /// Sessions that were opened.
    pub(super) sessions: u64,
}

impl Counts {
    /// Adds those of another client, or of a later time.
    pub(super) const fn add(&mut self, other: &Self) {
        self.cases += other.cases;
        self.frames += other.frames;
        self.edits += other.edits;
        self.answers += other.answers;
        self.unread += other.unread;
        self.in_process += other.in_process;
        self.unanswered += other.unanswered;
        self.sessions += other.sessions;
    }
}

/// A frame or an edit that did not get its pairs from the daemon.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct FailedFrame {
    /// The case.
    pub(super) case: CaseId,
    /// What it asked for.
    pub(super) asked: Asked,
    /// What its session asked for, in words.
    pub(super) way: String,
    /// The mistake.
    pub(super) finding: Finding,
}
