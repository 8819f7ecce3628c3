//! A scene with its edit under way, or answered. The answer borrows the scene, so that the two are kept in one
//! cell.

use pairmask::{PendingAnswer, Report, Scene, SceneAnswer};
use pairmask_core::scene::{Indices, Step};
use self_cell::{MutBorrow, self_cell};

use super::Edited;
use super::draft::Given;
use crate::code::PM_ERR_STATE;
use crate::failure::Failure;

/// What borrows the scene.
#[allow(clippy::large_enum_variant)] // One of each scene.
enum Borrower<'s> {
    Pending(PendingAnswer<'s, 's>),
    Answer(SceneAnswer<'s>),
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
    pub fn submit(&mut self, report: Report) -> Result<(), Failure> {
        self.end()?;
        let Place::Idle(edited) = std::mem::replace(&mut self.0, Place::Moved) else {
            return Err(NO_ANSWER);
        };
        let sent = Cell::try_new_or_recover(MutBorrow::new(edited), |owner| {
            send(owner.borrow_mut(), report).map(Borrower::Pending)
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

    /// Looks at the scene. An answer that was waited for stays; an edit under way is not waited for any more.
    pub fn look<R>(&mut self, look: impl Fn(&Scene) -> R) -> Result<R, Failure> {
        if let Place::Borrowed(cell) = &self.0 {
            let looked = cell.with_dependent(|_, borrower| match borrower {
                Borrower::Answer(answer) => Some(look(answer.scene())),
                _ => None,
            });
            if let Some(looked) = looked {
                return Ok(looked);
            }
        }
        Ok(look(&self.end()?.scene))
    }

    /// Reads the answer.
    pub fn read<R>(&self, read: impl FnOnce(&SceneAnswer<'_>) -> R) -> Result<R, Failure> {
        let Place::Borrowed(cell) = &self.0 else { return Err(NO_ANSWER) };
        cell.with_dependent(|_, borrower| match borrower {
            Borrower::Answer(answer) => Ok(read(answer)),
            _ => Err(NO_ANSWER),
        })
    }
}

/// Sends an edit.
fn send(edited: &mut Edited, report: Report) -> Result<PendingAnswer<'_, '_>, Failure> {
    let Edited { scene, draft } = edited;
    let draft = &*draft;
    let mut edit = draft.given.iter().fold(scene.edit(), |edit, given| match given {
        Given::Margined { indices, boxes, margins } => {
            edit.set_all_margined(*indices, boxes, &margins[..])
        }
        Given::Step(step) => edit.step(*step),
        Given::Table => edit.step(Step::Filters(&draft.table)),
    });
    if draft.margins.iter().any(Option::is_some) {
        let singles = draft.indices.iter().zip(&draft.boxes).zip(&draft.margins);
        edit = singles.fold(edit, |edit, ((index, b), margin)| match margin {
            Some(margin) => edit.set_margined(*index, *b, *margin),
            None => edit.set(*index, *b),
        });
    } else if !draft.indices.is_empty() {
        let indices = Indices::List(&draft.indices);
        edit = edit.set_all(indices, &draft.boxes);
    }
    Ok(edit.submit(report)?)
}
