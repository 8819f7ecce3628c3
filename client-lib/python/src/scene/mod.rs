//! Scenes that persist.
//!
//! ```text
//! options   settings of scenes
//! edited    a scene with its edit under way, which borrows it
//! ops       what an edit does, collected until it is committed
//! edit, pending, answer      the classes of an edit
//! ```

mod answer;
mod edit;
mod edited;
mod ops;
mod options;
mod pending;

use std::ops::Range;
use std::sync::{Arc, Weak};

use pairmask::filters::Tag;
use pairmask::{MarginStats, Report, Scene};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyRange;

pub use self::answer::PySceneAnswer;
use self::answer::{Read, python_range};
pub use self::edit::PyEdit;
use self::edited::{Edited, Ticket};
use self::ops::Op;
pub use self::options::{join_options, scene_options};
pub use self::pending::PyPendingAnswer;
use crate::arrays::new_boxes;
use crate::errors::Raise;
use crate::guarded::Guarded;
use crate::memory::Memory;
use crate::rules::{Part, TagParts};
use crate::sources::Boxes;

/// A box as an array of one row, or `None`.
fn box_array(py: Python<'_>, found: Option<pairmask::Aabb>) -> PyResult<Option<Bound<'_, PyAny>>> {
    let array = |b| new_boxes(py, &[b])?.call_method1("reshape", (6,));
    found.map(array).transpose()
}

/// Boxes that persist from answer to answer, by indices of the client's own.
#[pyclass(frozen, name = "Scene", module = "pairmask")]
pub struct PyScene {
    edited: Arc<Guarded<Edited>>,
}

/// A scene that its session closes with itself.
pub struct OpenScene(Weak<Guarded<Edited>>);

impl OpenScene {
    /// Closes the scene, if it is still there.
    pub fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.0.upgrade().map_or(Ok(()), |edited| edited.close(py))
    }

    /// Whether it is still there.
    pub fn is_there(&self) -> bool {
        self.0.strong_count() > 0
    }
}

impl PyScene {
    pub fn new(scene: Scene) -> Self {
        Self { edited: Arc::new(Guarded::new(Edited::new(scene), "the scene was closed")) }
    }

    /// The scene, as its session keeps it.
    pub fn open(&self) -> OpenScene {
        OpenScene(Arc::downgrade(&self.edited))
    }

    /// Calls `f` with the scene, where no edit of it is under way. `f` is quick.
    fn with<R>(&self, py: Python<'_>, f: impl FnOnce(&mut Scene) -> PyResult<R>) -> PyResult<R> {
        self.edited.with(py, |edited| f(edited.scene()?))?
    }

    /// The same while other Python threads run.
    fn with_detached<R: Send>(
        &self,
        py: Python<'_>,
        f: impl FnOnce(&mut Scene) -> PyResult<R> + Send,
    ) -> PyResult<R> {
        self.edited.with_detached(py, |edited| f(edited.scene()?))?
    }

    /// Fails where an edit of the scene is under way.
    fn check_idle(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |_| Ok(()))
    }

    fn commit(&self, py: Python<'_>, ops: &[Op], report: Report) -> PyResult<Read> {
        self.edited.with_detached(py, |edited| edited.commit(ops, report))?
    }

    fn submit(&self, py: Python<'_>, ops: Vec<Op>, report: Report) -> PyResult<Ticket> {
        self.edited.with_detached(py, |edited| edited.submit(ops, report))?
    }

    fn wait(&self, py: Python<'_>, ticket: Ticket) -> PyResult<Read> {
        self.edited.with_detached(py, |edited| edited.wait(ticket))?
    }

    fn leave(&self, ticket: Ticket) {
        self.edited.with_rest(|edited| edited.leave(ticket));
    }
}

#[pymethods]
impl PyScene {
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

    fn __repr__(&self, py: Python<'_>) -> String {
        let boxes = self.with(py, |scene| Ok(scene.len()));
        boxes.map_or_else(
            |_| "<Scene, closed or being edited>".to_owned(),
            |n| format!("<Scene of {n} boxes>"),
        )
    }

