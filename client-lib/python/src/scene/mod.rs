//! Scenes that persist: those of one session, those with margins, and those that several processes write.

mod answer;
mod edit;
mod ops;

use std::ops::Range;

use pairmask::filters::Tag;
use pairmask::info::MarginedSceneStats;
use pairmask::scene::shared::{AtEnd, Hears};
use pairmask::{JoinOptions, MarginedScene, Scene, SharedScene};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyRange;

pub use self::answer::PySceneAnswer;
pub use self::edit::PyEdit;

use self::answer::python_range;
use self::edit::Target;
use crate::arrays::{Rows, new_boxes};
use crate::errors::Raise;
use crate::frame::seconds;
use crate::guarded::Guarded;
use crate::memory::Memory;
use crate::rules::{Part, TagParts};

const CLOSED: &str = "the scene was closed";

/// A box as an array of one row, or `None`.
fn box_array(py: Python<'_>, found: Option<pairmask::Aabb>) -> PyResult<Option<Bound<'_, PyAny>>> {
    let array = |b| new_boxes(py, &[b])?.call_method1("reshape", (6,));
    found.map(array).transpose()
}

/// Boxes that persist from answer to answer, by indices of the client's own.
#[pyclass(frozen, name = "Scene", module = "pairmask")]
pub struct PyScene {
    scene: Guarded<Scene>,
}

impl PyScene {
    pub const fn new(scene: Scene) -> Self {
        Self { scene: Guarded::new(scene, CLOSED) }
    }
}

#[pymethods]
impl PyScene {
    /// Begins an edit.
    fn edit(slf: Py<Self>) -> PyEdit {
        PyEdit::new(Target::Plain(slf))
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
        let boxes = Rows::of_some(boxes, 6)?.boxes(py)?;
        let parts = TagParts { world, owner, filter, is_static };
        let tags: Option<Vec<Tag>> =
            if parts.are_none() { None } else { Some(parts.tags(boxes.len())?) };
        let found = self.scene.with_detached(py, |scene| {
            let query = scene.query(&boxes);
            let query = match &tags {
                Some(tags) => query.tags(tags),
                None => query,
            };
            query.find().map(|answer| answer.to_vec())
        })?;
        Memory::of_rows(found.map_err(Raise::raise)?).into_array(py)
    }

    /// Forgets what was told: the next changes are a resync.
    fn lose(&self, py: Python<'_>) -> PyResult<()> {
        self.scene.with(py, Scene::lose)
    }

    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        self.scene.with(py, |scene| scene.len())
    }

    fn __bool__(&self) -> bool {
        true
    }

    /// The box of an index, also one that is switched off.
    fn get<'py>(&self, py: Python<'py>, index: u32) -> PyResult<Option<Bound<'py, PyAny>>> {
        box_array(py, self.scene.with(py, |scene| scene.get(index))?)
    }

    /// Bytes that this process keeps of the scene.
    #[getter]
    fn allocated_bytes(&self, py: Python<'_>) -> PyResult<usize> {
        self.scene.with(py, |scene| scene.allocated_bytes())
    }

    /// Ends the scene.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.scene.close(py)
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_args))]
    fn __exit__(&self, py: Python<'_>, _args: &Bound<'_, PyAny>) -> PyResult<()> {
        self.close(py)
    }
}

/// Boxes that persist, each with a margin; only boxes that left theirs are sent.
#[pyclass(frozen, name = "MarginedScene", module = "pairmask")]
pub struct PyMarginedScene {
    scene: Guarded<MarginedScene>,
}

impl PyMarginedScene {
    pub const fn new(scene: MarginedScene) -> Self {
        Self { scene: Guarded::new(scene, CLOSED) }
    }
}

#[pymethods]
impl PyMarginedScene {
    /// Begins an edit.
    fn edit(slf: Py<Self>) -> PyEdit {
        PyEdit::new(Target::Margined(slf))
    }

    /// Forgets what was told.
    fn lose(&self, py: Python<'_>) -> PyResult<()> {
        self.scene.with(py, MarginedScene::lose)
    }

    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        self.scene.with(py, |scene| scene.len())
    }

    fn __bool__(&self) -> bool {
        true
    }

    /// The box of an index as it was set.
    fn get<'py>(&self, py: Python<'py>, index: u32) -> PyResult<Option<Bound<'py, PyAny>>> {
        box_array(py, self.scene.with(py, |scene| scene.get(index))?)
    }

    /// The box of an index as it was sent: inflated.
    fn inflated<'py>(&self, py: Python<'py>, index: u32) -> PyResult<Option<Bound<'py, PyAny>>> {
        box_array(py, self.scene.with(py, |scene| scene.inflated(index))?)
    }

    /// Boxes set and sent so far.
    #[getter]
    fn stats(&self, py: Python<'_>) -> PyResult<PyMarginedStats> {
        let stats = self.scene.with(py, |scene| scene.stats())?;
        let MarginedSceneStats { edits, requests, set, sent, .. } = stats;
        Ok(PyMarginedStats { edits, requests, set, sent })
    }

    /// Ends the scene.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.scene.close(py)
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
#[pyclass(frozen, get_all, name = "MarginedStats", module = "pairmask")]
pub struct PyMarginedStats {
    /// Edits that were applied.
    edits: u64,
    /// Edits for which a request was made.
    requests: u64,
    /// Boxes that edits set.
    set: u64,
    /// Boxes that were sent.
    sent: u64,
}

