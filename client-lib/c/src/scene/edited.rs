//! A scene with its edit: written, under way, or answered. The answer borrows the scene, so that the two are
//! in one cell.

use pairmask::filters::FilterTable;
use pairmask::{Aabb, Margin, Pending, Report, Scene, SceneAnswer};
use pairmask_core::scene::{Indices, Step};
use self_cell::{MutBorrow, self_cell};

use crate::code::pm_code::PM_ERR_STATE;
use crate::failure::Failure;

/// A step of an edit. Arrays of the program are read where they lie.
pub enum Given {
    /// One that borrows nothing of this library.
    Step(Step<'static>),
    Table(FilterTable),
    Single(u32, Aabb, Option<Margin>),
    /// Boxes with margins: one for all, or one for each.
    Margined {
        indices: Indices<'static>,
        boxes: &'static [Aabb],
        margins: Vec<Margin>,
    },
}

/// A scene, and the edit of it that is being written.
pub struct Edited {
    pub scene: Scene,
    pub steps: Vec<Given>,
}

/// What borrows the scene.
#[allow(clippy::large_enum_variant)] // One of each scene.
enum Borrower<'s> {
    Pending(Pending<SceneAnswer<'s>>),
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

/// A scene that is idle, or that an edit under way or an answer borrows. It is neither only while it is moved.
pub struct State {
    idle: Option<Box<Edited>>,
    borrowed: Option<Cell>,
}

const NO_ANSWER: Failure =
    Failure::new(PM_ERR_STATE, "the scene has no answer: commit an edit, or wait for it");

impl State {
    pub fn new(scene: Scene) -> Self {
        let edited = Edited { scene, steps: Vec::new() };
        Self { idle: Some(Box::new(edited)), borrowed: None }
    }

    /// The scene without its answer, and the edit that is being written.
    pub fn end(&mut self) -> Result<&mut Edited, Failure> {
        if let Some(cell) = self.borrowed.take() {
            self.idle = Some(cleared(cell.into_owner()));
        }
        self.idle.as_deref_mut().ok_or(NO_ANSWER)
    }

    /// Sends the edit that was written.
    pub fn submit(&mut self, report: Report) -> Result<(), Failure> {
        self.end()?;
        let owner = MutBorrow::new(self.idle.take().ok_or(NO_ANSWER)?);
        let sent = Cell::try_new_or_recover(owner, |owner| {
            send(owner.borrow_mut(), report).map(Borrower::Pending)
        });
        let (owner, failure) = match sent {
            Ok(cell) => {
                self.borrowed = Some(cell);
                return Ok(());
            }
            Err(failed) => failed,
        };
        self.idle = Some(cleared(owner));
        Err(failure)
    }

    /// Waits for the answer to the edit under way. Returns whether it is new, and not one that was waited for before.
    pub fn wait(&mut self) -> Result<bool, Failure> {
        let cell = self.borrowed.as_mut().ok_or(NO_ANSWER)?;
        cell.with_dependent_mut(|_, borrower| {
            match std::mem::replace(borrower, Borrower::Nothing) {
                Borrower::Pending(pending) => *borrower = Borrower::Answer(pending.wait()?),
                Borrower::Answer(answer) => {
                    *borrower = Borrower::Answer(answer);
                    return Ok(false);
                }
                Borrower::Nothing => return Err(NO_ANSWER),
            }
            Ok(true)
        })
    }

    /// Looks at the scene. An answer that was waited for stays; an edit under way is not waited for any more.
    pub fn look<R>(&mut self, mut look: impl FnMut(&Scene) -> R) -> Result<R, Failure> {
        self.read(|answer| look(answer.scene())).or_else(|_| Ok(look(&self.end()?.scene)))
    }

    /// Reads the answer.
    pub fn read<R>(&self, read: impl FnOnce(&SceneAnswer<'_>) -> R) -> Result<R, Failure> {
        let cell = self.borrowed.as_ref().ok_or(NO_ANSWER)?;
        cell.with_dependent(|_, borrower| match borrower {
            Borrower::Answer(answer) => Ok(read(answer)),
            _ => Err(NO_ANSWER),
        })
    }
}

/// A scene whose edit has ended.
fn cleared(owner: MutBorrow<Box<Edited>>) -> Box<Edited> {
    let mut edited = owner.into_inner();
    edited.steps.clear();
    edited
}

/// Sends an edit.
fn send(edited: &mut Edited, report: Report) -> Result<Pending<SceneAnswer<'_>>, Failure> {
    let Edited { scene, steps } = edited;
    let edit = steps.iter().fold(scene.edit(), |edit, given| match given {
        Given::Step(step) => edit.step(*step),
        Given::Table(table) => edit.step(Step::Filters(table)),
        Given::Single(index, b, None) => edit.set(*index, *b),
        Given::Single(index, b, Some(margin)) => edit.set_margined(*index, *b, *margin),
        Given::Margined { indices, boxes, margins } => match margins[..] {
            [same] => edit.set_all_margined(*indices, boxes, same),
            _ => edit.set_all_margined(*indices, boxes, &margins[..]),
        },
    });
    Ok(edit.submit(report)?)
}
