//! Scenes that persist: those of one session, those with margins, and those that several processes write.
//!
//! ```text
//! any       a scene of any kind, and an edit of it from its steps to what it told
//! edited    a scene with its edit under way, which borrows it
//! ops       what an edit does, collected until it is committed
//! edit, pending, answer      the classes of an edit
//! plain, margined, shared    what a class of scenes has beside what all have
//! ```

mod answer;
mod any;
mod edit;
mod edited;
mod margined;
mod ops;
mod pending;
mod plain;
mod shared;

use pairmask::scene::Want;
use pyo3::PyClass;
use pyo3::prelude::*;
use pyo3::pyclass_init::PyClassInitializer;

pub use self::answer::PySceneAnswer;
pub use self::edit::PyEdit;
pub use self::margined::{PyMarginedScene, PyMarginedSceneStats, margined_pairs};
pub use self::pending::PyPendingAnswer;
pub use self::plain::PyScene;
pub use self::shared::{PySharedScene, join_options};

use self::answer::Read;
use self::any::AnyScene;
use self::edited::{Edited, Ticket};
use self::ops::Op;
use crate::arrays::new_boxes;
use crate::guarded::Guarded;

/// A box as an array of one row, or `None`.
fn box_array(py: Python<'_>, found: Option<pairmask::Aabb>) -> PyResult<Option<Bound<'_, PyAny>>> {
    let array = |b| new_boxes(py, &[b])?.call_method1("reshape", (6,));
    found.map(array).transpose()
}

/// What scenes of all kinds have. Their classes are derived from it.
#[pyclass(frozen, subclass, name = "_AnyScene", module = "pairmask")]
pub struct PyAnyScene {
    edited: Guarded<Edited>,
    has_margins: bool,
}

impl PyAnyScene {
    /// A scene as an object of its own class.
    fn of<C>(py: Python<'_>, scene: AnyScene, class: C) -> PyResult<Py<C>>
    where
        C: PyClass<BaseType = Self>,
    {
        let has_margins = matches!(scene, AnyScene::Margined(_));
        let edited = Guarded::new(Edited::new(scene), "the scene was closed");
        Py::new(py, PyClassInitializer::from(Self { edited, has_margins }).add_subclass(class))
    }

    /// Calls `f` with the scene, where no edit of it is under way. `f` is quick.
    fn with<R>(&self, py: Python<'_>, f: impl FnOnce(&mut AnyScene) -> PyResult<R>) -> PyResult<R> {
        self.edited.with(py, |edited| f(edited.scene()?))?
    }

    /// The same while other Python threads run.
    fn with_detached<R: Send>(
        &self,
        py: Python<'_>,
        f: impl FnOnce(&mut AnyScene) -> PyResult<R> + Send,
    ) -> PyResult<R> {
        self.edited.with_detached(py, |edited| f(edited.scene()?))?
    }

    const fn has_margins(&self) -> bool {
        self.has_margins
    }

    /// Fails where an edit of the scene is under way.
    fn check_idle(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |_| Ok(()))
    }

    fn commit(&self, py: Python<'_>, ops: &[Op], want: Want, take: bool) -> PyResult<Read> {
        self.edited.with_detached(py, |edited| edited.commit(ops, want, take))?
    }

    fn submit(&self, py: Python<'_>, ops: Vec<Op>, want: Want) -> PyResult<Ticket> {
        self.edited.with_detached(py, |edited| edited.submit(ops, want))?
    }

    fn wait(&self, py: Python<'_>, ticket: Ticket, take: bool) -> PyResult<Read> {
        self.edited.with_detached(py, |edited| edited.wait(ticket, take))?
    }

    fn leave(&self, ticket: Ticket) {
        self.edited.with_rest(|edited| edited.leave(ticket));
    }
}

#[pymethods]
impl PyAnyScene {
    /// Begins an edit.
    fn edit(slf: Py<Self>) -> PyEdit {
        PyEdit::new(slf)
    }

    /// The box of an index, also one that is switched off; of a shared scene, one of this member's. It is the box
    /// as it was set.
    fn get<'py>(&self, py: Python<'py>, index: u32) -> PyResult<Option<Bound<'py, PyAny>>> {
        box_array(py, self.with(py, |scene| Ok(scene.get(index)))?)
    }

    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        self.with(py, |scene| Ok(scene.len()))
    }

    fn __bool__(&self) -> bool {
        true
    }

    /// Ends the scene; a shared one is left. An edit under way is given up.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.edited.close(py)
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_args))]
    fn __exit__(&self, py: Python<'_>, _args: &Bound<'_, PyAny>) -> PyResult<()> {
        self.close(py)
    }
}
