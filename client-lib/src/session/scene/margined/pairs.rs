//! What is known of the pairs that were told, and whether an edit needs a request.

use pairmask_core::scene::{Edit, ExactPairs, SceneCopy, Told, Want};

use super::super::SceneAnswer;
use super::MarginedPairs;

/// What is kept of the pairs.
#[derive(Debug)]
#[allow(clippy::large_enum_variant)] // One of each scene.
pub(super) enum Pairs {
    Near(Near),
    Exact(Exact),
}

/// Near pairs are told by the scene.
#[derive(Debug, Default)]
pub(super) struct Near {
    /// Whether there may be changes that were not taken.
    is_open: bool,
    /// Pairs at the last taken answer.
    pair_count: u64,
    /// An answer that needed no request.
    told: Told,
}

/// Exact pairs are told here.
#[derive(Debug, Default)]
pub(super) struct Exact {
    pairs: ExactPairs,
    /// Whether there may be near pairs that are not known here.
    is_behind: bool,
}

impl Pairs {
    pub fn new(pairs: MarginedPairs) -> Self {
        match pairs {
            MarginedPairs::Near => Self::Near(Near::default()),
            MarginedPairs::Exact => Self::Exact(Exact::default()),
        }
    }

    /// Whether boxes that did not leave their margin are to be sent too: a daemon tells pairs of the boxes that
    /// it is sent.
    pub fn needs_all(&self, want: Want) -> bool {
        matches!(self, Self::Near(_)) && want == Want::Moved
    }

    /// What is asked of the scene; `None` where no request is needed. `sends` says whether there is anything
    /// to send.
    pub fn ask(&self, want: Want, sends: bool) -> Option<Want> {
        match self {
            Self::Near(near) => {
                let tells = want == Want::All || (want == Want::Changes && near.is_open);
                (sends || tells).then_some(want)
            }
            Self::Exact(_) if want == Want::Nothing => sends.then_some(want),
            Self::Exact(exact) => (sends || exact.is_behind).then_some(Want::Changes),
        }
    }

    /// Notes an edit that the scene applies, before it is applied to the boxes of now.
    pub fn note(&mut self, edit: Edit<'_>, before: &SceneCopy, want: Want, sends: bool) {
        match self {
            Self::Near(near) => near.is_open |= sends,
            Self::Exact(exact) => {
                exact.is_behind |= sends;
                exact.pairs.note(edit, before, want);
            }
        }
    }

    pub fn allocated_bytes(&self) -> usize {
        match self {
            Self::Near(_) => 0,
            Self::Exact(exact) => exact.pairs.allocated_bytes(),
        }
    }
}

impl Near {
    pub const fn note_lost(&mut self) {
        self.is_open = true;
    }

    /// Tells that nothing has changed.
    pub fn tell_nothing(&mut self, want: Want) {
        self.told = Told::of_none(want, self.pair_count);
    }

    pub const fn told(&self) -> &Told {
        &self.told
    }

    /// Notes that an answer of the scene is taken.
    pub fn note_taken(&mut self, answer: &SceneAnswer<'_>) {
        if let (Want::Changes | Want::All, Some(count)) = (answer.want(), answer.pair_count()) {
            (self.is_open, self.pair_count) = (false, count);
        }
    }
}

impl Exact {
    /// Takes the near pairs that an answer of the scene tells.
    pub fn learn(&mut self, answer: &SceneAnswer<'_>, now: &SceneCopy) {
        if answer.want() != Want::Changes {
            return;
        }
        if answer.is_resync() {
            self.pairs.resync_near(answer.pairs(), now);
        } else {
            let ended = answer.ended().into_iter().map(|ended| ended.pair);
            self.pairs.change_near(answer.begun(), ended, now);
        }
        self.is_behind = false;
    }

    pub fn tell(&mut self, want: Want, now: &SceneCopy, threads: Option<usize>) {
        self.pairs.tell(want, now, threads);
    }

    pub const fn told(&self) -> &Told {
        self.pairs.told()
    }

    pub fn take(&mut self) {
        self.pairs.take();
    }

    pub fn lose(&mut self) {
        self.pairs.lose();
    }
}
