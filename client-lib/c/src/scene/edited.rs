//! A scene with its edit: written, under way, or answered. The answer borrows the scene, so that the two are
//! kept in one cell.

use pairmask::filters::FilterTable;
use pairmask::{Aabb, Margin, PendingAnswer, Report, Scene, SceneAnswer};
use pairmask_core::scene::{Indices, Step};
use self_cell::{MutBorrow, self_cell};

use crate::code::pm_code::PM_ERR_STATE;
use crate::failure::Failure;

/// What an edit says, until it is answered. Arrays of the program are read where they lie.
#[derive(Default)]
pub struct Draft {
    /// Boxes that were set one by one.
    pub indices: Vec<u32>,
    /// One for each.
    pub boxes: Vec<Aabb>,
    /// One for each, where one was given.
    pub margins: Vec<Option<Margin>>,
    /// All else.
    pub given: Vec<Given>,
    /// The table of filters, which a step names.
    pub table: FilterTable,
}

/// A step of an edit.
pub enum Given {
    /// One that borrows nothing of this library.
    Step(Step<'static>),
    /// The draft's table of filters.
    Table,
    /// Boxes with margins: one for all, or one for each.
    Margined { indices: Indices<'static>, boxes: &'static [Aabb], margins: Vec<Margin> },
}

impl Draft {
    /// Nothing said, with the memory of this.
    pub fn clear(&mut self) {
        self.indices.clear();
        self.boxes.clear();
        self.margins.clear();
        self.given.clear();
    }
}

/// A scene, and the edit of it that is being written.
pub struct Edited {
    pub scene: Scene,
    pub draft: Draft,
}

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
pub struct State(Place);

enum Place {
    Idle(Box<Edited>),
    Borrowed(Cell),
    /// Only while it is moved.
    Moved,
}

const NO_ANSWER: Failure =
    Failure::new(PM_ERR_STATE, "the scene has no answer: commit an edit, or wait for it");

impl State {
    pub fn new(scene: Scene) -> Self {
        Self(Place::Idle(Box::new(Edited { scene, draft: Draft::default() })))
    }

    /// The scene without its answer, and the edit that is being written.
    pub fn end(&mut self) -> Result<&mut Edited, Failure> {
        self.0 = match std::mem::replace(&mut self.0, Place::Moved) {
            Place::Borrowed(cell) => Place::Idle(cleared(cell.into_owner())),
            idle => idle,
        };
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
        let (place, sent) = match sent {
            Ok(cell) => (Place::Borrowed(cell), Ok(())),
            Err((owner, failure)) => (Place::Idle(cleared(owner)), Err(failure)),
        };
        self.0 = place;
        sent
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
    pub fn look<R>(&mut self, mut look: impl FnMut(&Scene) -> R) -> Result<R, Failure> {
        self.read(|answer| look(answer.scene())).or_else(|_| Ok(look(&self.end()?.scene)))
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

/// A scene whose edit has ended.
fn cleared(owner: MutBorrow<Box<Edited>>) -> Box<Edited> {
    let mut edited = owner.into_inner();
    edited.draft.clear();
    edited
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
        edit = edit.set_all(Indices::List(&draft.indices), &draft.boxes);
    }
    Ok(edit.submit(report)?)
}
