//! A scene with its edit under way. The edit borrows the scene, so that the two are in one cell.

use pairmask::{Pending, Report, Scene, SceneAnswer};
use pyo3::{PyErr, PyResult};
use self_cell::{MutBorrow, self_cell};

use super::answer::Read;
use super::ops::Op;
use crate::errors::{misused, raised};

/// A scene and the steps of its edit.
type Owner = MutBorrow<(Box<Scene>, Vec<Op>)>;
/// `None` once it was waited for.
type Borrower<'s> = Option<Pending<SceneAnswer<'s>>>;

self_cell!(
    struct Cell {
        owner: Owner,
        #[not_covariant]
        dependent: Borrower,
    }
);

/// Names an edit under way: no later one of its scene has the same.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Ticket(u64);

/// A scene, or an edit of it under way. It is neither only after a panic.
pub struct Edited {
    idle: Option<Box<Scene>>,
    under_way: Option<Cell>,
    /// The last edit that was submitted.
    last: Ticket,
}

fn is_under_way() -> PyErr {
    misused("an edit of this scene is under way: wait for its answer, or close it", "UnderWay")
}

impl Edited {
    pub fn new(scene: Scene) -> Self {
        Self { idle: Some(Box::new(scene)), under_way: None, last: Ticket(0) }
    }

    /// The scene, where no edit of it is under way.
    pub fn scene(&mut self) -> PyResult<&mut Scene> {
        self.idle.as_deref_mut().ok_or_else(is_under_way)
    }

    /// Applies an edit and waits for what it reports.
    pub fn commit(&mut self, ops: Vec<Op>, report: Report) -> PyResult<Read> {
        let ticket = self.submit(ops, report)?;
        self.wait(ticket)
    }

    /// Applies an edit, and sends it where a daemon has the scene.
    pub fn submit(&mut self, ops: Vec<Op>, report: Report) -> PyResult<Ticket> {
        let scene = self.idle.take().ok_or_else(is_under_way)?;
        let sent = Cell::try_new_or_recover(MutBorrow::new((scene, ops)), |owner| {
            let (scene, ops) = owner.borrow_mut();
            let edit = ops.iter().fold(scene.edit(), |edit, op| op.add_to(edit));
            edit.submit(report).map(Some)
        });
        match sent {
            Ok(cell) => {
                self.under_way = Some(cell);
                self.last = Ticket(self.last.0 + 1);
                Ok(self.last)
            }
            Err((owner, error)) => {
                self.idle = Some(owner.into_inner().0);
                Err(raised(error))
            }
        }
    }

    /// Waits for what an edit reports.
    pub fn wait(&mut self, ticket: Ticket) -> PyResult<Read> {
        let closed = || misused("the answer of this edit was received or discarded", "Closed");
        let mut cell = self.under_way.take_if(|_| self.last == ticket).ok_or_else(closed)?;
        let reported = cell.with_dependent_mut(|_, pending| {
            let answer = pending.take().ok_or_else(closed)?.wait().map_err(raised)?;
            Ok(Read::of(&answer))
        });
        self.end(cell);
        reported
    }

    /// Discards the answer of an edit, if it is under way: the edit is applied, and the next answer makes up
    /// for this one.
    pub fn leave(&mut self, ticket: Ticket) {
        if let Some(cell) = self.under_way.take_if(|_| self.last == ticket) {
            self.end(cell);
        }
    }

    fn end(&mut self, cell: Cell) {
        self.idle = Some(cell.into_owner().into_inner().0);
    }
}
