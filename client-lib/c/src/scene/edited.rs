//! A scene with its edit under way, or answered. The answer borrows the scene, so that the two are kept in one
//! cell.

use pairmask::scene::{Ended, Sets, Step, Want};
use pairmask::{
    EngineId, MarginedAnswer, PairList, PendingAnswer, PendingMargined, PendingShared, SceneAnswer,
    SceneEdit, ServedBy, SharedAnswer, SharedEdit,
};
use self_cell::{MutBorrow, self_cell};

use super::draft::Given;
use super::{AnyScene, Edited};
use crate::code::PM_ERR_STATE;
use crate::failure::Failure;

/// An edit under way.
enum Pending<'s> {
    Plain(PendingAnswer<'s, 's>),
    Margined(PendingMargined<'s>),
    Shared(PendingShared<'s>),
}

/// The answer to an edit.
pub(super) enum Answer<'s> {
    Plain(SceneAnswer<'s>),
    Margined(MarginedAnswer<'s>),
    Shared(SharedAnswer<'s>),
}

/// What borrows the scene.
#[allow(clippy::large_enum_variant)] // One of each scene.
enum Borrower<'s> {
    Pending(Pending<'s>),
    Answer(Answer<'s>),
    /// An edit whose wait has failed.
    Nothing,
}

self_cell!(
    struct Cell {
        owner: MutBorrow<Box<Edited>>,
        #[not_covariant]
        dependent: Borrower,
    }
);

/// Where a scene is.
pub(super) struct State(Place);

enum Place {
    Idle(Box<Edited>),
    Borrowed(Cell),
    /// Only while it is moved.
    Moved,
}

const NO_ANSWER: Failure =
    Failure::new(PM_ERR_STATE, "the scene has no answer: commit an edit, or wait for it");

impl State {
    pub fn new(edited: Edited) -> Self {
        Self(Place::Idle(Box::new(edited)))
    }

    pub const fn is_idle(&self) -> bool {
        matches!(self.0, Place::Idle(_))
    }

    /// The scene without its answer, and the edit that is being written.
    pub fn end(&mut self) -> Result<&mut Edited, Failure> {
        if let Place::Borrowed(_) = &self.0
            && let Place::Borrowed(cell) = std::mem::replace(&mut self.0, Place::Moved)
        {
            let mut edited = cell.into_owner().into_inner();
            edited.draft.clear();
            self.0 = Place::Idle(edited);
        }
        match &mut self.0 {
            Place::Idle(edited) => Ok(edited),
            _ => Err(NO_ANSWER),
        }
    }

    /// Sends the edit that was written.
    pub fn submit(&mut self, want: Want) -> Result<(), Failure> {
        self.end()?;
        let Place::Idle(edited) = std::mem::replace(&mut self.0, Place::Moved) else {
            return Err(NO_ANSWER);
        };
        let sent = Cell::try_new_or_recover(MutBorrow::new(edited), |owner| {
            send(owner.borrow_mut(), want).map(Borrower::Pending)
        });
        match sent {
            Ok(cell) => {
                self.0 = Place::Borrowed(cell);
                Ok(())
            }
            Err((owner, failure)) => {
                let mut edited = owner.into_inner();
                edited.draft.clear();
                self.0 = Place::Idle(edited);
                Err(failure)
            }
        }
    }

    /// Waits for the answer to the edit under way.
    pub fn wait(&mut self) -> Result<(), Failure> {
        let Place::Borrowed(cell) = &mut self.0 else { return Err(NO_ANSWER) };
        cell.with_dependent_mut(|_, borrower| {
            match std::mem::replace(borrower, Borrower::Nothing) {
                Borrower::Pending(pending) => *borrower = Borrower::Answer(pending.wait()?),
                Borrower::Answer(answer) => *borrower = Borrower::Answer(answer),
                Borrower::Nothing => return Err(NO_ANSWER),
            }
            Ok(())
        })
    }

    /// Takes the answer: what it tells is known from now on.
    pub fn take(&mut self) -> Result<(), Failure> {
        let Place::Borrowed(cell) = &mut self.0 else { return Err(NO_ANSWER) };
        cell.with_dependent_mut(|_, borrower| {
            let (kept, is_answer) = match std::mem::replace(borrower, Borrower::Nothing) {
                Borrower::Answer(answer) => (Borrower::Answer(answer.take()), true),
                other => (other, false),
            };
            *borrower = kept;
            if is_answer { Ok(()) } else { Err(NO_ANSWER) }
        })
    }

    /// Reads the answer.
    pub fn read<R>(&self, read: impl FnOnce(&Answer<'_>) -> R) -> Result<R, Failure> {
        let Place::Borrowed(cell) = &self.0 else { return Err(NO_ANSWER) };
        cell.with_dependent(|_, borrower| match borrower {
            Borrower::Answer(answer) => Ok(read(answer)),
            _ => Err(NO_ANSWER),
        })
    }
}

/// Sends an edit as the scene's kind asks.
fn send(edited: &mut Edited, want: Want) -> Result<Pending<'_>, Failure> {
    let Edited { scene, draft } = edited;
    let draft = &*draft;
    let singles =
        Sets { indices: pairmask::scene::Indices::List(&draft.indices), boxes: &draft.boxes };
    let has_singles = !draft.indices.is_empty();
    // The steps, for a scene that has no margins.
    let bare_steps = || {
        if draft.given.iter().any(|given| matches!(given, Given::Margined { .. })) {
            let text = "only a scene with margins takes boxes with some";
            return Err(Failure::new(PM_ERR_STATE, text));
        }
        let steps = draft.given.iter().map(|given| given.step(draft));
        Ok(steps.chain(has_singles.then_some(Step::Set(singles))))
    };
    match scene {
        AnyScene::Plain(scene) => {
            let edit = bare_steps()?.fold(scene.edit(), SceneEdit::step);
            Ok(Pending::Plain(edit.submit(want)?))
        }
        AnyScene::Shared(scene) => {
            let edit = bare_steps()?.fold(scene.edit(), SharedEdit::step);
            Ok(Pending::Shared(edit.submit(want)?))
        }
        AnyScene::Margined(scene) => {
            let mut edit = scene.edit();
            for given in &draft.given {
                edit = match given {
                    Given::Margined { indices, boxes, margins } => {
                        edit.set_all(*indices, boxes, &margins[..])
                    }
                    other => match other.step(draft) {
                        Step::Set(Sets { indices, boxes }) => {
                            edit.set_all(indices, boxes, pairmask::Margin::default())
                        }
                        Step::Remove(indices) => edit.remove_all(indices),
                        Step::Switch(indices, on) => edit.switch_all(indices, on),
                        Step::Static(indices, on) => edit.make_all_static(indices, on),
                        _ => return Err(pairmask::scene::EditError::Rules.into()),
                    },
                };
            }
            if has_singles {
                edit = edit.set_all(singles.indices, singles.boxes, &draft.margins[..]);
            }
            Ok(Pending::Margined(edit.submit(want)?))
        }
    }
}

impl<'s> Pending<'s> {
    fn wait(self) -> Result<Answer<'s>, Failure> {
        Ok(match self {
            Self::Plain(pending) => Answer::Plain(pending.wait()?),
            Self::Margined(pending) => Answer::Margined(pending.wait()?),
            Self::Shared(pending) => Answer::Shared(pending.wait()?),
        })
    }
}

/// The same of an answer of any kind.
macro_rules! of_any {
    ($answer:expr, $name:ident => $value:expr) => {
        match $answer {
            Answer::Plain($name) => $value,
            Answer::Margined($name) => $value,
            Answer::Shared($name) => $value,
        }
    };
}

impl Answer<'_> {
    fn take(self) -> Self {
        match self {
            Self::Plain(answer) => Self::Plain(answer.take()),
            Self::Margined(answer) => Self::Margined(answer.take()),
            Self::Shared(answer) => Self::Shared(answer.take()),
        }
    }

    pub fn is_resync(&self) -> bool {
        of_any!(self, answer => answer.is_resync())
    }

    pub fn begun(&self) -> PairList<'_> {
        of_any!(self, answer => answer.begun())
    }

    pub fn pairs(&self) -> PairList<'_> {
        of_any!(self, answer => answer.pairs())
    }

    pub fn ended(&self) -> Vec<Ended> {
        of_any!(self, answer => answer.ended().to_vec())
    }

    pub fn ended_count(&self) -> usize {
        of_any!(self, answer => answer.ended().len())
    }

    pub fn pair_count(&self) -> Option<u64> {
        of_any!(self, answer => answer.pair_count())
    }

    /// What answered; `None` where nobody was asked.
    pub fn served_by(&self) -> Option<ServedBy> {
        match self {
            Self::Plain(answer) => Some(answer.served_by()),
            Self::Margined(answer) => answer.served_by(),
            Self::Shared(_) => Some(ServedBy::Daemon),
        }
    }

    /// The engine, where the answer names it.
    pub fn engine(&self) -> Option<EngineId> {
        match self {
            Self::Plain(answer) => Some(answer.engine()),
            Self::Margined(_) => None,
            Self::Shared(answer) => Some(answer.engine()),
        }
    }

    /// The tick of a shared scene; 0 of others.
    pub fn tick(&self) -> u64 {
        match self {
            Self::Shared(answer) => answer.tick(),
            _ => 0,
        }
    }

    /// Leases of writers that were late, of a shared scene.
    pub fn late(&self) -> Vec<std::ops::Range<u32>> {
        match self {
            Self::Shared(answer) => answer.late(),
            _ => Vec::new(),
        }
    }

    /// Pairs that were not tested.
    pub fn skipped_pairs(&self) -> u64 {
        let skips = match self {
            Self::Plain(answer) => answer.skipped(),
            Self::Shared(answer) => answer.skipped(),
            Self::Margined(_) => return 0,
        };
        skips.static_pairs + skips.unmoved_pairs + skips.cell_pairs
    }
}