/// A scene that several processes write, each its own boxes.
#[pyclass(frozen, name = "SharedScene", module = "pairmask")]
pub struct PySharedScene {
    scene: Guarded<SharedScene>,
}

impl PySharedScene {
    pub const fn new(scene: SharedScene) -> Self {
        Self { scene: Guarded::new(scene, CLOSED) }
    }
}

#[pymethods]
impl PySharedScene {
    /// Begins an edit of this member's boxes.
    fn edit(slf: Py<Self>) -> PyEdit {
        PyEdit::new(Target::Shared(slf))
    }

    /// Leases a `range` of indices: this member alone may set boxes there.
    fn lease(&self, py: Python<'_>, indices: &Bound<'_, PyRange>) -> PyResult<()> {
        let step: i64 = indices.getattr("step")?.extract()?;
        let range: Range<u32> =
            indices.getattr("start")?.extract()?..indices.getattr("stop")?.extract()?;
        if step != 1 {
            return Err(PyValueError::new_err("a lease is a range without gaps"));
        }
        self.scene.with_detached(py, |scene| scene.lease(range))?.map_err(Raise::raise)
    }

    /// Leases the lowest free range of so many indices.
    fn lease_any(&self, py: Python<'_>, count: u32) -> PyResult<Py<PyRange>> {
        let leased = self.scene.with_detached(py, |scene| scene.lease_any(count))?;
        python_range(py, &leased.map_err(Raise::raise)?)
    }

    /// Gives back the lease that begins at an index. Its boxes are removed.
    fn give_back(&self, py: Python<'_>, first: u32) -> PyResult<()> {
        self.scene.with_detached(py, |scene| scene.give_back(first))?.map_err(Raise::raise)
    }

    /// The ranges that this member has leased.
    #[getter]
    fn leases(&self, py: Python<'_>) -> PyResult<Vec<Py<PyRange>>> {
        let leases = self.scene.with(py, |scene| scene.leases().to_vec())?;
        leases.iter().map(|range| python_range(py, range)).collect()
    }

    /// Indices are below this.
    #[getter]
    fn most_boxes(&self, py: Python<'_>) -> PyResult<u32> {
        self.scene.with(py, |scene| scene.most_boxes())
    }

    /// How long a tick is open after its first commit, at the most, seconds.
    #[getter]
    fn tick_deadline(&self, py: Python<'_>) -> PyResult<f64> {
        self.scene.with(py, |scene| scene.tick_deadline().as_secs_f64())
    }

    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        self.scene.with(py, |scene| scene.len())
    }

    fn __bool__(&self) -> bool {
        true
    }

    /// The box of an index of this member.
    fn get<'py>(&self, py: Python<'py>, index: u32) -> PyResult<Option<Bound<'py, PyAny>>> {
        box_array(py, self.scene.with(py, |scene| scene.get(index))?)
    }

    /// Leaves the scene.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.scene.close(py)
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_args))]
    fn __exit__(&self, py: Python<'_>, _args: &Bound<'_, PyAny>) -> PyResult<()> {
        self.close(py)
    }
}

/// What a member asks of a shared scene.
pub fn join_options(
    most_boxes: Option<u32>,
    tick_deadline: Option<f64>,
    at_end: Option<&str>,
    hears: &str,
) -> PyResult<JoinOptions> {
    let unknown = |name: &str, known: &str| {
        Err(PyValueError::new_err(format!("'{name}' is none of these: {known}")))
    };
    let mut options = JoinOptions::default().hearing(match hears {
        "own" => Hears::Own,
        "all" => Hears::All,
        _ => return unknown(hears, "own, all"),
    });
    if let Some(most) = most_boxes {
        options = options.with_most_boxes(most);
    }
    if let Some(deadline) = tick_deadline {
        options = options.with_tick_deadline(seconds(deadline)?);
    }
    match at_end {
        None => {}
        Some("remove") => options = options.with_at_end(AtEnd::Remove),
        Some("keep") => options = options.with_at_end(AtEnd::Keep),
        Some(name) => return unknown(name, "remove, keep"),
    }
    Ok(options)
}