    /// Which boxes of the scene some other boxes overlap: rows (query, index), sorted.
    #[pyo3(signature = (boxes, *, world=None, owner=None, filter=None, is_static=None))]
    fn query<'py>(
        &self,
        py: Python<'py>,
        boxes: &Bound<'py, PyAny>,
        world: Part<'_, 'py>,
        owner: Part<'_, 'py>,
        filter: Part<'_, 'py>,
        is_static: Part<'_, 'py>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let boxes = Boxes::of_some(boxes)?.to_vec(py)?;
        let parts = TagParts { world, owner, filter, is_static };
        let tags: Option<Vec<Tag>> =
            if parts.are_none() { None } else { Some(parts.tags(boxes.len())?) };
        let found = self.with_detached(py, |scene| {
            let query = scene.query(&boxes);
            let query = match &tags {
                Some(tags) => query.tags(tags),
                None => query,
            };
            query.find().map(|answer| answer.to_vec()).map_err(Raise::raise)
        })?;
        Memory::of_rows(found).into_array(py)
    }

    /// Forgets what was told: the next changes are a resync.
    fn resync(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |scene| {
            scene.resync();
            Ok(())
        })
    }

    /// The box of an index as it was sent: inflated, where it has a margin.
    fn inflated<'py>(&self, py: Python<'py>, index: u32) -> PyResult<Option<Bound<'py, PyAny>>> {
        box_array(py, self.with(py, |scene| Ok(scene.inflated(index)))?)
    }

    /// What margins have saved so far; `None` of a scene without.
    #[getter]
    fn margin_stats(&self, py: Python<'_>) -> PyResult<Option<PyMarginStats>> {
        let stats = self.with(py, |scene| Ok(scene.margin_stats()))?;
        Ok(stats.map(|MarginStats { edits, requests, set, sent, .. }| PyMarginStats {
            edits,
            requests,
            set,
            sent,
        }))
    }

    /// Bytes that this process keeps of the scene.
    #[getter]
    fn allocated_bytes(&self, py: Python<'_>) -> PyResult<usize> {
        self.with(py, |scene| Ok(scene.allocated_bytes()))
    }

    /// Bytes that the daemon keeps of it, by its last answer; 0 where it has none.
    #[getter]
    fn daemon_bytes(&self, py: Python<'_>) -> PyResult<u64> {
        self.with(py, |scene| Ok(scene.daemon_bytes()))
    }

    /// Indices are below this.
    #[getter]
    fn most_boxes(&self, py: Python<'_>) -> PyResult<u32> {
        self.with(py, |scene| Ok(scene.most_boxes()))
    }

    /// Leases a `range` of indices of a shared scene: this member alone may set boxes there.
    fn lease(&self, py: Python<'_>, indices: &Bound<'_, PyRange>) -> PyResult<()> {
        let step: i64 = indices.getattr("step")?.extract()?;
        let range: Range<u32> =
            indices.getattr("start")?.extract()?..indices.getattr("stop")?.extract()?;
        if step != 1 {
            return Err(PyValueError::new_err("a lease is a range without gaps"));
        }
        self.with_detached(py, |scene| scene.lease(range).map_err(Raise::raise))
    }

    /// Leases the lowest free range of so many indices.
    fn lease_any(&self, py: Python<'_>, count: u32) -> PyResult<Py<PyRange>> {
        let leased =
            self.with_detached(py, |scene| scene.lease_any(count).map_err(Raise::raise))?;
        python_range(py, &leased)
    }

    /// Gives back the lease that begins at an index. Its boxes are removed.
    fn give_back(&self, py: Python<'_>, first: u32) -> PyResult<()> {
        self.with_detached(py, |scene| scene.give_back(first).map_err(Raise::raise))
    }

    /// The ranges of a shared scene that this member has leased.
    #[getter]
    fn leases(&self, py: Python<'_>) -> PyResult<Vec<Py<PyRange>>> {
        let leases = self.with(py, |scene| Ok(scene.leases().to_vec()))?;
        leases.iter().map(|range| python_range(py, range)).collect()
    }

    /// How long a tick of a shared scene is open after its first commit, at the most, seconds.
    #[getter]
    fn tick_deadline(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        self.with(py, |scene| Ok(scene.tick_deadline().map(|deadline| deadline.as_secs_f64())))
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

/// Boxes that were set, and how few of them were sent.
#[pyclass(frozen, get_all, name = "MarginStats", module = "pairmask")]
pub struct PyMarginStats {
    /// Edits that were applied.
    edits: u64,
    /// Edits for which a request was made.
    requests: u64,
    /// Boxes that edits set.
    set: u64,
    /// Boxes that were sent.
    sent: u64,
}
