//! Scenes whose boxes have margins.

use pairmask::info::MarginedSceneStats;
use pairmask::{Aabb, MarginedPairs, MarginedScene};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::any::AnyScene;
use super::{PyAnyScene, box_array};

/// Boxes that persist, each with a margin; only boxes that left theirs are sent.
#[pyclass(frozen, extends = PyAnyScene, name = "MarginedScene", module = "pairmask")]
pub struct PyMarginedScene;

impl PyMarginedScene {
    pub fn new(py: Python<'_>, scene: MarginedScene) -> PyResult<Py<Self>> {
        PyAnyScene::of(py, AnyScene::Margined(scene), Self)
    }
}

/// Which pairs are told.
pub fn margined_pairs(name: &str) -> PyResult<MarginedPairs> {
    match name {
        "exact" => Ok(MarginedPairs::Exact),
        "near" => Ok(MarginedPairs::Near),
        _ => Err(PyValueError::new_err(format!("no pairs '{name}': exact, near"))),
    }
}

#[pymethods]
impl PyMarginedScene {
    /// Forgets what was told: the next changes are a resync.
    fn lose(slf: &Bound<'_, Self>) -> PyResult<()> {
        slf.as_super().get().with(slf.py(), |scene| {
            scene.margined()?.lose();
            Ok(())
        })
    }

    /// The box of an index as it was sent: inflated.
    fn inflated<'py>(slf: &Bound<'py, Self>, index: u32) -> PyResult<Option<Bound<'py, PyAny>>> {
        let find = |scene: &mut AnyScene| Ok(scene.margined()?.inflated(index));
        let found: Option<Aabb> = slf.as_super().get().with(slf.py(), find)?;
        box_array(slf.py(), found)
    }

    /// Boxes set and sent so far.
    #[getter]
    fn stats(slf: &Bound<'_, Self>) -> PyResult<PyMarginedSceneStats> {
        let count = |scene: &mut AnyScene| Ok(scene.margined()?.stats());
        let stats = slf.as_super().get().with(slf.py(), count)?;
        let MarginedSceneStats { edits, requests, set, sent, .. } = stats;
        Ok(PyMarginedSceneStats { edits, requests, set, sent })
    }

    /// Bytes that this process keeps of the scene.
    #[getter]
    fn allocated_bytes(slf: &Bound<'_, Self>) -> PyResult<usize> {
        slf.as_super().get().with(slf.py(), |scene| Ok(scene.margined()?.allocated_bytes()))
    }

    /// Bytes that the daemon keeps of it, by its last answer; 0 where it has none.
    #[getter]
    fn daemon_bytes(slf: &Bound<'_, Self>) -> PyResult<u64> {
        slf.as_super().get().with(slf.py(), |scene| Ok(scene.margined()?.daemon_bytes()))
    }
}

/// Boxes that were set, and how few of them were sent.
#[pyclass(frozen, get_all, name = "MarginedSceneStats", module = "pairmask")]
pub struct PyMarginedSceneStats {
    /// Edits that were applied.
    edits: u64,
    /// Edits for which a request was made.
    requests: u64,
    /// Boxes that edits set.
    set: u64,
    /// Boxes that were sent.
    sent: u64,
}
