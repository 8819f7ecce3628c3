//! Scenes that several processes write.

use std::ops::Range;

use pairmask::scene::shared::{AtEnd, Hears};
use pairmask::{JoinOptions, SharedScene};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyRange;

use super::PyAnyScene;
use super::answer::python_range;
use super::any::AnyScene;
use crate::errors::Raise;
use crate::frame::seconds;

/// A scene that several processes write, each its own boxes.
#[pyclass(frozen, extends = PyAnyScene, name = "SharedScene", module = "pairmask")]
pub struct PySharedScene;

impl PySharedScene {
    pub fn new(py: Python<'_>, scene: SharedScene) -> PyResult<Py<Self>> {
        PyAnyScene::of(py, AnyScene::Shared(scene), Self)
    }
}

#[pymethods]
impl PySharedScene {
    /// Leases a `range` of indices: this member alone may set boxes there.
    fn lease(slf: &Bound<'_, Self>, indices: &Bound<'_, PyRange>) -> PyResult<()> {
        let step: i64 = indices.getattr("step")?.extract()?;
        let range: Range<u32> =
            indices.getattr("start")?.extract()?..indices.getattr("stop")?.extract()?;
        if step != 1 {
            return Err(PyValueError::new_err("a lease is a range without gaps"));
        }
        slf.as_super()
            .get()
            .with_detached(slf.py(), |scene| scene.shared()?.lease(range).map_err(Raise::raise))
    }

    /// Leases the lowest free range of so many indices.
    fn lease_any(slf: &Bound<'_, Self>, count: u32) -> PyResult<Py<PyRange>> {
        let leased = slf.as_super().get().with_detached(slf.py(), |scene| {
            scene.shared()?.lease_any(count).map_err(Raise::raise)
        })?;
        python_range(slf.py(), &leased)
    }

    /// Gives back the lease that begins at an index. Its boxes are removed.
    fn give_back(slf: &Bound<'_, Self>, first: u32) -> PyResult<()> {
        slf.as_super()
            .get()
            .with_detached(slf.py(), |scene| scene.shared()?.give_back(first).map_err(Raise::raise))
    }

    /// The ranges that this member has leased.
    #[getter]
    fn leases(slf: &Bound<'_, Self>) -> PyResult<Vec<Py<PyRange>>> {
        let leased = |scene: &mut AnyScene| Ok(scene.shared()?.leases().to_vec());
        let leases = slf.as_super().get().with(slf.py(), leased)?;
        leases.iter().map(|range| python_range(slf.py(), range)).collect()
    }

    /// Indices are below this.
    #[getter]
    fn most_boxes(slf: &Bound<'_, Self>) -> PyResult<u32> {
        slf.as_super().get().with(slf.py(), |scene| Ok(scene.shared()?.most_boxes()))
    }

    /// How long a tick is open after its first commit, at the most, seconds.
    #[getter]
    fn tick_deadline(slf: &Bound<'_, Self>) -> PyResult<f64> {
        let deadline = |scene: &mut AnyScene| Ok(scene.shared()?.tick_deadline().as_secs_f64());
        slf.as_super().get().with(slf.py(), deadline)
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
