//! Answers of a scene whose boxes have margins: the scene's own, or what this process knows.

use std::fmt;

use pairmask_core::scene::{SceneCopy, Told, Want};

use super::super::answer::{EndedList, PairList, Source};
use super::super::{PendingAnswer, SceneAnswer};
use super::pairs::{Exact, Near, Pairs};
use crate::session::ServedBy;
use crate::session::error::CommitError;

/// An edit under way. Dropped, it is applied, and its answer counts as never given.
#[must_use = "an edit is answered when it is waited for"]
pub struct PendingMargined<'s> {
    /// `None` where no request was made.
    pending: Option<PendingAnswer<'s, 's>>,
    pairs: &'s mut Pairs,
    now: &'s SceneCopy,
    want: Want,
    threads: Option<usize>,
}

impl fmt::Debug for PendingMargined<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PendingMargined")
            .field("want", &self.want)
            .field("pending", &self.pending)
            .finish_non_exhaustive()
    }
}

impl<'s> PendingMargined<'s> {
    pub(super) const fn new(
        pending: Option<PendingAnswer<'s, 's>>,
        pairs: &'s mut Pairs,
        now: &'s SceneCopy,
        want: Want,
        threads: Option<usize>,
    ) -> Self {
        Self { pending, pairs, now, want, threads }
    }

    /// Waits for the answer, as long as the session's deadline allows.
    ///
    /// # Errors
    /// [`CommitError`]. The edit is applied; the next answer makes up for this one.
    pub fn wait(self) -> Result<MarginedAnswer<'s>, CommitError> {
        let Self { pending, pairs, now, want, threads } = self;
        let answer = pending.map(PendingAnswer::wait).transpose()?;
        let served_by = answer.as_ref().map(SceneAnswer::served_by);
        let found = match pairs {
            Pairs::Exact(exact) => {
                // Taken at once: what this process knows of near pairs is the scene's history.
                if let Some(answer) = answer.map(SceneAnswer::take) {
                    exact.learn(&answer, now);
                }
                exact.tell(want, now, threads);
                Found::Exact(exact)
            }
            Pairs::Near(near) => {
                if let Some(answer) = answer {
                    Found::Scene(answer, near)
                } else {
                    near.tell_nothing(want);
                    Found::Same(near)
                }
            }
        };
        Ok(MarginedAnswer { want, served_by, found })
    }
}

/// Where an answer lies.
enum Found<'s> {
    /// With the scene: near pairs.
    Scene(SceneAnswer<'s>, &'s mut Near),
    /// Nothing has changed since the last taken answer.
    Same(&'s Near),
    Exact(&'s mut Exact),
}

/// The answer to an edit. All its lists are sorted: the bytes are the same whoever answered.
///
/// [`take`](Self::take) acknowledges it: the next changes are counted from it. An answer that is dropped
/// instead counts as never given, and the next one makes up for it.
///
/// A daemon's answer of near pairs holds one of the three places for frames until it is dropped; one of exact
/// pairs holds none.
#[must_use = "an answer that is not taken is told again"]
pub struct MarginedAnswer<'s> {
    want: Want,
    served_by: Option<ServedBy>,
    found: Found<'s>,
}

impl fmt::Debug for MarginedAnswer<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("MarginedAnswer")
            .field("want", &self.want)
            .field("begun", &self.begun().len())
            .field("ended", &self.ended().len())
            .field("pairs", &self.pairs().len())
            .finish_non_exhaustive()
    }
}

impl MarginedAnswer<'_> {
    /// Takes the answer: what it tells is known from now on.
    pub fn take(mut self) -> Self {
        match self.found {
            Found::Scene(answer, near) => {
                near.note_taken(&answer);
                self.found = Found::Scene(answer.take(), near);
            }
            Found::Exact(exact) => {
                exact.take();
                self.found = Found::Exact(exact);
            }
            Found::Same(_) => {}
        }
        self
    }

    /// Which answer was asked for.
    pub const fn want(&self) -> Want {
        self.want
    }

    /// Whether changes were asked for and [`pairs`](Self::pairs) holds all pairs instead: because those are
    /// fewer than the changes, or because it is not known any more what was told. The client forgets the
    /// pairs that it knows.
    pub fn is_resync(&self) -> bool {
        self.source().is_resync()
    }

    /// Pairs that began, for [`Want::Changes`].
    pub fn begun(&self) -> PairList<'_> {
        self.source().begun()
    }

    /// Pairs that ended, for [`Want::Changes`].
    pub fn ended(&self) -> EndedList<'_> {
        self.source().ended()
    }

    /// Pairs of now, for [`Want::All`], [`Want::Moved`] and a [resync](Self::is_resync).
    pub fn pairs(&self) -> PairList<'_> {
        self.source().pairs()
    }

    /// Pairs of the whole scene, if the answer knows: [`Want::Moved`] and [`Want::Nothing`] do not.
    pub fn pair_count(&self) -> Option<u64> {
        self.source().pair_count()
    }

    /// What answered the request that was made; `None` where none was needed.
    pub const fn served_by(&self) -> Option<ServedBy> {
        self.served_by
    }

    fn source(&self) -> Source<'_> {
        let told: &Told = match &self.found {
            Found::Scene(answer, _) => return answer.source(),
            Found::Same(near) => near.told(),
            Found::Exact(exact) => exact.told(),
        };
        Source::Here(told)
    }
}
