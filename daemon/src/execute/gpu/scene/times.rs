//! Where the time of an edit went.

use std::time::{Duration, Instant};

use crate::execute::gpu::frame::StepTime;

/// Time of an edit by its parts, for measurements.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EditTimes {
    /// The edit was checked, and the host's bits changed.
    pub check: Duration,
    /// It was brought to where the GPU sees it.
    pub upload: Duration,
    /// The layout was chosen, and blocks and recordings were made ready.
    pub plan: Duration,
    /// The GPU was asked and waited for.
    pub gpu: Duration,
    /// What it found was read and sorted.
    pub sort: Duration,
    /// Submissions.
    pub submissions: u32,
    /// Times of the stages of the last submission, if they are taken.
    pub stages: Vec<StepTime>,
}

impl EditTimes {
    /// All of it.
    pub fn total(&self) -> Duration {
        self.check + self.upload + self.plan + self.gpu + self.sort
    }
}

/// A clock that is read at the end of each part.
pub(super) struct Clock(Instant);

impl Clock {
    pub fn start() -> Self {
        Self(Instant::now())
    }

    /// Adds the time since the last lap to a part.
    pub fn lap(&mut self, part: &mut Duration) {
        let now = Instant::now();
        *part += now - self.0;
        self.0 = now;
    }
}
